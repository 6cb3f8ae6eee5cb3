"""Benches of branch and bound: problems cut to pieces, CIDGIK's infeasible ones, wide tolerances, and soundness."""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from workcell.bench.ik.soundness import soundness_rows
from workcell.bench.reference.cidgik_problems import bench_arm, environment, joint_points, spheres
from workcell.bench.reference.closed_forms import parallel_arm
from workcell.bench.reference.generate import generate
from workcell.bench.reference.robots import bench_robot
from workcell.bench.rows import Bench, Row, row_of
from workcell.geometry.types import Piece
from workcell.ik.check import check_certificate
from workcell.ik.judge.exact import ExactDistances, ExactKinematics, smallest_clearance
from workcell.ik.judge.verify import Verifier
from workcell.ik.problem import Budget, IKProblem, Tolerances
from workcell.ik.result import IKResult
from workcell.ik.solve import solve
from workcell.pose import Pose
from workcell.sets.problems import load_problem_set

BUDGET = Budget(5.0)
_CUTTING = Budget(0.5)
_MOST_CUTS = 80
_DEEP = 5e-3
"""Metres by which closed forms must collide: more than a pose within the tolerances could undo."""
_WIDE = Tolerances(position=1e-3, rotation=1e-2)
"""The tolerances of the problem sets' judge."""


def cut_problem(problem: IKProblem, seed: int = 0) -> IKProblem:
    """The same problem with a box over every solution that sampling and branch and bound find, until they find none.

    Each box holds the centre of a sphere of the found configuration's middle links, and keeps off those of the base,
    the first and the last link: they are the same, or nearly, for every solution.
    """
    assert problem.cover is not None
    rng = np.random.default_rng([seed, 9])
    kinematics, cover = ExactKinematics(problem.robot), problem.cover
    fixed = (cover.link <= 1) | (cover.link >= problem.robot.dof - 1)
    ends = dataclasses.replace(
        cover,
        link=cover.link[fixed],
        centre=cover.centre[fixed],
        radius=cover.radius[fixed],
        overshoot=None,
        source=(),
    )
    middle = np.flatnonzero(~fixed)
    for cut in range(_MOST_CUTS):
        q = solve(problem, "auto", _CUTTING, seed + cut).q
        if q is None:
            break
        rotation, position = kinematics.links(q)
        for _ in range(100):
            s = rng.choice(middle)
            centre = rotation[cover.link[s]] @ cover.centre[s] + position[cover.link[s]]
            half = rng.uniform(0.02, 0.05, size=3)
            box = Piece(f"cut{cut}", "box", Pose.from_xyz(centre), half)
            if not len(ends) or smallest_clearance(ends, rotation, position, ExactDistances([box]))[0] > 0.01:
                problem = dataclasses.replace(problem, obstacles=(*problem.obstacles, box))
                break
        else:
            break
    return problem


def supplement_problems(n: int, seed: int) -> Iterator[IKProblem]:
    """CIDGIK's supplement: UR10 in the cube of spheres, poses whose every closed-form configuration collides.

    Neither the tool nor the joint before it collides by itself: those poses are certified trivially. Only the joints'
    points meet the spheres. Poses with fewer than eight closed forms are among them: the paper's figure is of others.
    """
    robot = bench_arm("ur10")
    cover = joint_points(robot)
    pieces = spheres(*environment("cube"))
    rng = np.random.default_rng([seed, 5])
    distances, kinematics = ExactDistances(pieces), ExactKinematics(robot)
    made = 0
    while made < n:
        target = robot.fk(robot.random_configuration(rng))
        problem = IKProblem(robot, target, pieces, cover)
        judge = Verifier(problem)
        solutions = parallel_arm(robot, target)
        if not len(solutions) or any(judge(q).clearance.distance > -_DEEP for q in solutions):
            continue
        _, position = kinematics.links(solutions[0])
        points = np.array([target.position, position[-1], position[-2]])
        if distances(points).min() > 0.0:
            made += 1
            yield problem


