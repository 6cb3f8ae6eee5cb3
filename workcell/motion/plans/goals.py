"""Goal configurations of a motion to a pose: sampled by inverse kinematics, a round at a time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from workcell import clock
from workcell.ik.hjcd.solver import Collected, collect
from workcell.ik.judge.verify import Verifier
from workcell.ik.problem import Budget, IKProblem
from workcell.motion.body import BodyClearance, Upright
from workcell.pose import Array

ROOM = 5e-4
"""Metres that a path keeps clear where its ends do: what the proofs, ours and others', are easy with."""
GOALS = 6
"""Goal configurations of the first round; every further round has twice as many."""
_LONGEST = 3200
"""Restarts for one of them, at most."""
_FOREVER = 1e9
"""Seconds that are no bound."""
_PULL = 0.3
"""Share of the way from a goal to the corner before it where a nearer goal is looked for."""


class Goals:
    """The goal configurations found so far.

    Args:
        problem: whose target is to be reached.
        clearance: of a configuration, in the planner's model.
        upright: limit on the tool's orientation.
        seed: of the first; every further one has the next.
        start: (n,) where the motion begins: goals are in the whole turns of joints that are nearest to it.

    Attributes:
        rows: (n,) each.
        least: the smallest of their clearances, metres; inf without any.
    """

    def __init__(
        self, problem: IKProblem, clearance: BodyClearance, upright: Upright | None, seed: int, start: Array
    ) -> None:
        self._start = start
        self._problem, self._clearance, self._upright = problem, clearance, upright
        allowed = problem.tolerances
        self._roomy = replace(
            problem, tolerances=replace(allowed, safety_margin=allowed.safety_margin + 2 * ROOM)
        )
        self._seed, self._judge = 1_000_000 * seed, Verifier(problem)
        self.rows: list[Array] = []
        self.least = float("inf")

    def sample(self, restarts: int, deadline: float) -> None:
        """As many from fresh seeds as there are, within so many restarts; those with room to spare, if any.

        The first solution of each seed is taken: later ones of a seed come along one self-motion curve and lie close
        to each other, where all of them may be walled in.
        """
        for question in (self._roomy, self._problem):
            left = restarts
            if not self.rows:
                self.add([q for q in self._beside_start(question, deadline) if self.allowed(q)])
            for _ in range(max(GOALS, len(self.rows))):
                found = self._next(question, deadline, left)
                left -= found.restarts
                self.add([q for q in found.configurations if self.allowed(q)])
                if not found.configurations or left <= 0:
                    # what one seed does not find within its share the next would look for in vain
                    break
            if self.rows:
                return

    def _beside_start(self, question: IKProblem, deadline: float) -> tuple[Array, ...]:
        """What a descent from the start ends in, if it is a goal: the posture that the robot is in already."""
        if self._is_bounded:
            return ()
        left = min(max(deadline - clock.cpu_seconds(), 0.0), _FOREVER)
        beside = replace(question, q_reference=self._start)
        return collect(beside, 1, self._seed, Budget(left, iterations=1)).configurations

    @property
    def _is_bounded(self) -> bool:
        """Whether the problem has a reference of its own, which goals must be near to."""
        return self._problem.max_step is not None or self._problem.max_link_rotation is not None

    def nearer(self, path: Array, floor: float, count: int, deadline: float) -> list[Array]:
        """Up to `count` more that a path shorter than `path` (k, n) may end at, with twice the clearance `floor`.

        The first are looked for from the path's start and from between its last corners, so that they are near by.
        """
        length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
        references: list[Array] = []
        if not self._is_bounded:
            references = [path[0], path[-1] + _PULL * (path[-2] - path[-1])]
        kept: list[Array] = []
        for k in range(count):
            question = self._roomy if self.least >= 2 * ROOM else self._problem
            if k < len(references):
                question = replace(question, q_reference=references[k])
            found = self._next(question, deadline).configurations
            if not found:
                break
            for q in map(self._turned, found):
                near = float(np.linalg.norm(q - path[0])) < length and self.allowed(q)
                if near and float(self._clearance.many(q[None])[0]) >= 2 * floor and self.reaches(q):
                    kept.append(q)
        return kept

    def add(self, rows: list[Array]) -> None:
        """Take in more."""
        rows = [self._turned(q) for q in rows]
        if rows:
            self.rows += rows
            self.least = min(self.least, float(self._clearance.many(np.stack(rows)).min()))

    def offered(self, rounds: int) -> tuple[Array, list[int]]:
        """Goals (k, n) to plan to, and the row of each; with every round in more whole turns, nearest first."""
        robot = self._problem.robot
        able = np.flatnonzero(robot.has_turns(np.stack(self.rows)))
        more = [
            (int(row), q) for row in able for q in robot.turns(self.rows[row], self._start, 1 + rounds)[1:]
        ]
        more.sort(key=lambda other: float(np.linalg.norm(other[1] - self._start)))
        return np.stack([*self.rows, *(q for _, q in more)]), [
            *range(len(self.rows)),
            *(row for row, _ in more),
        ]

    def _turned(self, q: Array) -> Array:
        return self._problem.robot.unwrap(q, self._start)

    def allowed(self, q: Array) -> bool:
        """Whether the tool's orientation limit holds there."""
        return self._upright is None or self._upright.kept(self._problem.robot, q)

    def reaches(self, q: Array) -> bool:
        """Whether the judge of single configurations accepts it."""
        return self._judge(q).accepted

    def _next(self, question: IKProblem, deadline: float, restarts: int = _LONGEST) -> Collected:
        self._seed += 1
        left = min(max(deadline - clock.cpu_seconds(), 0.0), _FOREVER)
        return collect(question, 1, self._seed, Budget(left, iterations=min(restarts, _LONGEST)))
