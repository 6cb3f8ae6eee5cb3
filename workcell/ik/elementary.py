"""Proofs that need no solver: the triangle inequality along the chain, and spheres whose place the target alone decides.

Every bound is computed from the problem again when a certificate is checked; its data only name the tolerances
that it covers and the hint (points on the joint axes) that makes the bound tight.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workcell.ik.certificate import Certificate, Scope, problem_hash
from workcell.ik.exact import ExactDistances
from workcell.ik.problem import IKProblem
from workcell.ik.verify import sphere_name
from workcell.pose import Array

WIDE = np.array([1e-3, 1e-2, 1e-3])
"""Position, rotation and clearance tolerances that a proof covers where its margin allows, wider than those asked for."""

ROUNDING = 1e-9
"""Metres kept back for rounding in the bounds."""


WORTHWHILE = 0.5
"""Share of the chain's plain length beyond which a target is far enough to look for a tighter bound."""


def prove_impossible(problem: IKProblem) -> Certificate | None:
    """A certificate by one of the elementary bounds, or None; costs well below a millisecond."""
    return _prove_reach(problem) or _prove_last_link(problem)


def check_reach(problem: IKProblem, certificate: Certificate) -> str | None:
    """Why a `reach` certificate does not hold, or None when it does."""
    covered, slides = certificate.data.get("tolerances"), certificate.data.get("slides")
    refusal = _wrong_tolerances(problem, covered)
    if refusal is not None or covered is None:
        return refusal
    if slides is None or slides.shape != (problem.robot.dof,) or not np.all(np.isfinite(slides)):
        return "the points on the joint axes are missing or malformed"
    if ReachBound.of(problem).margin(covered, slides) <= 0:
        return "the distance to the target lies within the chain's reach"
    return None


def check_last_link(problem: IKProblem, certificate: Certificate) -> str | None:
    """Why a `last_link` certificate does not hold, or None when it does."""
    covered = certificate.data.get("tolerances")
    refusal = _wrong_tolerances(problem, covered)
    if refusal is not None or covered is None:
        return refusal
    if problem.cover is None or not problem.obstacles:
        return "the problem has no spheres or no obstacles"
    if certificate.scope != _collision_scope(problem):
        return f"the scope {certificate.scope!r} claims too much: spheres prove it of {_collision_scope(problem)!r}"
    if _Depth.of(problem).deepest(covered)[0] <= 0:
        return "no sphere of the last link must penetrate an obstacle at the target"
    return None


