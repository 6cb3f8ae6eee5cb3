"""IKSPARK on mechanisms: rank-1 points are configurations, and an empty relaxation proves that there is none.

Algorithm 1 with Problem 3 climbs from the ends of directions (`directions`; the first one is the reference's lift,
where there is one). What a rank-1 point is read as is polished onto the ties, by at most `MAX_POLISH`, and judged. Rows
enter on the way where spheres touch, and where joints that follow others leave their curve.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from workcell import clock
from workcell.ik.certificate import Certificate
from workcell.ik.ikspark.mechanisms.avoid import Avoidance
from workcell.ik.ikspark.mechanisms.blocks import Blocks, linearise
from workcell.ik.ikspark.mechanisms.claim import certify_empty
from workcell.ik.ikspark.mechanisms.directions import Directions, loose
from workcell.ik.ikspark.mechanisms.forms import FormName
from workcell.ik.ikspark.mechanisms.lift import MechanismLift
from workcell.ik.ikspark.mechanisms.parts import Part, Parts
from workcell.ik.ikspark.mechanisms.program import Multipliers, Program
from workcell.ik.ikspark.mechanisms.rank import Step, ascend, tightened
from workcell.ik.ikspark.mechanisms.reading import off_rotations, read
from workcell.ik.ikspark.mechanisms.relaxation import Relaxation
from workcell.ik.ikspark.mechanisms.restart import Restart, Restarts
from workcell.ik.ikspark.mechanisms.rows import Rows
from workcell.ik.mechanisms.judge import judge_mechanism
from workcell.ik.mechanisms.polish import polish_mechanism
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.result import MechanismCandidate
from workcell.ik.problem import Budget
from workcell.ik.result import NEAR_MISSES
from workcell.ik.shared.convex import MAX_POLISH, MOST_FAILURES
from workcell.ik.stages import StageLog
from workcell.pose import Array

if TYPE_CHECKING:
    from workcell.ik.ikspark.mechanisms.users.constraints import UserRows

CUTS = "ikspark+cuts"
"""The name of answers for which planes that touch obstacles kept spheres off."""
PROGRAMS_A_SECOND = 200
"""Cone programs, with what goes on between them, that one quiet core does in a second."""
_SLOW: Mapping[FormName, float] = MappingProxyType({"quaternion": 0.8, "rotation": 0.95})
"""An ascent ends when a step leaves more than this of what is to vanish: a new start is worth more."""
_EXACT = 2e-7
"""Rank gap below which rotations are exact enough."""
_TIGHT = 1e-10
"""Clarabel's tolerance for the last point of all."""
_ROUNDS = 12
"""Ascents of one restart with ever more rows, where spheres touch or curves are left."""


Judge = Callable[[Array], Sequence[str]]
"""What is wrong with a configuration (size,), in words."""


def solve_mechanism_ikspark(
    problem: MechanismProblem,
    budget: Budget,
    seed: int = 0,
    *,
    form: FormName = "quaternion",
    judge: Judge | None = None,
    restart: Restart = "configuration",
) -> MechanismCandidate:
    """Look for a configuration, or for a proof that there is none, until the budget is spent.

    Args:
        problem: the question.
        budget: CPU seconds, and work in cone programs.
        seed: of the random directions.
        form: of the lift.
        judge: who accepts configurations; None: `judge_mechanism`.
        restart: where ascents begin again that have stalled, see `restart`.

    Raises:
        InputError: a user's constraint that is not convex; ModelError: ties that contradict each other.
    """
    return _Search(problem, budget, seed, form, judge, restart).run()


