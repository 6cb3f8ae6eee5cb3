"""The experiments of CIDGIK's supplement: the nuclear norm alone, infeasible poses, and a first-order solver."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np

from workcell.bench.reference.cidgik_problems import (
    POINT_RADIUS,
    bench_arm,
    environment,
    joint_points,
    random_problems,
    spheres,
)
from workcell.bench.reference.closed_forms import parallel_arm
from workcell.bench.reference.one_start import run_one_start
from workcell.bench.rows import Bench, Row
from workcell.ik.cidgik.solver import prove_cidgik
from workcell.ik.problem import IKProblem
from workcell.ik.trees.query import Balls, Goal, Points, Query, Workspace
from workcell.pose import Array
from workcell.sets.reports import cpu_columns

SLACK = 0.01
"""h(Z) below which the paper counts a point as of low rank after the nuclear norm alone."""
SCS_EPSILONS = (1e-3, 1e-5)
SCS_ITERATIONS = 1000


def _all(n: int, seed: int, sets: Path | None) -> list[Row]:
    rows = [_nuclear(n, seed), _infeasible(n, seed, eight=True), _infeasible(n, seed, eight=False)]
    return rows + _solvers(min(n, 10), seed)


def _row(name: str, times: list[float], success: float, paper: float | None, **more: Any) -> Row:
    return {
        "row": name,
        "n": len(times),
        "success": success,
        **cpu_columns(times),
        "paper": paper,
        **more,
    }


def _nuclear(n: int, seed: int) -> Row:
    """Problem 4 once with C = I on free UR10 poses: how often h(Z) < 1e-2 (`success`)."""
    arm = bench_arm("ur10")
    problems = random_problems(arm, joint_points(arm), *environment("free"), n, seed)
    times, gaps = [], []
    for problem in problems:
        began = time.process_time()
        gaps.append(run_one_start(problem, iterations=1).gaps[0])
        times.append(time.process_time() - began)
    return _row(
        "ur10/free/nuclear-norm-alone",
        times,
        float(np.mean(np.array(gaps) < SLACK)),
        None,
        gap_median=float(np.median(gaps)),
    )


def _infeasible(n: int, seed: int, eight: bool) -> Row:
    """Poses among the cube's spheres all of whose closed-form solutions collide: certified by one relaxation alone.

    The paper's figure stands beside the poses that have all eight, as it words its sample.
    """
    problems = infeasible_problems(n, seed, eight)
    times, proved = [], 0
    for problem in problems:
        began = time.process_time()
        proved += prove_cidgik(problem) is not None
        times.append(time.process_time() - began)
    count, paper = ("all-8-collide", 0.0152) if eight else ("all-2-to-8-collide", None)
    return _row(f"ur10/cube/{count}/one-relaxation", times, proved / n, paper)


def infeasible_problems(n: int, seed: int, eight: bool = False) -> list[IKProblem]:
    """UR10 poses for which every solution collides, although neither the tool nor the last joint's origin does.

    With `eight` only poses that all eight branches of the closed form reach: the paper's words are "collisions over all
    8 possible solutions". The others lie nearer to the edge of what the arm reaches, and are certified more easily.
    """
    arm = bench_arm("ur10")
    cover = joint_points(arm)
    centres, radius = environment("cube")
    pieces = spheres(centres, radius)
    rng = np.random.default_rng(seed)
    problems: list[IKProblem] = []
    while len(problems) < n:
        target = arm.fk(arm.random_configuration(rng))
        solutions = parallel_arm(arm, target)
        if len(solutions) < (8 if eight else 1):
            continue
        links = arm.link_transforms(solutions)
        points = cover.centres_world(links)
        blocked = np.any(np.linalg.norm(points[:, :, None] - centres, axis=-1) < radius, axis=(1, 2))
        fixed = np.array([target.position, links[0, -1, :3, 3]])
        if np.all(blocked) and np.all(np.linalg.norm(fixed[:, None] - centres, axis=-1) >= radius):
            problems.append(IKProblem(arm, target, pieces, cover))
    return problems


def _solvers(n: int, seed: int) -> list[Row]:
    """The first Problem 4 on the 100-sphere table, as the paper writes it, by Clarabel and by SCS through cvxpy.

    `success` is the share solved to the solver's own tolerance; `value_error` the largest relative difference of the
    optimal value from Clarabel's.
    """
    arm = bench_arm("hyper9")
    centres, radius = environment("table")
    problems = random_problems(arm, joint_points(arm), centres, radius, n, seed)
    settings: list[tuple[str, dict[str, Any]]] = [("clarabel", {"solver": "CLARABEL"})]
    for epsilon in SCS_EPSILONS:
        options = {"solver": "SCS", "eps_abs": epsilon, "eps_rel": epsilon, "max_iters": SCS_ITERATIONS}
        settings.append((f"scs-{epsilon:g}", options))
    rows, reference = [], np.zeros(0)
    for name, options in settings:
        times, values, solved = [], [], 0
        for problem in problems:
            spent, value, ok = _solved_plainly(problem, centres, radius, options)
            times.append(spent)
            values.append(value)
            solved += ok
        if name == "clarabel":
            reference = np.array(values)
        error = float(np.nanmax(np.abs(np.array(values) - reference) / np.abs(reference)))
        rows.append(_row(f"hyper9/table/{name}", times, solved / n, None, value_error=error))
    return rows


def _solved_plainly(
    problem: IKProblem, centres: Array, radius: float, options: dict[str, Any]
) -> tuple[float, float, bool]:
    """(the solver's own seconds, optimal value, whether it reached its tolerance) of the nuclear norm."""
    import cvxpy as cp

    from workcell.ik.cidgik.plain import relaxation

    robot = problem.robot
    balls = Balls(centres, np.full(len(centres), radius - POINT_RADIUS))
    points = (
        Points(problem.cover.link, problem.cover.centre, problem.cover.radius)
        if problem.cover
        else Points.none()
    )
    goal = Goal.posed(robot.default_tool, problem.target)
    plain, model = relaxation(Query(robot, (goal,), Workspace(points, balls)))
    whole = cp.Problem(cp.Minimize(cp.trace(model.Z)), plain.constraints)
    try:
        whole.solve(**options)
    except cp.error.SolverError:
        return 0.0, float("nan"), False
    return float(whole.solver_stats.solve_time), float(whole.value), whole.status == "optimal"


BENCHES = (
    Bench(
        "cidgik-supplement",
        100,
        "CIDGIK's supplement: nuclear norm alone, certificates of infeasible poses, SCS",
        _all,
    ),
)
