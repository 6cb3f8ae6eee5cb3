"""What a mechanism's configuration misses of a problem, as rows of metres and radians with their derivatives.

Equalities are rows always; what has room (regions, cones, limits of balls and sums, bounds on turns) only where it is
broken. Limits of hinges, slides and places are no rows: they are `lower` and `upper`, for whoever steps to keep.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.model.mechanism.mechanism import Mechanism
from workcell.model.mechanism.placing import Placed, difference, missed, place
from workcell.pose import Array, quat_to_matrix, rotation_vector

_LEAST_SINE = 0.1
"""Of a cone's angle, where a cosine is taken for an angle."""


@dataclass(frozen=True, slots=True)
class Rows:
    """What is missed at a configuration.

    Attributes:
        placed: the links there.
        value: (r,) metres and radians.
        slope: (r, dof) its derivatives.
    """

    placed: Placed
    value: Array
    slope: Array

    @property
    def worst(self) -> float:
        """The largest of them."""
        return float(np.abs(self.value).max(initial=0.0))


class Residuals:
    """A problem's rows at any configuration.

    Attributes:
        lower, upper: (dof,) of the numbers that have limits of their own, infinite for the others.
        value_of: (dof,) where in a configuration a number is that a number of the tangent changes alone; -1: in none.
    """

    def __init__(self, problem: MechanismProblem) -> None:
        self.problem, self.mechanism = problem, problem.mechanism
        self.value_of, self.lower, self.upper = _interval(problem)
        frames = [self.mechanism.frame(goal.frame) for goal in problem.goals]
        regions = [self.mechanism.frame(region.frame) for region in problem.regions]
        self._links = np.array([frame.link for frame in (*frames, *regions)], dtype=np.int64)
        self._local = np.array(
            [frame.T_link_frame.position for frame in frames]
            + [
                frame.T_link_frame.apply(region.point)
                for frame, region in zip(regions, problem.regions, strict=True)
            ]
        ).reshape(-1, 3)
        self._turned = [frame.T_link_frame.rotation for frame in frames]
        self._balls = [
            (at, rate, joint.upper)
            for joint, at, rate in zip(
                self.mechanism.joints,
                self.mechanism.value_slices,
                self.mechanism.rate_slices,
                strict=True,
            )
            if joint.kind == "ball" and np.isfinite(joint.upper)
        ]
        reference = problem.q_reference
        turning = problem.max_link_rotation is not None and reference is not None
        self._before = place(self.mechanism, reference).R if turning and reference is not None else None

    def at(self, q: Array) -> Rows:
        """The rows at a configuration (size,)."""
        placed = place(self.mechanism, q)
        value, slope = missed(placed)
        values, slopes = [value], [slope]
        if len(self._links):
            points = placed.points(self._links, self._local)
            linear, angular = placed.jacobians(self._links, points)
            for k in range(len(self.problem.goals)):
                self._goal(k, placed, points[k], linear[k], angular[k], values, slopes)
            for k, region in enumerate(self.problem.regions, start=len(self.problem.goals)):
                over = region.A @ points[k] - region.b
                kept = region.equal | (over > 0.0)
                values.append(over[kept])
                slopes.append(region.A[kept] @ linear[k])
        self._hinges(placed, values, slopes)
        return Rows(placed, np.concatenate(values), np.concatenate(slopes))

    def clipped(self, q: Array) -> Array:
        """The configuration with what has limits of its own within them."""
        found, own = np.array(q, dtype=float), self.value_of >= 0
        at = self.value_of[own]
        found[at] = np.clip(found[at], self.lower[own], np.maximum(self.lower[own], self.upper[own]))
        return found

    def held(self, q: Array, gradient: Array) -> NDArray[np.bool_]:
        """(dof,) which numbers are at a limit that going down a gradient (dof,) would lead beyond."""
        own = self.value_of >= 0
        here = np.where(own, q[np.maximum(self.value_of, 0)], 0.0)
        beyond: NDArray[np.bool_] = own & (
            ((here <= self.lower) & (gradient > 0)) | ((here >= self.upper) & (gradient < 0))
        )
        return beyond | (own & (self.lower >= self.upper))

    def _goal(
        self,
        k: int,
        placed: Placed,
        point: Array,
        linear: Array,
        angular: Array,
        values: list[Array],
        slopes: list[Array],
    ) -> None:
        goal = self.problem.goals[k]
        if goal.position is not None:
            values.append(point - goal.position)
            slopes.append(linear)
        R = placed.R[self._links[k]] @ self._turned[k]
        if goal.rotation is not None:
            values.append(rotation_vector(R @ goal.rotation.T))
            slopes.append(angular)
        if goal.axis is None or goal.direction is None:
            return
        axis = R @ goal.axis
        if goal.within == 0.0:
            values.append(axis - goal.direction)
            slopes.append(-_cross(axis) @ angular)
            return
        over = np.cos(goal.within) - axis @ goal.direction
        if over > 0.0:
            scale = max(np.sin(goal.within), _LEAST_SINE)
            values.append(np.array([over / scale]))
            slopes.append((_cross(goal.direction) @ axis @ angular / scale)[None])

    def _hinges(self, placed: Placed, values: list[Array], slopes: list[Array]) -> None:
        mechanism, q = self.mechanism, placed.q
        for at, rate, upper in self._balls:
            vector = rotation_vector(quat_to_matrix(q[at]))
            angle = float(np.linalg.norm(vector))
            if angle > upper:
                row = np.zeros((1, mechanism.dof))
                row[0, rate] = vector / angle
                values.append(np.array([angle - upper]))
                slopes.append(row)
        for total in mechanism.sums:
            if total.lower != total.upper:
                row = np.zeros((1, mechanism.dof))
                length = 0.0
                for joint, multiple in zip(total.joints, total.multiples, strict=True):
                    length += float(multiple * q[mechanism.value_slices[joint].start])
                    row[0, mechanism.rate_slices[joint]] += multiple
                if not total.lower <= length <= total.upper:
                    values.append(np.array([length - np.clip(length, total.lower, total.upper)]))
                    slopes.append(row)
        self._bounded_turns(placed, values, slopes)

    def _bounded_turns(self, placed: Placed, values: list[Array], slopes: list[Array]) -> None:
        """Of the reference: balls' parts of `max_step`, and `max_link_rotation`."""
        problem, mechanism = self.problem, self.mechanism
        if problem.q_reference is None:
            return
        if problem.max_step is not None and np.any(self.value_of < 0):
            step = np.asarray(problem.max_step)
            apart = difference(mechanism, problem.q_reference, placed.q)
            over = np.flatnonzero((self.value_of < 0) & (np.abs(apart) > step))
            values.append(apart[over] - np.sign(apart[over]) * step[over])
            slopes.append(np.eye(mechanism.dof)[over])
        if self._before is None or problem.max_link_rotation is None:
            return
        most = 2.0 * np.arcsin(min(problem.max_link_rotation / np.sqrt(8.0), 1.0))
        vectors = rotation_vector(placed.R @ self._before.swapaxes(1, 2))
        angles = np.linalg.norm(vectors, axis=1)
        links = np.flatnonzero(angles > most)
        if len(links):
            angular = placed.jacobians(links, placed.p[links])[1]
            axes = vectors[links] / angles[links, None]
            values.append(angles[links] - most)
            slopes.append((axes[:, None] @ angular)[:, 0])


def _cross(a: Array) -> Array:
    """The matrix (3, 3) of the cross product with a vector (3,)."""
    x, y, z = a.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _interval(problem: MechanismProblem) -> tuple[NDArray[np.int64], Array, Array]:
    """Where in a configuration each number of the tangent is, and its limits, cut with `max_step`."""
    mechanism: Mechanism = problem.mechanism
    value_of = np.full(mechanism.dof, -1, dtype=np.int64)
    lower, upper = np.full(mechanism.dof, -np.inf), np.full(mechanism.dof, np.inf)
    for joint, at, rate in zip(mechanism.joints, mechanism.value_slices, mechanism.rate_slices, strict=True):
        if joint.kind in ("hinge", "slide"):
            value_of[rate.start], lower[rate.start], upper[rate.start] = at.start, joint.lower, joint.upper
        elif joint.kind == "free":
            value_of[rate.start : rate.start + 3] = np.arange(at.start, at.start + 3)
    if problem.max_step is not None and problem.q_reference is not None:
        own = value_of >= 0
        here, step = problem.q_reference[value_of[own]], np.asarray(problem.max_step)[own]
        lower[own], upper[own] = np.maximum(lower[own], here - step), np.minimum(upper[own], here + step)
    return value_of, lower, upper
