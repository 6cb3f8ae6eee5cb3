"""The rows of a mechanism's relaxation, by what they say: affine functions of the variables, in cones.

Each has a family and an index, by which its multipliers are known to proofs (`workcell.ik.mechanisms.check`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from workcell.ik.ikspark.lift import frame_with_z
from workcell.ik.ikspark.mechanisms.lift import MechanismLift
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.problem import STEP_SLACK
from workcell.model.mechanism.mechanism import Mechanism
from workcell.model.mechanism.placing import Placed, place
from workcell.pose import Array

ConeName = Literal["zero", "nonneg", "soc", "psd"]
_SPARE = 0.5
"""Metres on top of all lengths, for slides without limits."""
_NOTHING = 1e-13
"""Rows whose numbers are all below this say nothing."""


@dataclass(frozen=True, slots=True)
class Rows:
    """Affine functions `rows (x, 1)` in a cone: zero, not negative, (t, v) with |v| <= t, or a PSD triangle."""

    family: str
    index: int
    cone: ConeName
    rows: Array


def interval_of(problem: MechanismProblem) -> Array:
    """(joints, 2) limits of hinges and slides, cut with `max_step` around the reference; infinite for other kinds.

    Slides without limits get some that are longer than all lengths together, with the farthest goal: they are searched
    no farther. Proofs have limits of their own.
    """
    mechanism = problem.mechanism
    interval = np.array([[joint.lower, joint.upper] for joint in mechanism.joints])
    for k, joint in enumerate(mechanism.joints):
        if joint.kind in ("ball", "free"):
            interval[k] = -np.inf, np.inf
        elif problem.max_step is not None and problem.q_reference is not None:
            here = float(problem.q_reference[mechanism.value_slices[k]][0])
            step = float(problem.max_step[mechanism.rate_slices[k]][0])  # type: ignore[index]
            interval[k] = max(interval[k, 0], here - step), min(interval[k, 1], here + step)
    slides = np.array([joint.kind == "slide" for joint in mechanism.joints])
    if not np.all(np.isfinite(interval[slides])):
        most = _all_lengths(problem, interval[slides])
        interval[slides] = np.clip(interval[slides], -most, most)
    return interval


def _all_lengths(problem: MechanismProblem, slides: Array) -> float:
    """Metres of all links, ties, frames, limited slides, and of the farthest goal."""
    mechanism = problem.mechanism
    frames = [joint.T_parent_joint for joint in mechanism.joints]
    frames += [frame for closure in mechanism.closures for frame in closure.frames]
    frames += [mechanism.frame(goal.frame).T_link_frame for goal in problem.goals]
    length = sum(float(np.linalg.norm(frame.position)) for frame in frames)
    length += float(np.abs(slides[np.isfinite(slides)]).sum())
    goals = [float(np.linalg.norm(goal.position)) for goal in problem.goals if goal.position is not None]
    homes = np.abs(mechanism.home).max(initial=0.0)
    return max(length + max(goals, default=0.0), float(homes)) + _SPARE


def structure(lift: MechanismLift) -> Iterator[Rows]:
    """What blocks, discs and slides are by themselves."""
    form, N = lift.form, lift.size
    sliding = {slide.node for slide in lift.slides.values()}
    for n, at in lift.full.items():
        block = _picked(N, at, form.size)
        yield Rows("weight", n, "zero", _plus(form.weight @ block, -1.0)[None])
        if len(form.structure):
            yield Rows("structure", n, "zero", form.structure @ block)
        if n not in sliding:
            yield Rows("block", n, "psd", block)
    for n, at in lift.planar.items():
        yield Rows("disc", n, "soc", np.vstack([_one(N), _picked(N, at, 2)]))
    for k, slide in lift.slides.items():
        kind = lift.nodes.nodes[slide.node].kind
        t = lift.fraction(k)
        if kind == "full":
            part, whole = _picked(N, slide.start, form.size), _picked(N, lift.full[slide.node], form.size)
            yield Rows("slide", k, "psd", part)
            yield Rows("slide rest", k, "psd", whole - part)
            if len(form.structure):
                yield Rows("slide structure", k, "zero", form.structure @ part)
        elif kind == "planar":
            part, whole = _picked(N, slide.start + 1, 2), _picked(N, lift.planar[slide.node], 2)
            yield Rows("slide", k, "soc", np.vstack([t, part]))
            yield Rows("slide rest", k, "soc", np.vstack([_one(N) - t, whole - part]))
        else:
            yield Rows("slide", k, "nonneg", np.stack([t, _one(N) - t]))


def ties(lift: MechanismLift, problem: MechanismProblem, interval: Array) -> Iterator[Rows]:
    """Hinges' axes, limits, closures, slides that follow slides."""
    mechanism = lift.mechanism
    for k, joint in enumerate(mechanism.joints):
        parent, child = lift.rotations[joint.parent], lift.rotations[k + 1]
        frame = joint.T_parent_joint.rotation
        if joint.kind == "hinge":
            axis = _along(parent, frame @ joint.axis) - _along(child, joint.axis)
            yield Rows("axis", k, "zero", axis)
            yield from _hinge_limit(lift, k, interval[k])
        elif joint.kind == "ball" and joint.upper < np.pi:
            turned = np.einsum("ijx,jk->ikx", parent, frame) - child
            yield Rows("ball", k, "soc", _ball(turned, joint.upper, lift.size))
    for c, closure in enumerate(mechanism.closures):
        (a, b), (F, G) = closure.links, closure.frames
        yield Rows("closure", c, "zero", lift.point(a, F.position) - lift.point(b, G.position))
        if closure.kind == "weld":
            apart = np.einsum("ijx,jk->ikx", lift.rotations[a], F.rotation)
            apart = apart - np.einsum("ijx,jk->ikx", lift.rotations[b], G.rotation)
            yield Rows("weld", c, "zero", apart.reshape(9, -1))
    yield from _sums(lift, mechanism)


