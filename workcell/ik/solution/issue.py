"""Makes the small proof that goes with a configuration: a box around it, as wide as a solution is away."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from workcell.ik.certificate import Certificate, problem_hash
from workcell.ik.problem import IKProblem
from workcell.ik.solution.box import Stance
from workcell.ik.solution.check import KIND, statement, wrong_box
from workcell.pose import Array

_WIDENINGS = 2
_SPARE = 1.01
_LEAST = 1e-12
"""Radians: a box is wider than rounding."""
_NEAR = 1e-3
"""Radians from a limit within which another joint is moved, where there is a choice."""


def certify_solution(problem: IKProblem, q: Array) -> Certificate | None:
    """The proof that goes with a configuration (n,), or None where it can't be shown that q is one.

    It shows that a solution is in the box, else, near singularities and for fewer than six joints, and where that box
    would not be clear, only that all of a tiny box around q is within the tolerances.
    """
    middle = np.array(q, dtype=float)
    stance = Stance.at(problem, middle)
    if isinstance(stance, str):
        return None
    allowed = problem.tolerances
    tolerances = np.array([allowed.position, allowed.rotation, allowed.safety_margin])
    for joints, inverse, half in (_around_solution(problem, stance, middle), _around(len(middle))):
        data = {
            "middle": middle,
            "half": half,
            "joints": joints.astype(float),
            "inverse": inverse,
            "tolerances": tolerances,
        }
        if half.max(initial=0.0) < 1.0 and wrong_box(problem, stance, data) is None:
            return Certificate(KIND, KIND, statement(data), allowed.position, problem_hash(problem), data)
    return None


def _around(n: int) -> tuple[NDArray[np.int64], Array, Array]:
    """A tiny box, in which no solution is shown."""
    return np.zeros(0, dtype=np.int64), np.zeros((0, 0)), np.full(n, _LEAST)


def _around_solution(
    problem: IKProblem, stance: Stance, middle: Array
) -> tuple[NDArray[np.int64], Array, Array]:
    """Six joints, the inverse of the derivatives by them, and half widths that Newton's step keeps within."""
    n = len(middle)
    joints = _pivots(stance.slopes, problem.robot.lower, problem.robot.upper, middle)
    if len(joints) < 6:
        return _around(n)
    try:
        inverse: Array = np.asarray(np.linalg.inv(stance.slopes[:, joints]), dtype=float)
    except np.linalg.LinAlgError:
        return _around(n)
    half: Array = np.full(n, _LEAST)
    for _ in range(_WIDENINGS):
        half[joints] = np.maximum(_SPARE * stance.image(joints, inverse, half), _LEAST)
        if not half.max() < 1.0:
            return _around(n)
    half[joints] *= _SPARE
    return joints, inverse, half


def _pivots(slopes: Array, lower: Array, upper: Array, middle: Array) -> NDArray[np.int64]:
    """(6,) joints whose columns of the derivatives (6, n) are most independent, in order; all of fewer."""
    from scipy.linalg import qr

    n = slopes.shape[1]
    if n <= 6:
        return np.arange(n)
    room = np.minimum(middle - lower, upper - middle)
    order = qr(slopes * np.clip(room / _NEAR, 1e-3, 1.0), mode="r", pivoting=True)[1]
    chosen: NDArray[np.int64] = np.sort(order[:6])
    return chosen.astype(np.int64)
