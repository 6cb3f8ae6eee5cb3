"""Proofs without a solver: the triangle inequality along the chain, and spheres placed by the target alone.

Every bound is computed from the problem again when a certificate is checked (`workcell.ik.elementary.check`); its data
only name the tolerances that it covers and the hint (points on the joint axes, a sphere and an obstacle).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workcell.geometry.types import SphereCover
from workcell.identity_cache import ByIdentity
from workcell.ik.certificate import Certificate, problem_hash, proof_scope
from workcell.ik.judge.exact import exact_distances, target_rotation
from workcell.ik.judge.verify import sphere_name
from workcell.ik.problem import IKProblem
from workcell.model.robot import LIMIT_SLACK, Robot
from workcell.pose import Array

WIDE = np.array([1e-3, 1e-2, 1e-3])
"""Position, rotation and clearance tolerances that a proof covers where its margin allows, wider than those asked
for."""

ROUNDING = 1e-9
"""Metres kept back for rounding in the bounds, see `workcell.ik.elementary.check`."""

WORTHWHILE = 0.5
"""Share of the chain's plain length beyond which a target is far enough to look for a tighter bound."""


def prove_impossible(problem: IKProblem) -> Certificate | None:
    """A certificate by one of the elementary bounds, or None; costs well below a millisecond."""
    return _prove_reach(problem) or _prove_last_link(problem)


@dataclass(frozen=True, slots=True)
class JointAxes:
    """A robot's joint axes with a point on each, `slides[k]` along axis k, as the reach bound needs them.

    Attributes:
        offset: (n - 1, 3) joint origins 2 ... n in the link before.
        slope: (3 n - 3, n) what the slides add to the vectors from each point to the next, in the link between them.
        squares, loads: (n - 1, n n) and (n - 1, n) those vectors' squared lengths: their Hessians, half their
            gradients.
        first, in_tool: (2, 3) origin and direction of the first axis in the world, of the last one in the tool frame.
        travel: metres that prismatic joints add, the slack of their limits included.
        plain: metres of the chain with the points at the joint origins.
    """

    offset: Array
    slope: Array
    squares: Array
    loads: Array
    first: Array
    in_tool: Array
    travel: float
    plain: float

    @staticmethod
    def of(robot: Robot) -> JointAxes:
        """The axes of a robot, remembered."""
        return _axes.get((robot,), lambda: JointAxes._make(robot.uncoupled))

    @staticmethod
    def _make(robot: Robot) -> JointAxes:
        n, tool, base = robot.dof, robot.tool().T_link_tool, robot.T_world_base
        along = (robot.joint_rotation @ robot.axis[:, :, None])[..., 0]
        offset, links = robot.joint_xyz[1:], np.arange(n - 1)
        slope = np.zeros((n - 1, 3, n))
        slope[links, :, links], slope[links, :, links + 1] = -robot.axis[:-1], along[1:]
        in_link = np.swapaxes(slope, 1, 2)
        farthest = np.maximum(np.abs(robot.lower), np.abs(robot.upper)) + LIMIT_SLACK
        travel = np.where(robot.prismatic, farthest, 0.0).sum()
        return JointAxes(
            offset,
            slope.reshape(-1, n),
            (in_link @ slope).reshape(-1, n * n),
            (in_link @ offset[..., None])[..., 0],
            np.stack([base.rotation @ robot.joint_xyz[0] + base.position, base.rotation @ along[0]]),
            np.stack([-tool.position, robot.axis[-1]]) @ tool.rotation,
            float(travel),
            float(np.linalg.norm(offset, axis=1).sum() + travel),
        )


