"""One query's search: its budget, its ascents to rank 1, what it read there, and why near misses failed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workcell import clock
from workcell.geometry.types import FreeSpace
from workcell.ik.certificate import Certificate
from workcell.ik.ikspark.lift import Lift, goal_vector
from workcell.ik.ikspark.rank import ConvexSet, Iterate, ascend, linearise
from workcell.ik.ikspark.restart import LineRestarts
from workcell.ik.judge.verify import Verifier
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.result import NEAR_MISSES, Candidate
from workcell.ik.shared.convex import LOCAL_DAMPING, LOCAL_STEPS, MAX_POLISH
from workcell.ik.shared.limits import Interval
from workcell.ik.shared.polish import Polished, polish
from workcell.ik.stages import StageLog
from workcell.pose import Array

PROGRAMS_A_SECOND = 300
"""Cone programs, with what goes on between them, that one quiet core does in a second."""
GROWTH = 3
"""Cone programs that growing the free space counts as: about what it costs."""


@dataclass(frozen=True, slots=True, eq=False)
class Reached:
    """The end of an ascent.

    Attributes:
        x: (N,) the last point; None: the set is empty, or the solver failed.
        ray: a Farkas ray where the set was found empty.
        q: (n,) the configuration read from it; None where its rank is not one, or polish moved it too far.
        accepted: whether the judge accepts that.
    """

    x: Array | None
    ray: Array | None = None
    q: Array | None = None
    accepted: bool = False


class Search:
    """What all ways of searching share.

    Attributes:
        problem: the query.
        local: whether to descend locally from every iterate besides.
        most: work at most, in cone programs.
        rng: of all directions that are drawn.
        lines: where restarts begin on lines through the last point (Algorithm 2); None: at ends of random directions.
        stats, rejected, error, stages: for the report.
    """

    def __init__(self, problem: IKProblem, budget: Budget, seed: int, *, local: bool) -> None:
        self.problem, self._deadline, self.local = problem, clock.cpu_seconds() + budget.cpu_s, local
        self.most = budget.work(PROGRAMS_A_SECOND)
        self.rng = np.random.default_rng(seed)
        self._verifier: Verifier | None = None
        self.rejected: list[str] = []
        counts = (
            "sdps",
            "restarts",
            "growths",
            "rank_one",
            "rank_gap",
            "moved",
            "in_given",
            "own_rows",
            "lines",
        )
        self.stats = dict.fromkeys(counts, 0.0)
        self.error: str | None = None
        self._goal, self._interval = goal_vector(problem.T_base_tool), Interval.of(problem)
        self._fresh = True
        self._latest: Array | None = None
        self.lines: LineRestarts | None = None
        self.stages = StageLog()

    @property
    def work(self) -> float:
        """What has been done, in cone programs."""
        return self.stats["sdps"] + GROWTH * self.stats["growths"]

    def over(self) -> bool:
        """Whether the budget is spent."""
        return clock.cpu_seconds() >= self._deadline or self.work >= self.most

    def answer(
        self,
        q: Array,
        cuboids: NDArray[np.int64] | None = None,
        free_space: FreeSpace | None = None,
        by: str = "",
    ) -> Candidate:
        """What is handed back with a configuration (n,); the rest as of `Candidate`."""
        return Candidate(
            *(q, None, dict(self.stats), tuple(self.rejected), None, self.stages.stages),
            cuboids=cuboids,
            free_space=free_space,
            by=by,
        )

    def no_answer(self, certificate: Certificate | None = None) -> Candidate:
        """What is handed back without a configuration."""
        return Candidate(
            None, certificate, dict(self.stats), tuple(self.rejected), self.error, self.stages.stages
        )

    def direction(self, lift: Lift) -> Array:
        """Where the next restart ascends: the reference's own lift first, then random directions, or along a line."""
        first, self._fresh = self._fresh, False
        if first and self.problem.q_ahead is not None:
            return lift.lift(self.problem.q_ahead)
        beyond = None
        if self.lines is not None and self._latest is not None:
            before = self.lines.programs
            beyond = self.lines.beyond(self._latest)
            self.stats["sdps"] += self.lines.programs - before
        if beyond is not None:
            self.stats["lines"] += 1
            return linearise(lift, beyond)[1]
        return self.rng.standard_normal(lift.size)

    def attempt(self, convex: ConvexSet, direction: Array, where: str = "") -> Reached:
        """One ascent, and what is read at its end; with `local`, at each of its points."""
        self.stats["restarts"] += 1
        last = Iterate(None)
        note = f"restart {self.stats['restarts']:.0f}{where}"
        for step, iterate in enumerate(ascend(convex, direction)):
            self.stats["sdps"] += 1
            self.stages.add_point(
                step, None if iterate.x is None else iterate.gap, iterate.ray is not None, note
            )
            if iterate.x is None:
                return Reached(None, iterate.ray)
            last = iterate
            self._latest = iterate.x
            if self.local and not iterate.rank_one:
                start = self._angles(convex.lift, iterate.x)
                descended = polish(self.problem, start, steps=LOCAL_STEPS, damping=LOCAL_DAMPING)
                self.stages.add("local descent", note=f"{1e3 * descended.position_error:.1e} mm off the pose")
                if self.accepts(descended):
                    return Reached(iterate.x, None, descended.q, True)
            if iterate.rank_one or self.over():
                break
        return self._read(convex.lift, last) if last.rank_one else Reached(last.x)

    def _read(self, lift: Lift, iterate: Iterate) -> Reached:
        """The configuration of a rank-1 point, polished and judged."""
        assert iterate.x is not None
        self.stats["rank_one"] += 1
        polished = polish(self.problem, self._angles(lift, iterate.x))
        self.stages.add("snap", gap=iterate.gap, note=f"polish moved a joint by {polished.moved:.1e} rad")
        if polished.moved > MAX_POLISH and not self.local:
            self.note(f"polish moved a joint by {polished.moved:.2g} rad from a rank-1 point")
            return Reached(iterate.x)
        accepted = self.accepts(polished)
        if accepted:
            self.stats["rank_gap"], self.stats["moved"] = iterate.gap, polished.moved
        return Reached(iterate.x, None, polished.q if polished.reaches(self.problem) else None, accepted)

    def accepts(self, polished: Polished) -> bool:
        """Whether the judge accepts a configuration that reaches the target."""
        if not polished.reaches(self.problem):
            return False
        if self._verifier is None:
            self._verifier = Verifier(self.problem)
        judged = self._verifier(polished.q)
        self.stages.add("judge", note="accepted" if judged.accepted else judged.reasons[0])
        if not judged.accepted:
            self.note(judged.reasons[0])
        return judged.accepted

    def _angles(self, lift: Lift, x: Array) -> Array:
        return self.problem.robot.unwrap(lift.angles(x, self._goal), self._interval.middle)

    def note(self, reason: str) -> None:
        """Keep a reason for the report."""
        if reason not in self.rejected and len(self.rejected) < NEAR_MISSES:
            self.rejected.append(reason)
