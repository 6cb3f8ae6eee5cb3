"""Several solutions of one problem that differ: in the arm's posture, and by their distance in joint space."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from workcell import clock
from workcell.errors import InputError
from workcell.ik.diverse.posture import Posture, posture
from workcell.ik.hjcd.solver import collect_solutions
from workcell.ik.judge.verify import Verification, Verifier
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.result import IKResult, Status
from workcell.ik.solve import solve
from workcell.pose import Array

POOL = 4
"""Solutions collected for each that is asked for."""
DISTINCT = 0.05
"""Radians or metres by which two solutions differ in some joint, to count as two."""
SAMPLING = 0.5
"""Effort for samples, as of a `Budget` without one; the rest is the portfolio's, where they hold no solution."""


def solutions(
    problem: IKProblem, count: int, budget: Budget | None = None, seed: int = 0
) -> tuple[IKResult, ...]:
    """Up to `count` verified solutions that differ from each other.

    A pool of solutions is sampled from random seeds and along self-motion curves. From it, one of each posture
    (shoulder, elbow, wrist) is chosen first, then whatever lies farthest from those chosen before. No two are closer
    than `DISTINCT` in every joint. Where sampling finds nothing, the portfolio is asked for one.

    Args:
        problem: the question.
        count: how many are wanted.
        budget: CPU seconds of this process in total (default: 5 s), and the effort, of which samples have half.
        seed: same problem, count and seed, same solutions, as far as the budget reaches.

    Returns:
        `SOLVED` results, each accepted by `verify`, the first the one found first; none where none was found
        (`solve` says why). `stats` has the signs of the posture and the distance in joint space to the nearest other
        one.

    Raises:
        InputError: a count below 1.
    """
    if count < 1:
        raise InputError(f"{count} solutions are none", where="count", remedy="at least 1")
    budget = budget or Budget(effort=2 * SAMPLING)
    begun, judge = clock.cpu_seconds(), Verifier(problem)
    effort = SAMPLING if budget.effort is None else 0.5 * budget.effort
    pool = collect_solutions(problem, POOL * count, seed, replace(budget, effort=effort))
    pool = [problem.unwrapped(q) for q in pool]
    found = _judged(problem, judge, pool, count)
    if found:
        return found
    left = budget.cpu_s - (clock.cpu_seconds() - begun)
    rest = None if budget.effort is None else effort
    result = solve(problem, budget=replace(budget, cpu_s=max(left, 0.0), effort=rest), seed=seed)
    return (result,) if result.solved else ()


def _judged(problem: IKProblem, judge: Verifier, pool: list[Array], count: int) -> tuple[IKResult, ...]:
    """Results of those chosen from a pool of configurations (n,); without those that the judge refuses."""
    fixed, collected = ~problem.robot.repeats, len(pool)
    while pool:
        rows, postures = np.stack(pool), [posture(problem.robot, q) for q in pool]
        chosen = _choose(rows, postures, fixed, count)
        verdicts = [judge(rows[row]) for row in chosen]
        refused = {row for row, verdict in zip(chosen, verdicts, strict=True) if not verdict.accepted}
        if not refused:
            apart = _distances(rows[chosen], fixed) + np.diag(np.full(len(chosen), np.inf))
            return tuple(
                _result(verdict, rows[row], postures[row], float(nearest), collected)
                for row, verdict, nearest in zip(chosen, verdicts, apart.min(axis=1), strict=True)
            )
        pool = [q for row, q in enumerate(pool) if row not in refused]
    return ()


def _choose(q: Array, postures: list[Posture], fixed: NDArray[np.bool_], count: int) -> list[int]:
    """Rows of q (k, n): the first, then the farthest from those chosen, postures not seen yet before all others."""
    distance = _distances(q, fixed)
    chosen, seen = [0], {postures[0]}
    while len(chosen) < min(count, len(q)):
        nearest = distance[:, chosen].min(axis=1)
        if nearest.max() < DISTINCT:
            break
        fresh = np.array([item not in seen for item in postures]) & (nearest >= DISTINCT)
        row = int(np.where(fresh, nearest, -1.0).argmax() if fresh.any() else nearest.argmax())
        chosen.append(row)
        seen.add(postures[row])
    return chosen


def _distances(q: Array, fixed: NDArray[np.bool_]) -> Array:
    """Largest joint difference (k, k) of each two rows of q (k, n), what repeats modulo whole turns."""
    difference = np.abs(q[:, None] - q[None])
    turned = np.abs(difference - 2 * np.pi * np.round(difference / (2 * np.pi)))
    largest: Array = np.where(fixed, difference, turned).max(axis=-1)
    return largest


def _result(verdict: Verification, q: Array, signs: Posture, nearest: float, pool: int) -> IKResult:
    return IKResult(
        Status.SOLVED,
        "hjcd",
        q=q,
        position_error=verdict.position_error,
        rotation_error=verdict.rotation_error,
        clearance=verdict.clearance,
        stats={
            **{name: float(sign) for name, sign in signs._asdict().items()},
            "nearest_other": nearest,
            "pool": float(pool),
        },
    )
