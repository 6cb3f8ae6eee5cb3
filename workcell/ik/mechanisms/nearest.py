"""To the closest configuration about one: the squared pose errors downhill, with all else kept.

Newton steps along what ties, directions and regions leave open, each brought back onto them by the polish. Limits of
hinges, slides and places hold exactly; what else has room (regions, limits of balls, spheres) is brought back to where
it holds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workcell.ik.mechanisms.polish import (
    LONGEST_STEP,
    MechanismPolished,
    More,
    polish_mechanism,
    residuals_of,
)
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.residuals import Residuals, Rows
from workcell.model.mechanism.placing import Placed, difference, moved, place
from workcell.pose import Array, read_only

KEPT = 1e-7
"""Metres (radians) that what has to hold may be missed by."""
_LEAST_GAIN = 1e-7
"""Share of the cost that a step must gain to be followed by another of its kind."""
_FLAT = 1e-8
"""Slope of the cost along what is open that is none."""
_LEAST_BEND = 1e-3
"""Curvature that a step counts on at least, so that it is no longer than a slope of one and this give."""
_PROBE = 1e-6
"""Step of the tangent over which curvatures are measured."""
_SAME = 1e-6
"""Share of the largest singular value of what has to hold below which rows say the same."""
_NEAR = (1e-2, 1e-4, 1e-7)
"""Radians or metres from a limit, in turn, that are at it."""
_TRIALS = 6
_BACK = 20
"""Steps of the polish that brings a step back."""


@dataclass(frozen=True, slots=True)
class Nearest:
    """A configuration with the goals' poses as near as it gets downhill.

    Attributes:
        q: (size,) within the limits of its joints.
        cost: sum of the squared errors of positions (metres) and rotations (entries), Eq. 36.
        worst: what ties and all else that has to hold are missed by, at most, metres or radians.
        moved: the largest change of a number of the tangent, radians or metres.
        steps: how many were made.
    """

    q: Array
    cost: float
    worst: float
    moved: float
    steps: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "q", read_only(self.q))


def without_poses(problem: MechanismProblem) -> MechanismProblem:
    """The question with goals' positions and rotations left aside; directions, regions and all else stay."""
    goals = tuple(
        replace(goal, position=None, rotation=None) for goal in problem.goals if goal.direction is not None
    )
    return replace(problem, goals=goals)


def pose_cost(problem: MechanismProblem, q: ArrayLike) -> float:
    """The sum of the squared errors of all goals' positions and rotations (Eq. 36) at a configuration (size,)."""
    mechanism = problem.mechanism
    value = _Errors(problem).at(place(mechanism, mechanism.configuration(q)))[0]
    return float(value @ value)


def nearest_mechanism(
    problem: MechanismProblem, q: ArrayLike, *, steps: int = 40, more: More | None = None
) -> Nearest:
    """Move a configuration to where goals' poses are as near as they get downhill, with all else of a problem kept.

    Users' constraints and collisions are not looked at, unless `more` does.

    Args:
        problem: what is asked; its goals need not be within reach.
        q: (size,) to begin at; it is brought to where ties and all else hold first.
        steps: at most.
        more: as of `polish_mechanism`.

    Raises:
        InputError: no configuration.
    """
    return _Descent(problem, more).run(problem.mechanism.configuration(q), steps)


class _Errors:
    """What positions and rotations of goals are off."""

    def __init__(self, problem: MechanismProblem) -> None:
        self._goals = problem.goals
        self._frames = [problem.mechanism.frame(goal.frame) for goal in problem.goals]
        self._links = np.array([frame.link for frame in self._frames], dtype=np.int64)
        self._local = np.array([frame.T_link_frame.position for frame in self._frames]).reshape(-1, 3)
        self._dof = problem.mechanism.dof

    def at(self, placed: Placed) -> tuple[Array, Array]:
        """Errors (m,), metres and entries of rotations, and their derivatives (m, dof)."""
        values, slopes = [np.zeros(0)], [np.zeros((0, self._dof))]
        if not len(self._links):
            return values[0], slopes[0]
        points = placed.points(self._links, self._local)
        linear, angular = placed.jacobians(self._links, points)
        for k, (goal, frame) in enumerate(zip(self._goals, self._frames, strict=True)):
            if goal.position is not None:
                values.append(points[k] - goal.position)
                slopes.append(linear[k])
            if goal.rotation is not None:
                R = placed.R[frame.link] @ frame.T_link_frame.rotation
                values.append((R - goal.rotation).ravel())
                turned = np.cross(angular[k].T[:, :, None], R[None], axis=1)
                slopes.append(turned.reshape(self._dof, 9).T)
        return np.concatenate(values), np.concatenate(slopes)


@dataclass(frozen=True, slots=True)
class _Here:
    """A configuration that keeps what has to hold, its cost and the slope (dof,), and what has to hold."""

    q: Array
    cost: float
    slope: Array
    rows: Rows


