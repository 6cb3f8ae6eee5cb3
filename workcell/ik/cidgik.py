"""CIDGIK (Giamou et al., RA-L 2022): inverse kinematics as low-rank points of a distance-geometric relaxation.

Points on the robot instead of angles: Z = [X I]^T [X I] holds their inner products, in which link lengths, goals,
spheres and planes are linear. Convex iteration (Problems 4 and 5), restarted from random objectives, leads to matrices
of rank d, which are configurations; an empty relaxation (Problem 3) proves that there is none.
"""

from __future__ import annotations

import time
from functools import lru_cache

import numpy as np

from workcell.ik.certificate import Certificate
from workcell.ik.cidgik_goals import Balls, Goal
from workcell.ik.cidgik_rank import Iterate, converge, nuclear, random_objective, toward
from workcell.ik.cidgik_recover import joint_angles
from workcell.ik.cidgik_reduction import Vectors
from workcell.ik.cidgik_relaxation import Instance, Structure
from workcell.ik.cidgik_skeleton import Skeleton
from workcell.ik.cidgik_workspace import Keeper, Rules
from workcell.ik.elementary import prove_impossible
from workcell.ik.polish import Polished, polish
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.relaxation import Interval
from workcell.ik.result import Candidate
from workcell.ik.verify import Verifier
from workcell.model.robot import LIMIT_SLACK, Robot
from workcell.pose import Array

MAX_POLISH = 1e-2
"""Radians by which polish may move a joint for the answer to count as the convex method's own."""
LOCAL_STEPS = 15
LOCAL_DAMPING = 1e-2
ROUNDS = 8
"""Times that rows are added within one restart."""
MOST_FAILURES = 3
NEAR_MISSES = 5


def solve_cidgik(problem: IKProblem, budget: Budget, seed: int = 0, *, local: bool = False) -> Candidate:
    """Look for a configuration, or for a proof that there is none, until the budget (CPU seconds) is spent.

    Args:
        problem: a serial chain of revolute joints; with `q_reference` the search begins next to it.
        budget: CPU seconds.
        seed: of the random objectives.
        local: also run Levenberg-Marquardt from the angles read at every iterate (`cidgik+lm`). Without it an
            answer is read from a point whose excess rank is below 1e-5, and polish moved it by 1e-2 rad or less.

    Raises:
        InputError: a prismatic joint, axes that are all parallel, or two joints about one axis.
    """
    search = _Search(problem, time.process_time() + budget.cpu_s, seed, local=local)
    if search.over():
        return search.result(None)
    return search.run()


