"""IKSPARK (Wu, Tron): inverse kinematics as rank-1 points of a convex set, on Clarabel called directly.

The set holds every lifted configuration that reaches the target (`relaxation`); maximising the sum of largest
eigenvalues, linearised again and again (Problem 3), from the ends of random directions leads to points where all
blocks have rank 1, which are configurations. If the set is empty, a ray of the dual cone proves that there is none.
"""

from __future__ import annotations

import time
from contextlib import ExitStack

import numpy as np

from workcell.ik.certificate import Certificate
from workcell.ik.farkas import certify_kinematics
from workcell.ik.ikspark_obstacles import Avoidance
from workcell.ik.instance import Instance, instance_of
from workcell.ik.lift import Lift
from workcell.ik.polish import Polished, polish
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.rank import Iterate, ascend
from workcell.ik.result import Candidate
from workcell.ik.verify import Verifier
from workcell.pose import Array

MAX_POLISH = 1e-2
"""Radians by which polish may move a joint for the answer to count as the convex method's own."""
LOCAL_STEPS = 40
"""Levenberg-Marquardt steps from the angles of an iterate (`ikspark+lm`)."""
MOST_FAILURES = 3
"""Solves without a point and without a ray after which the solver gives up."""
NEAR_MISSES = 5
"""Reasons that are reported."""


def solve_ikspark(problem: IKProblem, budget: Budget, seed: int = 0, *, local: bool = False) -> Candidate:
    """Look for a configuration, or for a proof that there is none, until the budget (CPU seconds) is spent.

    Args:
        problem: a serial chain of revolute joints; with `q_reference` the search begins next to it.
        budget: CPU seconds.
        seed: of the random directions.
        local: also run Levenberg-Marquardt from the angles read at every iterate (`ikspark+lm`). Without it
            an answer is read from a point whose rank gap is below 1e-5, and polish moved it by 1e-2 rad or less.

    Raises:
        InputError: a prismatic joint, or bounds without their reference.
    """
    search = Search(problem, time.process_time() + budget.cpu_s, seed, local=local)
    if search.over():
        return search.result(None)
    return search.run()


class Search:
    """One run of the solver: what it has tried, and why near misses failed."""

    def __init__(self, problem: IKProblem, deadline: float, seed: int, *, local: bool) -> None:
        self.problem, self.deadline, self.local = problem, deadline, local
        self.rng = np.random.default_rng(seed)
        self.verify = Verifier(problem)
        self.rejected: list[str] = []
        self.stats = dict.fromkeys(("sdps", "restarts", "rank_one", "rank_gap", "moved"), 0.0)
        self.error: str | None = None
        self.last = Iterate(None)
        self._fresh = True

    def over(self) -> bool:
        """Whether the budget is spent."""
        return time.process_time() >= self.deadline

    def result(self, q: Array | None, certificate: Certificate | None = None) -> Candidate:
        """What is handed back: an answer, a proof, or neither."""
        return Candidate(q, certificate, dict(self.stats), tuple(self.rejected), self.error)

    def run(self) -> Candidate:
        """Restart Problem 3 from random directions until an answer, a proof or the end of the budget."""
        with ExitStack() as stack:
            instance = stack.enter_context(instance_of(self.problem))
            if instance.interval.empty:
                self.note("q_reference lies farther outside the joint limits than max_step")
                return self.result(None)
            proof = (
                None
                if instance.contradiction is None
                else certify_kinematics(self.problem, instance.contradiction)
            )
            avoidance = Avoidance.of(self.problem, instance, stack)
            if proof is None and avoidance is not None:
                proof = avoidance.blocked()
            failures = 0
            while proof is None and failures < MOST_FAILURES and not self.over():
                q = self.attempt(instance, self._direction(instance.relaxation.lift))
                if q is None and avoidance is not None and self.last.x is not None:
                    q = avoidance.search(self, self.last.x)
                if q is not None:
                    return self.result(q)
                if self.last.ray is not None:
                    return self._emptied(self.last.ray)
                failures += self.last.x is None
            if failures == MOST_FAILURES:
                self.error = "Clarabel found neither a point of the relaxation nor a proof that it is empty"
            return self.result(None, proof)

    def attempt(self, instance: Instance, direction: Array) -> Array | None:
        """One ascent; the configuration (n,) at its end when that solves the problem. `last` is where it ended."""
        self.stats["restarts"] += 1
        for iterate in ascend(instance, direction):
            self.stats["sdps"] += 1
            self.last = iterate
            if iterate.x is None:
                break
            if self.local and not iterate.rank_one:
                q = self._accept(polish(self.problem, self._angles(instance, iterate.x), steps=LOCAL_STEPS))
                if q is not None:
                    return q
            if iterate.rank_one:
                return self._read(instance, iterate)
            if self.over():
                break
        return None

    def _read(self, instance: Instance, iterate: Iterate) -> Array | None:
        """The configuration of a rank-1 point, polished and judged."""
        assert iterate.x is not None
        self.stats["rank_one"] += 1
        polished = polish(self.problem, self._angles(instance, iterate.x))
        if polished.moved > MAX_POLISH and not self.local:
            self.note(f"polish moved a joint by {polished.moved:.2g} rad from a rank-1 point")
            return None
        q = self._accept(polished)
        if q is not None:
            self.stats["rank_gap"], self.stats["moved"] = iterate.gap, polished.moved
        return q

    def _accept(self, polished: Polished) -> Array | None:
        if not polished.reaches(self.problem):
            return None
        judged = self.verify(polished.q)
        if not judged.accepted:
            self.note(judged.reasons[0])
            return None
        return polished.q

    def _angles(self, instance: Instance, x: Array) -> Array:
        angles = instance.relaxation.lift.angles(x, instance.goal)
        return self.problem.robot.unwrap(angles, instance.interval.middle)

    def _direction(self, lift: Lift) -> Array:
        """The reference's own lift first, then random directions."""
        first, self._fresh = self._fresh, False
        if first and self.problem.q_reference is not None:
            return lift.lift(self.problem.q_reference)
        return self.rng.standard_normal(lift.size)

    def _emptied(self, ray: Array) -> Candidate:
        certificate = certify_kinematics(self.problem, ray)
        if certificate is None:
            self.note("the relaxation is empty, but not by the margin that the tolerances need")
        return self.result(None, certificate)

    def note(self, reason: str) -> None:
        """Keep a reason for the report."""
        if reason not in self.rejected and len(self.rejected) < NEAR_MISSES:
            self.rejected.append(reason)
