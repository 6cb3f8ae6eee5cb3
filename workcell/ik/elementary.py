"""Proofs that need no solver: the triangle inequality along the chain, and spheres whose place the target alone decides.

Every bound is computed from the problem again when a certificate is checked; its data only name the tolerances
that it covers and the hint (points on the joint axes) that makes the bound tight.
"""

from __future__ import annotations

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


def prove_impossible(problem: IKProblem) -> Certificate | None:
    """A certificate by one of the elementary bounds, or None; costs less than a millisecond."""
    return _prove_reach(problem) or _prove_last_link(problem)


def check_reach(problem: IKProblem, certificate: Certificate) -> str | None:
    """Why a `reach` certificate does not hold, or None when it does."""
    covered, slides = certificate.data.get("tolerances"), certificate.data.get("slides")
    refusal = _wrong_tolerances(problem, covered)
    if refusal is not None or covered is None:
        return refusal
    if slides is None or slides.shape != (problem.robot.dof,) or not np.all(np.isfinite(slides)):
        return "the points on the joint axes are missing or malformed"
    if reach_margin(problem, covered, slides) <= 0:
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
    if _deepest(problem, covered)[0] <= 0:
        return "no sphere of the last link must penetrate an obstacle at the target"
    return None


def reach_margin(problem: IKProblem, covered: Array, slides: Array) -> float:
    """Metres by which the target lies beyond the chain's reach, or nearer than its shortest extent; negative: neither.

    On each joint axis k stands the point `slides[k]` along it. Neighbours keep their distance (both are fixed to the
    link between them), the first is fixed to the base and the last to the tool, so that the sum of those distances
    bounds the distance of the ends. A prismatic joint adds its travel.
    """
    first, last, offset = _ends(problem, slides)
    lengths = np.linalg.norm(_spans(problem, slides), axis=1)
    robot = problem.robot
    travel = np.where(robot.prismatic, np.maximum(np.abs(robot.lower), np.abs(robot.upper)), 0.0)
    moved = covered[0] + covered[1] * offset + ROUNDING
    distance = float(np.linalg.norm(last - first))
    total = float(lengths.sum() + travel.sum())
    too_far = distance - moved - total
    longest = float(lengths.max(initial=0.0))
    too_near = longest - (total - longest) - distance - moved
    return float(max(too_far, too_near))


def _ends(problem: IKProblem, slides: Array) -> tuple[Array, Array, float]:
    """World positions (3,) of the first axis point and of the last one at the target; its distance to the tool point."""
    robot, tool = problem.robot, problem.robot.tool()
    in_base = robot.joint_xyz[0] + robot.joint_rotation[0] @ robot.axis[0] * slides[0]
    in_tool = tool.T_link_tool.inverse().apply(robot.axis[-1] * slides[-1])
    return (
        robot.T_world_base.apply(in_base),
        problem.target.apply(in_tool),
        float(np.linalg.norm(in_tool)),
    )


def _spans(problem: IKProblem, slides: Array) -> Array:
    """(n - 1, 3) from each axis point to the next one, in the link between them."""
    robot = problem.robot
    along = np.einsum("kij,kj->ki", robot.joint_rotation, robot.axis)
    spans: Array = robot.joint_xyz[1:] + along[1:] * slides[1:, None] - robot.axis[:-1] * slides[:-1, None]
    return spans


def _prove_reach(problem: IKProblem) -> Certificate | None:
    tolerances = _tolerances(problem)
    slides = np.zeros(problem.robot.dof)
    if reach_margin(problem, tolerances[-1], slides) <= 0:
        slides = _tight_slides(problem)
    for covered in tolerances:
        margin = reach_margin(problem, covered, slides)
        if margin > 0:
            statement = (
                f"the target is {1e3 * margin:.1f} mm out of reach by the triangle inequality along the chain, "
                f"{_covering(covered)}"
            )
            data = {"tolerances": covered, "slides": slides}
            return Certificate("reach", "kinematics", statement, margin, problem_hash(problem), data)
    return None


