"""CIDGIK (Giamou et al., RA-L 2022): inverse kinematics as low-rank points of a distance-geometric relaxation.

Points on the robot instead of angles: Z = [X I]^T [X I] holds their inner products, in which link lengths, goals,
spheres and planes are linear. Convex iteration (Problems 4 and 5), restarted from random objectives, leads to matrices
of rank d, which are configurations; an empty relaxation (Problem 3) proves that there is none. Numbers of problems,
equations and tables in this folder are the paper's:

    @article{cidgik,
      author  = {Giamou, M. and Marić, F. and Rosen, D. M. and Peretroukhin, V. and Roy, N. and
                 Petrović, I. and Kelly, J.},
      title   = {Convex Iteration for Distance-Geometric Inverse Kinematics},
      journal = {IEEE Robotics and Automation Letters},
      volume  = {7},
      number  = {2},
      pages   = {1952--1959},
      year    = {2022},
    }
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from workcell import clock
from workcell.errors import InputError
from workcell.ik.certificate import Certificate
from workcell.ik.cidgik.certify import certify
from workcell.ik.cidgik.finish import polish_query
from workcell.ik.cidgik.model import fastest_relaxation_at, goal_of, relaxation_at, sorted_obstacles
from workcell.ik.cidgik.proof import Proof
from workcell.ik.cidgik.recover import nearest_turn
from workcell.ik.cidgik.search import PROGRAMS_A_SECOND, Finished, Search, prove_empty
from workcell.ik.elementary.bounds import prove_impossible
from workcell.ik.judge.verify import Verifier
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.result import Candidate
from workcell.ik.shared.convex import LOCAL_DAMPING, LOCAL_STEPS
from workcell.ik.shared.limits import Interval
from workcell.ik.shared.polish import polish
from workcell.ik.trees.query import Query
from workcell.pose import Array


def solve_cidgik(problem: IKProblem, budget: Budget, seed: int = 0, *, local: bool = False) -> Candidate:
    """Look for a configuration, or for a proof that there is none, until the budget is spent.

    `max_step` narrows the joint limits; `max_link_rotation` is left to the judge.

    Args:
        problem: a serial chain of revolute joints; with `q_reference` the search begins next to it.
        budget: CPU seconds, and cone programs.
        seed: of the random objectives.
        local: also run Levenberg-Marquardt from the angles read at every iterate (`cidgik+lm`). Without it an
            answer is read from a point whose excess rank is below 1e-5, and polish moved it by 1e-2 rad or less.

    Raises:
        InputError: a prismatic joint, axes that are all parallel, two joints about one axis, or an obstacle around
            the point on the first joint's axis that the base fixes.
    """
    deadline = clock.cpu_seconds() + budget.cpu_s
    interval = Interval.of(problem)
    if interval.empty:
        return Candidate(rejected=("q_reference lies farther outside the joint limits than max_step",))
    refuse_buried_base(problem)
    if clock.cpu_seconds() >= deadline:
        return Candidate()
    skeleton, instance, keeper = fastest_relaxation_at(problem)
    try:
        # the elementary bounds are about whole poses
        certificate = prove_impossible(problem) if problem.goal == "pose" else None
        if certificate is not None:
            return Candidate(certificate=certificate)
        judge = _Judge(problem, interval)
        search = Search(
            skeleton,
            instance,
            keeper,
            judge,
            lambda: relaxation_at(problem),
            deadline,
            budget.work(PROGRAMS_A_SECOND),
            np.random.default_rng(seed),
            problem.q_reference,
            local,
        )
        q = search.run()
        return Candidate(
            q, judge.certificate, search.stats, tuple(search.rejected), search.error, search.stages.stages
        )
    finally:
        instance.release()


def prove_cidgik(problem: IKProblem) -> Certificate | None:
    """A certificate from one relaxation alone (Problem 3), without a search; None where it is not empty.

    Raises:
        InputError: as `solve_cidgik`.
    """
    proof = prove_empty(*relaxation_at(problem), lambda: False)
    return None if proof is None else certify(problem, proof)


def refuse_buried_base(problem: IKProblem) -> None:
    """Raise InputError for a sphere that the first joint's origin, fixed to the base, lies in."""
    balls, _ = sorted_obstacles(problem)
    if problem.cover is None or not len(balls):
        return
    anchor = problem.robot.T_world_base.apply(problem.robot.joint_xyz[0])
    depth = balls.radius - np.linalg.norm(balls.centre - anchor, axis=1)
    worst = int(depth.argmax())
    if depth[worst] > 0:
        spheres = [piece for piece in problem.obstacles if piece.kind == "sphere"]
        raise InputError(
            f"the obstacle contains the base of {problem.robot.name}: its first joint is "
            f"{1e3 * depth[worst]:.0f} mm inside",
            where=spheres[worst].name,
            remedy="move the obstacle or the base",
        )


@dataclass(slots=True)
class _Judge:
    """Polishes and verifies for one problem."""

    problem: IKProblem
    interval: Interval
    certificate: Certificate | None = None
    _verifier: Verifier | None = field(default=None)

    def finish(self, q: Array) -> Finished:
        """Two or three Gauss-Newton steps, and the verdict."""
        return self._polished(q, steps=10, damping=1e-9)

    def descend(self, q: Array) -> Finished:
        """A local search, and the verdict."""
        return self._polished(q, steps=LOCAL_STEPS, damping=LOCAL_DAMPING)

    def prove(self, proof: Proof) -> bool:
        """Keep the proof as a certificate if it holds."""
        self.certificate = certify(self.problem, proof)
        return self.certificate is not None

    def _polished(self, q: Array, steps: int, damping: float) -> Finished:
        problem = self.problem
        if problem.goal == "pose":
            start = nearest_turn(q, self.interval.middle)
            now, *_, moved = polish(problem, start, steps=steps, damping=damping)
        else:
            within = replace(problem.robot, lower=self.interval.lower, upper=self.interval.upper)
            query = Query(within, (goal_of(problem),))
            now, moved = polish_query(query, q, steps=steps, damping=damping)
        if self._verifier is None:
            self._verifier = Verifier(problem)
        verdict = self._verifier(now)
        return Finished(now, moved, None if verdict.accepted else verdict.reasons[0])
