"""The variables of the plain relaxation: rotations, origins and slides of a mechanism as cvxpy expressions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from workcell.ik.ikspark.lift import frame_with_z
from workcell.ik.ikspark.mechanisms.plain.forms import Expression, Form, FormName, new_form
from workcell.ik.ikspark.mechanisms.plain.slides import Slide, SlideName, new_slide
from workcell.ik.ikspark.mechanisms.users.expressions import Expressions
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.model.mechanism.mechanism import Joint
from workcell.model.mechanism.placing import place
from workcell.pose import Array, axis_angle_to_matrix, matrix_to_quat


@dataclass(frozen=True, eq=False)
class PlainMechanism:
    """The relaxation's expressions, in the world frame.

    Attributes:
        problem: whose.
        intervals: by joint, where a hinge or slide may be.
        rotations: by link, (3, 3); links tied by slides share one.
        origins: by link, (3,).
        forms: by the link whose rotation it is.
        slides: by joint.
        floating: by joint, the origin of a floating body (3,).
    """

    problem: MechanismProblem
    intervals: tuple[tuple[float, float], ...]
    rotations: tuple[Expression, ...]
    origins: tuple[Expression, ...]
    forms: Mapping[int, Form]
    slides: Mapping[int, Slide]
    floating: Mapping[int, Expression]

    @property
    def expressions(self) -> Expressions:
        """Points and rotations of frames and values of slides, as users' constraints have them."""
        return Expressions(
            self.problem.mechanism,
            lambda link: self.rotations[link],
            lambda link: self.origins[link],
            lambda joint: self.slides[joint].value,
        )

    @property
    def blocks(self) -> list[tuple[Expression, float]]:
        """Matrices that have rank 1 at a configuration, with their traces; nan: only their sum is a constant."""
        rotations = [(form.block, form.trace) for form in self.forms.values()]
        return rotations + [(block, np.nan) for slide in self.slides.values() for block in slide.blocks]

    @property
    def gaps(self) -> Array:
        """For each block 1 - (largest eigenvalue / trace), at the values of the last solve."""
        values = [np.linalg.eigvalsh(block.value) for block, _ in self.blocks]
        return np.array([1.0 - found[-1] / found.sum() for found in values])

    def put(self, q: Array) -> None:
        """Give all variables the values that they have at a configuration (size,)."""
        mechanism = self.problem.mechanism
        placed = place(mechanism, mechanism.configuration(q))
        for link, form in self.forms.items():
            form.put(placed.R[link])
        for joint, slide in self.slides.items():
            value = float(placed.q[mechanism.value_slices[joint].start])
            slide.put(value, placed.R[joint + 1] @ mechanism.joints[joint].axis)
        for joint, origin in self.floating.items():
            origin.value = placed.p[joint + 1]

    def configuration(self) -> Array:
        """The configuration (size,) at the values of the last solve; true where all blocks have rank 1."""
        mechanism = self.problem.mechanism
        R = [rotation.value for rotation in self.rotations]
        q = np.array(mechanism.neutral)
        for k, (joint, at) in enumerate(zip(mechanism.joints, mechanism.value_slices, strict=True)):
            if joint.kind == "slide":
                q[at] = self.slides[k].value.value
            elif joint.kind == "free":
                q[at] = np.concatenate([self.floating[k].value, matrix_to_quat(R[k + 1])])
            else:
                turn = (R[joint.parent] @ joint.T_parent_joint.rotation).T @ R[k + 1]
                q[at] = (
                    matrix_to_quat(turn) if joint.kind == "ball" else _angle(joint, turn, self.intervals[k])
                )
        return q


def _angle(joint: Joint, turn: Array, interval: tuple[float, float]) -> float:
    """A hinge's angle of a rotation (3, 3) about its axis, where its interval is."""
    F = frame_with_z(joint.axis)
    across = F.T @ turn @ F
    angle = float(np.arctan2(across[1, 0] - across[0, 1], across[0, 0] + across[1, 1]))
    middle = 0.5 * sum(interval)
    return (
        angle + 2 * np.pi * float(np.round((middle - angle) / (2 * np.pi))) if np.isfinite(middle) else angle
    )


def plain_variables(problem: MechanismProblem, form: FormName, slide: SlideName) -> PlainMechanism:
    """A rotation for every link that turns by itself, a lift for every slide, an origin for what floats.

    Raises:
        InputError: no such form or lift of slides; a slide without limits on a link that turns.
    """
    import cvxpy as cp

    mechanism = problem.mechanism
    intervals = joint_intervals(problem)
    rotations: list[Expression] = [cp.Constant(np.eye(3))]
    origins: list[Expression] = [cp.Constant(np.zeros(3))]
    node: list[tuple[int, Array]] = [(0, np.eye(3))]
    forms: dict[int, Form] = {}
    slides: dict[int, Slide] = {}
    floating: dict[int, Expression] = {}
    for k, joint in enumerate(mechanism.joints):
        T, link = joint.T_parent_joint, k + 1
        lower, upper = intervals[k]
        held = joint.kind == "hinge" and lower == upper
        if joint.kind == "slide" or held:
            turn = axis_angle_to_matrix(joint.axis, lower) if held else np.eye(3)
            root, within = node[joint.parent]
            node.append((root, within @ T.rotation @ turn))
            rotations.append(rotations[joint.parent] @ (T.rotation @ turn))
        else:
            forms[link] = new_form(form)
            node.append((link, np.eye(3)))
            rotations.append(forms[link].rotation)
        if joint.kind == "free":
            floating[k] = cp.Variable(3)
            origins.append(floating[k])
            continue
        origin = origins[joint.parent] + rotations[joint.parent] @ T.position
        if joint.kind == "slide":
            root, within = node[link]
            direction = rotations[link] @ joint.axis
            slides[k] = new_slide(
                slide, forms.get(root), within @ joint.axis, direction, *_ordered(lower, upper)
            )
            origin = origin + slides[k].product
        origins.append(origin)
    return PlainMechanism(problem, intervals, tuple(rotations), tuple(origins), forms, slides, floating)


def _ordered(lower: float, upper: float) -> tuple[float, float]:
    """An interval that is not empty: what is wrong with the other is said by a row."""
    return lower, max(lower, upper)


def joint_intervals(problem: MechanismProblem) -> tuple[tuple[float, float], ...]:
    """Where each hinge and slide may be: limits, `max_step` around `q_reference`, and what it is held at."""
    mechanism = problem.mechanism
    held = {one.joint: float(one.coefficients[0]) for one in mechanism.followers if one.leader < 0}
    found = []
    for k, joint in enumerate(mechanism.joints):
        lower, upper = joint.lower, joint.upper
        if joint.kind in ("hinge", "slide"):
            if k in held:
                lower, upper = max(lower, held[k]), min(upper, held[k])
            if problem.max_step is not None and problem.q_reference is not None:
                middle = float(problem.q_reference[mechanism.value_slices[k].start])
                step = float(np.asarray(problem.max_step)[mechanism.rate_slices[k].start])
                lower, upper = max(lower, middle - step), min(upper, middle + step)
        found.append((float(lower), float(upper)))
    return tuple(found)
