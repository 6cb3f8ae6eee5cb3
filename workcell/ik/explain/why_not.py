"""Why a query ends in "no": what would have to go to make it possible, found by deciding the query without it.

The obstacles, the joints' limits, the wanted rotation and the robot's collisions with itself are taken away: each alone
first, then ever more of them, until a smallest set is found that makes the query possible. Each step is a query of its
own, decided as every other: with a verified configuration or a proof. A proof says what it used, and sets that leave
all of that in place need not be asked about.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from workcell import clock
from workcell.errors import InputError
from workcell.geometry.types import Piece, obstacle_name
from workcell.ik.certificate import Certificate
from workcell.ik.check import obstacles_used
from workcell.ik.explain.closest import ClosestPose, closest_pose
from workcell.ik.judge.verify import verify
from workcell.ik.problem import ITSELF, Budget, IKProblem
from workcell.ik.result import IKResult, Status
from workcell.ik.solve import solve

_STEP = 0.5
"""Effort for deciding one step."""
_CLOSEST = 2.0
"""Effort for the closest pose."""
MOST_STEPS = 60
"""Queries after which no smaller set is looked for."""
_OBSTACLE, _LIMIT, _ROTATION = "obstacle", "limits of joint", "rotation"
_ITSELF = "self-collision"


@dataclass(frozen=True, slots=True)
class Cause:
    """Something that a query demands.

    Attributes:
        kind: an obstacle to be missed, a joint's limits, the target's rotation, or that the robot misses itself.
        name: the obstacle, the joint, or the two links that touch.
    """

    kind: str
    name: str = ""

    def __str__(self) -> str:
        if self.kind == _ROTATION:
            return "the target's rotation"
        if self.kind == _ITSELF:
            return f"the robot's collision with itself{f' ({self.name})' if self.name else ''}"
        return f"the {self.kind} {self.name}"


@dataclass(frozen=True, slots=True)
class Explanation:
    """Why there is no solution.

    Attributes:
        status: of the query explained.
        causes: a set whose removal makes the query possible, none of which can stay; empty when nothing that was tried
            does.
        smallest: whether it was decided that no set of fewer causes does.
        alternatives: other single causes whose removal alone does as well.
        pieces: the obstacles among the causes.
        undecided: steps that ended neither in a configuration nor in a proof: the set may be smaller than it is.
        solution: (n,) a configuration that is verified once the causes are gone; None without causes.
        closest: the nearest pose that is possible as things are, or None.
        steps: queries decided on the way.
    """

    status: Status
    causes: tuple[Cause, ...]
    smallest: bool
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
            words = (
                "taking away obstacles, joint limits, the wanted rotation and self-collisions, even all together, "
                "does not help"
            )
            if self.undecided:
                words = "nothing that was taken away made it possible within the time for it"
        else:
            words = f"it would be possible without {_listed(self.causes)}"
            if len(self.causes) > 1:
                words += (
                    " (no fewer do)"
                    if self.smallest
                    else " (none of these can stay, but fewer others may do)"
                )
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
            "smallest": self.smallest,
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
                "proved": closest.proved,
                "none_closer_than_m": closest.bound.position,
                "no_cost_below": closest.bound.cost,
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
        budget: CPU seconds after which no more steps are decided; default 20 s. Work ends each step.
        seed: of the solvers.

    Raises:
        InputError: the query was solved.
    """
    if result.solved:
        raise InputError(
            "this query is SOLVED", where="result", remedy="ask why only where there is no solution"
        )
    steps = _Steps(problem, budget or Budget(20.0), seed)
    # what can be moved comes first in `candidates`, and limits can't
    singles = [cause for cause in steps.candidates(result.certificate) if steps.possible((cause,))]
    causes, smallest = (tuple(singles[:1]), True) if singles else steps.several()
    found = steps.solution_without(causes)
    closest = closest_pose(
        problem, Budget(60.0, effort=_CLOSEST), seed, near=() if found is None else (np.array(found),)
    )
    blamed = {cause.name for cause in causes if cause.kind == _OBSTACLE}
    pieces = tuple(piece for piece in problem.obstacles if obstacle_name(piece) in blamed)
    return Explanation(
        result.status,
        steps.named(causes, causes),
        smallest,
        tuple(steps.named((cause,), (cause,))[0] for cause in singles[1:]),
        pieces,
        steps.undecided,
        found,
        closest,
        steps.count,
    )


