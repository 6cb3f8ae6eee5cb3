"""Random cells for the live guards: shapes that stand and that move around arms, and goals that run through them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workcell.bench.live.arms import Arms, arms_of
from workcell.bench.live.cells import Obstacle, cell
from workcell.bench.live.contacts import Contacts
from workcell.bench.live.traces import PERIOD, Setup
from workcell.model.robot import Robot
from workcell.model.scene import Scene
from workcell.pose import Array, Pose, matrix_to_quat

CLEAR_AT_START = {"still": 0.03, "mover": 0.15}
"""Metres that what stands, and what moves, keeps from arms as they begin."""
_COUNTS = {"still": (2, 7), "mover": (1, 4)}
"""How many there are, least, and most and one."""
_ASIDE = 1.2
"""Radians (metres) from home of the configurations that goals come by."""
_HASTE = (0.2, 1.5)
"""Shares of the joints' velocity limits at which goals go from one to the next."""
_JUMPS = 0.15
"""Share of them that goals jump to."""


@dataclass(frozen=True, slots=True)
class Crowd:
    """A cell, what moves in it, and what is asked of its arms.

    Attributes:
        arms: the arms alone.
        scene: the compiled scene, with the same arms.
        movers: what moves, where it begins.
        goals: for each arm its tool's poses, one a frame.
    """

    arms: Arms
    scene: Scene
    movers: tuple[Obstacle, ...]
    goals: tuple[list[Pose], ...]

    def start(self) -> Array:
        """(n,) where the arms begin."""
        return np.concatenate([self.scene.robot(name).start for name in self.arms.names])


def crowd(setup: Setup, count: int, frames: int, seed: int) -> Crowd:
    """A random cell of one arm or two, for so many frames; the same seed, the same cell."""
    rng = np.random.default_rng([seed, count, 5])
    arms = arms_of(setup, count)
    bases = {name: setup.base(k, count).tolist() for k, name in enumerate(arms.names)}
    shapes: list[Obstacle] = []
    for kind, (least, most) in _COUNTS.items():
        for k in range(int(rng.integers(least, most))):
            drawn = (_shape(f"{kind}{k}", kind, arms, rng) for _ in range(50))
            fitting = next((one for one in drawn if _fits(setup, bases, arms, one, kind)), None)
            shapes += [] if fitting is None else [fitting]
    goals = tuple(_wander(robot, frames, rng) for robot in arms.robots)
    movers = tuple(one for one in shapes if one.moves)
    return Crowd(arms, cell(setup.robot, bases, shapes), movers, goals)


def _fits(setup: Setup, bases: dict[str, list[float]], arms: Arms, shape: Obstacle, kind: str) -> bool:
    """Whether it keeps clear of the arms where they begin."""
    scene, room = cell(setup.robot, bases, [shape]), CLEAR_AT_START[kind]
    start = np.concatenate([scene.robot(name).start for name in arms.names])
    return Contacts(scene, arms.names, own=False, limit=2.0 * room).distance(start) > room


def _shape(name: str, kind: str, arms: Arms, rng: np.random.Generator) -> Obstacle:
    """A box, a capsule or a sphere within an arm's reach, mostly in front of it."""
    robot = arms.robots[int(rng.integers(len(arms.robots)))]
    size = tuple(rng.uniform(0.03, 0.12, int(rng.integers(1, 4))).tolist())
    quat = rng.normal(size=4)
    quat /= np.linalg.norm(quat)
    place = somewhere(robot, rng).tolist()
    return Obstacle(name, size, (place[0], place[1], place[2]), tuple(quat.tolist()), kind == "mover")


def somewhere(robot: Robot, rng: np.random.Generator) -> Array:
    """(3,) within reach of the arm's second joint, mostly in front."""
    shoulder = robot.link_transforms(robot.home)[min(2, robot.dof)][:3, 3]
    away = rng.normal(size=3)
    away *= robot.reach() * rng.uniform(0.2, 0.9) / np.linalg.norm(away)
    away[0] = abs(away[0]) if rng.random() < 0.8 else away[0]
    place: Array = shoulder + away
    return place


def _wander(robot: Robot, frames: int, rng: np.random.Generator) -> list[Pose]:
    """Poses of the tool on smooth ways from one random configuration to the next, and jumps; nothing is avoided."""
    rows = [np.array(robot.home)]
    while len(rows) < frames:
        aim = np.clip(robot.home + rng.uniform(-_ASIDE, _ASIDE, robot.dof), robot.lower, robot.upper)
        if rng.random() < _JUMPS:
            rows += [aim] * 25
            continue
        # a smooth step's fastest is 1.875 times its mean
        seconds = 1.875 * np.max(np.abs(aim - rows[-1]) / robot.velocity) / rng.uniform(*_HASTE)
        s = np.linspace(0.0, 1.0, 2 + int(seconds / PERIOD))[1:, None]
        rows += list(rows[-1] + s**3 * (10.0 - 15.0 * s + 6.0 * s * s) * (aim - rows[-1]))
    T = robot.fk_transform(np.array(rows[:frames]))
    return [Pose(one[:3, 3], matrix_to_quat(one[:3, :3])) for one in T]