def _hinge_limit(lift: MechanismLift, k: int, interval: Array) -> Iterator[Rows]:
    """Eq. 8 as a cone; next to a known link, where it is exact, as a half-plane."""
    joint = lift.mechanism.joints[k]
    half = 0.5 * (interval[1] - interval[0])
    if not half < np.pi or half == 0.0:
        return
    middle, E = 0.5 * (interval[0] + interval[1]), frame_with_z(joint.axis)
    towards = np.cos(middle) * E[:, 0] + np.sin(middle) * E[:, 1]
    u = _along(lift.rotations[joint.parent], joint.T_parent_joint.rotation @ towards)
    w = _along(lift.rotations[k + 1], E[:, 0])
    for known, other in ((u, w), (w, u)):
        if not np.any(known[:, :-1]):
            if np.any(other[:, :-1]):
                yield Rows("chord", k, "nonneg", _plus(known[:, -1] @ other, -np.cos(half))[None])
            return
    yield Rows("limit", k, "soc", np.vstack([2.0 * np.sin(0.5 * half) * _one(lift.size), u - w]))


def _ball(turned: Array, most: float, N: int) -> Array:
    return np.vstack([2.0 * np.sqrt(2.0) * np.sin(0.5 * most) * _one(N), turned.reshape(9, -1)])


def _sums(lift: MechanismLift, mechanism: Mechanism) -> Iterator[Rows]:
    """Ties of slides among themselves that are linear; what else follows is looked after elsewhere."""
    for i, follower in enumerate(mechanism.followers):
        if mechanism.joints[follower.joint].kind != "slide" or np.any(follower.coefficients[2:]):
            continue
        row = lift.slide_row(follower.joint)
        if follower.leader >= 0:
            if mechanism.joints[follower.leader].kind != "slide":
                continue
            row = row - follower.coefficients[1] * lift.slide_row(follower.leader)
        row[-1] -= follower.coefficients[0]
        yield Rows("follower", i, "zero", row[None])
    for i, total in enumerate(mechanism.sums):
        if any(mechanism.joints[k].kind != "slide" for k in total.joints):
            continue
        pairs = zip(total.joints, total.multiples, strict=True)
        row = sum((multiple * lift.slide_row(k) for k, multiple in pairs), np.zeros(lift.size + 1))
        if total.lower == total.upper:
            yield Rows("sum", i, "zero", _plus(row, -total.lower)[None])
        else:
            yield Rows("sum", i, "nonneg", np.stack([_plus(row, -total.lower), _plus(-row, total.upper)]))


