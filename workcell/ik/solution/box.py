"""What a box of configurations has to keep, as numbers: see the section on `solution` of docs/proofs.md.

The box is `middle +- half`. Chain and equations are looked at in its middle alone; over the box they change by no more
than the half widths times lengths along the chain, to first order or, less their derivatives, to second.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workcell.geometry.types import Piece, SphereCover
from workcell.identity_cache import ByIdentity
from workcell.ik.problem import IKProblem
from workcell.ik.solution.kernels import BOX, CYLINDER, SPHERE, least_gap, stand
from workcell.model.robot import LIMIT_SLACK, Robot
from workcell.pose import Array, quat_to_matrix

LONGEST = 100.0
"""Metres, and radians of a joint, beyond which nothing is proved."""
_UNIT = 2.0**-44
_KINDS = {"box": BOX, "sphere": SPHERE, "cylinder": CYLINDER}
_FULL = 2.0 * np.sqrt(2.0)
_robots, _covers, _worlds = ByIdentity(), ByIdentity(), ByIdentity()


@dataclass(frozen=True, slots=True)
class Chain:
    """A robot's numbers.

    Attributes:
        frames, offsets, axes: as `stand` takes them.
        base, tool: (12,) rotation row by row and position.
        beyond: (n + 1,) metres from each link's origin, the base's first, to the tool's along the chain.
    """

    frames: Array
    offsets: Array
    axes: Array
    base: Array
    tool: Array
    beyond: Array

    @staticmethod
    def of(robot: Robot) -> Chain:
        """Of a robot, remembered."""
        return _robots.get((robot,), lambda: Chain._make(robot))

    @staticmethod
    def _make(robot: Robot) -> Chain:
        base, tool = robot.T_world_base, robot.tool().T_link_tool
        lengths = np.linalg.norm(robot.joint_xyz, axis=1)
        tip = float(np.linalg.norm(tool.position))
        return Chain(
            np.array(robot.joint_rotation),
            np.array(robot.joint_xyz),
            np.array(robot.axis),
            np.concatenate([base.rotation.ravel(), base.position]),
            np.concatenate([tool.rotation.ravel(), tool.position]),
            np.append(np.cumsum(lengths[::-1])[::-1], 0.0) + tip,
        )


@dataclass(frozen=True, slots=True)
class Spheres:
    """A robot's spheres.

    Attributes:
        rows: (s, 5) link, centre, radius.
        levers: (s, n) metres from each joint's origin to the centre along the chain; zero for joints beyond.
    """

    rows: Array
    levers: Array

    @staticmethod
    def of(robot: Robot, cover: SphereCover | None) -> Spheres:
        """Of a robot's cover, remembered."""
        if cover is None:
            return Spheres(np.zeros((0, 5)), np.zeros((0, robot.dof)))
        return _covers.get((robot, cover), lambda: Spheres._make(robot, cover))

    @staticmethod
    def _make(robot: Robot, cover: SphereCover) -> Spheres:
        lengths = np.append(0.0, np.cumsum(np.linalg.norm(robot.joint_xyz, axis=1)))
        to_link = lengths[cover.link][:, None] - lengths[None, 1:]
        own = np.linalg.norm(cover.centre, axis=1)
        moved = np.arange(1, robot.dof + 1)[None] <= cover.link[:, None]
        rows = np.column_stack([cover.link, cover.centre, cover.radius])
        return Spheres(rows, np.where(moved, to_link + own[:, None], 0.0))


