"""From a configuration near an answer to one: damped Gauss-Newton on all that a problem asks, limits kept.

Ties that say the same, and joints that none of them determines, are no trouble: what the rows leave open stays where it
is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from workcell.identity_cache import ByIdentity
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.residuals import Residuals, Rows
from workcell.model.mechanism.placing import difference, moved
from workcell.pose import Array, read_only

DONE = 1e-13
"""Metres (radians) that are rounding."""
LONGEST_STEP = 0.7
"""Radians or metres that a number of the tangent changes at most in one step."""
_DAMPING, _LEAST, _MOST = 1e-3, 1e-9, 1e6
_FLOOR = 1e-13
"""Share of the largest of J J^T that is added where rows say the same."""
_STALLED = 8
"""Steps within which the cost must halve."""

More = Callable[[Rows], tuple[Array, Array]]


@dataclass(frozen=True, slots=True)
class MechanismPolished:
    """A polished configuration.

    Attributes:
        q: (size,) within the limits of its joints.
        worst: the largest of what is still missed, metres or radians.
        moved: the largest change of a number of the tangent, radians or metres.
        steps: how many were made.
    """

    q: Array
    worst: float
    moved: float
    steps: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "q", read_only(self.q))


def polish_mechanism(
    problem: MechanismProblem, q: ArrayLike, *, steps: int = 60, more: More | None = None
) -> MechanismPolished:
    """Move a configuration to where ties, goals, regions and limits are kept, as near as it can be reached downhill.

    Users' constraints and collisions are not looked at, unless `more` does.

    Args:
        problem: what is asked.
        q: (size,) to begin at.
        steps: at most.
        more: further rows (r,) and their derivatives (r, dof), where they are broken.

    Raises:
        InputError: no configuration.
    """
    mechanism, residuals = problem.mechanism, residuals_of(problem)
    begin = mechanism.configuration(q)
    here = residuals.clipped(begin)
    rows = _rows(residuals, here, more)
    cost, damping, milestone, age, made = float(rows.value @ rows.value), _DAMPING, np.inf, 0, 0
    while made < steps and rows.worst > DONE and damping <= _MOST:
        if age >= _STALLED:
            if cost > 0.5 * milestone:
                break
            age = 0
        if age == 0:
            milestone = cost
        step = _step(residuals, here, rows, damping * np.sqrt(cost))
        there = residuals.clipped(moved(mechanism, here, step))
        trial = _rows(residuals, there, more)
        made, age = made + 1, age + 1
        better = float(trial.value @ trial.value)
        if better < cost:
            here, rows, cost = there, trial, better
            damping = max(0.2 * damping, _LEAST)
        else:
            damping = 5.0 * damping
            if not np.abs(step).max(initial=0.0) > 1e-15:
                break
    changed = np.abs(difference(mechanism, begin, here)).max(initial=0.0)
    return MechanismPolished(here, rows.worst, float(changed), made)


def _rows(residuals: Residuals, q: Array, more: More | None) -> Rows:
    rows = residuals.at(q)
    if more is None:
        return rows
    value, slope = more(rows)
    return Rows(rows.placed, np.concatenate([rows.value, value]), np.concatenate([rows.slope, slope]))


def _step(residuals: Residuals, q: Array, rows: Rows, damping: float) -> Array:
    """The damped step in what no limit holds; what it would push out of its limits is held in its turn."""
    free = ~residuals.held(q, rows.slope.T @ rows.value)
    step = np.zeros(len(free))
    for _ in range(2):
        step[:] = 0.0
        J = rows.slope[:, free]
        step[free] = -_damped(J, rows.value, damping)
        longest = np.abs(step).max(initial=0.0)
        if longest > LONGEST_STEP:
            step *= LONGEST_STEP / longest
        stuck = residuals.held(q, -step) & free
        if not stuck.any():
            break
        free &= ~stuck
    return step


def _damped(J: Array, value: Array, damping: float) -> Array:
    """(J^T J + damping)^-1 J^T value, by the smaller of the two systems."""
    few = len(value) <= J.shape[1]
    H = J @ J.T if few else J.T @ J
    diagonal = np.einsum("ii->i", H)
    diagonal += damping + _FLOOR * max(float(diagonal.max(initial=0.0)), 1.0)
    found: Array = np.asarray(np.linalg.solve(H, value if few else J.T @ value), dtype=float)
    return J.T @ found if few else found


_made = ByIdentity()


def residuals_of(problem: MechanismProblem) -> Residuals:
    """The problem's rows, remembered."""
    made: Residuals = _made.get((problem,), lambda: Residuals(problem))
    return made
