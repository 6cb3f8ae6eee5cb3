"""OMPL's planners beside ours: the same goals, and our compiled proof of an edge as their motion validator.

OMPL calls Python once for an edge, not once for a state; the extra is `workcell[ompl]`.
"""

from __future__ import annotations

import importlib
import importlib.util
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from workcell.motion.body import kernels
from workcell.pose import Array

if TYPE_CHECKING:
    from workcell.motion.kernels.body import Body

MOST = 4000
"""Configurations of one edge that are looked at."""


@dataclass(frozen=True, slots=True)
class OmplPath:
    """What OMPL found.

    Attributes:
        path: (k, n) corners; None when none was found.
        cpu_s: CPU seconds of the search and its simplification.
        edges: edges that the validator was asked about.
    """

    path: Array | None
    cpu_s: float
    edges: int


def installed() -> bool:
    """Whether the extra is there."""
    return importlib.util.find_spec("ompl") is not None


def plan_ompl(
    body: Body,
    bounds: Array,
    start: Array,
    goals: Array,
    planner: str,
    budget_s: float,
    seed: int,
    simplify: bool,
) -> OmplPath:
    """Ask one planner of `ompl.geometric` for a path from `start` (n,) to any of `goals` (k, n).

    Args:
        bounds: (n, 2) joint limits.
        planner: its class, such as `RRTConnect` or `BITstar`. An asymptotically optimal one uses all of its time.
        budget_s: CPU seconds.
        simplify: let OMPL shorten what it found.
    """
    base, geometric, util = (
        importlib.import_module(f"ompl.{part}") for part in ("base", "geometric", "util")
    )
    util.setLogLevel(util.LogLevel.LOG_NONE)
    util.RNG.setSeed(seed + 1)
    n = len(start)
    space = base.RealVectorStateSpace(n)
    limits = base.RealVectorBounds(n)
    for k in range(n):
        limits.setLow(k, float(bounds[k, 0]))
        limits.setHigh(k, float(bounds[k, 1]))
    space.setBounds(limits)
    information = base.SpaceInformation(space)
    motions, states = _validators(base, information, body, n)
    information.setMotionValidator(motions)
    information.setStateValidityChecker(states)
    information.setup()
    definition = base.ProblemDefinition(information)
    definition.addStartState(_state(space, start))
    region = base.GoalStates(information)
    for goal in goals:
        region.addState(_state(space, goal))
    definition.setGoal(region)
    definition.setOptimizationObjective(base.PathLengthOptimizationObjective(information))
    search = getattr(geometric, planner)(information)
    search.setProblemDefinition(definition)
    search.setup()
    began = time.process_time()
    deadline = began + budget_s
    search.solve(base.PlannerTerminationCondition(lambda: time.process_time() > deadline))
    path = None
    if definition.hasExactSolution():
        solution = definition.getSolutionPath()
        if simplify:
            geometric.PathSimplifier(information).simplifyMax(solution)
        path = np.array([[state[k] for k in range(n)] for state in solution.getStates()])
    return OmplPath(path, time.process_time() - began, motions.asked)


def _state(space: Any, q: Array) -> Any:
    state = space.allocState()
    for k, value in enumerate(q):
        state[k] = float(value)
    return state


def _validators(base: Any, information: Any, body: Body, n: int) -> tuple[Any, Any]:
    """The compiled proof as OMPL wants it: of a motion, and of a single state."""
    entries = kernels()
    ends, out = np.empty((2, n)), np.empty(7)

    class Motions(base.MotionValidator):  # type: ignore[misc]
        def __init__(self, space: Any) -> None:
            super().__init__(space)
            self.asked = 0

        def checkMotion(self, first: Any, second: Any, *last_valid: Any) -> bool:
            self.asked += 1
            for k in range(n):
                ends[0, k], ends[1, k] = first[k], second[k]
            code: int = entries.prove_lines(body, ends, 0.0, entries.FINEST, MOST, out)
            proved: bool = code == entries.PROVED
            return proved

    class States(base.StateValidityChecker):  # type: ignore[misc]
        def isValid(self, state: Any) -> bool:
            for k in range(n):
                ends[0, k] = ends[1, k] = state[k]
            code: int = entries.prove_lines(body, ends, 0.0, entries.FINEST, 1, out)
            proved: bool = code == entries.PROVED
            return proved

    return Motions(information), States(information)
