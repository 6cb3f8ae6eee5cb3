"""IKSPARK's relaxation of a question about a mechanism, written plainly in cvxpy.

    question, model = plain_relaxation(problem)
    elbow = model.expressions.point("elbow")
    cvxpy.Problem(cvxpy.Maximize(elbow[2]), question.constraints).solve(solver="CLARABEL")

gives a bound that no configuration which answers the question exceeds. Every unknown rotation is a whole block here:
nothing is reduced, and a solve takes a hundred times longer than that of the solver proper.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from workcell.ik.ikspark.lift import frame_with_z
from workcell.ik.ikspark.mechanisms.plain.forms import Expression, FormName
from workcell.ik.ikspark.mechanisms.plain.model import PlainMechanism, plain_variables
from workcell.ik.ikspark.mechanisms.plain.slides import SlideName
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.problem import STEP_SLACK
from workcell.model.mechanism.placing import place
from workcell.pose import Array

if TYPE_CHECKING:
    import cvxpy

Rows = dict[tuple[str, int], list[Expression]]
"""Constraints by family and index in it."""


def plain_relaxation(
    problem: MechanismProblem,
    form: FormName = "quaternion",
    slide: SlideName = "split",
    *,
    reach: bool = True,
    workspace: tuple[Array, Array] | None = None,
) -> tuple[cvxpy.Problem, PlainMechanism]:
    """A feasibility problem over all lifted configurations that answer a question, and the expressions in it.

    Hinges that follow others, and sums with hinges in them, are left free; so are collisions. Steps of balls and
    floating bodies are bounded as a whole.

    Args:
        problem: the question.
        form: of unknown rotations.
        slide: of products of slides and directions; `split` needs the quaternion form.
        reach: whether positions, rotations and directions are rows; False: they are `pose_cost`'s alone.
        workspace: (3,) and (3,) corners of a box that floating bodies' origins are in; None: anywhere.

    Raises:
        InputError: no such form or lift; a slide without limits on a link that turns; a user's constraint that can't be
            built.
    """
    import cvxpy as cp

    model = plain_variables(problem, form, slide)
    rows = plain_rows(model, reach=reach)
    constraints = [row for form_of in model.forms.values() for row in form_of.constraints]
    constraints += [row for one in model.slides.values() for row in one.constraints]
    if workspace is not None:
        for origin in model.floating.values():
            constraints += [origin >= workspace[0], origin <= workspace[1]]
    constraints += [row for family in rows.values() for row in family]
    return cp.Problem(cp.Minimize(0), constraints), model


def plain_rows(model: PlainMechanism, *, reach: bool = True) -> Mapping[tuple[str, int], list[Expression]]:
    """All rows that tie the blocks, by family and index: `axis`, `limit`, `ball`, `closure`, `weld`, `sum`, ..."""
    families: list[Callable[[PlainMechanism], Iterator[tuple[str, int, Expression]]]] = [
        _joints,
        _closures,
        _sums,
        _cones,
        _regions,
        _turns,
        _steps,
        _users,
    ]
    rows: Rows = {}
    for family in [*families, _goals] if reach else families:
        for name, index, row in family(model):
            rows.setdefault((name, index), []).append(row)
    return MappingProxyType(rows)


def pose_cost(model: PlainMechanism) -> Expression:
    """f of Eq. 36, a convex quadratic: squared distances of all goals' positions, rotations and directions."""
    import cvxpy as cp

    misses = [miss for _, _, miss in _misses(model)]
    return cp.sum([cp.sum_squares(miss) for miss in misses]) if misses else cp.Constant(0.0)


def _joints(model: PlainMechanism) -> Iterator[tuple[str, int, Expression]]:
    """Common axes (5) and limits (8) of hinges, limits of balls."""
    import cvxpy as cp

    for k, joint in enumerate(model.problem.mechanism.joints):
        lower, upper = model.intervals[k]
        if joint.kind in ("hinge", "slide") and lower > upper:
            yield "limit", k, cp.Constant(1.0) <= 0.0
        parent = model.rotations[joint.parent] @ joint.T_parent_joint.rotation
        child = model.rotations[k + 1]
        if joint.kind == "ball" and upper < np.pi:
            yield "ball", k, cp.norm(parent - child, "fro") <= 2 * np.sqrt(2) * np.sin(upper / 2)
        if joint.kind != "hinge" or lower == upper:
            continue
        yield "axis", k, parent @ joint.axis == child @ joint.axis
        middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
        if 0 <= half < np.pi:
            F = frame_with_z(joint.axis)
            turned = np.cos(middle) * F[:, 0] + np.sin(middle) * F[:, 1]
            yield "limit", k, cp.norm(parent @ turned - child @ F[:, 0]) <= 2 * np.sin(half / 2)