@dataclass(frozen=True, slots=True)
class ReachBound:
    """The triangle inequality along points on the joint axes.

    On each joint axis k stands the point `slides[k]` along it. Neighbours keep their distance (both are fixed to the
    link between them), the first is fixed to the base and the last to the tool, so that the sum of those distances
    bounds the distance of the ends. A prismatic joint adds its travel.

    Attributes:
        axis, along: (n, 3) each joint's axis in its own link, and in the link before.
        offset: (n - 1, 3) joint origins 2 ... n in the link before.
        first, last: (2, 3) world points of the first and of the last axis: origin, direction. The last at the target.
        in_tool: (2, 3) the last axis in the tool frame.
        travel: metres that prismatic joints add.
    """

    axis: Array
    along: Array
    offset: Array
    first: Array
    last: Array
    in_tool: Array
    travel: float

    @staticmethod
    def of(problem: IKProblem) -> ReachBound:
        """The bound's numbers for a problem."""
        robot, tool = problem.robot, problem.robot.tool()
        along = (robot.joint_rotation @ robot.axis[:, :, None])[..., 0]
        base, target, to_link = (
            robot.T_world_base.rotation,
            problem.target.rotation,
            tool.T_link_tool.rotation,
        )
        in_tool = np.stack([-tool.T_link_tool.position, robot.axis[-1]]) @ to_link
        origin = base @ robot.joint_xyz[0] + robot.T_world_base.position
        last = in_tool @ target.T
        last[0] += problem.target.position
        travel = np.where(robot.prismatic, np.maximum(np.abs(robot.lower), np.abs(robot.upper)), 0.0).sum()
        first = np.stack([origin, base @ along[0]])
        return ReachBound(robot.axis, along, robot.joint_xyz[1:], first, last, in_tool, float(travel))

    def spans(self, slides: Array) -> Array:
        """(n - 1, 3) from each axis point to the next one, in the link between them."""
        spans: Array = self.offset + self.along[1:] * slides[1:, None] - self.axis[:-1] * slides[:-1, None]
        return spans

    def ends(self, slides: Array) -> Array:
        """(3,) from the first axis point to the last one at the target."""
        between: Array = self.last[0] + slides[-1] * self.last[1] - self.first[0] - slides[0] * self.first[1]
        return between

    def margin(self, covered: Array, slides: Array) -> float:
        """Metres by which the target lies beyond the chain's reach, or nearer than its shortest extent; else negative."""
        lengths = np.sqrt((self.spans(slides) ** 2).sum(axis=1))
        lever = float(np.linalg.norm(self.in_tool[0] + slides[-1] * self.in_tool[1]))
        moved = covered[0] + covered[1] * lever + ROUNDING
        distance = float(np.linalg.norm(self.ends(slides)))
        total, longest = float(lengths.sum()) + self.travel, float(lengths.max(initial=0.0))
        too_far = distance - moved - total
        too_near = longest - (total - longest) - distance - moved
        return float(max(too_far, too_near))

    def tight_slides(self, iterations: int = 8) -> Array:
        """Points that make `distance - sum of lengths` large: its lengths majorised by quadratics (Weiszfeld), its
        distance by its tangent, which never lowers it."""
        n = len(self.axis)
        slides, pairs = np.zeros(n), np.stack([-self.axis[:-1], self.along[1:]], axis=2)
        squares = np.swapaxes(pairs, 1, 2) @ pairs
        loads = (np.swapaxes(pairs, 1, 2) @ self.offset[..., None])[..., 0]
        for _ in range(iterations):
            weights = 1.0 / np.maximum(np.linalg.norm(self.spans(slides), axis=1), 1e-6)
            between = self.ends(slides)
            direction = between / max(float(np.linalg.norm(between)), 1e-12)
            H, g = 1e-9 * np.eye(n), np.zeros(n)
            for k in range(n - 1):
                H[k : k + 2, k : k + 2] += weights[k] * squares[k]
                g[k : k + 2] -= weights[k] * loads[k]
            g[0] -= direction @ self.first[1]
            g[-1] += direction @ self.last[1]
            slides = np.clip(np.linalg.solve(H, g), -3.0, 3.0)
        return slides


def _prove_reach(problem: IKProblem) -> Certificate | None:
    wide, asked = _tolerances(problem)
    bound = ReachBound.of(problem)
    slides = np.zeros(problem.robot.dof)
    if bound.margin(wide, slides) <= 0:
        plain = float(np.linalg.norm(bound.offset, axis=1).sum()) + bound.travel
        if float(np.linalg.norm(bound.ends(slides))) < WORTHWHILE * plain:
            return None
        slides = bound.tight_slides()
    for covered in (wide, asked):
        margin = bound.margin(covered, slides)
        if margin > 0:
            statement = (
                f"the target is {1e3 * margin:.1f} mm out of reach by the triangle inequality along the chain, "
                f"{_covering(covered)}"
            )
            data = {"tolerances": covered, "slides": slides}
            return Certificate("reach", "kinematics", statement, margin, problem_hash(problem), data)
    return None


def _prove_last_link(problem: IKProblem) -> Certificate | None:
    if problem.cover is None or not problem.obstacles:
        return None
    wide, asked = _tolerances(problem)
    depth = _Depth.of(problem)
    margin, sphere, piece = depth.deepest(asked)
    if margin <= 0:
        return None
    covered = asked
    if depth.deepest(wide)[0] > 0:
        covered, (margin, sphere, piece) = wide, depth.deepest(wide)
    statement = (
        f"wherever the arm reaches the target, {sphere_name(problem, sphere)} is inside "
        f"{problem.obstacles[piece].name}, {1e3 * margin:.1f} mm deeper than needed, {_covering(covered)}"
    )
    data = {"tolerances": covered, "pair": np.array([sphere, piece])}
    return Certificate("last_link", _collision_scope(problem), statement, margin, problem_hash(problem), data)


