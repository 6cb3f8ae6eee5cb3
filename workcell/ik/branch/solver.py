"""Joint-space branch and bound: every query ends in a configuration or in a proof that there is none.

A node is a box of joint angles. Contractors derived from the closure of the chain (axes seen from the base and from the
target, with bounds on how far they move over the box) shrink it; obstacles exclude it when some sphere collides all
over it; a local search from its centre ends the tree with a solution; otherwise it is split. See
`workcell.ik.branch.kernels`.
"""

from __future__ import annotations

import functools

import numpy as np

from workcell import clock
from workcell.compile_ahead import DECIDING, wait_for
from workcell.errors import InputError
from workcell.geometry.types import Piece, SphereCover
from workcell.ik.branch.arrays import KNOWN, OVERLAP, inflation, problem_arrays
from workcell.ik.branch.checker.check import seal, statement
from workcell.ik.branch.crew import Crew
from workcell.ik.certificate import Certificate, problem_hash, proof_scope
from workcell.ik.judge.verify import Verifier
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.result import Candidate
from workcell.ik.shared.limits import Interval
from workcell.pose import Array, Pose

NODES_A_SECOND = 12_000
"""Boxes that one quiet core decides in a second, in the median of the public problem sets."""


def kernels_ready() -> bool:
    """Whether solver and checker were compiled before, on this machine."""
    from workcell.ik.branch.checker.walk import walk
    from workcell.ik.branch.kernels import search
    from workcell.jit import is_compiled

    return is_compiled(search.run) and is_compiled(walk)


@functools.cache
def prepare_kernels() -> None:
    """Compile solver and checker, or load them from the cache, by deciding and re-checking one small problem."""
    wait_for(DECIDING)
    from workcell.ik.branch.checker.check import check_branch
    from workcell.model.serial import serial_robot

    joint = {"quat": [1.0, 0.0, 0.0, 0.0], "axis": [0.0, 0.0, 1.0], "lower": -1.0, "upper": 1.0}
    joints = [{**joint, "name": "a", "xyz": [0.0, 0.0, 0.1]}, {**joint, "name": "b", "xyz": [0.3, 0.0, 0.0]}]
    arm = serial_robot("two", joints, Pose.from_xyz([0.2, 0.0, 0.0]))
    ball = Piece("ball", "sphere", Pose.from_xyz([2.0, 0.0, 0.0]), np.array([0.1]))
    cover = SphereCover(np.array([2]), np.zeros((1, 3)), np.array([0.05]))
    problem = IKProblem(arm, Pose.from_xyz([0.1, 0.1, 0.1]), (ball,), cover)
    candidate = solve_branch(problem, Budget(1e3))
    if candidate.certificate is not None:
        check_branch(problem, candidate.certificate)


def prepare(problem: IKProblem) -> None:
    """`prepare_kernels`, which are the same for all problems."""
    del problem
    prepare_kernels()


def solve_branch(problem: IKProblem, budget: Budget, seed: int = 0) -> Candidate:
    """Decide `problem` in the budget: a configuration, a certificate of kind `branch` that none exists, or neither.

    "None" means none with a clearance of c + `OVERLAP`, c the wanted one, where a configuration need only keep c.
    The search is deterministic, on any number of threads; its order, and so which configuration it finds, depends on
    that number.
    `seed` is taken for the signature all solvers share.

    Raises:
        InputError: a piece is of a kind that has no exclusion test, a bound on the rotation of links is asked for, or
            the limits leave nothing.
    """
    del seed
    return BranchSearch(problem).run(clock.cpu_seconds() + budget.cpu_s, budget)


class BranchSearch:
    """One query; `run` can be called again to go on where it stopped."""

    def __init__(self, problem: IKProblem) -> None:
        _refuse(problem)
        self.problem = problem
        self.arrays = problem_arrays(problem)
        root = self.arrays.root
        if np.any(root[0] > root[1]):
            raise InputError("the limits and max_step leave no configuration", where="max_step")
        tolerances = problem.tolerances
        reached = 0.9999 * np.array([tolerances.position, tolerances.rotation])
        self._crew = Crew(self.arrays, reached, self._accept)
        self._verifier: Verifier | None = None
        self._q: Array | None = None
        self._rejected: list[str] = []

    def run(self, deadline: float, budget: Budget) -> Candidate:
        """Search on, for as many boxes as the budget's effort is worth; `deadline` (`clock.cpu_seconds`) ends it."""
        self._crew.run(deadline, budget.work(NODES_A_SECOND), budget.threads)
        certificate = self._certificate() if self._q is None and self._crew.finished else None
        return Candidate(
            q=self._q, certificate=certificate, stats=self._crew.stats(), rejected=tuple(self._rejected)
        )

    def _accept(self, q: Array) -> bool:
        interval = Interval.of(self.problem)
        # The boxes have the slack of the limits; the answer needs none.
        robot = self.problem.robot
        q = q[1 : 1 + robot.joint_count]
        q = q if robot.coupling is None else robot.coupling.variables(q)
        q = np.clip(q, interval.lower, interval.upper)
        self._verifier = self._verifier or Verifier(self.problem)
        verdict = self._verifier(q)
        if verdict.accepted:
            self._q = q
        elif len(self._rejected) < 5:
            self._rejected.append("; ".join(verdict.reasons))
        return verdict.accepted

    def _certificate(self) -> Certificate:
        nodes = self._crew.written()
        blocked = nodes[nodes[:, 0] <= -2]
        problem = self.problem
        clearance = problem.tolerances.safety_margin
        if len(blocked):
            clearance = _rounded_up(max(clearance, float(blocked[:, 3].max())), clearance + OVERLAP)
        data = {
            "tree": nodes[:, 0],
            "splits": nodes[nodes[:, 0] >= 0, 1],
            "blocked": self._pairs(blocked),
            "root": self.arrays.root[:, 1:-1],
            "inflation": np.array(inflation(problem)),
            "clearance": np.array([clearance]),
        }
        data["seal"] = seal(data)
        return Certificate(
            kind="branch",
            scope=proof_scope(problem, "spheres" if len(blocked) else "chain"),
            statement=statement(data),
            margin=float(data["inflation"][0]),
            problem_hash=problem_hash(problem),
            data=data,
        )

    def _pairs(self, leaves: Array) -> Array:
        """(2, ...) sphere and obstacle of leaves (..., 4), or two spheres, as the problem counts them."""
        order = self.arrays.sphere_order
        if not len(leaves):
            return np.zeros((2, 0))
        one, two = leaves[:, 1].astype(int), leaves[:, 2].astype(int)
        own = leaves[:, 0] == -3
        return np.stack([order[one], np.where(own, order[np.where(own, two, 0)], two)]).astype(float)


def _rounded_up(clearance: float, most: float) -> float:
    """A clearance in few digits, no less than it and no more than `most`: a statement names it as it is."""
    step = 10.0 ** (np.floor(np.log10(clearance)) - 3) if clearance > 0 else 1.0
    return float(min(max(np.ceil(clearance / step) * step, clearance), most))


def _refuse(problem: IKProblem) -> None:
    if problem.max_link_rotation is not None:
        raise InputError("branch and bound doesn't know this bound", where="max_link_rotation", remedy="None")
    if problem.cover is not None:
        for piece in problem.obstacles:
            if piece.kind not in KNOWN:
                raise InputError(
                    f"a piece of kind {piece.kind!r}", where=piece.name, remedy=f"one of {', '.join(KNOWN)}"
                )
