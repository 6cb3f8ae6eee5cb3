"""Branch and bound on the serial chains of a mechanism that end at its goals.

A chain that can't do what is asked proves that the whole can't. Where all of them can, their joints together are
where a local search for the whole begins.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from workcell import clock
from workcell.ik.branch.solver import BranchSearch, prepare_kernels
from workcell.ik.mechanisms.chains.check import chain_certificate
from workcell.ik.mechanisms.chains.query import ChainQuery, NoChainError, chain_query
from workcell.ik.mechanisms.chains.ways import Way, ways
from workcell.ik.mechanisms.polish import polish_mechanism
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.result import MechanismCandidate
from workcell.ik.problem import Budget
from workcell.ik.stages import StageLog
from workcell.pose import Array, matrix_to_quat

FIRST = 0.02
"""Effort for each chain in the first round, in seconds; every round has four times as much."""
_GROWS = 4.0


def solve_mechanism_chains(problem: MechanismProblem, budget: Budget, seed: int = 0) -> MechanismCandidate:
    """Look for a chain that can't reach its goal, or for a configuration that all chains together suggest.

    Args:
        problem: the question; goals without a position, and joints that no chain passes, say nothing here.
        budget: CPU seconds, and work of branch and bound.
        seed: taken for the signature that all solvers share.
    """
    del seed
    return _Chains(problem, budget).run()


class _Chains:
    def __init__(self, problem: MechanismProblem, budget: Budget) -> None:
        self.problem, self._budget = problem, budget
        self.stages = StageLog()
        self._chains: list[tuple[Way, ChainQuery, BranchSearch]] = []
        self._found: list[tuple[ChainQuery, Array]] = []
        self._boxes = 0.0
        for way in ways(problem):
            try:
                query = chain_query(problem, way)
            except NoChainError:
                continue
            self._chains.append((way, query, BranchSearch(query.problem)))
        self._count = len(self._chains)

    def run(self) -> MechanismCandidate:
        """Rounds of growing effort, until a proof, a configuration, or the end of the budget."""
        if not self._chains:
            return self._answer(rejected=("no serial chain leads from the world to a goal's position",))
        prepare_kernels()
        deadline = clock.cpu_seconds() + self._budget.cpu_s
        left = np.inf if self._budget.effort is None else self._budget.effort
        effort = FIRST
        while self._chains and left > 0.0 and clock.cpu_seconds() < deadline:
            for chain in tuple(self._chains):
                share = min(effort, left)
                if share <= 0.0:
                    break
                left -= share
                way, query, search = chain
                candidate = search.run(deadline, replace(self._budget, effort=share))
                if candidate.certificate is not None:
                    self.stages.add("chain", note=f"{_named(way)} can't reach its goal")
                    return self._answer(
                        certificate=chain_certificate(self.problem, way, candidate.certificate)
                    )
                if candidate.q is not None:
                    self.stages.add("chain", note=f"{_named(way)} can reach its goal")
                    self._found.append((query, candidate.q))
                    self._chains.remove(chain)
            effort *= _GROWS
        return self._answer(q=self._together()) if self._found and not self._chains else self._answer()

    def _together(self) -> Array:
        """What the chains suggest for the whole, polished; who judges it finds out whether it is an answer."""
        problem, mechanism = self.problem, self.problem.mechanism
        q = np.array(mechanism.home if problem.q_reference is None else problem.q_reference)
        for query, values in self._found:
            for joint, value in zip(query.values, values, strict=True):
                if joint >= 0:
                    q[mechanism.value_slices[joint]] = value
        for goal in problem.goals:
            frame = mechanism.frame(goal.frame)
            joint = frame.link - 1
            if goal.position is None or goal.rotation is None or mechanism.joints[joint].kind != "free":
                continue
            R = goal.rotation @ frame.T_link_frame.rotation.T
            at = mechanism.value_slices[joint]
            q[at] = np.concatenate([goal.position - R @ frame.T_link_frame.position, matrix_to_quat(R)])
        polished = polish_mechanism(problem, q)
        self.stages.add("polish", note=f"moved a joint by {polished.moved:.1e}, {polished.worst:.1e} missed")
        return polished.q

    def _answer(self, **parts: object) -> MechanismCandidate:
        stats = {"chains": float(self._count), "reach": float(len(self._found))}
        return replace(MechanismCandidate(stats=stats, stages=self.stages.stages), **parts)  # type: ignore[arg-type]


def _named(way: Way) -> str:
    return f"the chain of {len(way.edges)} to goal {way.goal}"
