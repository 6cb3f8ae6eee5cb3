"""Problem sets by seed, for any robot with spheres: so that the benches and tests need no files."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from workcell.errors import InputError, UnknownNameError
from workcell.geometry.types import Piece, SphereCover
from workcell.ik.judge.exact import ExactDistances, ExactKinematics, smallest_clearance
from workcell.ik.problem import IKProblem
from workcell.model.robot import Robot
from workcell.pose import Array, Pose
from workcell.sets.problems import NamedProblem, ProblemSet

LEAST_CLEARANCE = 2e-3
"""Metres that the hidden configuration of a solvable problem keeps from every obstacle."""
_TRIES = 10_000


def generate(robot: Robot, cover: SphereCover, kind: str, n: int, seed: int = 0) -> ProblemSet:
    """A problem set for a serial robot whose base is the world.

    Args:
        robot: serial; its default tool is the one to place.
        cover: its spheres.
        kind: `free` (no obstacles), `random` (boxes strewn through the reach), `workcell` (one cell with a table, a
            rack and a post, scaled by the reach), each with targets of random configurations that are clear; or
            `unreachable` (in turn beyond the chain's length, and with a box on a sphere of the last link).
        n: number of problems.
        seed: same seed, same set.

    Raises:
        UnknownNameError: no such kind. InputError: no clear configuration was found.
    """
    if kind not in KINDS:
        raise UnknownNameError("kind of problem set", kind, KINDS, where="kind")
    maker = _Maker(robot, cover, np.random.default_rng([seed, *kind.encode()]))
    named = []
    for k in range(n):
        target, obstacles = KINDS[kind](maker, k)
        problem = IKProblem(robot, target, obstacles, cover)
        named.append(NamedProblem(f"{robot.name}_{kind}_{k:04d}", problem))
    return ProblemSet(kind, robot, cover, tuple(named))


class _Maker:
    """One robot's random configurations, boxes and clearances."""

    def __init__(self, robot: Robot, cover: SphereCover, rng: np.random.Generator) -> None:
        self.robot, self.cover, self.rng = robot, cover, rng
        self.kinematics = ExactKinematics(robot)
        self.reach = robot.reach()
        self.shoulder = robot.T_world_base.apply(robot.joint_xyz[0])

    def clearance(self, q: Array, obstacles: tuple[Piece, ...]) -> float:
        if not obstacles or len(self.cover) == 0:
            return np.inf
        rotation, position = self.kinematics.links(q)
        return smallest_clearance(self.cover, rotation, position, ExactDistances(obstacles))[0]

    def free(self, _: int) -> tuple[Pose, tuple[Piece, ...]]:
        return self.robot.fk(self.robot.random_configuration(self.rng)), ()

    def random(self, _: int) -> tuple[Pose, tuple[Piece, ...]]:
        q = self.robot.random_configuration(self.rng)
        wanted, boxes = int(self.rng.integers(15, 26)), list[Piece]()
        for _attempt in range(_TRIES):
            box = self._box(f"box {len(boxes)}")
            if self.clearance(q, (box,)) >= LEAST_CLEARANCE and not self._hits_base(box):
                boxes.append(box)
            if len(boxes) == wanted:
                return self.robot.fk(q), tuple(boxes)
        raise InputError(f"no room for boxes around {self.robot.name}", where="robot")

    def workcell(self, _: int) -> tuple[Pose, tuple[Piece, ...]]:
        cell = self._cell()
        for _attempt in range(_TRIES):
            q = self.robot.random_configuration(self.rng)
            if self.clearance(q, cell) >= LEAST_CLEARANCE:
                return self.robot.fk(q), cell
        raise InputError(f"{self.robot.name} has no clear configuration in the cell", where="robot")

    def unreachable(self, index: int) -> tuple[Pose, tuple[Piece, ...]]:
        if index % 2 == 0:
            at = self.shoulder + self._direction() * self.reach * self.rng.uniform(1.05, 1.6)
            return Pose(at, self._quaternion()), ()
        return self._blocked()

    def _blocked(self) -> tuple[Pose, tuple[Piece, ...]]:
        """A reachable pose with a ball on a sphere that the tool's link carries wherever the arm comes from."""
        q = self.robot.random_configuration(self.rng)
        carried = np.flatnonzero(self.cover.link == self.robot.tool().link)
        if len(carried) == 0:
            raise InputError(f"the last link of {self.robot.name} has no sphere", where="cover")
        sphere = int(self.rng.choice(carried))
        T = self.robot.link_transforms(q)[self.cover.link[sphere]]
        centre = T[:3, :3] @ self.cover.centre[sphere] + T[:3, 3]
        ball = Piece("ball", "sphere", Pose.from_xyz(centre), np.array([self.rng.uniform(0.04, 0.08)]))
        return self.robot.fk(q), (ball,)

    def _box(self, name: str) -> Piece:
        distance = 0.8 * self.reach * np.cbrt(self.rng.uniform())
        half = self.rng.uniform(0.02, 0.1, size=3) * self.reach
        return Piece(
            name, "box", Pose(self.shoulder + distance * self._direction(), self._quaternion()), half
        )

    def _hits_base(self, box: Piece) -> bool:
        """Whether a box touches what hardly moves: the spheres of base and first link, wherever that points."""
        fixed = self.cover.link <= 1
        if not np.any(fixed):
            return False
        rotation, position = self.kinematics.zero_rotation[:2], self.kinematics.zero_position[:2]
        link = self.cover.link[fixed]
        axis = rotation[1] @ self.robot.axis[0]
        arm = (rotation[link] @ self.cover.centre[fixed][..., None])[..., 0] + position[link] - position[1]
        height = arm @ axis
        swing = np.linalg.norm(arm - height[:, None] * axis, axis=1) + self.cover.radius[fixed]
        gaps = ExactDistances([box])(position[1] + height[:, None] * axis)[:, 0] - swing
        return bool(gaps.min() < LEAST_CLEARANCE)

    def _cell(self) -> tuple[Piece, ...]:
        """A table in front, a rack of three boards between two sides on it, a post beside; in units of the reach."""
        rows = [
            ("table", (0.65, 0.0, -0.12), (0.35, 0.6, 0.02)),
            *((f"board {k}", (0.75, 0.0, 0.02 + 0.24 * k), (0.14, 0.34, 0.01)) for k in range(3)),
            *((f"side {k}", (0.75, 0.35 * (2 * k - 1), 0.26), (0.14, 0.01, 0.26)) for k in range(2)),
            ("post", (0.1, -0.6, 0.3), (0.04, 0.04, 0.5)),
        ]
        floor = np.array([self.shoulder[0], self.shoulder[1], self.shoulder[2] - 0.3 * self.reach])
        return tuple(
            Piece(
                name, "box", Pose.from_xyz(floor + self.reach * np.array(centre)), self.reach * np.array(half)
            )
            for name, centre, half in rows
        )

    def _direction(self) -> Array:
        v = self.rng.normal(size=3)
        unit: Array = v / np.linalg.norm(v)
        return unit

    def _quaternion(self) -> Array:
        v = self.rng.normal(size=4)
        unit: Array = v / np.linalg.norm(v)
        return unit


KINDS: dict[str, Callable[[_Maker, int], tuple[Pose, tuple[Piece, ...]]]] = {
    "free": _Maker.free,
    "random": _Maker.random,
    "workcell": _Maker.workcell,
    "unreachable": _Maker.unreachable,
}
"""What makes the target and the obstacles of one problem, for each kind of problem set."""
