"""IKSPARK (Wu, Tron): inverse kinematics as rank-1 points of a convex set, on Clarabel called directly.

The set holds every lifted configuration that reaches the target (`relaxation`); maximising the sum of largest
eigenvalues, linearised again and again (Problem 3), from the ends of random directions leads to points where all
blocks have rank 1, which are configurations. If the set is empty, a ray of the dual cone proves that there is none.
Numbers of problems, equations, algorithms and sections in this folder are the paper's:

    @misc{ikspark,
      author = {Wu, Liangting and Tron, Roberto},
      title  = {{IKSPARK}: Obstacle-Aware Inverse Kinematics via Convex Optimization},
    }
"""

from __future__ import annotations

from contextlib import ExitStack

import numpy as np
from numpy.typing import NDArray

from workcell import clock
from workcell.ik.certificate import Certificate
from workcell.ik.elementary.bounds import prove_impossible
from workcell.ik.ikspark.cuboids import CuboidSet, reachable_pairs, sphere_maps
from workcell.ik.ikspark.half_spaces import Avoidance
from workcell.ik.ikspark.instance import Instance, instance_of, relaxation_of
from workcell.ik.ikspark.lift import Lift, goal_vector
from workcell.ik.ikspark.rank import ConvexSet, Iterate, ascend, linearise
from workcell.ik.ikspark.rays import certify_homeless, certify_kinematics, certify_model
from workcell.ik.judge.verify import Verifier
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.result import NEAR_MISSES, Candidate
from workcell.ik.shared.convex import LOCAL_DAMPING, LOCAL_STEPS, MAX_POLISH, MOST_FAILURES
from workcell.ik.shared.limits import Interval
from workcell.ik.shared.polish import Polished, polish
from workcell.ik.stages import StageLog
from workcell.pose import Array

CUBOIDS_AFTER = 8
"""Restarts with half-spaces before free-space cuboids, where the problem has some, take turns with them."""
PROOF_AFTER = 500
"""Cone programs (or half of what the budget is worth) before a proof about the cuboids is the answer."""
PROGRAMS_A_SECOND = 300
"""Cone programs, with what goes on between them, that one quiet core does in a second."""
SLOTS = 12
"""Half-spaces that one ascent may carry."""
ROUNDS = 4
"""Ascents with ever more half-spaces, after one whose point collides."""


def solve_ikspark(problem: IKProblem, budget: Budget, seed: int = 0, *, local: bool = False) -> Candidate:
    """Look for a configuration, or for a proof that there is none, until the budget is spent.

    Args:
        problem: a serial chain of revolute joints; with `q_reference` the search begins next to it.
        budget: CPU seconds, and cone programs.
        seed: of the random directions.
        local: also run Levenberg-Marquardt from the angles read at every iterate (`ikspark+lm`). Without it
            an answer is read from a point whose rank gap is below 1e-5, and polish moved it by 1e-2 rad or less.

    Raises:
        InputError: a prismatic joint, or bounds without their reference.
    """
    search = Search(problem, budget, seed, local=local)
    if search.over():
        return search.result(None)
    return search.run()


