"""What the tests of both convex solvers ask of a configuration."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from workcell.ik.ikspark.rank import RANK_GAP
from workcell.ik.judge.verify import verify
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.result import Candidate

MOST_MOVED = 1e-2
"""Radians that a polish may move a joint by where the convex method stands alone."""


def assert_reached(
    solver: Callable[..., Candidate], problem: IKProblem, seed: int = 0, **options: bool
) -> np.ndarray:
    """The solver's configuration: accepted by the judge, and read from a point of rank one unless found locally."""
    candidate = solver(problem, Budget(10.0), seed, **options)
    assert candidate.certificate is None and candidate.error is None
    assert candidate.q is not None, candidate.rejected
    verdict = verify(problem, candidate.q)
    assert verdict.accepted, verdict.reasons
    if not options.get("local"):
        assert candidate.stats["rank_gap"] < RANK_GAP
        assert candidate.stats["moved"] <= MOST_MOVED
    return candidate.q
