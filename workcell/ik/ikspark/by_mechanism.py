"""IKSPARK on a serial robot by way of its mechanism: what the serial formulation has no rows for.

Slides, joints that follow others, and goals that are a part of a pose are in the formulation for mechanisms
(`workcell.ik.ikspark.mechanisms`). What is read there is judged as all answers are, and its proofs are about the robot.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from math import inf

import numpy as np
from numpy.typing import NDArray

from workcell import clock
from workcell.geometry.types import FreeSpace
from workcell.ik.ikspark.mechanisms.solver import solve_mechanism_ikspark
from workcell.ik.ikspark.obstacles.door import check_free_space
from workcell.ik.ikspark.obstacles.growing import Room
from workcell.ik.judge.verify import Verifier
from workcell.ik.mechanisms.of_problem import mechanism_problem, of_robot_problem
from workcell.ik.mechanisms.result import MechanismCandidate
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.result import Candidate
from workcell.ik.shared.limits import Interval
from workcell.model.mechanism.mechanism import WORLD
from workcell.model.mechanism.of_robot import variables_of
from workcell.pose import Array

REGIONS_FIRST = 0.5
"""Work among regions of free space (or half of what the budget is worth) before the turn of planes, in seconds."""


def needs_mechanism(problem: IKProblem) -> bool:
    """Whether the serial formulation does not take a problem."""
    robot = problem.robot
    return problem.goal != "pose" or robot.coupling is not None or bool(robot.prismatic.any())


def solve_by_mechanism(
    problem: IKProblem,
    budget: Budget,
    seed: int = 0,
    *,
    cuboids: bool = True,
    fallback: bool = True,
    apart: bool = True,
) -> Candidate:
    """Look for a configuration, or for a proof that there is none, until the budget is spent.

    Args:
        problem: any serial robot; any goal.
        budget: CPU seconds, and work in cone programs.
        seed: of the directions.
        cuboids, fallback, apart: as of `solve_ikspark`.

    Raises:
        InputError: free space made for another scene or cover.
    """
    check_free_space(problem)
    if Interval.of(problem).empty:
        return Candidate(rejected=("q_reference lies farther outside the joint limits than max_step",))
    question, robot, verifier = mechanism_problem(problem), problem.robot, Verifier(problem)
    if not apart:
        question = replace(question, apart=None)

    def judge(q: Array) -> tuple[str, ...]:
        return verifier(variables_of(robot, q)).reasons

    by_planes = replace(question, free_space=None, grow=None)
    room = _room(problem) if cuboids else None
    if room is None:
        return _answer(problem, solve_mechanism_ikspark(by_planes, budget, seed, judge=judge))
    began = clock.cpu_seconds()
    among = replace(question, free_space=room.free_space, grow=partial(_grown, room))
    first, rest = _shares(budget) if fallback else (budget, budget)
    found = solve_mechanism_ikspark(among, first, seed, judge=judge)
    if not fallback or found.q is not None or found.certificate is not None:
        return _answer(problem, found, room)
    left = max(budget.cpu_s - (clock.cpu_seconds() - began), 0.0)
    after = solve_mechanism_ikspark(by_planes, replace(rest, cpu_s=left), seed + 1, judge=judge)
    return _answer(problem, _together(found, after))


def _shares(budget: Budget) -> tuple[Budget, Budget]:
    """What is spent among regions of free space, and what on planes after that."""
    effort = inf if budget.effort is None else budget.effort
    first = min(REGIONS_FIRST, 0.5 * effort)
    rest = None if budget.effort is None else effort - first
    return replace(budget, effort=first), replace(budget, effort=rest)


def _together(one: MechanismCandidate, two: MechanismCandidate) -> MechanismCandidate:
    """The second of two turns, with what is to be said of both."""
    stats = {name: value + one.stats.get(name, 0.0) for name, value in two.stats.items()}
    rejected = tuple(dict.fromkeys((*one.rejected, *two.rejected)))
    return replace(two, stats=stats, rejected=rejected, stages=(*one.stages, *two.stages))


def _room(problem: IKProblem) -> Room | None:
    """The free space of a query among obstacles."""
    spheres = problem.cover is not None and len(problem.cover) > 0
    return Room(problem) if spheres and problem.obstacles else None


def _grown(room: Room, points: Array, radii: Array | None = None) -> FreeSpace:
    """The free space with what holds spheres (k,) around points (k, 3)."""
    room.hold(points, np.zeros(len(points)) if radii is None else radii)
    return room.free_space


def _answer(problem: IKProblem, found: MechanismCandidate, room: Room | None = None) -> Candidate:
    q = None if found.q is None else variables_of(problem.robot, found.q)
    held = None if q is None or room is None or found.by else _regions_at(problem, room, q)
    return Candidate(
        q,
        None if found.certificate is None else of_robot_problem(problem, found.certificate),
        found.stats,
        found.rejected,
        found.error,
        found.stages,
        cuboids=held,
        free_space=None if held is None or room is None else room.free_space,
        by=found.by,
    )


def _regions_at(problem: IKProblem, room: Room, q: Array) -> NDArray[np.int64] | None:
    """(m,) the region that each sphere is in at an answer (n,), grown where none holds it; None: one is in none."""
    cover, robot = problem.cover, problem.robot
    assert cover is not None
    centres = cover.centres_world(robot.link_transforms(q))
    needed = cover.radius + problem.tolerances.safety_margin
    homeless = room.regions.holding(centres, needed) < 0
    room.hold(centres[homeless], needed[homeless])
    held = room.regions.holding(centres, needed)
    moving = cover.link != WORLD
    return held if bool(np.all(held[moving] >= 0)) else None