class _Steps:
    """The queries on the way, each decided once."""

    def __init__(self, problem: IKProblem, budget: Budget, seed: int) -> None:
        self._problem, self._seed = problem, seed
        self._deadline = clock.cpu_seconds() + budget.cpu_s
        self._known: dict[frozenset[Cause], IKResult] = {}
        self._needed: list[frozenset[Cause]] = []
        self.undecided = 0
        names = dict.fromkeys(obstacle_name(piece) for piece in problem.obstacles)
        self.obstacles = [Cause(_OBSTACLE, name) for name in names]
        self.limits = [
            Cause(_LIMIT, name)
            for name, bound in zip(problem.robot.joint_names, _bounded(problem), strict=True)
            if bound
        ]
        self.rotation = [Cause(_ROTATION)] if problem.goal != "position" else []
        self.itself = [Cause(_ITSELF)] if _minds_itself(problem) else []

    @property
    def count(self) -> int:
        return len(self._known)

    @property
    def every(self) -> list[Cause]:
        """All that may be to blame."""
        return [*self.obstacles, *self.itself, *self.limits, *self.rotation]

    def candidates(self, certificate: Certificate | None) -> list[Cause]:
        """What may be to blame alone. A proof holds without the obstacles that it does not use: they are not."""
        used = None if certificate is None else self._used(self._problem, certificate)
        return [cause for cause in self.every if used is None or cause in used]

    def _used(self, problem: IKProblem, certificate: Certificate) -> frozenset[Cause]:
        """What a proof may rest on: the obstacles that it names (all, if it names none), and what it doesn't tell."""
        names = obstacles_used(problem, certificate)
        gone = [] if certificate.scope != "kinematics" else self.itself
        return frozenset(
            cause
            for cause in self.every
            if cause not in gone and (cause.kind != _OBSTACLE or names is None or cause.name in names)
        )

    def possible(self, causes: Collection[Cause]) -> bool:
        """Whether the query without these causes has a verified solution; "no" when it could not be decided."""
        key = frozenset(causes)
        if key not in self._known:
            left, reduced = self._deadline - clock.cpu_seconds(), self._reduced(key)
            result = solve(reduced, budget=Budget(max(left, 0.0), effort=_STEP), seed=self._seed)
            self._known[key] = result
            self.undecided += not (result.solved or result.status.is_proof)
            if result.certificate is not None and result.status.is_proof:
                self._needed.append(self._used(reduced, result.certificate) - key)
        return self._known[key].solved

    def solution_without(self, causes: Sequence[Cause]) -> tuple[float, ...] | None:
        """The configuration that was found without these causes."""
        if not causes:
            return None
        return tuple(float(angle) for angle in self._known[frozenset(causes)].unwrap())

    def named(self, causes: Iterable[Cause], gone: Sequence[Cause]) -> tuple[Cause, ...]:
        """The causes; a self-collision with the two links that touch in the solution found without `gone`."""
        return tuple(
            Cause(_ITSELF, self._touching(gone)) if cause.kind == _ITSELF else cause for cause in causes
        )

    def _touching(self, gone: Sequence[Cause]) -> str:
        others = self._reduced([cause for cause in gone if cause.kind != _ITSELF])
        found = self.solution_without(gone)
        assert found is not None
        first, second = verify(others, np.array(found)).clearance.pair
        return f"{first} with {second}"

    def several(self) -> tuple[tuple[Cause, ...], bool]:
        """A set of causes, no one of which is enough, and whether no smaller one does.

        A set of which nothing can stay bounds its size from above; smaller ones are then looked through, but for those
        that leave in place all that one of the proofs used.
        """
        found = self._deleted()
        for size in range(2, len(found)):
            for causes in itertools.combinations(self.every, size):
                if not all(needed.intersection(causes) for needed in self._needed):
                    continue
                if self.count >= MOST_STEPS and frozenset(causes) not in self._known:
                    return found, False
                if self.possible(causes):
                    return causes, self.undecided == 0
        return found, self.undecided == 0

    def _deleted(self) -> tuple[Cause, ...]:
        """Everything is taken away, then put back one by one as long as the rest stays possible; limits first."""
        order = [*self.rotation, *self.limits, *self.itself, *self.obstacles]
        if not self.possible(order):
            return ()
        gone = order
        for cause in order:
            fewer = [other for other in gone if other != cause]
            if fewer and self.possible(fewer):
                gone = fewer
        return tuple(gone)

    def _reduced(self, causes: Collection[Cause]) -> IKProblem:
        problem = self._problem
        names = {cause.name for cause in causes if cause.kind == _OBSTACLE}
        if any(cause.kind == _ITSELF for cause in causes):
            names.add(ITSELF)
        if names:
            problem = (problem.without or _without_pieces)(problem, names)
        joints = {cause.name for cause in causes if cause.kind == _LIMIT}
        if joints:
            problem = _unlimited(problem, joints)
        if any(cause.kind == _ROTATION for cause in causes):
            problem = replace(problem, goal="position")
        return problem


def _minds_itself(problem: IKProblem) -> bool:
    """Whether collisions of the robot with itself count, and can be left out of account."""
    own = problem.self_collision
    return (own is not None and len(own) > 0) or (problem.checker is not None and problem.without is not None)


def _without_pieces(problem: IKProblem, names: Collection[str]) -> IKProblem:
    kept = tuple(piece for piece in problem.obstacles if obstacle_name(piece) not in names)
    own = None if ITSELF in names else problem.self_collision
    return replace(problem, obstacles=kept, self_collision=own)


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
