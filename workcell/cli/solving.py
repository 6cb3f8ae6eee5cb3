"""`ik`, `solve` and `bench`: questions and answers."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from workcell.cli import exit_codes
from workcell.cli.output import busy, check_outputs, print_json, print_table, progress_bar, tell
from workcell.compile_ahead import DECIDING, compile_ahead
from workcell.errors import InputError, ModelError, UnknownNameError
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.result import IKResult
from workcell.pose import Pose

if TYPE_CHECKING:
    from workcell.world.planning_world import PlanningWorld


def ik(options: argparse.Namespace) -> int:
    """One query, answered in words."""
    from workcell.cli.mechanisms import answer_mechanism, asks_of_mechanism
    from workcell.ik.explain.why_not import explain
    from workcell.ik.solve import check_solver_name, solve

    if (options.pose is None) == (options.goals is None):
        options.parser.error("give --pose, or --goals instead")
    if asks_of_mechanism(options):
        return answer_mechanism(options)
    check_solver_name(options.solver)
    target = Pose(np.array(options.pose[:3]), np.array(options.pose[3:]))
    try:
        with busy(f"loading {options.cell or options.robot}"):
            world = _world(options)
    except (ModelError, UnknownNameError) as error:
        if isinstance(error, UnknownNameError) and error.kind != "tool":
            raise
        return answer_mechanism(options, error)
    _compile_ahead(options.solver)
    problem = replace(world.problem(target), goal=options.goal)
    result = solve(problem, solver=options.solver, budget=Budget(options.budget_s), seed=options.seed)
    why = None
    if result.status.is_proof and not options.no_why:
        why = explain(problem, result, seed=options.seed)
    if options.json:
        print_json({**_result_json(problem, result), "why": None if why is None else why.to_json()})
    else:
        _tell(problem, result)
        if why is not None:
            tell(f"  why: {why.sentence}")
    if result.solved:
        return exit_codes.DONE
    return exit_codes.IMPOSSIBLE if result.status.is_impossible else exit_codes.NOT_ACHIEVED


def _compile_ahead(solver: str) -> None:
    """The portfolio samples first, and decides by branch and bound what that leaves."""
    from workcell.ik.registry import AUTO

    if solver == AUTO:
        compile_ahead(DECIDING)


def _world(options: argparse.Namespace) -> PlanningWorld:
    """The robot alone checks itself against itself; in a cell, against everything there."""
    from workcell.model.loading.assets import is_path, list_assets
    from workcell.model.scene import Scene
    from workcell.world.planning_world import PlanningWorld

    if options.cell is None:
        from workcell.model.scene import robot_scene

        scene = robot_scene(options.robot)
        name = None
    else:
        scene, name = Scene.load(options.cell), options.robot
        if name not in scene.robots:
            if not is_path(name) and name not in list_assets("robots"):
                raise UnknownNameError(
                    "robot", name, {*scene.robots, *list_assets("robots")}, where=options.cell
                )
            if len(scene.robots) > 1:
                raise UnknownNameError("robot", name, scene.robots, where=options.cell)
            scene, name = Scene.load(options.cell, robot=name), None
    return PlanningWorld.of(scene, name, tool=options.tool, seed=options.seed)


def _result_json(problem: IKProblem, result: IKResult) -> dict[str, Any]:
    certificate = result.certificate
    return {
        "status": result.status.value,
        "sentence": result.sentence,
        "solver": result.solver,
        "q": result.q,
        "joint_names": problem.robot.joint_names,
        "position_error_m": result.position_error,
        "rotation_error_rad": result.rotation_error,
        "clearance_m": result.clearance.distance,
        "nearest_pair": result.clearance.pair if any(result.clearance.pair) else None,
        "certificate": None
        if certificate is None
        else {"kind": certificate.kind, "statement": certificate.statement, "margin": certificate.margin},
        "rejected": result.rejected,
        "stats": result.stats,
    }


def _tell(problem: IKProblem, result: IKResult) -> None:
    tell(f"{result.status.value}: {result.sentence}")
    if result.q is not None:
        for name, value in zip(problem.robot.joint_names, result.q, strict=True):
            tell(f"  {name:<20s} {value:+.6f}")
        tell(
            f"  position error {1e3 * result.position_error:.2e} mm, rotation error {result.rotation_error:.2e} rad"
        )
        if any(result.clearance.pair):
            first, second = result.clearance.pair
            tell(f"  clearance {1e3 * result.clearance.distance:.1f} mm, between {first} and {second}")
    if result.certificate is not None:
        tell(f"  proof ({result.certificate.kind}): {result.certificate.statement}")
    for reason in result.rejected[:5]:
        tell(f"  rejected: {reason}")
    tell(f"  solver {result.solver}, {1e3 * result.stats.get('cpu_s', float('nan')):.1f} ms CPU")


def solve(options: argparse.Namespace) -> int:
    """A whole problem set; exit 0 when every problem was processed."""
    from workcell.ik.solve import check_solver_name
    from workcell.sets.problems import load_problem_set
    from workcell.sets.solving import solve_set

    check_solver_name(options.solver)
    _compile_ahead(options.solver)
    with busy(f"reading {options.set}"):
        problem_set = load_problem_set(Path(options.set))
    check_outputs([options.out], [options.set])
    out = Path(options.out) if options.out else None
    with progress_bar(f"solve {Path(options.set).name}", len(problem_set.problems)) as bar:
        summary = solve_set(
            problem_set,
            solver=options.solver,
            budget=Budget(options.budget_s),
            seed=options.seed,
            jobs=options.jobs,
            out=out,
            progress=bar.step,
        )
    if options.json:
        print_json(summary.to_json())
    else:
        print_table(f"{Path(options.set).name}, solver {options.solver}", ["", "value"], summary.rows())
        if out:
            tell(f"wrote {out}")
    return exit_codes.DONE


def bench(options: argparse.Namespace) -> int:
    """Measure one table, or list them."""
    from workcell.bench.tables import list_benches, run_bench

    if options.list:
        rows = [(entry.name, entry.n, entry.description) for entry in list_benches()]
        if options.json:
            print_json([{"bench": name, "n": n, "description": text} for name, n, text in rows])
        else:
            print_table("Benches", ["name", "n", "what it measures"], rows)
        return exit_codes.DONE
    if options.bench is None:
        raise InputError("which bench?", where="bench", remedy="workcell bench --list names them")
    from workcell.files import write_json_atomic

    check_outputs([options.out])
    sets = Path(options.sets) if options.sets else None
    document = run_bench(
        options.bench, n=options.n, seed=options.seed, sets=sets, seeds=options.seeds, jobs=options.jobs
    )
    if options.out:
        write_json_atomic(Path(options.out), document)
    if options.json:
        print_json(document)
    else:
        rows = document["rows"]
        header = list(dict.fromkeys(key for row in rows for key in row))
        print_table(
            f"{document['bench']} (seed {document['seed']})",
            header,
            [[row.get(key) for key in header] for row in rows],
        )
    return exit_codes.DONE