@dataclass(frozen=True, slots=True)
class ReachBound:
    """The triangle inequality along points on the joint axes.

    On each joint axis k stands the point `slides[k]` along it. Neighbours keep their distance (both are fixed to the
    link between them), the first is fixed to the base and the last to the tool, so that the sum of those distances
    bounds the distance of the ends. A prismatic joint adds its travel.

    Attributes:
        axes: the robot's joint axes.
        last: (2, 3) world points of the last axis at the target: origin, direction.
    """

    axes: JointAxes
    last: Array

    @staticmethod
    def of(problem: IKProblem) -> ReachBound:
        """The bound's numbers for a problem."""
        axes = JointAxes.of(problem.robot)
        last = axes.in_tool @ target_rotation(problem).T
        last[0] += problem.target.position
        return ReachBound(axes, last)

    def lengths(self, slides: Array) -> Array:
        """(n - 1,) metres from each axis point to the next one."""
        spans = self.axes.offset + (self.axes.slope @ slides).reshape(-1, 3)
        lengths: Array = np.sqrt(np.einsum("ij,ij->i", spans, spans))
        return lengths

    def ends(self, slides: Array) -> Array:
        """(3,) from the first axis point to the last one at the target."""
        first, last = self.axes.first, self.last
        between: Array = last[0] + slides[-1] * last[1] - first[0] - slides[0] * first[1]
        return between

    def margin(self, covered: Array, slides: Array) -> float:
        """Metres by which the target is beyond the chain's reach, or nearer than its shortest extent; else negative."""
        lengths = self.lengths(slides).tolist()
        in_tool = self.axes.in_tool
        lever = math.hypot(*(in_tool[0] + slides[-1] * in_tool[1]).tolist())
        moved = float(covered[0]) + float(covered[1]) * lever + ROUNDING
        distance = math.hypot(*self.ends(slides).tolist())
        total, longest = math.fsum(lengths) + self.axes.travel, max(lengths, default=0.0)
        too_far = distance - moved - total
        too_near = longest - (total - longest) - distance - moved
        return max(too_far, too_near)

    def tight_slides(self, iterations: int = 8) -> Array:
        """Points that make `distance - sum of lengths` large: its lengths majorised by quadratics (Weiszfeld), its
        distance by its tangent, which never lowers it. The gains shrink from step to step, all but a few: where twice
        the last gain in every step to come would prove nothing, the rest is spared."""
        axes, n = self.axes, self.axes.slope.shape[1]
        slides, ridge, before = np.zeros(n), 1e-9 * np.eye(n), -math.inf
        for left in range(iterations, 0, -1):
            lengths, between = self.lengths(slides), self.ends(slides)
            distance = math.hypot(*between.tolist())
            beyond = distance - float(lengths.sum()) - axes.travel
            if beyond + 2 * left * max(beyond - before, 0.0) <= 0:
                break
            before = beyond
            weights = 1.0 / np.maximum(lengths, 1e-6)
            direction = between / max(distance, 1e-12)
            H, g = ridge + (weights @ axes.squares).reshape(n, n), -(weights @ axes.loads)
            g[0] -= direction @ axes.first[1]
            g[-1] += direction @ self.last[1]
            slides = np.minimum(np.maximum(np.linalg.solve(H, g), -3.0), 3.0)
        return slides


def _prove_reach(problem: IKProblem) -> Certificate | None:
    wide, asked = _tolerances(problem)
    bound = ReachBound.of(problem)
    slides = np.zeros(problem.robot.joint_count)
    if bound.margin(wide, slides) <= 0:
        if math.hypot(*bound.ends(slides).tolist()) < WORTHWHILE * bound.axes.plain:
            return None
        slides = bound.tight_slides()
    covered, margin = asked, bound.margin(asked, slides)
    if margin <= 0:
        return None
    if bound.margin(wide, slides) > 0:
        covered, margin = wide, bound.margin(wide, slides)
    data, scope = {"tolerances": covered, "slides": slides}, proof_scope(problem, "chain")
    return Certificate("reach", scope, reach_statement(margin, covered), margin, problem_hash(problem), data)


def reach_statement(margin: float, covered: Array) -> str:
    """What a reach bound claims, in words."""
    return (
        f"the target is {1e3 * margin:.1f} mm out of reach by the triangle inequality along the chain, "
        f"{_covering(covered)}"
    )


