"""Benches of planning: problem-set files, by our planner and by OMPL's."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from workcell.bench.reference import ompl
from workcell.bench.reference.robots import bench_robot
from workcell.bench.rows import Bench, Row
from workcell.errors import InputError
from workcell.ik.hjcd.solver import collect_solutions
from workcell.ik.problem import Budget
from workcell.motion.body import pack_body
from workcell.motion.plans.goals import GOALS, ROOM
from workcell.motion.plans.to_pose import plan_to_pose
from workcell.motion.proofs.judge import judge_path
from workcell.pose import Array
from workcell.sets.problems import NamedProblem, ProblemSet, load_problem_set
from workcell.sets.reports import cpu_figures
from workcell.sets.solving import problem_seed

_MBM = (
    "bookshelf_small",
    "bookshelf_tall",
    "bookshelf_thin",
    "box",
    "cage",
    "table_pick",
    "table_under_pick",
)
FILES = (
    *((f"panda_mbm_{name}", 1.0) for name in _MBM),
    ("sawyer_workcell", 5.0),
    ("sawyer_shelf", 5.0),
)
"""Problem-set files and the CPU seconds that each problem gets."""
OMPL_PLANNERS = (("RRTConnect", 3.0, True), ("BITstar", 0.5, False))
"""Planners of OMPL, the seconds they get, and whether their paths are simplified."""


def plan_rows(n: int, seed: int, sets: Path | None) -> list[Row]:
    """`workcell plan` on the files, every path judged by the independent kernel."""
    rows = []
    for name, budget_s in FILES:
        starts = problems_of(name, n, sets)
        _warm(starts)
        plans = [
            plan_to_pose(item.problem, start, budget=Budget(budget_s), seed=problem_seed(seed, item.id))
            for item, start in starts
        ]
        paths = [plan.path for plan in plans]
        rows.append(path_row(f"{name}/workcell", starts, paths, [plan.stats["cpu_s"] for plan in plans]))
    return rows


def ompl_rows(n: int, seed: int, sets: Path | None) -> list[Row]:
    """OMPL with our compiled proof of edges, on the same files, from the same goals; the goals' time is not counted."""
    if not ompl.installed():
        raise InputError("OMPL is not installed", where="plan-ompl", remedy="pip install 'workcell[ompl]'")
    rows = []
    for name, _ in FILES:
        starts = problems_of(name, n, sets)
        for planner, budget_s, simplify in OMPL_PLANNERS:
            paths: list[Array | None] = []
            cpu, edges = [], 0
            for item, start in starts:
                problem = item.problem
                seeds = range(problem_seed(seed, item.id), problem_seed(seed, item.id) + GOALS)
                found = [q for k in seeds for q in collect_solutions(problem, 1, k, Budget(0.2))]
                body = pack_body(problem.robot, problem.cover, problem.obstacles)
                if not found:
                    paths.append(None)
                    continue
                answer = ompl.plan_ompl(
                    body,
                    problem.robot.joint_limits,
                    start,
                    np.array(found),
                    planner,
                    budget_s,
                    seed,
                    simplify,
                )
                paths.append(answer.path)
                cpu.append(answer.cpu_s)
                edges += answer.edges
            row = path_row(f"{name}/ompl-{planner.lower()}", starts, paths, cpu)
            rows.append(row | {"edges": edges / max(len(cpu), 1)})
    return rows


def problems_of(name: str, n: int, sets: Path | None) -> list[tuple[NamedProblem, Array]]:
    """The first n problems of a file with their starts; the robot's home where the file has none."""
    if sets is None:
        raise InputError("this bench runs problem-set files", where="sets", remedy="--sets FOLDER")
    problem_set = load_problem_set(sets / f"{name}.json")
    home = _home(problem_set)
    return [(item, home if item.start is None else item.start) for item in problem_set.problems[:n]]


def _home(problem_set: ProblemSet) -> Array:
    from workcell.model.loading.assets import list_assets

    if problem_set.robot.name in list_assets("robots"):
        return np.array(bench_robot(problem_set.robot.name)[0].home)
    return np.array(problem_set.robot.home)


def _warm(starts: Sequence[tuple[NamedProblem, Array]]) -> None:
    """One unmeasured problem loads what is loaded lazily."""
    item, start = starts[0]
    plan_to_pose(item.problem, start, budget=Budget(0.5))


def path_row(
    name: str,
    starts: Sequence[tuple[NamedProblem, Array]],
    paths: Sequence[Array | None],
    cpu: Sequence[float],
) -> Row:
    """A row of paths: how many are right, what they took, how long they are; each judged by the independent kernel."""
    verdicts = [
        judge_path(item.problem, start, path)
        for (item, start), path in zip(starts, paths, strict=True)
        if path is not None
    ]
    good = [verdict for verdict in verdicts if verdict.accepted]
    mean, median, p95 = cpu_figures(list(cpu))
    return {
        "row": name,
        "n": len(starts),
        "success": len(good) / len(starts),
        "wrong": len(verdicts) - len(good),
        "cpu_ms_mean": mean,
        "cpu_ms_median": median,
        "cpu_ms_p95": p95,
        "cpu_ms_max": 1e3 * max(cpu, default=float("nan")),
        "length_rad": float(np.mean([verdict.length for verdict in good])) if good else None,
        "clearance_mm": 1e3 * min((v.clearance.distance for v in good), default=float("nan")),
        "paper": None,
    }


BENCHES = (
    Bench("plan", 50, f"workcell plan on problem-set files; paths keep {1e3 * ROOM:g} mm where they can", plan_rows),
    Bench("plan-ompl", 20, "OMPL with the compiled proof of edges, on the same files (extra: ompl)", ompl_rows),
)  # fmt: skip
