"""`ik` of mechanisms: linkages, hands, arms that are tied to each other, and several goals at once."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from workcell.cli import exit_codes
from workcell.cli.output import busy, print_json, tell
from workcell.errors import InputError, ModelError, UnknownNameError, WorkcellError
from workcell.ik.problem import Budget
from workcell.pose import Pose

if TYPE_CHECKING:
    from workcell.ik.mechanisms.goals import FrameGoal
    from workcell.ik.mechanisms.problem import MechanismProblem
    from workcell.ik.mechanisms.result import MechanismResult
    from workcell.model.mechanism.mechanism import Mechanism
    from workcell.model.scene import Scene
    from workcell.sets.goals import Goals

_WORK = {"sdps": "cone programs", "restarts": "restarts", "cuts": "rows added", "starts": "random starts"}
"""Numbers of solvers that are told, and their words."""
_MOST_TOLD = 5


def asks_of_mechanism(options: argparse.Namespace) -> bool:
    """Whether a question is about a mechanism, whatever the model is."""
    from workcell.model.loading.assets import is_path, list_assets, list_tasks

    if options.goals is not None or options.mechanism or options.closest or options.form is not None:
        return True
    name = str(options.robot)
    if options.cell is not None:
        return False
    if is_path(name):
        return name.endswith(".toml")
    others = {*list_assets("cells"), *list_tasks()}
    return name in others and name not in list_assets("robots")


def answer_mechanism(options: argparse.Namespace, refused: WorkcellError | None = None) -> int:
    """Answer a question about a mechanism.

    Args:
        options: of `ik`.
        refused: why the model is no serial robot, or has no such tool; raised where it is no mechanism, or has no such
            frame, either.
    """
    from workcell.ik.mechanisms.hygiene import check_problem
    from workcell.ik.mechanisms.nearest import without_poses
    from workcell.ik.solve_mechanism import (
        CLOSEST_SOLVERS,
        closest_configuration,
        mechanism_solver_names,
        solve_mechanism,
    )

    if options.solver not in mechanism_solver_names():
        raise UnknownNameError("solver", options.solver, mechanism_solver_names(), where="solver")
    with busy(f"loading {options.cell or options.robot}"):
        try:
            problem, asked = _question(options)
        except (ModelError, UnknownNameError) as error:
            raise refused or error from None
    closest = options.closest or (asked is not None and asked.closest)
    if closest and options.solver not in ("auto", *CLOSEST_SOLVERS):
        raise UnknownNameError("solver", options.solver, ("auto", *CLOSEST_SOLVERS), where="--closest")
    notes = (*problem.mechanism.notes, *check_problem(without_poses(problem) if closest else problem))
    result = (closest_configuration if closest else solve_mechanism)(
        problem,
        solver=options.solver,
        budget=Budget(options.budget_s),
        seed=options.seed,
        form=options.form or (asked.form if asked else None) or "quaternion",
    )
    if options.json:
        print_json({**_json(problem, result, notes), "because": None if refused is None else refused.message})
    else:
        because = "" if refused is None else f" ({refused.message})"
        tell(f"as a mechanism{because}: {summary_of(problem.mechanism)}")
        _tell(problem, result, notes)
    if result.solved:
        return exit_codes.DONE
    return exit_codes.IMPOSSIBLE if result.status.is_impossible else exit_codes.NOT_ACHIEVED


def _question(options: argparse.Namespace) -> tuple[MechanismProblem, Goals | None]:
    """The problem, and the file of goals that asks it."""
    from workcell.sets.goals import read_goals
    from workcell.world.mechanism_world import MechanismWorld, mechanism_in

    if options.goals is not None:
        asked = read_goals(Path(options.goals))
        return asked.problem(_source(options)), asked
    target = Pose(np.array(options.pose[:3]), np.array(options.pose[3:]))
    mechanism = mechanism_in(_source(options))
    goal = _goal(options, _frame(options, mechanism), target)
    return MechanismWorld.of(mechanism).problem([goal]), None


def _source(options: argparse.Namespace) -> Scene | str:
    """What the mechanism is in."""
    from workcell.model.loading.assets import is_path, list_assets, list_tasks
    from workcell.model.scene import Scene

    name = options.robot
    known = {*list_assets("robots"), *list_assets("cells"), *list_tasks()}
    if options.cell is not None:
        scene = Scene.load(options.cell)
        return scene if name in scene.robots else Scene.load(options.cell, robot=name)
    if not is_path(name) and not name.endswith(".toml") and name not in known:
        raise UnknownNameError("robot, cell or task", name, known)
    return str(name)


def _frame(options: argparse.Namespace, mechanism: Mechanism) -> str:
    """The frame that is to be at the pose: `--tool`, in a cell the robot's; else `tool`, where there is one."""
    name, known = options.tool or "tool", mechanism.frames
    for found in (name, f"{options.robot}/{name}"):
        if found in known:
            return found
    if options.tool is not None:
        return mechanism.frame(options.tool).name
    raise InputError(
        "which frame is to be at the pose?", where="--tool", remedy=f"known: {', '.join(sorted(known))}"
    )


def _goal(options: argparse.Namespace, frame: str, target: Pose) -> FrameGoal:
    from workcell.ik.mechanisms.goals import FrameGoal

    whole = FrameGoal.posed(frame, target)
    if options.goal == "pose":
        return whole
    if options.goal == "position":
        return replace(whole, rotation=None)
    return FrameGoal.pointing(frame, target.rotation[:, 2], position=target.position)


