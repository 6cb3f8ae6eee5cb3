"""The configuration closest to goals that need not be within reach: Algorithm 1 with Problem 4 (VI-E).

From the minimiser of the squared pose errors over the relaxation (Problem 2b, `cost`), which is a bound that nothing is
below, every step minimises them again, with what is missing to rank 1 cut down by a factor c (Eq. 52), until it is
gone. c begins at `FIRST` each time; where that asks for too much, Problem 3 tells how much there is, and c is the first
of Eq. 53's series that asks for no more. Where nearly nothing is left to gain, the next start's cost has a random
configuration's lift added (`directions`). What a rank-1 point is read as is brought onto the ties, goes on downhill
(`nearest`), and is judged with the goals' poses left aside.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import cast

import numpy as np

from workcell import clock
from workcell.ik.certificate import Certificate
from workcell.ik.ikspark.mechanisms.avoid import Avoidance
from workcell.ik.ikspark.mechanisms.claim import certify_empty
from workcell.ik.ikspark.mechanisms.directions import Directions, loose
from workcell.ik.ikspark.mechanisms.forms import FormName
from workcell.ik.ikspark.mechanisms.minimising.adaptive import Descent, Reduction
from workcell.ik.ikspark.mechanisms.minimising.bound import TIGHT, bound_of, lower_bound
from workcell.ik.ikspark.mechanisms.minimising.cost import CostProgram
from workcell.ik.ikspark.mechanisms.parts import Part, Parts
from workcell.ik.ikspark.mechanisms.program import Program
from workcell.ik.ikspark.mechanisms.reading import off_rotations, read
from workcell.ik.ikspark.mechanisms.relaxation import Relaxation
from workcell.ik.ikspark.mechanisms.rows import Rows
from workcell.ik.ikspark.mechanisms.solver import PROGRAMS_A_SECOND, user_judge, user_rows
from workcell.ik.mechanisms.judge import judge_mechanism
from workcell.ik.mechanisms.nearest import nearest_mechanism, without_poses
from workcell.ik.mechanisms.penetration import Penetration
from workcell.ik.mechanisms.polish import polish_mechanism
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.result import MechanismCandidate
from workcell.ik.problem import Budget
from workcell.ik.result import NEAR_MISSES
from workcell.ik.shared.conic import ConicSolution
from workcell.ik.shared.convex import MAX_POLISH, MOST_FAILURES
from workcell.ik.stages import StageLog
from workcell.pose import Array

FIRST: Mapping[FormName, float] = MappingProxyType({"quaternion": 0.1, "rotation": 0.2})
"""c_0 of Eq. 53."""
COUNTS = (
    *("restarts", "steps", "too_much", "rank_one", "cuts"),
    *("rank_gap", "moved", "off_rotations", "cost_relaxed", "cost_rank_one"),
)
"""Numbers about a search: starts, steps, how often a c asked for too much, rank-1 points, sets of rows where spheres

