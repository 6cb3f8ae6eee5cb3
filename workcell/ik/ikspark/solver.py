"""IKSPARK (Wu, Tron): inverse kinematics as rank-1 points of a convex set, on Clarabel called directly.

The set holds every lifted configuration that reaches the target (`relaxation`), with every sphere of the robot in a
region of free space (`among_cuboids`); maximising the sum of largest eigenvalues, linearised again and again
(Problem 3), from the ends of random directions leads to points where all blocks have rank 1, which are configurations.
If the set is empty, a ray of the dual cone proves that there is none. Numbers of problems, equations, algorithms and
sections in this folder are the paper's:

    @misc{ikspark,
      author = {Wu, Liangting and Tron, Roberto},
      title  = {{IKSPARK}: Obstacle-Aware Inverse Kinematics via Convex Optimization},
    }
"""

from __future__ import annotations

from contextlib import ExitStack
from math import inf
from typing import Literal, Protocol, get_args

from workcell.errors import InputError
from workcell.ik.ikspark.by_mechanism import needs_mechanism, solve_by_mechanism
from workcell.ik.ikspark.instance import instance_of
from workcell.ik.ikspark.obstacles.alone import Alone
from workcell.ik.ikspark.obstacles.among_cuboids import AmongCuboids
from workcell.ik.ikspark.obstacles.door import check_free_space
from workcell.ik.ikspark.obstacles.half_spaces import Avoidance, has_spheres_and_obstacles
from workcell.ik.ikspark.obstacles.own import OwnSpheres
from workcell.ik.ikspark.proving import Proving
from workcell.ik.ikspark.restart import LineRestarts
from workcell.ik.ikspark.search import Reached, Search
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.result import Candidate
from workcell.ik.shared.convex import MOST_FAILURES
from workcell.pose import Array

Restart = Literal["objective", "line"]
"""Where an ascent begins after one that led nowhere."""
CUTS = "ikspark+cuts"
"""The name of the fallback."""
CUBOIDS_FIRST = 100
"""Work among cuboids (or half of what the budget is worth) before the fallback's turn, in cone programs."""


def solve_ikspark(
    problem: IKProblem,
    budget: Budget,
    seed: int = 0,
    *,
    local: bool = False,
    cuboids: bool = True,
    fallback: bool = True,
    apart: bool = True,
    restart: Restart = "objective",
) -> Candidate:
    """Look for a configuration, or for a proof that there is none, until the budget is spent.

    Args:
        problem: any serial robot; what has slides, joints that follow others or a goal that is a part of a pose is
            answered by its mechanism (`by_mechanism`). With `q_reference` the search begins next to it.
        budget: CPU seconds, and work in cone programs.
        seed: of the random directions.
        local: also run Levenberg-Marquardt from the angles read at every iterate (`ikspark+lm`). Without it
            an answer is read from a point whose rank gap is below 1e-5, and polish moved it by 1e-2 rad or less.
        cuboids: among obstacles, look first for an answer with every sphere in a region of free space.
        fallback: where that has found none after a counted amount of work, keep spheres off obstacles by half-spaces.
            An answer found so is by `ikspark+cuts`.
        apart: tell spheres of the robot that overlap each other a side each; False: a configuration in which it hits
            itself is only refused.
        restart: where ascents after the first begin: at the ends of random directions (`objective`), or on lines from
            where the last one got stuck through the set (`line`, Algorithm 2).

    Raises:
        InputError: an unknown kind of restart, bounds without their reference, or free space made for another scene or
            cover; with `local` a prismatic joint, or one that follows another.
    """
    if needs_mechanism(problem) and not local:
        return solve_by_mechanism(problem, budget, seed, cuboids=cuboids, fallback=fallback, apart=apart)
    check_free_space(problem)
    if restart not in get_args(Restart):
        raise InputError(
            f"unknown restart {restart!r}", where="restart", remedy=" or ".join(get_args(Restart))
        )
    search = Search(problem, budget, seed, local=local)
    if search.over():
        return search.no_answer()
    with ExitStack() as stack:
        instance = stack.enter_context(instance_of(problem))
        if instance.interval.empty:
            search.note("q_reference lies farther outside the joint limits than max_step")
            return search.no_answer()
        proving = Proving(search, instance)
        if instance.contradiction is not None:
            proof = proving.of_empty(instance.contradiction)
            if proof is not None:
                return search.no_answer(proof)
        search.stages.add("set-up")
        if restart == "line":
            search.lines = LineRestarts(instance, search.rng)
        own = OwnSpheres(search, instance, asked=apart)
        if not has_spheres_and_obstacles(problem):
            return _restarted(search, proving, Alone(search, instance, own, stack)) or search.no_answer()
        if cuboids:
            share = min(CUBOIDS_FIRST, 0.5 * search.most) if fallback else inf
            among = AmongCuboids(search, instance, own, stack, most=share)
            found = _restarted(search, proving, among)
            if found is None and among.spare is not None and fallback:
                return search.answer(among.spare, by="" if local else CUTS)
            if found is not None or not fallback:
                return found or search.no_answer(proving.of_cuboids(at_last=True))
        by = CUTS if cuboids and not local else ""
        found = _restarted(search, proving, Avoidance(search, instance, own, stack, by))
        return found or search.no_answer(proving.of_cuboids(at_last=True))


class Way(Protocol):
    """A way of searching."""

    @property
    def exhausted(self) -> bool:
        """Whether it has had its share of the work, or has an answer that another way has to give."""
        ...

    def climb(self) -> Reached:
        """One restart; where none of its ascents is accepted, the end of the first one, for what it may prove."""
        ...

    def answer(self, q: Array) -> Candidate:
        """What is handed back with an accepted configuration (n,)."""
        ...


def _restarted(search: Search, proving: Proving, way: Way) -> Candidate | None:
    """Restart a way of searching until an answer, a proof, or its end."""
    failures, ray = 0, None
    while not search.over() and not way.exhausted and failures < MOST_FAILURES:
        reached = way.climb()
        if reached.accepted:
            assert reached.q is not None
            return way.answer(reached.q)
        if way.exhausted:
            break
        ray = reached.ray
        proof = proving.of_bounds() if ray is None else proving.of_empty(ray)
        proof = proof or proving.of_cuboids()
        if proof is not None:
            return search.no_answer(proof)
        failures = failures + 1 if reached.x is None else 0
    if failures == MOST_FAILURES and ray is None:
        search.error = "Clarabel found neither a point of the relaxation nor a proof that it is empty"
    return None
