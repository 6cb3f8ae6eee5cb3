"""The cells of IKSPARK's Tables VI and VII (section X-C.2): a Sawyer among random boxes, and in a workcell.

The paper shows its cells and its spheres in pictures alone (figures 16, 19). What it states is kept: 20 to 30 random
obstacles that keep off the robot at the configuration whose tool pose is the target; fixed obstacles with targets of
random clear configurations, and four cuboids chosen by hand; 5, 10 or 22 spheres. All sizes and places are ours.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np

from workcell.geometry.types import FreeSpace, Piece, SphereCover
from workcell.ik.judge.exact import ExactDistances, ExactKinematics, smallest_clearance
from workcell.ik.problem import IKProblem
from workcell.model.loading.load import load_robot
from workcell.model.robot import Robot
from workcell.pose import Array, Pose

Kind = Literal["random", "workcell"]
ROBOT = "sawyer"
DENSITIES: Mapping[str, tuple[int, float]] = MappingProxyType(
    {"low": (5, 0.11), "mid": (10, 0.095), "high": (22, 0.08)}
)
"""Spheres strung along the arm: how many, and their radius in metres. Five that touch, or more that overlap, and the
more there are, the closer they come to the arm's own thickness."""
LEAST_CLEARANCE = 2e-3
"""Metres that the spheres, of every density, keep from every obstacle at the configuration that was drawn."""

_FIRST_LINK = 2
_FEWEST, _MOST = 20, 30
_SPREAD, _HALF = 1.0, (0.04, 0.14)
_COLUMN = SphereCover(np.zeros(5, dtype=np.int64), np.linspace([0, 0, 0], [0, 0, 0.4], 5), np.full(5, 0.15))
"""What stands still, or turns in place, below the shoulder."""

_ENDS = {
    "table": ((-1.4, -1.4, -0.2), (1.4, 1.4, -0.1)),
    "wall behind": ((-0.6, -1.4, -0.1), (-0.5, 1.4, 1.7)),
    "wall in front": ((0.65, -1.4, -0.1), (0.75, 1.4, 1.7)),
    "cabinet": ((-0.25, 0.23, -0.1), (0.25, 0.73, 0.8)),
    "machine": ((-0.25, -1.3, -0.1), (0.65, -0.23, 0.8)),
}
_CUBOIDS = {
    "between cabinet and machine": ((-0.5, -0.23, -0.1), (0.65, 0.23, 1.7)),
    "in front of the cabinet": ((0.25, -0.23, -0.1), (0.65, 1.4, 1.7)),
    "behind both": ((-0.5, -1.4, -0.1), (-0.25, 1.4, 1.7)),
    "above both": ((-0.5, -1.4, 0.8), (0.65, 1.4, 1.7)),
}
_INSET = 1e-5
"""Metres between the cuboids chosen by hand and the obstacles that bound them."""


@dataclass(frozen=True, slots=True)
class Cell:
    """One problem, and the clear configuration (n,) that its target is the tool pose of."""

    problem: IKProblem
    planted: Array


def cells(kind: Kind, density: str, n: int, seed: int = 0) -> list[Cell]:
    """The first n cells of a seed; those of the three densities have the same targets and obstacles.

    `random`: 20 to 30 boxes along the axes, each edge 8 to 28 cm, their centres drawn evenly from a ball of 1 m around
    the shoulder, and drawn again where they touch the spheres of any density, or the column that the arm stands on.
    `workcell`: the Sawyer on a table between two walls, a cabinet at its left and a machine at its right; with the four
    cuboids as free space. Configurations are drawn evenly from the joint limits.
    """
    robot = load_robot(ROBOT).chain()
    cover = spheres_along(robot, *DENSITIES[density])
    free_space = workcell_cuboids() if kind == "workcell" else None
    drawn = _draw(robot, kind, np.random.default_rng([seed, *kind.encode()]))
    return [
        Cell(IKProblem(robot, robot.fk(q), obstacles, cover, free_space), q)
        for (q, obstacles), _ in zip(drawn, range(n), strict=False)
    ]


def spheres_along(robot: Robot, count: int, radius: float) -> SphereCover:
    """Spheres of one radius in equal steps on the straight lines from the second joint, by the others, to the tool."""
    ends = np.vstack([robot.joint_xyz[_FIRST_LINK:], robot.tool().T_link_tool.position])
    length = np.linalg.norm(ends, axis=1)
    passed = np.concatenate([[0.0], np.cumsum(length)])
    at = (np.arange(count) + 0.5) / count * passed[-1]
    segment = np.searchsorted(passed, at, side="right") - 1
    share = (at - passed[segment]) / length[segment]
    return SphereCover(segment + _FIRST_LINK, share[:, None] * ends[segment], np.full(count, radius))


def workcell_obstacles() -> tuple[Piece, ...]:
    """The fixed obstacles."""
    return tuple(_box(name, np.array(lower), np.array(upper)) for name, (lower, upper) in _ENDS.items())


def workcell_cuboids() -> FreeSpace:
    """The four cuboids, which together are all that is free between the walls."""
    lower, upper = np.array(list(_CUBOIDS.values())).transpose(1, 0, 2)
    return FreeSpace(lower + _INSET, upper - _INSET)


def _draw(robot: Robot, kind: Kind, rng: np.random.Generator) -> Iterator[tuple[Array, tuple[Piece, ...]]]:
    """Clear configurations and what they are clear of, without end."""
    covers = [spheres_along(robot, *sizes) for sizes in DENSITIES.values()]
    clearance, fixed = _Clearance(robot, [*covers, _COLUMN]), workcell_obstacles()
    while True:
        q = robot.random_configuration(rng)
        if kind == "random":
            yield q, _strewn(rng, clearance, q)
        elif _Clearance(robot, covers)(q, fixed) >= LEAST_CLEARANCE:
            yield q, fixed


def _strewn(rng: np.random.Generator, clearance: _Clearance, q: Array) -> tuple[Piece, ...]:
    """Boxes anywhere but where the robot is."""
    wanted, boxes = int(rng.integers(_FEWEST, _MOST + 1)), list[Piece]()
    while len(boxes) < wanted:
        direction = rng.normal(size=3)
        away = _SPREAD * np.cbrt(rng.uniform()) * direction / np.linalg.norm(direction)
        centre, half = clearance.shoulder + away, rng.uniform(*_HALF, size=3)
        box = _box(f"box {len(boxes)}", centre - half, centre + half)
        if clearance(q, (box,)) >= LEAST_CLEARANCE:
            boxes.append(box)
    return tuple(boxes)


class _Clearance:
    """The smallest signed distance of several covers from obstacles, by the exact kernel."""

    def __init__(self, robot: Robot, covers: list[SphereCover]) -> None:
        self._kinematics, self._covers = ExactKinematics(robot), covers
        self.shoulder = robot.T_world_base.apply(robot.joint_xyz[0] + robot.joint_xyz[1])

    def __call__(self, q: Array, obstacles: tuple[Piece, ...]) -> float:
        rotation, position = self._kinematics.links(q)
        distances = ExactDistances(obstacles)
        return min(smallest_clearance(cover, rotation, position, distances)[0] for cover in self._covers)


def _box(name: str, lower: Array, upper: Array) -> Piece:
    return Piece(name, "box", Pose.from_xyz(0.5 * (lower + upper)), 0.5 * (upper - lower))