def asked(lift: MechanismLift, problem: MechanismProblem, *, poses: bool = True) -> Iterator[Rows]:
    """Goals, regions, and bounds against the reference.

    Args:
        lift: the variables.
        problem: what is asked.
        poses: whether positions and rotations of goals are demanded; else they are a cost.
    """
    mechanism = problem.mechanism
    for g, goal in enumerate(problem.goals):
        frame = mechanism.frame(goal.frame)
        R = np.einsum("ijx,jk->ikx", lift.rotations[frame.link], frame.T_link_frame.rotation)
        if poses and goal.position is not None:
            at = lift.point(frame.link, frame.T_link_frame.position)
            yield Rows("position", g, "zero", _minus(at, goal.position))
        if poses and goal.rotation is not None:
            yield Rows("rotation", g, "zero", _minus(R.reshape(9, -1), goal.rotation.ravel()))
        if goal.axis is not None and goal.direction is not None:
            pointing = _along(R, goal.axis)
            if goal.within == 0.0:
                yield Rows("direction", g, "zero", _minus(pointing, goal.direction))
            else:
                row = _plus(goal.direction @ pointing, -np.cos(goal.within))
                yield Rows("cone", g, "nonneg", row[None])
    for r, region in enumerate(problem.regions):
        frame = mechanism.frame(region.frame)
        p = lift.point(frame.link, frame.T_link_frame.apply(region.point))
        inside = -region.A @ p
        inside[:, -1] += region.b
        if np.any(region.equal):
            yield Rows("region equal", r, "zero", inside[region.equal])
        if not np.all(region.equal):
            yield Rows("region", r, "nonneg", inside[~region.equal])
    if problem.q_reference is not None and (
        problem.max_link_rotation is not None or problem.max_step is not None
    ):
        yield from _bounds(lift, problem, place(mechanism, problem.q_reference))


def _bounds(lift: MechanismLift, problem: MechanismProblem, reference: Placed) -> Iterator[Rows]:
    """Eq. 75 for every link, and the steps of balls and floating bodies."""
    mechanism = problem.mechanism
    if problem.max_link_rotation is not None:
        for link in range(1, mechanism.link_count):
            row = np.einsum("ijx,ij->x", lift.rotations[link], reference.R[link])
            bound = 3.0 - 0.5 * (problem.max_link_rotation + STEP_SLACK) ** 2
            yield Rows("turn", link, "nonneg", _plus(row, -bound)[None])
    if problem.max_step is None:
        return
    steps = np.asarray(problem.max_step)
    for k, joint in enumerate(mechanism.joints):
        if joint.kind not in ("ball", "free"):
            continue
        most = float(np.linalg.norm(steps[mechanism.rate_slices[k]][-3:]))
        if joint.kind == "ball" and most < np.pi:
            relative = reference.R[joint.parent].T @ reference.R[k + 1]
            turned = np.einsum("ijx,jk->ikx", lift.rotations[joint.parent], relative) - lift.rotations[k + 1]
            yield Rows("ball step", k, "soc", _ball(turned, most, lift.size))
        if joint.kind == "free":
            step = steps[mechanism.rate_slices[k]][:3]
            moved = _minus(lift.origins[k + 1], reference.p[k + 1])
            room = step[:, None] * _one(lift.size)
            yield Rows("free step", k, "nonneg", np.vstack([room - moved, room + moved]))
            if most < np.pi:
                row = np.einsum("ijx,ij->x", lift.rotations[k + 1], reference.R[k + 1])
                yield Rows("free turn", k, "nonneg", _plus(row, -1.0 - 2.0 * np.cos(most))[None])
                twist = _twist(lift.rotations[k + 1], reference.R[k + 1])
                room = steps[mechanism.rate_slices[k]][3:, None] * _one(lift.size)
                yield Rows("free twist", k, "nonneg", np.vstack([room - twist, room + twist]))


def _twist(R: Array, R_reference: Array) -> Array:
    """(3, N + 1) axis times sine of the turn from a reference, in the child: no component exceeds that of the turn."""
    relative = np.einsum("ki,kjx->ijx", R_reference, R)
    pairs = ((2, 1), (0, 2), (1, 0))
    return np.stack([0.5 * (relative[i, j] - relative[j, i]) for i, j in pairs])


def says_something(rows: Rows) -> bool:
    """Whether rows are more than zeros."""
    return bool(np.abs(rows.rows).max(initial=0.0) > _NOTHING)


def _along(R: Array, local: Array) -> Array:
    turned: Array = np.einsum("ijx,j->ix", R, local)
    return turned


def _picked(N: int, start: int, count: int) -> Array:
    rows = np.zeros((count, N + 1))
    rows[np.arange(count), start + np.arange(count)] = 1.0
    return rows


def _one(N: int) -> Array:
    row = np.zeros(N + 1)
    row[-1] = 1.0
    return row


def _plus(row: Array, constant: float) -> Array:
    row = np.array(row)
    row[-1] += constant
    return row


def _minus(rows: Array, constants: Array) -> Array:
    rows = np.array(rows)
    rows[:, -1] -= constants
    return rows