def _closures(model: PlainMechanism) -> Iterator[tuple[str, int, Expression]]:
    """Loops: two expressions for one point, or for one frame (Remark 1)."""
    for c, closure in enumerate(model.problem.mechanism.closures):
        (a, b), (F, G) = closure.links, closure.frames
        one, two = model.rotations[a], model.rotations[b]
        yield "closure", c, model.origins[a] + one @ F.position == model.origins[b] + two @ G.position
        if closure.kind == "weld":
            yield "weld", c, one @ F.rotation == two @ G.rotation


def _sums(model: PlainMechanism) -> Iterator[tuple[str, int, Expression]]:
    """Slides that follow slides, and sums of slides; a polynomial of higher degree is left out."""
    mechanism = model.problem.mechanism
    for i, total in enumerate(mechanism.sums):
        if all(joint in model.slides for joint in total.joints):
            length = sum(
                multiple * model.slides[joint].value
                for joint, multiple in zip(total.joints, total.multiples, strict=True)
            )
            if np.isfinite(total.lower):
                yield "sum", i, length >= total.lower
            if np.isfinite(total.upper):
                yield "sum", i, length <= total.upper
    for i, follower in enumerate(mechanism.followers):
        a, *slopes = follower.coefficients
        if follower.joint in model.slides and follower.leader in model.slides and not np.any(slopes[1:]):
            led = a + (slopes[0] if slopes else 0.0) * model.slides[follower.leader].value
            yield "follower", i, model.slides[follower.joint].value == led


def _misses(model: PlainMechanism) -> Iterator[tuple[str, int, Expression]]:
    """What goals miss, linear; zero where they are reached."""
    expressions = model.expressions
    for g, goal in enumerate(model.problem.goals):
        if goal.position is not None:
            yield "position", g, expressions.point(goal.frame) - goal.position
        if goal.rotation is not None:
            yield "rotation", g, expressions.rotation(goal.frame) - goal.rotation
        if goal.axis is not None and goal.direction is not None and goal.within == 0.0:
            yield "direction", g, expressions.rotation(goal.frame) @ goal.axis - goal.direction


def _goals(model: PlainMechanism) -> Iterator[tuple[str, int, Expression]]:
    for name, g, miss in _misses(model):
        yield name, g, miss == 0.0


def _cones(model: PlainMechanism) -> Iterator[tuple[str, int, Expression]]:
    for g, goal in enumerate(model.problem.goals):
        if goal.axis is not None and goal.direction is not None and goal.within > 0.0:
            axis = model.expressions.rotation(goal.frame) @ goal.axis
            yield "cone", g, goal.direction @ axis >= np.cos(goal.within)


def _regions(model: PlainMechanism) -> Iterator[tuple[str, int, Expression]]:
    for r, region in enumerate(model.problem.regions):
        place_of = model.expressions.point(region.frame, region.point)
        equal = np.asarray(region.equal, dtype=bool)
        if np.any(equal):
            yield "region", r, region.A[equal] @ place_of == region.b[equal]
        if not np.all(equal):
            yield "region", r, region.A[~equal] @ place_of <= region.b[~equal]


def _turns(model: PlainMechanism) -> Iterator[tuple[str, int, Expression]]:
    """Eq. 75: no link turns by more than `max_link_rotation` (Frobenius norm); exact at rotations."""
    import cvxpy as cp

    problem = model.problem
    if problem.max_link_rotation is None or problem.q_reference is None:
        return
    before = place(problem.mechanism, problem.q_reference).R
    least = 3.0 - 0.5 * (problem.max_link_rotation + STEP_SLACK) ** 2
    for link in range(1, problem.mechanism.link_count):
        yield "turn", link, cp.sum(cp.multiply(before[link], model.rotations[link])) >= least


def _steps(model: PlainMechanism) -> Iterator[tuple[str, int, Expression]]:
    """What `max_step` says of balls and floating bodies: the length of their turn, and a box around an origin."""
    import cvxpy as cp

    problem, mechanism = model.problem, model.problem.mechanism
    if problem.max_step is None or problem.q_reference is None:
        return
    before = place(mechanism, problem.q_reference)
    for k, joint in enumerate(mechanism.joints):
        if joint.kind not in ("ball", "free"):
            continue
        step, child = np.asarray(problem.max_step)[mechanism.rate_slices[k]], model.rotations[k + 1]
        most = float(np.linalg.norm(step[-3:]))
        if joint.kind == "free":
            yield "free step", k, cp.abs(model.origins[k + 1] - before.p[k + 1]) <= step[:3]
            if most < np.pi:
                yield "free turn", k, cp.sum(cp.multiply(before.R[k + 1], child)) >= 1 + 2 * np.cos(most)
        elif most < np.pi:
            turned = model.rotations[joint.parent] @ (before.R[joint.parent].T @ before.R[k + 1])
            yield "ball step", k, cp.norm(turned - child, "fro") <= 2 * np.sqrt(2) * np.sin(most / 2)


def _users(model: PlainMechanism) -> Iterator[tuple[str, int, Expression]]:
    for u, constraint in enumerate(model.problem.constraints):
        for row in constraint.build(model.expressions):
            yield "user", u, row