class _Search:
    def __init__(
        self,
        problem: MechanismProblem,
        budget: Budget,
        seed: int,
        form: FormName,
        judge: Judge | None = None,
        restart: Restart = "configuration",
    ) -> None:
        self.problem = problem
        self._deadline = clock.cpu_seconds() + budget.cpu_s
        self._most = budget.work(PROGRAMS_A_SECOND)
        self.stages, self.rejected = StageLog(), list[str]()
        self.relaxation = Relaxation.of(problem, form)
        self.lift, self.blocks = self.relaxation.lift, self.relaxation.lift.blocks
        self.parts = Parts.of(self.relaxation, user_rows(problem, self.lift))
        self._directions = Directions(self.lift, self.parts, np.random.default_rng(seed), loose(problem))
        self._restarts = Restarts(restart, np.random.default_rng([seed, 1]))
        self._stalled: dict[bytes, Array] = {}
        spheres = problem.cover is not None and len(problem.cover) > 0
        self._avoid = Avoidance(problem, self.lift) if spheres else None
        self._judge = judge or _judge_of(problem)
        self._empty_by_too_little = False
        self._curve_rows: list[Rows] = []
        self._sphere_rows: list[Rows] = []
        counts = ("restarts", "rank_one", "rank_gap", "moved", "off_rotations", "cuts")
        self.stats = dict.fromkeys(counts, 0.0)
        self.stages.add("set-up", note=f"{self.lift.size} variables in {len(self.parts.parts)} part(s)")

    def run(self) -> MechanismCandidate:
        """Restart until an answer, a proof, or the end of the budget."""
        if self.parts.whole.contradiction is not None:
            self._note("what is asked for contradicts what the mechanism is tied to")
            return self._nothing(self._proof(self.parts.whole.contradiction))
        failures, error = 0, None
        while not self._over():
            found = self._whole_point()
            if isinstance(found, MechanismCandidate):
                return found
            if found is None:
                failures += not self._over()
                if failures == MOST_FAILURES:
                    if not self._empty_by_too_little:
                        error = (
                            "Clarabel found neither a point of the relaxation nor a proof that it is empty"
                        )
                    break
                continue
            failures, q = 0, self._read(found)
            if q is None:
                q = self._cut_off(found)
                self.parts.whole.cut(())
            if q is not None:
                stages, rejected = self.stages.stages, tuple(self.rejected)
                by = CUTS if self._avoid is not None and self._avoid.by_planes else ""
                return MechanismCandidate(q, None, self._counted(), rejected, None, stages, by=by)
        return self._nothing(None, error)

    def _whole_point(self) -> Step | MechanismCandidate | None:
        """A point at which all parts have rank 1; or that there is none; or None: the budget or Clarabel failed."""
        x, gap = np.nan_to_num(self.parts.fixed), 0.0
        left = list(self.parts.parts)
        while left:
            for part in tuple(left):  # in turns: what one of them can't do needs no answer of the others
                if self._over():
                    return None
                self.stats["restarts"] += 1
                step = self._climb(part.blocks, part.program, self._direction(part))
                if step.empty and step.z is not None:
                    return self._empty(part, step.z)
                if step.x is None:
                    self._directions.draw()
                    return None
                self._stalled[part.columns.tobytes()] = step.x
                if step.rank_one:
                    x[part.columns], gap = step.x, max(gap, step.gap)
                    left.remove(part)
            self._directions.draw()
        return Step(x, gap)

    def _empty(self, part: Part, z: Array) -> MechanismCandidate | None:
        """What is answered where a part is empty."""
        multipliers = self.parts.multipliers(part, z)
        if multipliers is None:
            self._note("with the users' constraints the relaxation is empty")
            return self._nothing(None)
        proof = self._proof(multipliers)
        self._empty_by_too_little = proof is None
        return None if proof is None else self._nothing(proof)

    def _direction(self, part: Part) -> Array:
        if self.stats["restarts"] <= len(self.parts.parts) and self.problem.q_ahead is not None:
            return self._directions.nearest(part, self.lift.lift(self.problem.q_ahead))
        stalled = self._stalled.get(part.columns.tobytes())
        bounded = self._directions.towards(part, np.ones(self.lift.size))
        found = self._restarts.direction(part.blocks, part.program, stalled, bounded)
        return self._directions.of(part) if found is None else found

    def _climb(self, blocks: Blocks, program: Program, direction: Array) -> Step:
        last, note = Step(None), f"restart {self.stats['restarts']:.0f}"
        for count, step in enumerate(ascend(blocks, program, direction, slow=_SLOW[self.lift.form.name])):
            self.stages.add_point(count, None if step.x is None else step.gap, step.empty, note)
            last = step
            if step.x is None or self._over():
                break
        return last

    def _cut_off(self, point: Step) -> Array | None:
        """An accepted configuration near a point that spheres or curves forbid, from ascents with rows that say so."""
        self._curve_rows, self._sphere_rows = [], []
        if self._avoid is not None:
            self._avoid.forget()
        for _ in range(_ROUNDS):
            if point.x is None or not point.rank_one or self._over():
                return None
            rows = self._broken(point.x)
            if not rows:
                return None
            self.parts.whole.cut(rows)
            self.stats["cuts"] += 1
            self.stages.add("rows", note=f"{len(rows)} where spheres touch, or joints leave their curve")
            point = self._climb_within(linearise(self.blocks, point.x)[1])
            if point.rank_one and (q := self._read(point)) is not None:
                return q
        return None

    def _climb_within(self, direction: Array) -> Step:
        """An ascent of the whole with the rows so far, and those of curves that it leaves on its way."""
        last = Step(None)
        for _ in range(_ROUNDS):
            last = self._climb(self.blocks, self.parts.whole, direction)
            if last.x is None or self._over() or not self._leaves_curves(last.x):
                break
            self.parts.whole.cut([*self._curve_rows, *self._sphere_rows])
            direction = linearise(self.blocks, last.x)[1]
        return last

    def _leaves_curves(self, x: Array) -> bool:
        found = [row for curve in self.relaxation.curves if (row := curve.cut(x)) is not None]
        self._curve_rows += found
        return bool(found)

    def _broken(self, x: Array) -> list[Rows]:
        """All rows that hold from now on, where the point x breaks some that should; none where it breaks none."""
        more = self._leaves_curves(x)
        spheres = None if self._avoid is None else self._avoid.rows(x)
        self._sphere_rows = self._sphere_rows if spheres is None else spheres
        return [*self._curve_rows, *self._sphere_rows] if more or spheres is not None else []

    def _read(self, step: Step) -> Array | None:
        """The configuration of a rank-1 point, polished, if the judge accepts it."""
        assert step.x is not None
        self.stats["rank_one"] += 1
        x = self._tight(step)
        polished = polish_mechanism(self.problem, read(self.relaxation, x))
        self.stages.add("snap", gap=step.gap, note=f"polish moved a joint by {polished.moved:.1e}")
        if polished.moved > MAX_POLISH:
            self._note(f"polish moved a joint by {polished.moved:.2g} from a rank-1 point")
            return None
        reasons = self._judge(polished.q)
        self.stages.add("judge", note=reasons[0] if reasons else "accepted")
        if reasons:
            self._note(reasons[0])
            return None
        numbers = {
            "rank_gap": step.gap,
            "moved": polished.moved,
            "off_rotations": off_rotations(self.lift, x),
        }
        self.stats.update(numbers)
        return polished.q

    def _tight(self, step: Step) -> Array:
        """The rank-1 point once more, to the digits that the ascents were spared, unless it has them."""
        assert step.x is not None
        if self._curve_rows or self._sphere_rows:
            return tightened(self.blocks, self.parts.whole, step, exact=_EXACT, tolerance=_TIGHT)
        x = np.array(step.x)
        for part in self.parts.parts:
            own = x[part.columns]
            gap = float(linearise(part.blocks, own)[0].max(initial=0.0))
            here = Step(own, gap)
            x[part.columns] = tightened(part.blocks, part.program, here, exact=_EXACT, tolerance=_TIGHT)
        return x

    def _proof(self, multipliers: Multipliers) -> Certificate | None:
        proof = certify_empty(self.problem, multipliers) or self._proof_by_rows()
        self.stages.add("proof", note="too weak" if proof is None else "the relaxation is empty")
        if proof is None:
            self._note("the relaxation is empty, but not by the margin that the tolerances need")
        return proof

    def _proof_by_rows(self) -> Certificate | None:
        """A proof from the relaxation in which goals' directions are rows, as proofs know them, and no reduction."""
        if not any(goal.axis is not None and goal.within == 0.0 for goal in self.problem.goals):
            return None
        relaxation = Relaxation.of(self.problem, self.lift.form.name, pointing=False)
        program = Program(relaxation.lift.size, relaxation.rows)
        multipliers = program.contradiction
        if multipliers is None:
            solution = program.solve(np.zeros(relaxation.lift.size))
            multipliers = program.multipliers(solution.z) if solution.status == "infeasible" else None
        return None if multipliers is None else certify_empty(self.problem, multipliers)

    def _over(self) -> bool:
        return clock.cpu_seconds() >= self._deadline or self.parts.solves >= self._most

    def _counted(self) -> dict[str, float]:
        return {**self.stats, "sdps": float(self.parts.solves)}

    def _nothing(self, certificate: Certificate | None, error: str | None = None) -> MechanismCandidate:
        stages, rejected = self.stages.stages, tuple(self.rejected)
        return MechanismCandidate(None, certificate, self._counted(), rejected, error, stages)

    def _note(self, reason: str) -> None:
        if reason not in self.rejected and len(self.rejected) < NEAR_MISSES:
            self.rejected.append(reason)


def _judge_of(problem: MechanismProblem) -> Judge:
    user = user_judge(problem)
    return lambda q: judge_mechanism(problem, q, user).reasons


def user_judge(problem: MechanismProblem) -> Callable[[Array], list[str]] | None:
    """Who judges users' constraints; None: there are none."""
    if not problem.constraints:
        return None
    from workcell.ik.ikspark.mechanisms.users.constraints import violations

    return partial(violations, problem)


def user_rows(problem: MechanismProblem, lift: MechanismLift) -> UserRows | None:
    """Users' constraints as rows; cvxpy is imported for them alone."""
    if not problem.constraints:
        return None
    from workcell.ik.ikspark.mechanisms.users.constraints import conic_rows

    return conic_rows(problem.constraints, lift)
