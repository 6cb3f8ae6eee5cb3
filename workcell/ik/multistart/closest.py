"""Plain multi-start for the closest configuration: local descents of the pose errors from random configurations.

The honest baseline beside the convex search: no bound, the best of what the judge accepts but for its poses.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from workcell import clock
from workcell.ik.mechanisms.judge import MechanismJudge
from workcell.ik.mechanisms.nearest import nearest_mechanism, without_poses
from workcell.ik.mechanisms.penetration import Penetration
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.result import MechanismCandidate
from workcell.ik.mechanisms.sampling import random_configuration, reach_of
from workcell.ik.problem import Budget
from workcell.ik.result import NEAR_MISSES
from workcell.pose import Array

DEFAULT_STARTS = 10
"""Descents where a budget says neither how many starts nor how much work: there is no knowing when to stop."""
STARTS_A_SECOND = 5
"""Starts that one quiet core makes in a second, about."""


def closest_multistart(
    problem: MechanismProblem,
    budget: Budget,
    seed: int = 0,
    user: Callable[[Array], list[str]] | None = None,
) -> MechanismCandidate:
    """The best of several local searches; the first from `problem.q_reference`, or the mechanism's home.

    Args:
        problem: what is asked; positions and rotations of its goals are the cost.
        budget: seconds, and starts (`iterations`, or its effort; default `DEFAULT_STARTS`).
        seed: of the starts.
        user: as of `judge_mechanism`.
    """
    rng, mechanism = np.random.default_rng(seed), problem.mechanism
    judge, reach = MechanismJudge(without_poses(problem)), reach_of(mechanism)
    hinge = Penetration(problem)
    deadline = clock.cpu_seconds() + budget.cpu_s
    counted = DEFAULT_STARTS if budget.effort is None else budget.work(STARTS_A_SECOND)
    most, starts = budget.iterations or counted, 0
    best: tuple[float, Array] | None = None
    misses: dict[str, None] = {}
    while starts < most and clock.cpu_seconds() < deadline:
        start = mechanism.home if problem.q_reference is None else problem.q_reference
        if starts > 0:
            start = random_configuration(mechanism, rng, reach=reach)
        starts += 1
        found = nearest_mechanism(problem, start, more=None if hinge.nothing else hinge)
        verdict = judge(found.q, user)
        if not verdict.accepted:
            misses.setdefault(verdict.reasons[0])
        elif best is None or found.cost < best[0]:
            best = found.cost, np.array(found.q)
    return MechanismCandidate(
        None if best is None else best[1],
        stats={"starts": float(starts)},
        rejected=tuple(misses)[:NEAR_MISSES],
    )
