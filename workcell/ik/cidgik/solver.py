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
from workcell.ik.cidgik.proof import Proof, prove_empty
from workcell.ik.cidgik.recover import nearest_turn
from workcell.ik.cidgik.search import COUNTS, PROGRAMS_A_SECOND, Finished, Search
from workcell.ik.elementary import screen
from workcell.ik.elementary.bounds import prove_impossible
from workcell.ik.judge.verify import Verifier
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.result import Candidate
from workcell.ik.shared import convex
from workcell.ik.shared.limits import Interval
from workcell.ik.shared.polish import polish
from workcell.ik.stages import SolverStage
from workcell.ik.trees.query import Query
from workcell.pose import Array

SPHERES_FIRST = 60
"""Cone programs after which spheres that cover solids, and have not led to an answer, give way to planes."""
STEP_PROGRAMS = 30
"""Cone programs that spheres, and then planes, get for a step: it takes one or two, or can't be made."""
PLANES = "cidgik+planes"
"""The part of the solver that parts the robot's spheres from solids by planes that touch these."""


def prepare(problem: IKProblem) -> None:
    """Compile, or load, what looks for elementary proofs, and the distances to obstacles where there are any."""
    screen.prepare()
    convex.prepare(problem)


def solve_cidgik(
    problem: IKProblem, budget: Budget, seed: int = 0, *, local: bool = False, tangent: bool = False
) -> Candidate:
    """Look for a configuration, or for a proof that there is none, until the budget is spent.

    `max_step` narrows the joint limits; `max_link_rotation` bounds the links' directions (`turning`). The judge looks
    at both.

    Obstacles that are no spheres are spheres first: those that cover them. Where these leave nothing, or have not
    answered after `SPHERES_FIRST` cone programs (`STEP_PROGRAMS` of a step), the search begins again with planes that
    touch the obstacles, and what it finds is the answer of `PLANES` (of `cidgik+lm`, whose stages then say so).

    Args:
        problem: a serial chain of revolute joints; with `q_reference` the search begins next to it.
        budget: CPU seconds, and cone programs.
        seed: of the random objectives.
        local: also run Levenberg-Marquardt from the angles read at every iterate (`cidgik+lm`). Without it an
            answer is read from a point whose excess rank is below 1e-5, and polish moved it by 1e-2 rad or less.
        tangent: begin with planes.

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
    # the elementary bounds are about whole poses
    certificate = (
        prove_impossible(problem) if problem.goal == "pose" and screen.may_be_impossible(problem) else None
    )
    if certificate is not None and not _worth_a_search(problem, certificate):
        return Candidate(certificate=certificate)
    run = _Run(problem, _Judge(problem, interval), deadline, budget.work(PROGRAMS_A_SECOND), seed, local)
    found = run.search(tangent)
    if not tangent and run.undecided(found):
        note = "the spheres that cover the obstacles give way to planes that touch them"
        run.found = replace(found, stages=(*found.stages, SolverStage("planes", 0.0, note=note)))
        found = run.search(tangent=True)
    if found.q is None and found.certificate is None and certificate is not None:
        return replace(found, certificate=certificate)
    return found


def _worth_a_search(problem: IKProblem, certificate: Certificate) -> bool:
    """Whether a sphere that the target puts into an obstacle may do so without the robot, and the judge knows.

    It sticks out of the robot, and is in the obstacle by no more than that.
    """
    cover, pair = problem.cover, certificate.data.get("pair")
    if problem.checker is None or pair is None or cover is None or cover.overshoot is None:
        return False
    return certificate.margin <= float(cover.overshoot[int(pair[0])])


@dataclass(slots=True)
class _Run:
    """The searches for one problem."""

    problem: IKProblem
    judge: _Judge
    deadline: float
    most: float
    seed: int
    local: bool
    doubtful: bool = False
    found: Candidate = field(default_factory=Candidate)

    def search(self, tangent: bool) -> Candidate:
        """What a search finds, with the work of those before it."""
        problem, before = self.problem, self.found
        skeleton, instance, keeper = fastest_relaxation_at(problem, tangent)
        try:
            search = Search(
                skeleton,
                instance,
                keeper,
                self.judge,
                lambda: relaxation_at(problem),
                self.deadline,
                self._most_of(tangent) - before.stats.get("sdps", 0.0),
                np.random.default_rng(self.seed),
                problem.q_ahead,
                self.local,
                STEP_PROGRAMS if problem.max_step is not None else SPHERES_FIRST,
            )
            q = search.run()
        finally:
            instance.release()
        self.doubtful = keeper is not None and (keeper.conservative or keeper.left_out > 0)
        reasons = [reason for reason in search.rejected if reason not in before.rejected]
        self.found = Candidate(
            q,
            self.judge.certificate,
            {**search.stats, **{key: search.stats[key] + before.stats.get(key, 0.0) for key in COUNTS}},
            (*before.rejected, *reasons),
            search.error,
            (*before.stages, *search.stages.stages),
            by=PLANES if tangent and q is not None and not self.local else "",
        )
        return self.found

    def _most_of(self, tangent: bool) -> float:
        """Cone programs in all: a step is not searched for among ever more planes."""
        step = tangent and self.problem.max_step is not None
        return min(self.most, self.found.stats.get("sdps", 0.0) + STEP_PROGRAMS) if step else self.most

    def undecided(self, found: Candidate) -> bool:
        """Whether spheres that cover solids have had a say in that nothing was found, and work may be left."""
        nothing = found.q is None and found.certificate is None
        return nothing and self.doubtful and clock.cpu_seconds() < self.deadline


def prove_cidgik(problem: IKProblem) -> Certificate | None:
    """A certificate from one relaxation alone (Problem 3), without a search; None where it is not empty.

    Raises:
        InputError: as `solve_cidgik`.
    """
    proof = prove_empty(*relaxation_at(problem), lambda: False)
    return None if proof is None else certify(problem, proof)


def refuse_buried_base(problem: IKProblem) -> None:
    """Raise InputError for a sphere that the first joint's origin, fixed to the base, lies in."""
    balls = sorted_obstacles(problem).balls
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
        return self._polished(q, steps=convex.LOCAL_STEPS, damping=convex.LOCAL_DAMPING)

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