@dataclass(frozen=True, slots=True)
class _Depth:
    """Spheres that the target alone places: indices (s,), their gaps (s, k) to the obstacles there, how far their centres
    may stray from there (s,), their distance (s,) to the tool point, and the clearance that is wanted."""

    sphere: NDArray[np.int64]
    gap: Array
    stray: Array
    lever: Array
    wanted: float

    @staticmethod
    def of(problem: IKProblem) -> _Depth:
        assert problem.cover is not None
        sphere, in_tool, stray = _placed_spheres(problem)
        centres = in_tool @ problem.target.rotation.T + problem.target.position
        gap = ExactDistances(problem.obstacles)(centres) - problem.cover.radius[sphere, None]
        lever = np.linalg.norm(in_tool, axis=1)
        return _Depth(sphere, gap, stray, lever, problem.tolerances.safety_margin)

    def deepest(self, covered: Array) -> tuple[float, int, int]:
        """(metres beyond what the tolerances can undo, sphere, piece) of the worst sphere."""
        if self.gap.size == 0:
            return -np.inf, -1, -1
        gaps = self.gap + (self.stray + covered[0] + covered[1] * self.lever)[:, None]
        row, piece = divmod(int(np.argmin(gaps)), gaps.shape[1])
        return float(self.wanted - covered[2] - ROUNDING - gaps[row, piece]), int(self.sphere[row]), piece


def _placed_spheres(problem: IKProblem) -> tuple[NDArray[np.int64], Array, Array]:
    """Spheres whose place follows from the target: indices (s,), points in the tool frame (s, 3), and how far the
    centres stray from them.

    The tool's link has its place. A sphere of the link before it circles the last axis: it strays from its foot on that
    axis by its distance to it.
    """
    robot, cover = problem.robot, problem.cover
    assert cover is not None
    tool = robot.tool()
    own = np.flatnonzero(cover.link == tool.link)
    points, stray = cover.centre[own], np.zeros(len(own))
    if not robot.prismatic[-1]:
        before = np.flatnonzero(cover.link == tool.link - 1)
        along = robot.joint_rotation[-1] @ robot.axis[-1]
        from_axis = cover.centre[before] - robot.joint_xyz[-1]
        height = from_axis @ along
        stray = np.append(stray, np.linalg.norm(from_axis - height[:, None] * along, axis=1))
        own, points = np.append(own, before), np.vstack([points, height[:, None] * robot.axis[-1]])
    return own, (points - tool.T_link_tool.position) @ tool.T_link_tool.rotation, stray


def _collision_scope(problem: IKProblem) -> Scope:
    """What penetrating spheres prove: spheres that cover the robot from outside, only the model they belong to."""
    assert problem.cover is not None
    true_shape = problem.cover.kind == "inner" or (problem.cover.kind == "given" and problem.checker is None)
    return "geometry" if true_shape else "model"


def _tolerances(problem: IKProblem) -> tuple[Array, Array]:
    asked = np.array([problem.tolerances.position, problem.tolerances.rotation, 0.0])
    return np.maximum(asked, WIDE), asked


def _wrong_tolerances(problem: IKProblem, covered: Array | None) -> str | None:
    if covered is None or covered.shape != (3,) or not np.all(np.isfinite(covered)):
        return "the covered tolerances are missing or malformed"
    if np.any(covered < _tolerances(problem)[1]):
        return "the covered tolerances are narrower than those of the problem"
    return None


def _covering(covered: Array) -> str:
    return f"covering {1e3 * covered[0]:g} mm, {covered[1]:g} rad and {1e3 * covered[2]:g} mm of penetration"