def _prove_last_link(problem: IKProblem) -> Certificate | None:
    if problem.cover is None or not problem.obstacles:
        return None
    wide, asked = _tolerances(problem)
    depth = Depth.of(problem)
    margin, sphere, piece = depth.deepest(asked)
    if margin <= 0:
        return None
    covered = asked
    if depth.deepest(wide)[0] > 0:
        covered, (margin, sphere, piece) = wide, depth.deepest(wide)
    said = last_link_statement(problem, margin, covered, sphere, piece)
    data, scope = {"tolerances": covered, "pair": np.array([sphere, piece])}, proof_scope(problem, "spheres")
    return Certificate("last_link", scope, said, margin, problem_hash(problem), data)


def last_link_statement(problem: IKProblem, margin: float, covered: Array, sphere: int, piece: int) -> str:
    """What a penetration at the target claims, in words."""
    return (
        f"wherever the arm reaches the target, {sphere_name(problem, sphere)} is inside "
        f"{problem.obstacles[piece].name}, {1e3 * margin:.1f} mm deeper than needed, {_covering(covered)}"
    )


@dataclass(frozen=True, slots=True)
class PlacedSpheres:
    """Spheres whose place follows from the target, up to how far they stray.

    Indices (s,), points in the tool frame (s, 3), how far the centres stray from them (s,), the points'
    distances to the tool point (s,), and the radii (s,).

    The tool's link has its place. A sphere of the link before it circles the last axis: it strays from its foot on that
    axis by its distance to it.
    """

    sphere: NDArray[np.int64]
    in_tool: Array
    stray: Array
    lever: Array
    radius: Array

    @staticmethod
    def of(robot: Robot, cover: SphereCover) -> PlacedSpheres:
        """The spheres of a robot's cover, remembered."""
        return _placed.get((robot, cover), lambda: PlacedSpheres._make(robot.uncoupled, cover))

    @staticmethod
    def _make(robot: Robot, cover: SphereCover) -> PlacedSpheres:
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
        in_tool = (points - tool.T_link_tool.position) @ tool.T_link_tool.rotation
        return PlacedSpheres(own, in_tool, stray, np.linalg.norm(in_tool, axis=1), cover.radius[own])


_axes, _placed = ByIdentity(), ByIdentity()


@dataclass(frozen=True, slots=True)
class Depth:
    """Spheres that the target alone places, their gaps (s, k) to the obstacles there, and the clearance wanted."""

    placed: PlacedSpheres
    gap: Array
    wanted: float

    @staticmethod
    def of(problem: IKProblem) -> Depth:
        """The spheres of a problem with a cover and obstacles."""
        assert problem.cover is not None
        placed = PlacedSpheres.of(problem.robot, problem.cover)
        centres = placed.in_tool @ target_rotation(problem).T + problem.target.position
        gap = exact_distances(problem.obstacles)(centres) - placed.radius[:, None]
        return Depth(placed, gap, problem.tolerances.safety_margin)

    def deepest(self, covered: Array) -> tuple[float, int, int]:
        """(metres beyond what the tolerances can undo, sphere, piece) of the worst sphere."""
        if self.gap.size == 0:
            return -np.inf, -1, -1
        gaps = self._gaps(covered)
        row, piece = divmod(int(gaps.argmin()), gaps.shape[1])
        margin = float(self.wanted - covered[2] - ROUNDING - gaps[row, piece])
        return margin, int(self.placed.sphere[row]), piece

    def depth(self, covered: Array, sphere: int, piece: int) -> float:
        """The same of one sphere and one piece; minus infinity where the target does not place the sphere."""
        rows = np.flatnonzero(self.placed.sphere == sphere)
        if not len(rows):
            return -np.inf
        return float(self.wanted - covered[2] - ROUNDING - self._gaps(covered)[rows[0], piece])

    def _gaps(self, covered: Array) -> Array:
        placed = self.placed
        gaps: Array = self.gap + (placed.stray + covered[0] + covered[1] * placed.lever)[:, None]
        return gaps


def _tolerances(problem: IKProblem) -> tuple[Array, Array]:
    asked = np.array([problem.tolerances.position, problem.tolerances.rotation, 0.0])
    return np.maximum(asked, WIDE), asked


def _covering(covered: Array) -> str:
    return f"covering {1e3 * covered[0]:g} mm, {covered[1]:g} rad and {1e3 * covered[2]:g} mm of penetration"
