"""How an object moved while carried: where its foot was, how far it tilted, and whether it would have spilled."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workcell.errors import InputError
from workcell.model.scene import Scene
from workcell.pose import Array, quat_to_matrix
from workcell.simulate.execution import Execution

_GRAVITY = 9.81
_HALF_WINDOW_S = 0.04


@dataclass(frozen=True, slots=True)
class Carried:
    """An object's motion over rows of an execution.

    Attributes:
        time: (k,) seconds.
        position: (k, 3) its origin in the world, metres.
        tilt: (k,) radians between its z axis and the vertical.
        slosh: (k,) radians between its z axis and the normal of a liquid's surface in it: the tilt, plus at most the
            angle of the apparent gravity under its acceleration (over 80 ms).
    """

    time: Array
    position: Array
    tilt: Array
    slosh: Array


def carried(scene: Scene, execution: Execution, thing: str, begin: float, end: float) -> Carried:
    """How an object moved between two moments (seconds) of an execution.

    Raises:
        UnknownNameError: no such object. InputError: a fixed one, or fewer than three rows between the moments.
    """
    address = scene.object(thing).qpos_address
    rows = (execution.time >= begin) & (execution.time <= end)
    if address is None or rows.sum() < 3:
        raise InputError(
            f"{thing} is fixed, or {int(rows.sum())} rows between {begin} s and {end} s are too few",
            where="carried",
            remedy="an object with a free joint, and moments a few hundredths of a second apart",
        )
    time, position = execution.time[rows], execution.qpos[rows, address : address + 3]
    up = quat_to_matrix(execution.qpos[rows, address + 3 : address + 7])[:, :, 2]
    tilt = np.arctan2(np.linalg.norm(up[:, :2], axis=1), up[:, 2])
    step = min(max(round(_HALF_WINDOW_S / float(np.median(np.diff(time)))), 1), (len(time) - 1) // 2)
    window = float(np.median(np.diff(time))) * step
    pull = np.zeros_like(position)
    pull[step:-step] = (position[2 * step :] - 2 * position[step:-step] + position[: -2 * step]) / window**2
    leaning = np.arctan2(np.linalg.norm(pull[:, :2], axis=1), _GRAVITY + pull[:, 2])
    return Carried(time, position, tilt, tilt + leaning)
