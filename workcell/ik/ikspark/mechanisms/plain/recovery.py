"""Algorithm 1 in cvxpy: the convex problem, then Problem 3 until every block has rank 1."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from workcell.ik.ikspark.mechanisms.plain.forms import FormName
from workcell.ik.ikspark.mechanisms.plain.model import PlainMechanism
from workcell.ik.ikspark.mechanisms.plain.relaxation import plain_relaxation, pose_cost
from workcell.ik.ikspark.mechanisms.plain.slides import SlideName
from workcell.ik.ikspark.rank import RANK_GAP
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.pose import Array

if TYPE_CHECKING:
    import cvxpy

_TIGHT = {"tol_gap_abs": 1e-9, "tol_gap_rel": 1e-9, "tol_feas": 1e-9}
_STALLED = 1e-6
"""eps_2 of Algorithm 1: blocks that move by less than this, all together, have stalled."""


_USABLE = ("optimal", "optimal_inaccurate")


@dataclass(frozen=True, slots=True)
class Recovered:
    """What came of a rank recovery.

    Attributes:
        q: (size,) the configuration, where every block has rank 1; None: there is none.
        status: cvxpy's, of the last solve: `infeasible` is the relaxation's verdict at the first.
        bound: least cost of Problem 2b, which no configuration is below; nan where it was not solved.
        gaps: the largest rank gap after each solve.
    """

    q: Array | None
    status: str
    bound: float
    gaps: tuple[float, ...]


def rank_recovery(
    problem: MechanismProblem,
    form: FormName = "quaternion",
    slide: SlideName = "split",
    *,
    longest: int = 50,
    seed: int | None = None,
) -> Recovered:
    """Algorithm 1 with Problem 3, from Problem 2b's minimiser, or from the point farthest in a random direction.

    Args:
        problem: the question.
        form, slide: see `plain_relaxation`.
        longest: most steps of Problem 3 (k_max).
        seed: of the random direction; None: Problem 2b.
    """
    question, model = plain_relaxation(problem, form, slide)
    bound = np.nan
    gaps: list[float] = []
    if seed is None:
        relaxed, start = plain_relaxation(problem, form, slide, reach=False)
        status = _solve(relaxed.constraints, pose_cost(start))
        if status not in _USABLE:
            return Recovered(None, status, bound, ())
        bound = float(pose_cost(start).value)
        tops, before = _tops(start), _values(start)
        gaps.append(float(start.gaps.max(initial=0.0)))
    else:
        rng = np.random.default_rng(seed)
        tops, before = [rng.standard_normal(block.shape) for block, _ in model.blocks], np.full(1, np.inf)
    for _ in range(longest):
        status = _solve(question.constraints, -_along(model, tops))
        if status not in _USABLE:
            return Recovered(None, status, bound, tuple(gaps))
        gaps.append(float(model.gaps.max(initial=0.0)))
        if gaps[-1] < RANK_GAP:
            return Recovered(model.configuration(), status, bound, tuple(gaps))
        now = _values(model)
        if np.linalg.norm(now - before) < _STALLED:
            break
        before, tops = now, _tops(model)
    return Recovered(None, status, bound, tuple(gaps))


def _values(model: PlainMechanism) -> Array:
    return np.concatenate([np.zeros(0), *[np.ravel(block.value) for block, _ in model.blocks]])


def _tops(model: PlainMechanism) -> list[Array]:
    """The gradients of the largest eigenvalues (Lemma 1)."""
    vectors = [np.linalg.eigh(block.value)[1][:, -1] for block, _ in model.blocks]
    return [np.outer(v, v) for v in vectors]


def _along(model: PlainMechanism, tops: list[Array]) -> Any:
    import cvxpy as cp

    products = [cp.sum(cp.multiply(top, block)) for (block, _), top in zip(model.blocks, tops, strict=True)]
    return cp.sum(products) if products else cp.Constant(0.0)


def _solve(constraints: list[Any], cost: Any) -> str:
    import cvxpy as cp

    question: cvxpy.Problem = cp.Problem(cp.Minimize(cost), constraints)
    question.solve(solver="CLARABEL", **_TIGHT)
    return str(question.status)