def _judged(name: str, problems: Sequence[IKProblem], solver: str) -> Row:
    """A row with what re-checking costs and how large certificates are."""
    results: list[IKResult] = []
    ratios, sizes = [0.0], [0]
    solve(problems[0], solver, Budget(0.05))
    for problem in problems:
        result = solve(dataclasses.replace(problem), solver, BUDGET)
        results.append(result)
        if result.certificate is not None:
            started = time.process_time()
            assert check_certificate(problem, result.certificate) is None
            spent = time.process_time() - started
            ratios.append(spent / max(result.stats["cpu_s"] - spent, 1e-9))
            sizes.append(len(json.dumps(result.certificate.to_json())))
    cpu = [result.stats["cpu_s"] for result in results]
    extra = {
        "certified": float(np.mean([result.status.is_proof for result in results])),
        "cpu_ms_max": 1e3 * max(cpu),
        "check_over_solve_max": max(ratios),
        "certificate_bytes_max": max(sizes),
    }
    return row_of(name, results, extra=extra)


def _cut(n: int, seed: int, sets: Path | None) -> list[Row]:
    rows = []
    for name, problems in _narrow(n, seed, sets):
        cut = [cut_problem(problem, seed + k) for k, problem in enumerate(problems)]
        rows.append(_judged(f"{name}/cut/branch", cut, "branch"))
    return rows


def _narrow(n: int, seed: int, sets: Path | None) -> Iterator[tuple[str, list[IKProblem]]]:
    """Problems to cut: the narrow sets of a folder, or strewn boxes for the robots that travel with workcell."""
    files = [] if sets is None else sorted(sets.glob("*_narrow.json"))
    for file in files:
        loaded = load_problem_set(file)
        yield f"{loaded.robot.name}/narrow", [named.problem for named in loaded.problems[:n]]
    if not files:
        for name in ("sawyer", "iiwa14", "ur10"):
            made = generate(*bench_robot(name), "random", n, seed)
            yield f"{name}/random", [named.problem for named in made.problems]


def _supplement(n: int, seed: int, sets: Path | None) -> list[Row]:
    problems = list(supplement_problems(n, seed))
    return [
        _judged(f"ur10/cube, all closed forms collide/{solver}", problems, solver)
        for solver in ("branch", "auto")
    ]


def _tolerance(n: int, seed: int, sets: Path | None) -> list[Row]:
    """Infeasible problems, with the whole tolerance ball of the problem sets' judge to be excluded."""
    rows = []
    for name, problems in _blocked(n, seed, sets):
        for label, allowed in (("0.1 mm, 0.001 rad", Tolerances()), ("1 mm, 0.01 rad", _WIDE)):
            wide = [dataclasses.replace(problem, tolerances=allowed) for problem in problems]
            rows.append(_judged(f"{name}/{label}", wide, "branch"))
    return rows


def _blocked(n: int, seed: int, sets: Path | None) -> Iterator[tuple[str, list[IKProblem]]]:
    files = [] if sets is None else sorted(sets.glob("*_blocked.json"))
    for file in files:
        loaded = load_problem_set(file)
        yield f"{loaded.robot.name}/blocked", [named.problem for named in loaded.problems[:n]]
    if not files:
        for name in ("ur10", "iiwa14"):
            made = generate(*bench_robot(name), "random", n, seed)
            yield f"{name}/cut", [cut_problem(named.problem, seed) for named in made.problems]


def _soundness(n: int, seed: int, sets: Path | None) -> list[Row]:
    return soundness_rows(n, seed)


BENCHES = (
    Bench("branch-cut", 20, "branch and bound where every solution found has been covered by a box", _cut),
    Bench(
        "branch-supplement",
        100,
        "CIDGIK's supplement: UR10 among spheres, every closed form collides",
        _supplement,
    ),
    Bench(
        "branch-tolerance", 20, "proofs that cover the whole tolerance ball of 1 mm and 0.01 rad", _tolerance
    ),
    Bench(
        "branch-soundness",
        100_000,
        "boxes that hold a planted solution: none may be excluded (n a part)",
        _soundness,
    ),
)