class Search:
    """One run of the solver: what it has tried, and why near misses failed."""

    def __init__(self, problem: IKProblem, budget: Budget, seed: int, *, local: bool) -> None:
        self.problem, self.deadline, self.local = problem, clock.cpu_seconds() + budget.cpu_s, local
        self.most = budget.work(PROGRAMS_A_SECOND)
        self.rng = np.random.default_rng(seed)
        self._verifier: Verifier | None = None
        self.rejected: list[str] = []
        self.stats = dict.fromkeys(("sdps", "restarts", "rank_one", "rank_gap", "moved"), 0.0)
        self.error: str | None = None
        self.last = Iterate(None)
        self._goal, self._interval = goal_vector(problem.T_base_tool), Interval.of(problem)
        self._fresh = True
        self._turns = 0
        self._bounds_tried = False
        self._cuboid_set: CuboidSet | None = None
        self._in_cuboids = False
        self._model_proof: Certificate | None = None
        self.stages = StageLog()

    def over(self) -> bool:
        """Whether the budget is spent."""
        return clock.cpu_seconds() >= self.deadline or self.stats["sdps"] >= self.most

    def result(self, q: Array | None, certificate: Certificate | None = None) -> Candidate:
        """What is handed back: an answer, a proof, or neither."""
        return Candidate(
            q,
            certificate,
            dict(self.stats),
            tuple(self.rejected),
            self.error,
            self.stages.stages,
            None if q is None else self._assignment(),
            self.problem.free_space,
        )

    def _assignment(self) -> NDArray[np.int64] | None:
        """Which cuboid each sphere was in, if the last attempt was in the set with cuboids."""
        if not self._in_cuboids or self._cuboid_set is None or self.problem.cover is None:
            return None
        return self._cuboid_set.assignment(len(self.problem.cover))

    def run(self) -> Candidate:
        """Restart Problem 3 from random directions until an answer, a proof or the end of the budget."""
        with ExitStack() as stack:
            instance = stack.enter_context(instance_of(self.problem))
            if instance.interval.empty:
                self.note("q_reference lies farther outside the joint limits than max_step")
                return self.result(None)
            if instance.contradiction is not None:
                proof = certify_kinematics(self.problem, instance.contradiction)
                if proof is not None:
                    return self.result(None, proof)
            avoidance = Avoidance.of(self.problem, instance, stack)
            self.stages.add("set-up")
            failures = 0
            while not self.over() and failures < MOST_FAILURES:
                convex = self._next_set(instance)
                q = self.attempt(convex, self._direction(instance.lift))
                if q is None and avoidance is not None and self.last.x is not None:
                    q = self._avoid(avoidance, self.last.x)
                proof = None if q is not None else self._proof(convex is instance)
                if q is not None or proof is not None:
                    return self.result(q, proof)
                failures = failures + 1 if self.last.x is None and convex is instance else 0
            if failures == MOST_FAILURES and self.last.ray is None:
                self.error = "Clarabel found neither a point of the relaxation nor a proof that it is empty"
            return self.result(None, self._model_proof)

    def _next_set(self, instance: Instance) -> ConvexSet:
        """The relaxation itself, or in turns with it, after some restarts, the one with cuboids."""
        if self.stats["restarts"] < CUBOIDS_AFTER or self._turns % 2:
            self._turns += 1
            return instance
        self._turns += 1
        return self._cuboids(instance) or instance

    def _proof(self, plain: bool) -> Certificate | None:
        """A proof that the last attempt, on the plain relaxation or not, gave rise to."""
        if plain and self.last.ray is not None:
            proof = certify_kinematics(self.problem, self.last.ray)
            self.stages.add("proof", note="too weak" if proof is None else "the relaxation is empty")
            if proof is None:
                self.note("the relaxation is empty, but not by the margin that the tolerances need")
            return proof
        if self.problem.obstacles and not self._bounds_tried:
            # spheres of the last link are where the target puts them: no search is needed to see them collide
            self._bounds_tried = True
            proof = prove_impossible(self.problem)
            self.stages.add("elementary bounds", note="" if proof is None else "a proof")
            return proof
        return self._model_proof if self.stats["sdps"] >= min(PROOF_AFTER, 0.5 * self.most) else None

    def attempt(self, convex: ConvexSet, direction: Array) -> Array | None:
        """One ascent; the configuration (n,) at its end when that solves the problem. `last` is where it ended."""
        self.stats["restarts"] += 1
        self._in_cuboids = convex is self._cuboid_set
        for step, iterate in enumerate(ascend(convex, direction)):
            self.stats["sdps"] += 1
            self.last = iterate
            self._tell(step, iterate)
            if iterate.x is None:
                break
            if self.local and not iterate.rank_one:
                start = self._angles(iterate.x)
                descended = polish(self.problem, start, steps=LOCAL_STEPS, damping=LOCAL_DAMPING)
                self.stages.add("local descent", note=f"{1e3 * descended.position_error:.1e} mm off the pose")
                q = self._accept(descended)
                if q is not None:
                    return q
            if iterate.rank_one:
                return self._read(iterate)
            if self.over():
                break
        return None

    def _avoid(self, avoidance: Avoidance, x: Array) -> Array | None:
        """Add half-spaces where spheres collide and ascend again, a few times."""
        planes = np.zeros((0, avoidance.centres.shape[-1]))
        for _ in range(ROUNDS):
            added = avoidance.planes(x)
            if not len(added):
                return None
            planes = np.vstack([planes, added])[-SLOTS:]
            self.stages.add("half-spaces", note=f"{len(added)} added, {len(planes)} in all")
            instance = avoidance.instance_for(len(planes))
            instance.set_halfspaces(planes)
            q = self.attempt(instance, linearise(instance.lift, x)[1])
            if q is not None:
                return q
            last, self.last = self.last, Iterate(x)
            if last.x is None or self.over():
                return None
            x = last.x
        return None

    def _tell(self, step: int, iterate: Iterate) -> None:
        """Log a solve of an ascent."""
        note = f"restart {self.stats['restarts']:.0f}{', in cuboids' if self._in_cuboids else ''}"
        gap = None if iterate.x is None else iterate.gap
        self.stages.add_point(step, gap, iterate.ray is not None, note)

    def _cuboids(self, instance: Instance) -> CuboidSet | None:
        """The set with every sphere in a free-space cuboid; None without cuboids, or once it is known to be empty.

        A proof that it is empty is kept until `PROOF_AFTER`: the true obstacles may leave more room.
        """
        problem = self.problem
        if (
            problem.free_space is None
            or problem.cover is None
            or not problem.obstacles
            or self._model_proof is not None
        ):
            return None
        if self._cuboid_set is None:
            pairs = reachable_pairs(problem, problem.free_space)
            if not pairs.allowed.any(axis=1).all():
                self._model_proof = certify_homeless(problem)
                return None
            maps = sphere_maps(instance.lift, problem, pairs.sphere)
            self._cuboid_set = CuboidSet(instance, pairs, maps)
            root = self._cuboid_set.solve(np.zeros(instance.lift.size))
            self.stats["sdps"] += 1
            self.stages.add("cuboids", note=f"the set with every sphere in one: {root.status}")
            if root.status == "infeasible":
                self._model_proof = certify_model(problem, root.z)
        return self._cuboid_set if self._model_proof is None else None

    def _read(self, iterate: Iterate) -> Array | None:
        """The configuration of a rank-1 point, polished and judged."""
        assert iterate.x is not None
        self.stats["rank_one"] += 1
        polished = polish(self.problem, self._angles(iterate.x))
        self.stages.add("snap", gap=iterate.gap, note=f"polish moved a joint by {polished.moved:.1e} rad")
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
        if self._verifier is None:
            self._verifier = Verifier(self.problem)
        judged = self._verifier(polished.q)
        self.stages.add("judge", note="accepted" if judged.accepted else judged.reasons[0])
        if not judged.accepted:
            self.note(judged.reasons[0])
            return None
        return polished.q

    def _angles(self, x: Array) -> Array:
        lift = relaxation_of(self.problem).lift
        return self.problem.robot.unwrap(lift.angles(x, self._goal), self._interval.middle)

    def _direction(self, lift: Lift) -> Array:
        """The reference's own lift first, then random directions."""
        first, self._fresh = self._fresh, False
        if first and self.problem.q_reference is not None:
            return lift.lift(self.problem.q_reference)
        return self.rng.standard_normal(lift.size)

    def note(self, reason: str) -> None:
        """Keep a reason for the report."""
        if reason not in self.rejected and len(self.rejected) < NEAR_MISSES:
            self.rejected.append(reason)