class _Search:
    def __init__(self, problem: IKProblem, deadline: float, seed: int, *, local: bool) -> None:
        self.problem, self.deadline, self.local = problem, deadline, local
        self.rng = np.random.default_rng(seed)
        self.interval = Interval.of(problem)
        self.rejected: list[str] = []
        self.stats = dict.fromkeys(("sdps", "restarts", "low_rank", "rows", "rank_gap", "moved"), 0.0)
        self.error: str | None = None
        self.last = Iterate(None)
        self._verifier: Verifier | None = None

    def over(self) -> bool:
        return time.process_time() >= self.deadline

    def result(self, q: Array | None, certificate: Certificate | None = None) -> Candidate:
        if hasattr(self, "instance"):
            self.stats["sdps"] = float(self.instance.solves)
        return Candidate(q, certificate, dict(self.stats), tuple(self.rejected), self.error)

    def run(self) -> Candidate:
        problem = self.problem
        if self.interval.empty:
            self.note("q_reference lies farther outside the joint limits than max_step")
            return self.result(None)
        proof = prove_impossible(problem)
        if proof is not None:
            return self.result(None, proof)
        structure = structure_of(problem)
        goals = (Goal.posed(problem.robot.default_tool, problem.target),)
        instance = Instance(structure, goals, self.interval.lower, self.interval.upper, LIMIT_SLACK)
        self.instance = instance
        try:
            return self._restarts(instance)
        finally:
            instance.release()

    def _restarts(self, instance: Instance) -> Candidate:
        keeper = self._keeper(instance)
        failures = 0
        while not self.over() and failures < MOST_FAILURES:
            q = self._attempt(instance, keeper, self._objective(instance))
            if q is not None:
                return self.result(q)
            failures = failures + 1 if self.last.Z is None and not (keeper and keeper.passing) else 0
        return self.result(None)

    def _objective(self, instance: Instance) -> Array:
        if self.stats["restarts"] == 0:
            if self.problem.q_reference is not None:
                return toward(instance, instance.structure.reduction.basis_at(self.problem.q_reference))
            return nuclear(instance)
        return random_objective(instance, self.rng)

    def _keeper(self, instance: Instance) -> Keeper | None:
        problem = self.problem
        if problem.cover is None or len(problem.cover) == 0 or not problem.obstacles:
            return None
        spheres = [piece for piece in problem.obstacles if piece.kind == "sphere"]
        others = tuple(piece for piece in problem.obstacles if piece.kind != "sphere")
        balls = Balls(
            np.array([piece.pose.position for piece in spheres]).reshape(-1, 3),
            np.array([piece.size[0] for piece in spheres]),
        )
        rules = Rules(
            problem.cover.radius + problem.tolerances.safety_margin, balls, Balls.none(), pieces=others
        )
        points = [
            instance.structure.reduction.point(int(k), c)
            for k, c in zip(problem.cover.link, problem.cover.centre, strict=True)
        ]
        stacked = Vectors(*(np.array([getattr(p, n) for p in points]) for n in ("alpha", "base", "goal")))
        return Keeper(instance, stacked, rules, problem.robot.T_world_base)

    def _attempt(self, instance: Instance, keeper: Keeper | None, C: Array) -> Array | None:
        """One restart: converge, add the rows that are broken, converge again; the configuration, if it is one."""
        self.stats["restarts"] += 1
        if keeper is not None:
            keeper.forget_passing()
        for _ in range(ROUNDS):
            for iterate in converge(instance, C):
                self.last = iterate
                if self.over():
                    break
            if self.last.Z is None or not self.last.low_rank or self.last.C is None:
                return None
            X = instance.basis(self.last.Z)
            if keeper is not None:
                added = keeper.add_broken(np.vstack([X, np.eye(3)]))
                self.stats["rows"] += added
                if added:
                    C = self.last.C
                    continue
            return self._read(instance, X)
        return None

    def _read(self, instance: Instance, X: Array) -> Array | None:
        self.stats["low_rank"] += 1
        q = self.problem.robot.unwrap(joint_angles(instance, X), self.interval.middle)
        polished = polish(self.problem, q)
        if polished.moved > MAX_POLISH and not self.local:
            self.note(f"polish moved a joint by {polished.moved:.2g} rad from a low-rank point")
            return None
        return self._accept(polished)

    def _accept(self, polished: Polished) -> Array | None:
        if not polished.reaches(self.problem):
            return None
        if self._verifier is None:
            self._verifier = Verifier(self.problem)
        judged = self._verifier(polished.q)
        if not judged.accepted:
            self.note(judged.reasons[0])
            return None
        self.stats["rank_gap"], self.stats["moved"] = self.last.gap, polished.moved
        return polished.q

    def note(self, reason: str) -> None:
        if reason not in self.rejected and len(self.rejected) < NEAR_MISSES:
            self.rejected.append(reason)


class _Key:
    """What a structure depends on, compared by its numbers."""

    __slots__ = ("numbers", "make")

    def __init__(self, numbers: bytes, make: object) -> None:
        self.numbers, self.make = numbers, make

    def __hash__(self) -> int:
        return hash(self.numbers)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and self.numbers == other.numbers


@lru_cache(maxsize=32)
def _structure(key: _Key) -> Structure:
    return Structure(key.make())


def structure_of(problem: IKProblem) -> Structure:
    robot, interval = problem.robot, Interval.of(problem)
    generic = problem.max_step is not None
    cover = problem.cover
    if cover is not None and problem.obstacles:
        points = (cover.link, cover.centre)
    else:
        points = (np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
    tool = robot.tool().T_link_tool
    arrays = [
        robot.joint_xyz,
        robot.joint_rotation,
        robot.axis,
        robot.prismatic,
        tool.position,
        tool.quat_wxyz,
        *points,
    ]
    if not generic:
        arrays += [robot.lower, robot.upper]
    numbers = b"".join(np.ascontiguousarray(a).tobytes() for a in arrays) + bytes([generic])
    goal = Goal.posed(robot.default_tool, robot.fk(robot.home))
    return _structure(
        _Key(
            numbers, lambda: Skeleton(robot, [goal], points, interval.lower, interval.upper, generic=generic)
        )
    )