def summary_of(mechanism: Mechanism) -> str:
    """How many joints of which kinds, and what ties them."""
    kinds = [joint.kind for joint in mechanism.joints]
    words = {"hinge": "hinge", "slide": "slide", "ball": "ball", "free": "floating"}
    listed = ", ".join(f"{kinds.count(kind)} {words[kind]}" for kind in words if kind in kinds)
    ties = [closure.kind for closure in mechanism.closures]
    tied = [
        f"{count} {word}{'s' if count > 1 else ''}"
        for count, word in (
            (ties.count("connect"), "connect"),
            (ties.count("weld"), "weld"),
            (len(mechanism.followers), "coupling"),
            (len(mechanism.sums), "tendon"),
        )
        if count
    ]
    return f"{len(kinds)} joints ({listed}), {'tied by ' + ', '.join(tied) if tied else 'no loops'}"


def _json(problem: MechanismProblem, result: MechanismResult, notes: tuple[str, ...]) -> dict[str, Any]:
    mechanism, measured, certificate = problem.mechanism, result.measured, result.certificate
    return {
        "status": result.status.value,
        "sentence": _sentence(result),
        "solver": result.solver,
        "as": "mechanism",
        "joints": len(mechanism.joints),
        "loops": len(mechanism.closures),
        "q": result.q,
        "joint_values": None if result.q is None else _values(mechanism, result.q),
        "position_error_m": None if measured is None else measured.position_error,
        "rotation_error_rad": None if measured is None else measured.rotation_error,
        "region_error_m": None if measured is None else measured.region_error,
        "closure_error": None if measured is None else measured.closure_error,
        "cost": result.cost,
        "bound": result.bound,
        "gap": result.gap,
        "clearance_m": None if measured is None else measured.clearance.distance,
        "nearest_pair": measured.clearance.pair
        if measured is not None and any(measured.clearance.pair)
        else None,
        "pairs_looked_at": None if measured is None else measured.looked_at,
        "certificate": None
        if certificate is None
        else {"kind": certificate.kind, "statement": certificate.statement, "margin": certificate.margin},
        "notes": notes,
        "rejected": [reason for reason in result.rejected if reason not in notes],
        "stats": result.stats,
    }


def _values(mechanism: Mechanism, q: Any) -> dict[str, list[float] | float]:
    """By joint: one number of hinges and slides, a quaternion wxyz of balls, position and quaternion else."""
    found: dict[str, list[float] | float] = {}
    for joint, at in zip(mechanism.joints, mechanism.value_slices, strict=True):
        numbers = [float(value) for value in q[at]]
        found[joint.name] = numbers[0] if len(numbers) == 1 else numbers
    return found


def _sentence(result: MechanismResult) -> str:
    """The status in words; of a mechanism it is ties, goals and regions that an answer keeps."""
    if result.solved and np.isfinite(result.cost):
        return "The closest configuration that was found keeps every tie, which was independently verified."
    if result.solved:
        return "A configuration that keeps every tie and reaches every goal was found and independently verified."
    return result.status.sentence


def _tell(problem: MechanismProblem, result: MechanismResult, notes: tuple[str, ...]) -> None:
    mechanism, measured = problem.mechanism, result.measured
    tell(f"{result.status.value}: {_sentence(result)}")
    if result.q is not None and measured is not None:
        for name, value in _values(mechanism, result.q).items():
            numbers = [value] if isinstance(value, float) else value
            tell(f"  {name:<20s} {' '.join(f'{round(number, 6) + 0.0:+.6f}' for number in numbers)}")
        if problem.goals:
            tell(
                f"  position error {1e3 * measured.position_error:.2e} mm, "
                f"rotation error {measured.rotation_error:.2e} rad, the worst of {len(problem.goals)} goal(s)"
            )
        if problem.regions:
            tell(
                f"  outside of {len(problem.regions)} region(s) by at most {1e3 * measured.region_error:.2e} mm"
            )
        if mechanism.closures or mechanism.followers or mechanism.sums:
            tell(f"  ties are missed by at most {measured.closure_error:.2e} m (rad), by MuJoCo's measure")
        if any(measured.clearance.pair):
            first, second = measured.clearance.pair
            tell(
                f"  clearance {1e3 * measured.clearance.distance:.1f} mm, between {first} and {second} "
                f"(of {measured.looked_at} pairs)"
            )
    if np.isfinite(result.cost):
        tell(
            f"  cost {result.cost:.6g} (squared errors of positions, metres, and of rotations' entries); "
            f"proved: none is below {result.bound:.6g}, a gap of {result.gap:.2g}"
        )
    if result.certificate is not None:
        tell(f"  proof ({result.certificate.kind}): {result.certificate.statement}")
    for note in notes:
        tell(f"  note: {note}")
    for reason in [reason for reason in result.rejected if reason not in notes][:_MOST_TOLD]:
        tell(f"  rejected: {reason}")
    for line in _work(result):
        tell(f"  {line}")
    tell(f"  solver {result.solver}, {1e3 * result.stats.get('cpu_s', float('nan')):.1f} ms CPU")


def _work(result: MechanismResult) -> list[str]:
    """What each solver did: counts, and the last rank gap."""
    found: dict[str, list[str]] = {}
    for key, value in result.stats.items():
        solver, _, number = key.rpartition(".")
        if solver and value and number in _WORK:
            found.setdefault(solver, []).append(f"{value:.0f} {_WORK[number]}")
        elif solver and number == "rank_gap":
            found.setdefault(solver, []).append(f"rank gap {value:.1e}")
    return [f"{solver}: {', '.join(words)}" for solver, words in found.items()]
