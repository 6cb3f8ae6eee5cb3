"""Algorithm 1 of IKSPARK with Problem 3, as written: a start goes on until rank 1 or the last iteration."""

from __future__ import annotations

from dataclasses import dataclass

from workcell.ik.ikspark.instance import Instance
from workcell.ik.ikspark.rank import RANK_GAP, ConvexSet, linearise
from workcell.ik.judge.verify import Verification, verify
from workcell.ik.problem import IKProblem
from workcell.ik.result import IKResult, Status
from workcell.ik.shared.convex import MAX_POLISH
from workcell.ik.shared.polish import polish
from workcell.pose import Array


@dataclass(frozen=True, slots=True)
class Ascent:
    """The end of a start: the point x (N,), None where a cone program failed; its rank gap; cone programs solved."""

    x: Array | None
    gap: float
    programs: int

    @property
    def rank_one(self) -> bool:
        """Whether the point is a configuration."""
        return self.x is not None and self.gap < RANK_GAP


def ascend_to_rank_one(convex: ConvexSet, direction: Array, most: int) -> Ascent:
    """Problem 3 again and again, from the point of a convex set farthest along `direction` (N,).

    The solver's own ascents give up when a step has become slow; this one doesn't.
    """
    x, gap, programs = None, 1.0, 0
    while programs < most and gap >= RANK_GAP:
        solution = convex.solve(-direction)
        programs += 1
        if not solution.usable:
            return Ascent(None, gap, programs)
        x = solution.x
        gaps, direction = linearise(convex.lift, x)
        gap = float(gaps.max(initial=0.0))
    return Ascent(x, gap, programs)


def judged(problem: IKProblem, instance: Instance, ascent: Ascent, stats: dict[str, float]) -> IKResult:
    """The configuration at the end of an ascent, read as the solver does: a polish by 1e-2 rad or less, the judge."""
    q, verdict = None, Verification()
    if ascent.rank_one and ascent.x is not None:
        angles = instance.lift.angles(ascent.x, instance.goal)
        polished = polish(problem, problem.robot.unwrap(angles, instance.interval.middle))
        if polished.moved <= MAX_POLISH:
            q, verdict = polished.q, verify(problem, polished.q)
    return IKResult(
        Status.SOLVED if verdict.accepted else Status.NOT_FOUND,
        "ikspark",
        q=q if verdict.accepted else None,
        position_error=verdict.position_error,
        rotation_error=verdict.rotation_error,
        clearance=verdict.clearance,
        stats=stats,
        rejected=verdict.reasons,
    )
