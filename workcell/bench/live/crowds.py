"""Random cells for the live guards: what stands and what moves around arms, and goals that run through it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workcell.bench.live.arms import Arms, arms_of
from workcell.bench.live.cells import Obstacle, cell
from workcell.bench.live.contacts import Contacts
from workcell.bench.live.movers import FASTEST, REACHING, SPIN, Mover, Reacher, Wanderer
from workcell.bench.live.traces import PERIOD, Setup
from workcell.model.robot import Robot
from workcell.model.scene import Scene
from workcell.pose import Array, Pose, matrix_to_quat

CLEAR_AT_START = {"still": 0.03, "mover": 0.15}
"""Metres that what stands, and what moves, keeps from arms as they begin."""
_COUNTS = {"still": (2, 7), "mover": (1, 4)}
"""How many there are, least, and most and one."""
_REACHERS, _CAPSULES = 0.4, 3
"""Share of cells with an arm of capsules that reaches about, and of how many."""
_PLACES = 20
"""Aims of each mover."""
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
        movers: what moves, where it begins; aims: where each may go.
        goals: for each arm its tool's poses, one a frame.
    """

    arms: Arms
    scene: Scene
    movers: tuple[Mover, ...]
    aims: tuple[list[Array], ...]
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
    movers: list[Mover] = []
    aims: list[list[Array]] = []
    for kind, (least, most) in _COUNTS.items():
        for k in range(int(rng.integers(least, most))):
            drawn = ([_shape(f"{kind}{k}", kind, arms, rng)] for _ in range(50))
            shapes += next((one for one in drawn if _fits(setup, bases, arms, one, kind)), [])
    for shape in shapes:
        if shape.moves:
            aims.append([somewhere(arms, rng) for _ in range(_PLACES)])
            movers.append(_wanderer(shape, aims[-1][0], rng))
    if rng.random() < _REACHERS:
        for _ in range(50):
            reacher, capsules = _reacher(arms, rng)
            if _fits(setup, bases, arms, capsules, "mover"):
                shapes += capsules
                movers.append(reacher)
                aims.append([_reach(rng) for _ in range(_PLACES)])
                break
    goals = tuple(_wander(robot, frames, rng) for robot in arms.robots)
    return Crowd(arms, cell(setup.robot, bases, shapes), tuple(movers), tuple(aims), goals)


def _fits(setup: Setup, bases: dict[str, list[float]], arms: Arms, shapes: list[Obstacle], kind: str) -> bool:
    """Whether they keep clear of the arms where they begin."""
    scene, room = cell(setup.robot, bases, shapes), CLEAR_AT_START[kind]
    start = np.concatenate([scene.robot(name).start for name in arms.names])
    return Contacts(scene, arms.names, own=False, limit=2.0 * room).distance(start) > room


def _wanderer(shape: Obstacle, aim: Array, rng: np.random.Generator) -> Wanderer:
    pose = Pose(np.array(shape.position), np.array(shape.quat_wxyz))
    turning = rng.uniform(-SPIN, SPIN, 3) / np.sqrt(3.0)
    return Wanderer(shape.name, pose, aim, float(rng.uniform(0.1, FASTEST)), turning)


def _reacher(arms: Arms, rng: np.random.Generator) -> tuple[Reacher, list[Obstacle]]:
    """An arm that stands beside one of the arms, upright, and its capsules where they begin."""
    robot = arms.robots[int(rng.integers(len(arms.robots)))]
    angle, far = rng.uniform(-np.pi, np.pi), rng.uniform(0.4, 0.9) * robot.reach()
    base = robot.T_world_base.position + far * np.array([np.cos(angle), np.sin(angle), 0.0])
    lengths = rng.uniform(0.15, 0.3, _CAPSULES) * robot.reach()
    radius, q = float(rng.uniform(0.03, 0.06)), np.zeros(_CAPSULES + 1)
    names = [f"reacher{k}" for k in range(_CAPSULES)]
    reacher = Reacher(
        names, base, lengths, float(rng.uniform(0.2, REACHING)), q, _reach(rng), np.zeros(len(q))
    )
    capsules = [
        Obstacle(name, (radius, 0.5 * float(length)), _triple(pose.position), moves=True)
        for (name, pose), length in zip(reacher.bodies().items(), lengths, strict=True)
    ]
    return reacher, capsules


def _reach(rng: np.random.Generator) -> Array:
    """(k + 1,) a configuration of a reaching arm."""
    return np.concatenate([rng.uniform(-np.pi, np.pi, 1), rng.uniform(-1.2, 1.2, _CAPSULES)])


def _shape(name: str, kind: str, arms: Arms, rng: np.random.Generator) -> Obstacle:
    """A box, a capsule or a sphere within an arm's reach, mostly in front of it."""
    size = tuple(rng.uniform(0.03, 0.12, int(rng.integers(1, 4))).tolist())
    quat = rng.normal(size=4)
    quat /= np.linalg.norm(quat)
    return Obstacle(name, size, _triple(somewhere(arms, rng)), tuple(quat.tolist()), kind == "mover")


def _triple(place: Array) -> tuple[float, float, float]:
    return float(place[0]), float(place[1]), float(place[2])


def somewhere(arms: Arms, rng: np.random.Generator) -> Array:
    """(3,) within reach of an arm's second joint, mostly in front."""
    robot = arms.robots[int(rng.integers(len(arms.robots)))]
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