touch; of the answer its rank gap, what polish moved, how far it was from rotations, and the cost at the minimiser of
the relaxation and at the rank-1 point."""
_PULL, _HARDEST = 0.01, 1.0
"""Weight of a random configuration's lift in the second start's cost; that of every further one is twice as large."""
_ROUNDS = 12
"""Starts with ever more rows where spheres touch."""


def closest_mechanism(
    problem: MechanismProblem,
    budget: Budget,
    seed: int = 0,
    *,
    form: FormName = "quaternion",
    c: float | None = None,
) -> MechanismCandidate:
    """Look for the configuration with the goals' poses as near as possible, all else kept.

    Args:
        problem: the question; positions and rotations of its goals are the cost, directions have to hold.
        budget: CPU seconds, and work in cone programs.
        seed: of restarts.
        form: of the lift.
        c: what every step leaves of what is missing to rank 1, from 0 to less than 1; None: adaptive (Eq. 53).

    Returns:
        With the bound that is proved, whether or not a configuration was found; with a certificate, of the question
        without the goals' poses, where nothing keeps all the rest.

    Raises:
        InputError: a user's constraint that is not convex; ModelError: ties that contradict each other.
    """
    return _Closest(problem, budget, seed, form, c).run()


class _Closest:
    def __init__(
        self, problem: MechanismProblem, budget: Budget, seed: int, form: FormName, c: float | None
    ) -> None:
        self.problem, self.kept = problem, without_poses(problem)
        self._deadline = clock.cpu_seconds() + budget.cpu_s
        self._most = budget.work(PROGRAMS_A_SECOND)
        self.stages, self.rejected = StageLog(), list[str]()
        self.relaxation = Relaxation.of(problem, form, poses=False)
        self.lift, self.blocks = self.relaxation.lift, self.relaxation.lift.blocks
        extra = user_rows(problem, self.lift)
        self.program = CostProgram(self.relaxation, extra)
        self.plain = Program(self.lift.size, self.relaxation.rows, extra)
        self._descent = Descent(
            self.blocks, self.program, self.plain, first=FIRST[form], fixed=c, rows=self._rows_at
        )
        self._users, self._user = extra is not None, user_judge(problem)
        self._part = Part(np.arange(self.lift.size), self.blocks, self.plain)
        nothing = np.full(self.lift.size, np.nan)
        parts = Parts((self._part,), nothing, self.relaxation.rows, self.plain)
        self._directions = Directions(self.lift, parts, np.random.default_rng(seed), loose(problem))
        spheres = problem.cover is not None and len(problem.cover) > 0
        self._avoid = Avoidance(problem, self.lift) if spheres else None
        hinge = Penetration(problem) if spheres else None
        self._hinge = None if hinge is None or hinge.nothing else hinge
        self._curve_rows: list[Rows] = []
        self._sphere_rows: list[Rows] = []
        self.stats = dict.fromkeys(COUNTS, 0.0)
        self.bound, self.proof = 0.0, cast("Certificate | None", None)
        self.stages.add("set-up", note=f"{self.lift.size} variables")

    def run(self) -> MechanismCandidate:
        """The bound first; then starts until one leads to an answer, or the budget ends."""
        if self.plain.contradiction is not None:
            self._note("what the mechanism is tied to contradicts what has to hold besides goals' poses")
            return self._nothing(certify_empty(self.kept, self.plain.contradiction))
        if self._over():
            return self._nothing()
        start = self._relaxed()
        if isinstance(start, MechanismCandidate):
            return start
        failures = 0
        while not self._over() and failures < MOST_FAILURES:
            q = None if start is None else self._from(start)
            if q is not None:
                return self._candidate(q)
            failures += start is None
            start = None if self._over() else self._another()
        return self._nothing()

    def _relaxed(self) -> Array | MechanismCandidate | None:
        """The minimiser of Problem 2b, and the bound that it is; or that the set is empty."""
        solution = self.program.closest(tolerance=TIGHT)
        if solution.status == "infeasible":
            multipliers = self.program.multipliers(solution.z)
            self._note("nothing keeps all that has to hold besides the goals' poses")
            return self._nothing(None if multipliers is None else certify_empty(self.kept, multipliers))
        if not solution.usable:
            return None
        self.stats["cost_relaxed"] = self.program.cost.at(solution.x)
        self._certify(solution)
        return solution.x

    def _certify(self, solution: ConicSolution) -> None:
        # no proof rests on users' rows: without them the least cost is lower, if anything
        found = lower_bound(self.problem) if self._users else bound_of(self.problem, self.program, solution)
        if found is not None:
            self.bound, self.proof = found
        words = "nothing is proved" if found is None else f"no cost is below {self.bound:.6g}"
        self.stages.add("bound", note=words, numbers={"cost": self.stats["cost_relaxed"]})

    def _another(self) -> Array | None:
        """The minimiser of the cost with a random configuration's lift in its favour."""
        self._directions.draw()
        self._forget()
        self.program.cut(())
        pull = min(_PULL * 2.0 ** max(self.stats["restarts"] - 1.0, 0.0), _HARDEST)
        solution = self.program.solve(-pull * self._directions.of(self._part))
        return solution.x if solution.usable else None

    def _forget(self) -> None:
        self._curve_rows, self._sphere_rows = [], []
        if self._avoid is not None:
            self._avoid.forget()

    def _from(self, start: Array) -> Array | None:
        """An accepted configuration from a start; where spheres touch, from the least cost with rows that say so."""
        for _ in range(_ROUNDS):
            self.stats["restarts"] += 1
            last = self._reduced(start)
            if last is None or not last.rank_one:
                return None
            q = self._read(last)
            if q is not None or self._over() or self._avoid is None:
                return q
            rows = self._avoid.rows(last.x)
            if rows is None:
                return None
            self._sphere_rows, self.stats["cuts"] = rows, self.stats["cuts"] + 1
            self.program.cut([*self._curve_rows, *rows])
            solution = self.program.closest()
            self.stages.add("rows", note=f"{len(rows)} where spheres touch")
            if not solution.usable:
                return None
            start = solution.x
        return None

    def _reduced(self, start: Array) -> Reduction | None:
        """The last point of a descent."""
        last = None
        for step, last in enumerate(self._descent.run(start)):
            self.stats["steps"] += step > 0
            self.stats["too_much"] += last.asked
            numbers = {"left": last.left, "cost": last.cost, **({"c": last.c} if step else {})}
            note = f"restart {self.stats['restarts']:.0f}"
            self.stages.add(
                "rank reduction" if step else "relaxation", gap=last.gap, note=note, numbers=numbers
            )
            if self._over():
                break
        return last

    def _rows_at(self, x: Array) -> list[Rows]:
        """Rows that hold besides: of curves that a point (N,) leaves from there on, and of spheres that touched."""
        found = [row for curve in self.relaxation.curves if (row := curve.cut(x)) is not None]
        self._curve_rows += found
        return [*self._curve_rows, *self._sphere_rows]

    def _read(self, point: Reduction) -> Array | None:
        """The configuration of a rank-1 point, on the ties and downhill from there, if the judge accepts it."""
        self.stats["rank_one"] += 1
        tied = polish_mechanism(self.kept, read(self.relaxation, point.x))
        self.stages.add("snap", gap=point.gap, note=f"polish moved a joint by {tied.moved:.1e}")
        if tied.moved > MAX_POLISH:
            self._note(f"polish moved a joint by {tied.moved:.2g} from a rank-1 point")
            return None
        nearest = nearest_mechanism(self.problem, tied.q, more=self._hinge)
        self.stages.add(
            "downhill", note=f"moved a joint by {nearest.moved:.1e}", numbers={"cost": nearest.cost}
        )
        for q in (nearest.q, tied.q):
            measured = judge_mechanism(self.kept, q, self._user)
            self.stages.add("judge", note="accepted" if measured.accepted else measured.reasons[0])
            if measured.accepted:
                self._remember(point, tied.moved)
                return q
            self._note(measured.reasons[0])
        return None

    def _remember(self, point: Reduction, moved: float) -> None:
        self.stats["cost_rank_one"], self.stats["rank_gap"] = point.cost, point.gap
        self.stats["moved"], self.stats["off_rotations"] = moved, off_rotations(self.lift, point.x)

    def _over(self) -> bool:
        return clock.cpu_seconds() >= self._deadline or self.program.solves + self.plain.solves >= self._most

    def _candidate(self, q: Array | None, certificate: Certificate | None = None) -> MechanismCandidate:
        stats = {**self.stats, "sdps": float(self.program.solves + self.plain.solves)}
        return MechanismCandidate(
            q,
            certificate,
            stats,
            tuple(self.rejected),
            None,
            self.stages.stages,
            bound=self.bound,
            bound_certificate=self.proof,
        )

    def _nothing(self, certificate: Certificate | None = None) -> MechanismCandidate:
        return self._candidate(None, certificate)

    def _note(self, reason: str) -> None:
        if reason not in self.rejected and len(self.rejected) < NEAR_MISSES:
            self.rejected.append(reason)