def _tight_slides(problem: IKProblem, iterations: int = 12) -> Array:
    """Points on the axes that make `distance - sum of lengths` large: its lengths majorised by quadratics (Weiszfeld),
    its distance by its tangent, which never lowers it."""
    robot, n = problem.robot, problem.robot.dof
    slides = np.zeros(n)
    along = np.einsum("kij,kj->ki", robot.joint_rotation, robot.axis)
    first_axis = robot.T_world_base.rotation @ along[0]
    tool = robot.tool()
    last_axis = problem.target.rotation @ (tool.T_link_tool.rotation.T @ robot.axis[-1])
    for _ in range(iterations):
        weights = 1.0 / np.maximum(np.linalg.norm(_spans(problem, slides), axis=1), 1e-6)
        first, last, _ = _ends(problem, slides)
        direction = (last - first) / max(float(np.linalg.norm(last - first)), 1e-12)
        H, g = 1e-9 * np.eye(n), np.zeros(n)
        for k in range(n - 1):
            A = np.stack([-robot.axis[k], along[k + 1]], axis=1)
            H[k : k + 2, k : k + 2] += weights[k] * A.T @ A
            g[k : k + 2] -= weights[k] * A.T @ robot.joint_xyz[k + 1]
        g[0] -= direction @ first_axis
        g[-1] += direction @ last_axis
        slides = np.clip(np.linalg.solve(H, g), -3.0, 3.0)
    return slides


def _prove_last_link(problem: IKProblem) -> Certificate | None:
    if problem.cover is None or not problem.obstacles:
        return None
    for covered in _tolerances(problem):
        margin, sphere, piece = _deepest(problem, covered)
        if margin > 0:
            statement = (
                f"wherever the arm reaches the target, {sphere_name(problem, sphere)} is inside "
                f"{problem.obstacles[piece].name}, {1e3 * margin:.1f} mm deeper than needed, {_covering(covered)}"
            )
            data = {"tolerances": covered, "pair": np.array([sphere, piece])}
            digest = problem_hash(problem)
            return Certificate("last_link", _collision_scope(problem), statement, margin, digest, data)
    return None


def _deepest(problem: IKProblem, covered: Array) -> tuple[float, int, int]:
    """(metres beyond what the tolerances can undo, sphere, piece) of the worst sphere that the target alone places."""
    assert problem.cover is not None
    chosen, centres, wander = _placed_spheres(problem, covered)
    if len(chosen) == 0:
        return -np.inf, -1, -1
    gaps = ExactDistances(problem.obstacles)(centres) - problem.cover.radius[chosen, None] + wander[:, None]
    row, piece = divmod(int(np.argmin(gaps)), gaps.shape[1])
    wanted = problem.tolerances.safety_margin - covered[2]
    return float(wanted - ROUNDING - gaps[row, piece]), int(chosen[row]), piece


def _placed_spheres(problem: IKProblem, covered: Array) -> tuple[NDArray[np.int64], Array, Array]:
    """Spheres whose place follows from the target: indices (s,), world points (s, 3), and how far the centres may stray.

    The tool's link is placed up to the tolerances. A sphere of the link before it circles the last axis: it
    strays from its foot on that axis by its distance to it.
    """
    robot, cover = problem.robot, problem.cover
    assert cover is not None
    tool = robot.tool()
    T_tool_link = tool.T_link_tool.inverse()
    own = np.flatnonzero(cover.link == tool.link)
    in_tool = T_tool_link.apply(cover.centre[own])
    stray = np.zeros(len(own))
    if not robot.prismatic[-1]:
        before = np.flatnonzero(cover.link == tool.link - 1) if tool.link > 0 else np.zeros(0, dtype=np.int64)
        along = robot.joint_rotation[-1] @ robot.axis[-1]
        from_axis = cover.centre[before] - robot.joint_xyz[-1]
        height = from_axis @ along
        stray = np.append(stray, np.linalg.norm(from_axis - height[:, None] * along, axis=1))
        feet = T_tool_link.apply(robot.axis[-1] * height[:, None])
        own, in_tool = np.append(own, before), np.vstack([in_tool, feet])
    wander = stray + covered[0] + covered[1] * np.linalg.norm(in_tool, axis=1)
    return own, problem.target.apply(in_tool), wander


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
