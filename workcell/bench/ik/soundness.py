"""Soundness of the branch and bound and of its checker: no box that holds a planted solution is ever excluded.

A configuration is taken, its tool pose (off by the whole tolerance) made the target, and a random tree of boxes that
hold it is walked down. Every box that a contractor or a collision test excludes, or shrinks off the configuration, is a
violation. Random chains and real arms, with skew, parallel and meeting axes, zero-length links, sliding joints, limits
beyond a turn, singular poses, goals of all kinds and obstacles of all kinds.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from workcell.bench.reference.planting import planted_problem, random_chain, surround
from workcell.ik.branch.arrays import problem_arrays
from workcell.ik.problem import IKProblem, Tolerances
from workcell.model.robot import Robot
from workcell.pose import Array

GOALS = ("pose", "pose", "pose", "axis", "position")
PARTS = (
    "search/C1",
    "search/C2",
    "search/C3",
    "search/linear",
    "search/all",
    "checker/near",
    "checker/through",
    "checker/linear",
    "checker/all",
)
"""What is tried: each contractor alone and all together, of the search and of the checker; collision tests always."""
_LOSS = {1: "contracted away", 2: "called blocked by an obstacle", 3: "called blocked by two spheres"}


@dataclass(frozen=True, slots=True)
class Descent:
    """What descents found: boxes tried, and how many lost their solution, with a description of the first."""

    boxes: int
    violations: int
    first: str = ""


def descend(problem: IKProblem, q: Array, part: str, boxes: int, seed: int) -> Descent:
    """Try `boxes` boxes around `q` (free joints of the goal included) with one of `PARTS`, to the first violation."""
    from workcell.bench.reference import descents

    descents.seed(seed % 2**32)
    side, name = part.split("/")
    arrays = problem_arrays(problem)
    planted = np.concatenate([[0.0], into(q, arrays.root[:, 1:-1], problem), [0.0]])
    if side == "search":
        which = descents.SEARCH.index(name)
        tried, loss, box = _descend_search(arrays, planted, which, boxes)
    else:
        which = descents.CHECKER.index(name)
        tried, loss, box = _descend_checker(problem, arrays.root, planted, which, boxes)
    if loss == 0:
        return Descent(tried, 0)
    return Descent(tried + 1, 1, f"{part}: {planted.tolist()} {_LOSS[loss]}, box now {box}")


def _descend_search(arrays: Any, planted: Array, which: int, boxes: int) -> tuple[int, int, str]:
    from workcell.bench.reference.descents import descend_search
    from workcell.ik.branch.kernels.obstacles import new_sweep
    from workcell.ik.branch.kernels.state import new_state

    state, sweep = new_state(arrays.chain), new_sweep(len(planted))
    tried, loss = descend_search(arrays.chain, arrays.world, state, sweep, arrays.root, planted, which, boxes)
    return tried, loss, f"{state.lower.tolist()} .. {state.upper.tolist()}"


def _descend_checker(
    problem: IKProblem, root: Array, planted: Array, which: int, boxes: int
) -> tuple[int, int, str]:
    from workcell.bench.reference.descents import descend_checker
    from workcell.ik.branch.arrays import inflation
    from workcell.ik.branch.checker.closure import new_box
    from workcell.ik.branch.checker.setup import longest, proof_robot, proof_scene

    robot = proof_robot(problem, np.array(inflation(problem)), longest(problem))
    scene, box = proof_scene(problem, True), new_box(len(planted))
    pairs = np.zeros((0, 2)) if problem.self_collision is None else problem.self_collision.astype(float)
    tried, loss = descend_checker(robot, scene, pairs, box, root, planted, which, boxes)
    return tried, loss, f"{box.lower.tolist()} .. {box.upper.tolist()}"


def plantings(rng: np.random.Generator, robots: tuple[Robot, ...] = ()) -> Iterator[tuple[IKProblem, Array]]:
    """Problems and their solutions without end: random chains of 5 to 8 joints, and `robots` for a third of them."""
    while True:
        goal = GOALS[rng.integers(len(GOALS))]
        if robots and rng.random() < 0.3:
            robot = robots[rng.integers(len(robots))]
        else:
            robot = random_chain(rng, int(rng.integers(5, 9)), sliding=rng.choice([0.0, 0.0, 0.2]))
        # Wide tolerances too: what they do to second order must show.
        allowed = (Tolerances(), Tolerances(1e-3, 1e-2), Tolerances(0.02, 0.1))[rng.integers(3)]
        problem, q = planted_problem(robot, rng, goal=goal, tolerances=allowed)  # type: ignore[arg-type]
        if rng.random() < 0.5:
            problem = surround(
                problem, q, rng, count=int(rng.integers(1, 12)), pairs=int(rng.integers(0, 20))
            )
        yield problem, q


def try_boxes(part: str, boxes: int, seed: int, robots: tuple[Robot, ...] = (), each: int = 1000) -> Descent:
    """Descend with one part until `boxes` boxes have been tried, `each` a problem."""
    rng = np.random.default_rng([seed, PARTS.index(part)])
    tried, violations, first = 0, 0, ""
    for problem, q in plantings(rng, robots):
        if tried >= boxes:
            break
        descent = descend(problem, q, part, min(each, boxes - tried), int(rng.integers(2**31)))
        tried, violations = tried + descent.boxes, violations + descent.violations
        first = first or descent.first
    return Descent(tried, violations, first)


def soundness_rows(n: int, seed: int) -> list[dict[str, Any]]:
    """One row a part with n boxes each: boxes tried, violations, microseconds a box."""
    from workcell.bench.reference.robots import bench_robot

    robots = tuple(bench_robot(name)[0] for name in ("ur10", "iiwa14", "sawyer"))
    rows = []
    for part in PARTS:
        try_boxes(part, 10, seed)
        started = time.process_time()
        descent = try_boxes(part, n, seed, robots, each=5000)
        spent = time.process_time() - started
        rows.append(
            {
                "row": f"branch/soundness/{part}",
                "n": descent.boxes,
                "violations": descent.violations,
                "first_violation": descent.first,
                "cpu_us_per_box": 1e6 * spent / max(descent.boxes, 1),
            }
        )
    return rows


def into(q: Array, root: Array, problem: IKProblem) -> Array:
    """Angles moved by whole turns into the root box (2, N - 2)."""
    from workcell.bench.reference.descents import EDGE

    turn = 2 * np.pi
    turns = np.ones(len(q), dtype=bool)
    turns[: problem.robot.dof] = ~problem.robot.prismatic
    moved = q - turn * np.ceil((q - root[1] - EDGE) / turn) * ((q > root[1] + EDGE) & turns)
    back: Array = moved + turn * np.ceil((root[0] - EDGE - moved) / turn) * ((moved < root[0] - EDGE) & turns)
    return back