class _Descent:
    def __init__(self, problem: MechanismProblem, more: More | None) -> None:
        self.mechanism = problem.mechanism
        self._kept = without_poses(problem)
        self._residuals: Residuals = residuals_of(self._kept)
        self._errors, self._more = _Errors(problem), more

    def run(self, begin: Array, steps: int) -> Nearest:
        """Downhill until it is flat, with what is within ever less of its limit counted as at it."""
        back = self._back(begin, 3 * _BACK)
        here, made = self._here(back.q), 0
        for near in _NEAR if back.worst <= KEPT else ():
            while made < steps:
                found = self._step(here, near)
                made += 1
                if found is None:
                    break
                gained = here.cost - found[0].cost
                here, back = found
                if not gained > _LEAST_GAIN * here.cost:
                    break
        changed = np.abs(difference(self.mechanism, begin, here.q)).max(initial=0.0)
        return Nearest(here.q, here.cost, back.worst, float(changed), made)

    def _back(self, q: Array, steps: int = _BACK) -> MechanismPolished:
        return polish_mechanism(self._kept, q, steps=steps, more=self._more)

    def _rows(self, q: Array) -> Rows:
        rows = self._residuals.at(q)
        if self._more is None:
            return rows
        value, slope = self._more(rows)
        return Rows(rows.placed, np.concatenate([rows.value, value]), np.concatenate([rows.slope, slope]))

    def _here(self, q: Array) -> _Here:
        rows = self._rows(q)
        error, slopes = self._errors.at(rows.placed)
        return _Here(q, float(error @ error), 2.0 * error @ slopes, rows)

    def _step(self, here: _Here, near: float) -> tuple[_Here, MechanismPolished] | None:
        """The next configuration; None: none is lower."""
        q = self._at_limits(here.q, near)
        rows = self._ahead(here, near)
        free = ~self._residuals.held(q, np.zeros(len(here.slope)))
        Z = _null(rows.slope, free)
        for _ in range(len(free)):
            along = Z @ (Z.T @ here.slope)
            stuck = self._residuals.held(q, along) & free
            if not stuck.any():
                break
            free &= ~stuck
            Z = _null(rows.slope, free)
        step = np.where(free, 0.0, difference(self.mechanism, here.q, q))
        if rows is not here.rows:  # up to what it would break, no further
            step[free] -= np.linalg.lstsq(rows.slope[:, free], rows.value + rows.slope @ step, rcond=_SAME)[0]
        slope = Z.T @ here.slope
        if not max(np.abs(slope).max(initial=0.0), np.abs(step).max(initial=0.0)) > _FLAT:
            return None
        values, vectors = np.linalg.eigh(self._bends(here, Z))
        bend = np.maximum(np.abs(values), _LEAST_BEND)
        return self._lower(here, step - Z @ (vectors @ ((vectors.T @ slope) / bend)))

    def _ahead(self, here: _Here, near: float) -> Rows:
        """What has to hold, with inequalities that going so far downhill would break, as it is here."""
        ahead = -near / max(float(np.abs(here.slope).max(initial=0.0)), 1e-300) * here.slope
        rows = self._rows(moved(self.mechanism, here.q, ahead))
        if len(rows.value) == len(here.rows.value):
            return here.rows
        return Rows(here.rows.placed, rows.value - rows.slope @ ahead, rows.slope)

    def _lower(self, here: _Here, step: Array) -> tuple[_Here, MechanismPolished] | None:
        """Where a step or a part of it leads, brought back to what has to hold, if it is lower there."""
        step = step * min(1.0, LONGEST_STEP / max(float(np.abs(step).max(initial=0.0)), 1e-300))
        for _ in range(_TRIALS):
            there = self._residuals.clipped(moved(self.mechanism, here.q, step))
            back = self._back(there)
            if back.worst <= KEPT:
                found = self._here(np.array(back.q))
                if found.cost < here.cost - 1e-15:
                    return found, back
            step = 0.25 * step
        return None

    def _at_limits(self, q: Array, near: float) -> Array:
        """The configuration with what is near a limit exactly there."""
        own, found = self._residuals.value_of >= 0, np.array(q)
        at = self._residuals.value_of[own]
        for limit in (self._residuals.lower[own], self._residuals.upper[own]):
            found[at] = np.where(np.abs(found[at] - limit) < near, limit, found[at])
        return found

    def _bends(self, here: _Here, Z: Array) -> Array:
        """(k, k) curvature of the cost along what is open, that of what has to hold taken into account."""
        weights = -np.linalg.lstsq(here.rows.slope.T, here.slope, rcond=_SAME)[0]
        H = np.zeros((len(here.slope), Z.shape[1]))
        for k, column in enumerate(Z.T):
            there = self._here(moved(self.mechanism, here.q, _PROBE * column))
            H[:, k] = there.slope - here.slope
            if there.rows.slope.shape == here.rows.slope.shape:  # else another inequality begins to count
                H[:, k] += weights @ (there.rows.slope - here.rows.slope)
        bends: Array = Z.T @ H / _PROBE
        return 0.5 * (bends + bends.T)


def _null(J: Array, free: NDArray[np.bool_]) -> Array:
    """Orthonormal columns (dof, k) that rows J (r, dof) leave open among what is free."""
    Z = np.zeros((len(free), 0))
    if not free.any():
        return Z
    _, values, V = np.linalg.svd(J[:, free], full_matrices=True)
    rank = int(np.count_nonzero(values > _SAME * max(float(values.max(initial=0.0)), 1e-12)))
    Z = np.zeros((len(free), len(V) - rank))
    Z[free] = V[rank:].T
    return Z
