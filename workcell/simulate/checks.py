"""Whether an order to a simulation makes sense: shares, durations, trajectories, hands that are free."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import get_args

import numpy as np

from workcell.errors import InputError, UnknownNameError
from workcell.motion.path import Trajectory
from workcell.simulate.watch import Held, Hold


def checked_share(share: float, where: str) -> float:
    """A share of a range; raises InputError outside [0, 1]."""
    if not 0.0 <= share <= 1.0:
        raise InputError(f"a share of {share}", where=where, remedy="from 0 to 1 of the range")
    return share


def checked_seconds(seconds: float) -> float:
    """A duration; raises InputError for a negative one, or none."""
    if not (np.isfinite(seconds) and seconds >= 0):
        raise InputError(f"a duration of {seconds} s", where="seconds", remedy="zero or more")
    return seconds


def checked_motions(motion: Trajectory | Sequence[Trajectory], robots: int) -> list[Trajectory]:
    """Trajectories, at most one for each of so many robots; raises InputError for none, or for two of one robot."""
    motions = [motion] if isinstance(motion, Trajectory) else list(motion)
    names = [trajectory.robot_name for trajectory in motions]
    if not motions or len(set(names)) < len(names) or len(names) > robots:
        raise InputError(
            f"trajectories for {', '.join(names) or 'no robot'}", where="motion", remedy="one for each robot"
        )
    return motions


def check_free_hand(robot: str, held: Mapping[str, Held], hold: str) -> None:
    """Raise InputError for a hand that holds something, UnknownNameError for an unknown way to hold."""
    if hold not in get_args(Hold):
        raise UnknownNameError("hold", hold, get_args(Hold))
    if robot in held:
        raise InputError(
            f"the hand of {robot} holds the {held[robot].thing.name}",
            where="grasp",
            remedy="release it first",
        )
