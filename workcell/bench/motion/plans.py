"""Benches of planning, proof and timing."""

from __future__ import annotations

import time
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from workcell.bench.reference import ompl as plan_ompl
from workcell.bench.reference.robots import bench_robot
from workcell.bench.rows import Bench, Row
from workcell.errors import InputError
from workcell.geometry.types import Piece, SphereCover
from workcell.ik.hjcd.solver import collect_solutions
from workcell.ik.problem import Budget
from workcell.motion.body import BodyClearance, pack_body
from workcell.motion.plans.goals import GOALS, ROOM
from workcell.motion.plans.to_pose import plan_to_pose
from workcell.motion.proofs.judge import judge_path
from workcell.motion.proofs.on_spheres import CoverProver
from workcell.pose import Array, Pose
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
_DENSE = 1e-4
"""Radians between the configurations that a proof is checked against."""


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
    if not plan_ompl.installed():
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
                answer = plan_ompl.plan_ompl(
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


def proof_rows(n: int, seed: int, sets: Path | None) -> list[Row]:
    """Proofs of random joint paths of the Sawyer among 30 boxes, checked densely; planted grazes; plans.

    The Sawyer has 22 spheres or so.
    """
    robot, cover = bench_robot("sawyer")
    rng = np.random.default_rng(seed)
    proved, wrong, missed, cpu, looks = 0, 0, 0, [], []
    found, planted, missed_by = 0, 0, []
    for k in range(n):
        if k % 20 == 0:
            boxes = _boxes(rng, 30)
            prover = CoverProver(robot, cover, boxes)
            prover.path(np.zeros((2, robot.dof)))
        points = _random_path(rng, robot.joint_limits)
        began = time.process_time()
        proof = prover.path(points)
        cpu.append(time.process_time() - began)
        looks.append(float(proof.evaluations))
        dense = _smallest(prover.clearance, points, max(proof.margin, 0.0) + 1e-3)
        proved += proof.proved
        wrong += proof.proved and dense < max(proof.margin, 0.0) - 1e-9
        missed += not proof.proved and dense > 1e-5
        if proof.proved:
            planted += 1
            graze = CoverProver(robot, cover, (*boxes, _graze(prover, cover, points, rng))).path(points)
            found += not graze.proved
            missed_by.append(graze.evaluations)
    mean, median, p95 = cpu_figures(cpu)
    return [
        {
            "row": "sawyer/random-paths/proof",
            "n": n,
            "proved": proved,
            "wrong": wrong,
            "refused_though_clear": missed,
            "grazes_planted": planted,
            "grazes_found": found,
            "cpu_ms_mean": mean,
            "cpu_ms_median": median,
            "cpu_ms_p95": p95,
            "cpu_ms_max": 1e3 * max(cpu),
            "looks_median": float(np.median(looks)),
            "spheres": len(cover),
        }
    ]


def _boxes(rng: np.random.Generator, count: int) -> tuple[Piece, ...]:
    """Boxes around the robot, none within 0.25 m of its base's axis."""
    pieces: list[Piece] = []
    while len(pieces) < count:
        centre, half = rng.uniform([-1, -1, -0.3], [1, 1, 1.2]), rng.uniform(0.02, 0.1, 3)
        if np.hypot(*centre[:2]) > 0.25 + np.hypot(*half[:2]):
            pieces.append(Piece(f"box {len(pieces)}", "box", Pose.from_xyz(centre), half))
    return tuple(pieces)


def _random_path(rng: np.random.Generator, limits: Array) -> Array:
    """Two to four corners, 0.05 to 1 rad apart."""
    points = [rng.uniform(limits[:, 0], limits[:, 1])]
    for _ in range(int(rng.integers(1, 4))):
        step = rng.normal(size=len(limits))
        moved = points[-1] + step / np.linalg.norm(step) * rng.uniform(0.05, 1.0)
        points.append(np.clip(moved, limits[:, 0], limits[:, 1]))
    return np.array(points)


def _smallest(clearance: BodyClearance, points: Array, limit: float) -> float:
    """The smallest clearance at configurations `_DENSE` radians apart; what is above `limit` is of no interest."""
    smallest = np.inf
    for a, b in pairwise(points):
        count = max(2, int(np.abs(b - a).max() / _DENSE) + 1)
        smallest = min(
            smallest, float(clearance.many(a + np.linspace(0, 1, count)[:, None] * (b - a), limit).min())
        )
    return smallest


def _graze(prover: CoverProver, cover: SphereCover, points: Array, rng: np.random.Generator) -> Piece:
    """A ball of 1 cm that some moving sphere enters by 1 mm at a random place of the path."""
    q = points[0] + rng.uniform(0.2, 0.8) * (points[1] - points[0])
    centres = cover.centres_world(prover.robot.link_transforms(q))
    sphere = int(rng.choice(np.flatnonzero(cover.link >= 3)))
    away = rng.normal(size=3)
    away /= np.linalg.norm(away)
    place = centres[sphere] + (cover.radius[sphere] + 0.01 - 1e-3) * away
    return Piece("graze", "sphere", Pose.from_xyz(place), np.array([0.01]))


BENCHES = (
    Bench("plan", 50, f"workcell plan on problem-set files; paths keep {1e3 * ROOM:g} mm where they can", plan_rows),
    Bench("plan-ompl", 20, "OMPL with the compiled proof of edges, on the same files (extra: ompl)", ompl_rows),
    Bench(
        "plan-proof", 1000, "continuous proofs of random paths, checked every 1e-4 rad, and planted grazes", proof_rows
    ),
)  # fmt: skip
