"""Why a query ends in "no": what would have to go to make it possible, found by deciding the query without it.

The obstacles, the joints' limits and the wanted rotation are taken away, alone where that is enough and otherwise all
together and then put back one by one as long as the rest stays possible. Each step is a query of its own, decided as
every other: with a verified configuration or a proof.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from workcell.errors import InputError
from workcell.geometry.types import Piece, obstacle_name
from workcell.ik.certificate import Certificate
from workcell.ik.check import obstacles_used
from workcell.ik.explain.closest import ClosestPose, closest_pose
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.result import IKResult, Status
from workcell.ik.solve import solve

_STEP_S = 1.0
"""CPU seconds for deciding one step at most."""
_OBSTACLE, _LIMIT, _ROTATION = "obstacle", "limits of joint", "rotation"


@dataclass(frozen=True, slots=True)
class Cause:
    """Something that a query demands: an obstacle to be missed, a joint's limits, the target's rotation."""

    kind: str
    name: str = ""

    def __str__(self) -> str:
        if self.kind == _ROTATION:
            return "the target's rotation"
        return f"the {self.kind} {self.name}"


@dataclass(frozen=True, slots=True)
class Explanation:
    """Why there is no solution.

    Attributes:
        status: of the query explained.
        causes: a smallest set (by number where one alone is enough, else such that none of it can stay) whose removal
            makes the query possible; empty when nothing that was tried does.
        alternatives: other single causes whose removal alone does as well.
        pieces: the obstacles among the causes.
        undecided: steps that ended neither in a configuration nor in a proof: the set may be smaller than it is.
        solution: (n,) a configuration that is verified once the causes are gone; None without causes.
        closest: the nearest pose that is possible as things are, or None.
        steps: queries decided on the way.
    """

    status: Status
    causes: tuple[Cause, ...]
    alternatives: tuple[Cause, ...]
    pieces: tuple[Piece, ...]
    undecided: int
    solution: tuple[float, ...] | None
    closest: ClosestPose | None
    steps: int

    @property
    def sentence(self) -> str:
        """In words."""
        if not self.causes:
            words = "taking away obstacles, joint limits and the wanted rotation, even all together, does not help"
            if self.undecided:
                words = "nothing that was taken away made it possible within the time for it"
        else:
            words = f"it would be possible without {_listed(self.causes)}"
            if self.alternatives:
                words += f", or instead without {_listed(self.alternatives, 'or')}"
        nearest = (
            "no clear configuration was found near it" if self.closest is None else self.closest.sentence
        )
        return f"{words}; {nearest}"

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        closest = self.closest
        return {
            "sentence": self.sentence,
            "without": [{"kind": cause.kind, "name": cause.name} for cause in self.causes],
            "or_without_one_of": [{"kind": cause.kind, "name": cause.name} for cause in self.alternatives],
            "undecided_steps": self.undecided,
            "steps": self.steps,
            "possible_then_at": None if self.solution is None else list(self.solution),
            "closest": None
            if closest is None
            else {
                "q": closest.q,
                "xyz": closest.pose.position,
                "quat_wxyz": closest.pose.quat_wxyz,
                "position_error_m": closest.position_error,
                "rotation_error_rad": closest.rotation_error,
                "clearance_m": closest.clearance.distance,
            },
        }


def explain(
    problem: IKProblem,
    result: IKResult,
    *,
    budget: Budget | None = None,
    seed: int = 0,
) -> Explanation:
    """Say why a query has no solution, or none was found.

    Args:
        problem: the query.
        result: its answer, no configuration.
        budget: CPU seconds in total; default 10 s.
        seed: of the solvers.

    Raises:
        InputError: the query was solved.
    """
    if result.solved:
        raise InputError(
            "this query is SOLVED", where="result", remedy="ask why only where there is no solution"
        )
    steps = _Steps(problem, budget or Budget(10.0), seed)
    causes: tuple[Cause, ...]
    alternatives: tuple[Cause, ...] = ()
    singles = [cause for cause in steps.candidates(result.certificate) if steps.possible((cause,))]
    if singles:
        # obstacles can be moved, limits can't: they come first in `candidates`
        causes, alternatives = (singles[0],), tuple(singles[1:])
    else:
        causes = steps.deleted()
    found = steps.solution_without(causes)
    closest = closest_pose(problem, Budget(2.0), seed, near=() if found is None else (np.array(found),))
    blamed = {cause.name for cause in causes if cause.kind == _OBSTACLE}
    pieces = tuple(piece for piece in problem.obstacles if obstacle_name(piece) in blamed)
    return Explanation(
        result.status, causes, alternatives, pieces, steps.undecided, found, closest, steps.count
    )


class _Steps:
    """The queries on the way, each decided once."""

    def __init__(self, problem: IKProblem, budget: Budget, seed: int) -> None:
        self._problem, self._seed = problem, seed
        self._deadline = time.process_time() + budget.cpu_s
        self._known: dict[frozenset[Cause], IKResult] = {}
        self.undecided = 0
        names = dict.fromkeys(obstacle_name(piece) for piece in problem.obstacles)
        self.obstacles = [Cause(_OBSTACLE, name) for name in names]
        self.limits = [
            Cause(_LIMIT, name)
            for name, bound in zip(problem.robot.joint_names, _bounded(problem), strict=True)
            if bound
        ]
        self.rotation = [Cause(_ROTATION)] if problem.goal != "position" else []

    @property
    def count(self) -> int:
        return len(self._known)

    def candidates(self, certificate: Certificate | None) -> list[Cause]:
        """What may be to blame alone. A proof holds without the obstacles that it does not use: they are not."""
        used = None if certificate is None else obstacles_used(self._problem, certificate)
        blamed = [cause for cause in self.obstacles if used is None or cause.name in used]
        return [*blamed, *self.limits, *self.rotation]

    def possible(self, causes: Collection[Cause]) -> bool:
        """Whether the query without these causes has a verified solution; "no" when it could not be decided."""
        key = frozenset(causes)
        if key not in self._known:
            left = self._deadline - time.process_time()
            result = solve(self._reduced(key), budget=Budget(min(max(left, 0.0), _STEP_S)), seed=self._seed)
            self._known[key] = result
            self.undecided += not (result.solved or result.status.is_proof)
        return self._known[key].solved

    def solution_without(self, causes: Sequence[Cause]) -> tuple[float, ...] | None:
        """The configuration that was found without these causes."""
        if not causes:
            return None
        return tuple(float(angle) for angle in self._known[frozenset(causes)].unwrap())

    def deleted(self) -> tuple[Cause, ...]:
        """Everything is taken away, then put back one by one as long as the rest stays possible; limits first."""
        gone = [*self.rotation, *self.limits, *self.obstacles]
        if not self.possible(gone):
            return ()
        for cause in [*self.rotation, *self.limits, *self.obstacles]:
            fewer = [other for other in gone if other != cause]
            if fewer and self.possible(fewer):
                gone = fewer
        return tuple(gone)

    def _reduced(self, causes: Collection[Cause]) -> IKProblem:
        problem = self._problem
        names = {cause.name for cause in causes if cause.kind == _OBSTACLE}
        if names:
            problem = (problem.without or _without_pieces)(problem, names)
        joints = {cause.name for cause in causes if cause.kind == _LIMIT}
        if joints:
            problem = _unlimited(problem, joints)
        if any(cause.kind == _ROTATION for cause in causes):
            problem = replace(problem, goal="position")
        return problem


def _without_pieces(problem: IKProblem, names: Collection[str]) -> IKProblem:
    kept = tuple(piece for piece in problem.obstacles if obstacle_name(piece) not in names)
    return replace(problem, obstacles=kept)


def _bounded(problem: IKProblem) -> list[bool]:
    """Which joints have limits that forbid some angle; those of sliding joints are the arm's length, not a limit."""
    robot = problem.robot
    moved = np.arange(robot.dof) if robot.coupling is None else robot.coupling.variable
    return [
        not np.any(robot.prismatic[moved == k]) and bool(robot.upper[k] - robot.lower[k] < 2 * np.pi - 1e-9)
        for k in range(robot.dof)
    ]


def _unlimited(problem: IKProblem, joints: Collection[str]) -> IKProblem:
    """The same question for a robot some of whose joints turn all the way round."""
    robot = problem.robot
    free = np.array([name in joints for name in robot.joint_names])
    middle = 0.5 * (robot.lower + robot.upper)
    lower = np.where(free, np.minimum(robot.lower, middle - np.pi), robot.lower)
    upper = np.where(free, np.maximum(robot.upper, middle + np.pi), robot.upper)
    return replace(problem, robot=replace(robot, lower=lower, upper=upper), max_step=None)


def _listed(causes: Sequence[Cause], word: str = "and") -> str:
    names = [str(cause) for cause in causes]
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} {word} {names[-1]}"
