"""What a search can prove on its way: an empty relaxation, a last link in collision, cuboids that leave no room."""

from __future__ import annotations

import numpy as np

from workcell.ik.certificate import Certificate
from workcell.ik.elementary.bounds import prove_impossible
from workcell.ik.ikspark.instance import Instance
from workcell.ik.ikspark.obstacles.cuboids import whole_set
from workcell.ik.ikspark.rays import certify_homeless, certify_kinematics, certify_model
from workcell.ik.ikspark.search import Search
from workcell.pose import Array

ASKED_AFTER = 30
"""Cone programs before the whole set with cuboids is asked whether it is empty: it is a large one."""
PROOF_AFTER = 500
"""Cone programs (or half of what the budget is worth) before a proof about the cuboids is the answer."""


class Proving:
    """The proofs of one query, each looked for once."""

    def __init__(self, search: Search, instance: Instance) -> None:
        self._search, self._problem, self._instance = search, search.problem, instance
        self._bounds_tried = self._model_tried = False
        self._model: Certificate | None = None

    def of_empty(self, ray: Array) -> Certificate | None:
        """That the relaxation is empty, from a ray of it."""
        proof = certify_kinematics(self._problem, ray)
        self._search.stages.add("proof", note="too weak" if proof is None else "the relaxation is empty")
        if proof is None:
            self._search.note("the relaxation is empty, but not by the margin that the tolerances need")
        return proof

    def of_bounds(self) -> Certificate | None:
        """That spheres of the last link collide where the target puts them: no search is needed to see that."""
        if self._bounds_tried or not self._problem.obstacles:
            return None
        self._bounds_tried = True
        proof = prove_impossible(self._problem)
        self._search.stages.add("elementary bounds", note="" if proof is None else "a proof")
        return proof

    def of_cuboids(self, *, at_last: bool = False) -> Certificate | None:
        """That not every sphere can be in one of the cuboids that were given.

        It is kept until `PROOF_AFTER`, or until the end: the true obstacles may leave more room. What the solver grew
        itself has no part in it, and of a free space that queries let grow nothing is said.
        """
        if not self._model_tried and (at_last or self._search.stats["sdps"] >= ASKED_AFTER):
            self._model_tried = True
            self._model = self._in_given_cuboids()
        enough = self._search.stats["sdps"] >= min(PROOF_AFTER, 0.5 * self._search.most)
        return self._model if enough or at_last else None

    def _in_given_cuboids(self) -> Certificate | None:
        problem, given = self._problem, self._problem.free_space
        if given is None or problem.grow is not None or problem.cover is None or not problem.obstacles:
            return None
        whole = whole_set(self._instance, problem, given)
        if whole is None:
            return certify_homeless(problem)
        root = whole.solve(np.zeros(self._instance.lift.size))
        self._search.stats["sdps"] += 1
        self._search.stages.add("cuboids", note=f"the set with every sphere in one: {root.status}")
        return certify_model(problem, root.z) if root.status == "infeasible" else None