@dataclass(frozen=True, slots=True)
class Stance:
    """A problem seen from one configuration, and how far rounding may be off in each of these numbers.

    Attributes:
        chain, spheres, obstacles: the problem's numbers.
        equations, slopes: (6,) and (6, n), see `stand`.
        turned: |M - I| (Frobenius).
        centres: (s, 3) metres.
        rounding: metres, or without a unit.
    """

    chain: Chain
    spheres: Spheres
    obstacles: Array
    equations: Array
    slopes: Array
    turned: float
    centres: Array
    rounding: float

    @staticmethod
    def at(problem: IKProblem, q: Array) -> Stance | str:
        """The problem seen from q (n,), or why nothing can be said of it."""
        refusal = refused(problem)
        if refusal is not None:
            return refusal
        chain, spheres = Chain.of(problem.robot), Spheres.of(problem.robot, problem.cover)
        obstacles, size = _world(problem)
        target = problem.target
        goal = np.concatenate([target.rotation.ravel(), target.position])
        longest = max(
            float(chain.beyond[0] + np.linalg.norm(chain.base[9:])),
            float(np.linalg.norm(target.position)),
            float(np.abs(spheres.rows[:, 1:]).max(initial=0.0)) + float(chain.beyond[0]),
            size,
        )
        if not (longest <= LONGEST and np.abs(q).max() <= LONGEST):
            return f"something reaches {longest:.3g} m, or a joint {np.abs(q).max():.3g} rad; at most {LONGEST:g} do"
        n = len(q)
        equations, slopes, centres = np.zeros(6), np.zeros((6, n)), np.zeros((len(spheres.rows), 3))
        turned = stand(
            np.stack([chain.base, chain.tool, goal]),
            chain.frames,
            chain.offsets,
            chain.axes,
            np.array(q, dtype=float),
            spheres.rows,
            equations,
            slopes,
            centres,
        )
        rounding = _UNIT * (n + 2) * max(longest, 1.0)
        return Stance(chain, spheres, obstacles, equations, slopes, turned, centres, rounding)

    def reached(self, half: Array) -> tuple[float, float]:
        """Metres and radians within which every configuration of the box brings the tool to its target."""
        away = (
            float(np.linalg.norm(self.equations[:3]))
            + float(half @ self.chain.beyond[1:])
            + 3 * self.rounding
        )
        sine = (self.turned + 9 * self.rounding) / _FULL + 0.5 * float(half.sum())
        return away, 2.0 * float(np.arcsin(min(sine, 1.0))) + self.rounding

    def clearance(self, half: Array, pairs: NDArray[np.int64] | None) -> float:
        """Metres from obstacles, and of the pairs of spheres from each other, that the whole box keeps."""
        rows, moves = self.spheres.rows, self.spheres.levers @ half
        least = float(least_gap(self.centres, rows[:, 4] + moves, self.obstacles)) - 3 * self.rounding
        if pairs is not None and len(pairs):
            one, two = pairs.T
            apart = np.linalg.norm(self.centres[one] - self.centres[two], axis=1)
            apart -= rows[one, 4] + rows[two, 4] + moves[one] + moves[two]
            least = min(least, float(apart.min()) - 3 * self.rounding)
        return least

    def image(self, joints: NDArray[np.int64], inverse: Array, half: Array) -> Array:
        """(6,) how far Newton's step from any configuration of the box, the other joints in their middle, ends from it.

        Where that is less than the half widths of the six joints, the step maps the box into itself, and a
        configuration that it leaves where it is solves the equations.
        """
        h, slopes, size = half[joints], self.slopes[:, joints], np.abs(inverse)
        # two turns one after the other change a point by no more than the outer one's distance from it
        lever = self.chain.beyond[1:][np.maximum(joints[:, None], joints[None, :])]
        second = 0.5 * float(h @ lever @ h), 0.5 * float(h.sum()) ** 2
        remainder = np.repeat(second, 3) + self.rounding * (1.0 + float(h.sum()))
        off = np.abs(np.eye(6) - inverse @ slopes) + 1e-15 * (size @ np.abs(slopes))
        image: Array = np.abs(inverse @ self.equations) + off @ h + size @ remainder
        return np.asarray(image * (1.0 + 1e-12))


def refused(problem: IKProblem) -> str | None:
    """Why a problem is of a kind that no box is proved for, or None."""
    robot = problem.robot
    if problem.goal != "pose" or robot.prismatic.any() or robot.coupling is not None:
        return "proofs of solutions are about whole poses, and joints that turn, each by itself"
    if problem.max_step is not None or problem.max_link_rotation is not None:
        return "proofs of solutions know no bounds against a reference"
    if problem.checker is not None:
        return "proofs of solutions are about spheres, and here the compiled model judges"
    unknown = [piece.kind for piece in problem.obstacles if piece.kind not in _KINDS]
    if unknown and problem.cover is not None:
        return f"proofs of solutions know no pieces of kind {unknown[0]!r}"
    return None


def within_limits(problem: IKProblem, middle: Array, half: Array) -> bool:
    """Whether the box keeps the joint limits, the slack included."""
    robot = problem.robot
    lower, upper = robot.lower - LIMIT_SLACK, robot.upper + LIMIT_SLACK
    # an ulp of the sums, both ways
    spare = 4e-16 * (1.0 + np.abs(middle))
    return bool(np.all(middle - half - spare >= lower) and np.all(middle + half + spare <= upper))


def _world(problem: IKProblem) -> tuple[Array, float]:
    """Rows of the obstacles (k, 16), and metres within which they are."""
    pieces = problem.obstacles if problem.cover is not None else ()
    if not isinstance(pieces, tuple):
        return _rows(pieces)
    return _worlds.get((pieces,), lambda: _rows(pieces))


def _rows(pieces: Sequence[Piece]) -> tuple[Array, float]:
    rows = np.zeros((len(pieces), 16))
    if not pieces:
        return rows, 0.0
    rows[:, 1:10] = quat_to_matrix(np.array([piece.pose.quat_wxyz for piece in pieces])).reshape(-1, 9)
    for row, piece in zip(rows, pieces, strict=True):
        row[0], row[10:13] = _KINDS[piece.kind], piece.pose.position
        row[13 : 13 + len(piece.size)] = piece.size
    return rows, float(np.abs(rows[:, 10:]).sum(axis=1).max(initial=0.0))
