"""Plain multi-start for mechanisms: Levenberg-Marquardt on all that is asked, from random configurations.

The honest baseline: ties, goals and regions as least squares within the joints' limits, with a hinge on penetration
where there is a cover, until the judge accepts or the budget ends.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from workcell import clock
from workcell.ik.mechanisms.judge import MechanismJudge
from workcell.ik.mechanisms.penetration import Penetration
from workcell.ik.mechanisms.polish import polish_mechanism
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.result import MechanismCandidate
from workcell.ik.mechanisms.sampling import random_configuration, reach_of
from workcell.ik.problem import Budget
from workcell.ik.result import NEAR_MISSES
from workcell.model.mechanism.placing import difference, moved
from workcell.pose import Array

SOLVER = "multistart"
STARTS_A_SECOND = 100
"""Starts that one quiet core makes in a second, about."""
STEPS = 100
"""Of one start."""
HINGE_WEIGHT = 0.5
"""Weight of a metre of penetration beside one of the rest: a start reaches its goals first and then slides clear."""
FORGIVEN = (0.0, 1.0, 0.0, None)
"""Of starts in turn, where the compiled model decides: the share of the spheres' overshoot that they are let off.

None: no spheres at all."""

NEARNESS = (1.0, 0.5)
"""Of random starts in turn: how far from home, as a share of the way to anywhere within the limits."""


def solve_mechanism_multistart(
    problem: MechanismProblem,
    budget: Budget,
    seed: int = 0,
    user: Callable[[Array], list[str]] | None = None,
) -> MechanismCandidate:
    """Look for a configuration by local search from random starts until the judge accepts or the budget is spent.

    The first start is `problem.q_reference`, or the mechanism's home. The same seed makes the same starts. Users'
    constraints are judged, not searched for.

    Args:
        problem: what is asked.
        budget: seconds, or starts (`iterations`, or its effort).
        seed: of the starts.
        user: as of `judge_mechanism`.
    """
    rng, mechanism = np.random.default_rng(seed), problem.mechanism
    judge, reach = MechanismJudge(problem), reach_of(mechanism)
    hinges = _hinges(problem)
    home = mechanism.home if problem.q_reference is None else problem.q_reference
    deadline = clock.cpu_seconds() + budget.cpu_s
    most = budget.iterations or budget.work(STARTS_A_SECOND)
    starts = steps = 0
    misses: dict[str, float] = {}
    while starts < most and (starts == 0 or clock.cpu_seconds() < deadline):
        if budget.cpu_s <= 0:
            break
        start = home
        if starts > 0:
            anywhere = random_configuration(mechanism, rng, reach=reach)
            share = NEARNESS[starts // len(hinges) % len(NEARNESS)]
            start = moved(mechanism, home, share * difference(mechanism, home, anywhere))
        hinge = hinges[starts % len(hinges)]
        found = polish_mechanism(problem, start, steps=STEPS, more=hinge)
        starts, steps = starts + 1, steps + found.steps
        if hinge is not None:  # what spheres still push aside, ties and goals decide
            found = polish_mechanism(problem, found.q)
            steps += found.steps
        verdict = judge(found.q, user)
        if verdict.accepted:
            stats = {"starts": float(starts), "iterations": float(steps)}
            return MechanismCandidate(np.array(found.q), stats=stats)
        reason = "; ".join(verdict.reasons[:3])
        misses[reason] = min(found.worst, misses.get(reason, np.inf))
    nearest = tuple(sorted(misses, key=misses.__getitem__)[:NEAR_MISSES])
    return MechanismCandidate(stats={"starts": float(starts), "iterations": float(steps)}, rejected=nearest)


def _hinges(problem: MechanismProblem) -> list[Penetration | None]:
    decides = problem.mechanism.compiled is not None and problem.collisions
    found: list[Penetration | None] = []
    for share in FORGIVEN if decides else FORGIVEN[:1]:
        hinge = None if share is None else Penetration(problem, weight=HINGE_WEIGHT, forgiven=share)
        found.append(None if hinge is None or hinge.nothing else hinge)
    return found
