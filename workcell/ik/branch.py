"""Joint-space branch and bound: every query ends in a configuration or in a proof that there is none.

A node is a box of joint angles. Contractors derived from the closure of the chain (axes seen from the base and from the
target, with bounds on how far they move over the box) shrink it; obstacles exclude it when some sphere collides all
over it; a local search from its centre ends the tree with a solution; otherwise it is split. See `branch_kernels`.
"""

from __future__ import annotations

import functools
import time
from typing import Any

import numpy as np

from workcell.errors import InputError
from workcell.geometry.types import Piece, SphereCover
from workcell.ik.branch_check import seal, statement
from workcell.ik.branch_problem import KINDS, inflation, problem_arrays
from workcell.ik.certificate import Certificate, Scope, problem_hash
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.result import Candidate
from workcell.ik.verify import Verifier
from workcell.pose import Array, Pose

MOST_NODES = 2_000_000
"""Size of the tree at which the search gives up: its memory."""
_CHUNK = 500


@functools.cache
def prepare() -> None:
    """Compile solver and checker, or load them from the cache, by deciding and re-checking one small problem."""
    from workcell.ik.branch_check import check_branch
    from workcell.model.robot import serial_robot

    joint = {"quat": [1.0, 0.0, 0.0, 0.0], "axis": [0.0, 0.0, 1.0], "lower": -1.0, "upper": 1.0}
    joints = [{**joint, "name": "a", "xyz": [0.0, 0.0, 0.1]}, {**joint, "name": "b", "xyz": [0.3, 0.0, 0.0]}]
    arm = serial_robot("two", joints, Pose.from_xyz([0.2, 0.0, 0.0]))
    ball = Piece("ball", "sphere", Pose.from_xyz([2.0, 0.0, 0.0]), np.array([0.1]))
    cover = SphereCover(np.array([2]), np.zeros((1, 3)), np.array([0.05]))
    problem = IKProblem(arm, Pose.from_xyz([0.1, 0.1, 0.1]), (ball,), cover)
    candidate = solve_branch(problem, Budget(1e3))
    if candidate.certificate is not None:
        check_branch(problem, candidate.certificate)


def solve_branch(problem: IKProblem, budget: Budget, seed: int = 0) -> Candidate:
    """Decide `problem`: a configuration, or a certificate of kind `branch` that none exists, or neither in the budget.

    The search is deterministic; `seed` is taken for the signature all solvers share.

    Raises:
        InputError: a joint is prismatic, a piece is of a kind that has no exclusion test, or a bound on the rotation of
            links is asked for.
    """
    del seed
    return _Search(problem).run(time.process_time() + budget.cpu_s)


class _Search:
    """One query."""

    def __init__(self, problem: IKProblem) -> None:
        _refuse(problem)
        self.problem = problem
        self.arrays = problem_arrays(problem)
        self.verifier: Verifier | None = None
        self.rejected: list[str] = []

    def run(self, deadline: float) -> Candidate:
        from workcell.ik.branch_kernels import search
        from workcell.ik.branch_kernels.obstacles import new_sweep
        from workcell.ik.branch_kernels.state import new_state

        chain, world, root = self.arrays.chain, self.arrays.world, self.arrays.root
        joints = root.shape[1]
        state, sweep = new_state(chain), new_sweep(joints)
        tree = search.Tree(
            np.zeros((1024, 2, joints)), np.zeros((4096, 4)), np.zeros(8, dtype=np.int64), np.zeros(joints)
        )
        if np.any(root[0] > root[1]):
            raise InputError("the limits and max_step leave no configuration", where="max_step")
        tree.stack[0] = root
        tree.counts[0], tree.counts[6] = 1, -1
        tolerances = self.problem.tolerances
        reached = np.array([0.9999 * tolerances.position, 0.9999 * tolerances.rotation])
        while True:
            outcome = search.run(chain, world, root, state, sweep, tree, reached, _CHUNK)
            if outcome == search.FOUND:
                q = self._accept(tree.found[1 : 1 + self.problem.robot.dof])
                if q is not None:
                    return Candidate(q=q, stats=self._stats(tree), rejected=tuple(self.rejected))
            elif outcome == search.DONE:
                break
            elif outcome == search.FULL:
                if tree.counts[0] + 2 > len(tree.stack) or len(tree.nodes) >= MOST_NODES:
                    break
                tree = tree._replace(nodes=np.concatenate([tree.nodes, np.zeros_like(tree.nodes)]))
            if time.process_time() > deadline:
                break
        certificate = self._certificate(tree) if tree.counts[0] == 0 and tree.counts[4] == 0 else None
        return Candidate(certificate=certificate, stats=self._stats(tree), rejected=tuple(self.rejected))

    def _accept(self, q: Array) -> Array | None:
        robot, problem = self.problem.robot, self.problem
        lower, upper = robot.lower, robot.upper
        if problem.q_reference is not None and problem.max_step is not None:
            lower = np.maximum(lower, problem.q_reference - problem.max_step)
            upper = np.minimum(upper, problem.q_reference + problem.max_step)
        # The boxes have the slack of the limits; the answer needs none.
        q = np.clip(q, lower, upper)
        self.verifier = self.verifier or Verifier(self.problem)
        verdict = self.verifier(q)
        if verdict.accepted:
            return q
        if len(self.rejected) < 5:
            self.rejected.append("; ".join(verdict.reasons))
        return None

    def _stats(self, tree: Any) -> dict[str, float]:
        names = ("boxes_left", "nodes", "kinematic_leaves", "collision_leaves", "given_up", "local_searches")
        return {name: float(tree.counts[k]) for k, name in enumerate(names)}

    def _certificate(self, tree: Any) -> Certificate:
        nodes = tree.nodes[: tree.counts[1]]
        blocked = (nodes[:, 0] == -2) | (nodes[:, 0] == -3)
        problem = self.problem
        clearance = problem.tolerances.safety_margin
        if np.any(blocked):
            clearance = max(clearance, float(nodes[blocked, 3].max()))
        data = {
            "tree": nodes[:, 0],
            "splits": nodes[nodes[:, 0] >= 0, 1],
            "blocked": self._pairs(nodes[blocked]),
            "root": self.arrays.root[:, 1:-1],
            "inflation": np.array(inflation(problem)),
            "clearance": np.array([clearance]),
        }
        data["seal"] = seal(data)
        return Certificate(
            kind="branch",
            scope=certificate_scope(problem, bool(np.any(blocked))),
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


def certificate_scope(problem: IKProblem, obstacles_used: bool) -> Scope:
    """What a proof is about: see `workcell.ik.certificate.Scope`."""
    if not obstacles_used:
        return "kinematics"
    given = problem.cover is not None and problem.cover.kind == "given" and problem.checker is None
    return "geometry" if given else "model"


def _refuse(problem: IKProblem) -> None:
    if problem.max_link_rotation is not None:
        raise InputError("branch and bound doesn't know this bound", where="max_link_rotation", remedy="None")
    if problem.cover is not None:
        for piece in problem.obstacles:
            if piece.kind not in KINDS:
                raise InputError(
                    f"a piece of kind {piece.kind!r}", where=piece.name, remedy=f"one of {', '.join(KINDS)}"
                )
