"""Which paths an arm can follow, and where the runs on them begin.

A path can be followed where point IK, continuously from some solution of its first pose, stays on it within the limits
of positions and velocities, clear of the robot itself and outside of singularities. Where it can't, poses of the path
are looked for one by one, from many random configurations: those that have no solution are out of the arm's reach.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from workcell.bench.live.arms import Arms, conditioning, threshold
from workcell.bench.live.contacts import OwnContacts
from workcell.bench.live.traces import PERIOD, Setup, Trace
from workcell.pose import Array, Pose, axis_angle_to_matrix

if TYPE_CHECKING:
    from workcell.kernels.chain import Arm
    from workcell.model.robot import Robot

SOLUTIONS = 48
"""Random starts that look for solutions of a path's first pose."""
FARTHEST = 0.2
"""Metres by which a start is displaced at most (section 5.2)."""
CLEAR = 0.005
"""Metres that a start keeps from itself."""
_ON_PATH = 1e-4
_TRIES = 200
"""Random starts that look for a configuration of one pose."""


@dataclass(frozen=True, slots=True)
class Way:
    """The best way along a path that was found.

    Attributes:
        start: (n,) where it begins.
        missed: metres (radians weighted by 0.3), the largest pose error on it.
        speed: largest share of a velocity limit.
        conditioning: the least, in shares of the arm's threshold.
        clearance: metres, the least to the robot itself, at every tenth frame.
        unreachable: share of the poses for which no configuration was found; looked for where the way misses some.
    """

    start: Array
    missed: float
    speed: float
    conditioning: float
    clearance: float
    unreachable: float = 0.0

    @property
    def reached(self) -> bool:
        """Whether the path can be followed without any of the events that are counted."""
        on_path = self.missed < _ON_PATH and self.speed <= 1.0
        return on_path and self.conditioning > 1.0 and self.clearance > 0.0

    @property
    def obstacle(self) -> str:
        """What keeps the arm from the path; empty: nothing."""
        if self.missed >= _ON_PATH:
            lost = f"{100.0 * self.unreachable:.0f} % of its poses are out of reach"
            return (
                lost if self.unreachable else f"no way without a gap of {1e3 * self.missed:.1f} mm was found"
            )
        if self.speed > 1.0:
            return f"{self.speed:.1f} times as fast as the joints"
        if self.conditioning <= 1.0:
            return "through a singularity"
        return "" if self.clearance > 0.0 else "through itself"

    @property
    def merit(self) -> tuple[bool, float]:
        """By which ways are compared."""
        slack = min(self.conditioning - 1.0, 20.0 * self.clearance, 2.0 * (1.0 - self.speed))
        return self.reached, slack if self.missed < _ON_PATH else -1e3 * self.missed


def best_way(arms: Arms, trace: Trace, seed: int, solutions: int = SOLUTIONS) -> Way:
    """The way along a trace, of each arm for itself, that stays farthest from every event."""
    from workcell.bench.live.descent import follow, reach

    contacts = OwnContacts(arms)
    best: list[Way] = []
    home = np.concatenate([robot.home for robot in arms.robots])
    for k, (arm, robot, columns) in enumerate(zip(arms.packed(), arms.robots, arms.columns, strict=True)):
        rows, rng = trace.rows(k), np.random.default_rng([seed, k])
        found: list[Way] = []
        for trial in range(solutions):
            begin = robot.home if trial == 0 else robot.random_configuration(rng)
            q, way, costs = np.empty(robot.dof), np.empty((len(rows), robot.dof)), np.empty(len(rows))
            reach(arm, rows[0], begin, 0, np.zeros(1, dtype=np.uint64), q)
            follow(arm, rows, q, way, costs)
            steps = np.abs(np.diff(way, axis=0)).max(axis=0) / (robot.velocity * PERIOD)
            whole = np.tile(home, (len(way[::10]), 1))
            whole[:, columns] = way[::10]
            missed = float(np.sqrt(costs.max()))
            clear = contacts.least(whole, arm=k) if missed < _ON_PATH else 0.0
            ratio = float(conditioning(robot, way).min()) / threshold(robot)
            found.append(Way(np.array(way[0]), missed, float(steps.max()), ratio, clear))
        way_of_arm = max(found, key=lambda way: way.merit)
        if way_of_arm.missed >= _ON_PATH:
            way_of_arm = replace(way_of_arm, unreachable=_unreachable(arm, robot, rows))
        best.append(way_of_arm)
    if len(best) == 1:
        return best[0]
    return Way(
        np.concatenate([way.start for way in best]),
        max(way.missed for way in best),
        max(way.speed for way in best),
        min(way.conditioning for way in best),
        min(way.clearance for way in best),
        max(way.unreachable for way in best),
    )


def _unreachable(arm: Arm, robot: Robot, rows: Array) -> float:
    """Share of poses (k, 7), every tenth of them, that have no configuration within many descents."""
    from workcell.bench.live.descent import reach

    q, random, looked = np.empty(robot.dof), np.zeros(1, dtype=np.uint64), rows[::10]
    costs = [reach(arm, row, robot.home, _TRIES, random, q) for row in looked]
    return float(np.mean(np.sqrt(costs) > _ON_PATH))


def random_starts(arms: Arms, trace: Trace, way: Way, n: int, seed: int) -> list[Array]:
    """n configurations of solutions of the first pose, displaced by random vectors shorter than 0.2 m.

    The solutions are those nearest to the way's, as far as damped least squares keeps to them; clear of the robot
    itself and outside of singularities.
    """
    from workcell.bench.live.descent import CLOSE, reach

    contacts, rng = OwnContacts(arms), np.random.default_rng([seed, 1])
    goals, starts = trace.goals(0), list[Array]()
    for _ in range(2000 + 200 * n):
        if len(starts) == n:
            break
        whole, fine = np.empty(arms.dof), True
        for arm, robot, columns, goal in zip(arms.packed(), arms.robots, arms.columns, goals, strict=True):
            away = rng.normal(size=3)
            away *= FARTHEST * rng.uniform() ** (1.0 / 3.0) / np.linalg.norm(away)
            row, q = _displaced(arms.setup, goal, away, robot.T_world_base.position), np.empty(robot.dof)
            cost = reach(arm, row, way.start[columns], 0, np.zeros(1, dtype=np.uint64), q)
            near = np.abs(q - way.start[columns]).max() < 1.5
            fine &= cost < CLOSE and near and float(conditioning(robot, q)) > 1.2 * threshold(robot)
            whole[columns] = q
        if fine and contacts.least(whole[None]) > CLEAR:
            starts.append(whole)
    return starts


def _displaced(setup: Setup, goal: Pose, away: Array, base: Array) -> Array:
    """(7,) a pose moved by a vector (3,); turned about the vertical with it where the hand can't leave its plane."""
    position, R = goal.position + away, goal.rotation
    if setup.in_plane:
        before, after = goal.position - base, position - base
        angle = np.arctan2(after[1], after[0]) - np.arctan2(before[1], before[0])
        R = axis_angle_to_matrix(np.array([0.0, 0.0, 1.0]), angle) @ R
    return np.concatenate([position, Pose.from_rotation(position, R).quat_wxyz])
