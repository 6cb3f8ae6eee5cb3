"""Benches of IKSPARK: reachable and far poses, and the direct use of Clarabel against cvxpy."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from workcell import clock
from workcell.bench.ik.ikspark_tables.algorithm1 import ascend_to_rank_one, judged
from workcell.bench.rows import Bench, Row, row_of
from workcell.ik.ikspark.instance import instance_of, relaxation_of
from workcell.ik.ikspark.lift import goal_vector
from workcell.ik.ikspark.rank import LONGEST
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.result import IKResult
from workcell.ik.shared.limits import Interval
from workcell.ik.solve import solve
from workcell.pose import Array, Pose
from workcell.sets.reports import cpu_columns
from workcell.sets.solving import problem_seed

BUDGET = Budget(5.0)
"""CPU seconds a problem."""
AWAY = 2.0
"""Metres along x that a far target is moved by (paper, X-A)."""
ROBOT = "sawyer"
STARTS = (LONGEST, 50)
"""Cone programs of one start at most: as the solver's own, and as the paper's (section X-C.2)."""
UNMEASURED = 3
"""Solves before the clock starts: they import and compile what is loaded lazily."""


def reachable_problems(robot: str, n: int, seed: int) -> list[IKProblem]:
    """Tool poses of `n` configurations drawn evenly within the limits."""
    from workcell.model.loading.load import load_robot

    chain, rng = load_robot(robot).chain(), np.random.default_rng(seed)
    return [IKProblem(chain, chain.fk(chain.random_configuration(rng))) for _ in range(n)]


def far_problems(robot: str, n: int, seed: int) -> list[IKProblem]:
    """The same poses moved by `AWAY` along x."""
    shift = np.array([AWAY, 0.0, 0.0])
    near = reachable_problems(robot, n, seed)
    return [IKProblem(p.robot, Pose(p.target.position + shift, p.target.quat_wxyz)) for p in near]


def bench_ikspark_free(n: int, seed: int, robot: str = ROBOT) -> list[Row]:
    """Random reachable poses without obstacles: one start, the solver, with local search, and plain multi-start."""
    problems = reachable_problems(robot, n, seed)
    starts = [problem_seed(seed, str(k)) for k in range(n)]
    one_start(problems[0], seed)  # imports what is imported lazily
    rows = {
        f"ikspark, one start of {most} programs at most": [
            one_start(problem, start, most) for problem, start in zip(problems, starts, strict=True)
        ]
        for most in STARTS
    }
    rows |= {solver: _results(problems, solver, seed) for solver in ("ikspark", "ikspark+lm", "multistart")}
    return [row_of(f"{robot}/free/{name}", results) for name, results in rows.items()]


def one_start(problem: IKProblem, seed: int, most: int = LONGEST) -> IKResult:
    """Algorithm 1 with Problem 3 once, of `most` cone programs at most, from one random direction."""
    began = clock.cpu_seconds()
    with instance_of(problem) as instance:
        direction = np.random.default_rng(seed).standard_normal(instance.lift.size)
        ascent = ascend_to_rank_one(instance, direction, most)
        result = judged(problem, instance, ascent, {})
    stats = {"sdps": float(ascent.programs), "cpu_s": clock.cpu_seconds() - began}
    return replace(result, stats=stats)


def bench_ikspark_far(n: int, seed: int, robot: str = ROBOT) -> list[Row]:
    """Poses out of reach: how many are certified, the certificates re-checked."""
    problems = far_problems(robot, n, seed)
    return [
        row_of(f"{robot}/far/{solver}", _results(problems, solver, seed, budget))
        for solver, budget in (("ikspark", BUDGET), ("multistart", Budget(0.05)))
    ]


def bench_conic_vs_cvxpy(n: int, seed: int, robot: str = ROBOT) -> list[Row]:
    """One linear function minimised over the relaxation of each pose: Clarabel directly, and through cvxpy.

    `cvxpy-dpp` is the same reduced formulation, compiled once with goal and objective as parameters;
    `cvxpy-rebuilt` is `workcell.ik.ikspark.plain`, built anew for each pose. `next` rows keep the pose and change the
    objective, as restarts and Problem 3 do. `success` is the share whose optimal values agree to 1e-5.
    """
    problems = reachable_problems(robot, n, seed)
    directions = np.random.default_rng(seed).standard_normal((n, relaxation_of(problems[0]).lift.size))
    dpp = _parametrised(problems[0])
    same = [problems[0]] * n
    rows, name = [], f"{robot}/relaxation"
    times, values = _timed(_direct, problems, directions)
    rows.append(_row(f"{name}/clarabel", times, 1.0))
    rows.append(_compared(f"{name}/cvxpy-dpp", dpp, problems, directions, times, values))
    few = min(n, 10)
    rows.append(
        _compared(f"{name}/cvxpy-rebuilt", _rebuilt, problems[:few], directions[:few], times, values[:few])
    )
    with instance_of(problems[0]) as instance:
        times, values = _timed(lambda _, q: instance.solve(q).dual_objective, same, directions)
    rows.append(_row(f"{name}-next/clarabel", times, 1.0))
    rows.append(_compared(f"{name}-next/cvxpy-dpp", dpp, same, directions, times, values))
    return rows


def _compared(
    name: str,
    method: Callable[[IKProblem, Array], float],
    problems: Sequence[IKProblem],
    directions: Array,
    direct: Sequence[float],
    values: Array,
) -> Row:
    """The row of a method, with the ratio of its median time to that of the direct solves."""
    times, found = _timed(method, problems, directions)
    row = _row(name, times, float(np.mean(np.abs(found - values) < 1e-5 * (1.0 + np.abs(values)))))
    row["ratio_to_clarabel"] = float(np.median(times) / np.median(direct))
    return row


def _results(
    problems: Sequence[IKProblem], solver: str, seed: int, budget: Budget = BUDGET
) -> list[IKResult]:
    for problem in problems[:UNMEASURED]:
        solve(problem, solver, Budget(min(budget.cpu_s, 0.2)), seed)
    return [solve(p, solver, budget, problem_seed(seed, str(i))) for i, p in enumerate(problems)]


def _row(name: str, times: Sequence[float], success: float) -> Row:
    return {
        "row": name,
        "n": len(times),
        "success": success,
        **cpu_columns(times),
        "paper": None,
    }


def _timed(
    method: Callable[[IKProblem, Array], float], problems: Sequence[IKProblem], directions: Array
) -> tuple[list[float], Array]:
    method(problems[0], directions[0])
    times, values = [], []
    for problem, direction in zip(problems, directions, strict=True):
        started = time.process_time()
        values.append(method(problem, direction))
        times.append(time.process_time() - started)
    return times, np.array(values)


def _direct(problem: IKProblem, direction: Array) -> float:
    with instance_of(problem) as instance:
        return instance.solve(direction).dual_objective


def _parametrised(example: IKProblem) -> Callable[[IKProblem, Array], float]:
    """The reduced relaxation in cvxpy, compiled once, with goal and objective as parameters."""
    import cvxpy as cp

    from workcell.ik.ikspark.lift import GOAL

    relaxation = relaxation_of(example)
    lift, cones = relaxation.lift, relaxation.cones
    tensor = relaxation.tensor(Interval.of(example), example)
    x, q, goal = cp.Variable(lift.size), cp.Parameter(lift.size), cp.Parameter(GOAL)
    rows = sum(goal[g] * (tensor[:, :-1, g] @ x + tensor[:, -1, g]) for g in range(GOAL))
    constraints = [rows[: cones.zero] == 0]
    first = cones.zero + cones.nonneg
    if cones.nonneg:
        constraints.append(rows[cones.zero : first] >= 0)
    constraints += [cp.SOC(rows[k], rows[k + 1 : k + 4]) for k in range(first, relaxation.head, 4)]
    constraints += [cp.norm(x[d.start : d.start + 2]) <= 1 for d in lift.discs]
    for start in lift.ball_start:
        constraints.append(_matrix(x[int(start) : int(start) + 10]) >> 0)
    compiled = cp.Problem(cp.Minimize(q @ x), constraints)

    def minimum(problem: IKProblem, direction: Array) -> float:
        goal.value, q.value = goal_vector(problem.T_base_tool), direction
        return float(compiled.solve(solver="CLARABEL", tol_gap_abs=1e-6, tol_gap_rel=1e-6, tol_feas=1e-6))

    return minimum


def _matrix(packed: Any) -> Any:
    """A cvxpy matrix (4, 4) of a PSD triangle (10,)."""
    import cvxpy as cp

    from workcell.ik.shared.conic import triangle

    rows, columns, factor = triangle(4)
    spread = np.zeros((16, 10))
    for k, (i, j) in enumerate(zip(rows, columns, strict=True)):
        spread[4 * i + j, k] = spread[4 * j + i, k] = 1.0 / factor[k]
    return cp.reshape(spread @ packed, (4, 4), order="C")


def _rebuilt(problem: IKProblem, direction: Array) -> float:
    """The plain model with the same objective: a linear function of its blocks and discs."""
    import cvxpy as cp

    from workcell.ik.ikspark.plain import relaxation
    from workcell.ik.shared.conic import smat

    lift = relaxation_of(problem).lift
    plain, model = relaxation(problem)
    objective = sum(
        cp.sum(cp.multiply(smat(direction[start : start + 10], 4), model.blocks[link]))
        for link, start in zip(lift.balls, lift.ball_start, strict=True)
    )
    for disc in lift.discs:
        objective = objective + direction[disc.start : disc.start + 2] @ model.discs[disc.link]
    return float(cp.Problem(cp.Minimize(objective), plain.constraints).solve(solver="CLARABEL"))


def _free(n: int, seed: int, sets: Path | None) -> list[Row]:
    return [row for robot in ("sawyer", "ur10", "iiwa14") for row in bench_ikspark_free(n, seed, robot)]


def _far(n: int, seed: int, sets: Path | None) -> list[Row]:
    return [row for robot in ("sawyer", "ur10", "iiwa14") for row in bench_ikspark_far(n, seed, robot)]


def _conic(n: int, seed: int, sets: Path | None) -> list[Row]:
    return bench_conic_vs_cvxpy(n, seed)


BENCHES = (
    Bench("ikspark-free", 200, "IKSPARK on random reachable poses, without obstacles", _free),
    Bench("ikspark-far", 500, "IKSPARK on poses 2 m out of reach: certified, re-checked", _far),
    Bench("ikspark-cvxpy", 50, "one relaxation: Clarabel called directly against cvxpy", _conic),
)
