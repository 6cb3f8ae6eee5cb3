"""HJCD-IK's tables measured again: batch sizes (Table I), joints (Table II), throughput over many targets.

The paper's algorithm (two phases over a batch of seeds) and ours (each seed through both phases, the next one if that
failed) have rows of their own, on the same targets; only the first stands beside the paper's figures. Times of the
paper are wall-clock milliseconds on an RTX 4060 laptop; ours are CPU milliseconds of one core. Its error columns were
not available to us.
"""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from workcell.bench.rows import Bench, Row
from workcell.ik.hjcd.gpu.solver import warp_devices
from workcell.ik.hjcd.solver import solve_batch, solve_two_phase
from workcell.model.robot import Robot
from workcell.model.serial import serial_robot
from workcell.pose import Array, Pose, matrix_to_quat
from workcell.sets.reports import cpu_columns

BATCHES = (1, 10, 100, 1000, 2000)
DOFS = (7, 12, 18, 24)
DOF_BATCH = 1000
"""Seeds in the rows by joints. The paper's number is lost; its 7.80 ms for seven joints lie by Table I's at 1000."""
MANY = 2000
"""Targets of a throughput row."""
CALLS = 500
"""Targets that are solved by a call each."""
SUCCESS = 1e-6
"""Metres and radians within which a target counts as reached."""

_PAPER_BATCH = {
    "panda": dict(zip(BATCHES, (5.18, 5.48, 5.85, 7.53, 8.58), strict=True)),
    "fetch": dict(zip(BATCHES, (4.70, 5.23, 5.78, 7.65, 8.72), strict=True)),
}
_PAPER_DOF = dict(zip(DOFS, (7.80, 9.69, 15.76, 23.05), strict=True))

# Franka Emika Panda, modified Denavit-Hartenberg parameters (a, d, alpha) and limits, from the manufacturer's
# documentation.
_PANDA = (
    (0.0, 0.333, 0.0, -2.8973, 2.8973),
    (0.0, 0.0, -0.5, -1.7628, 1.7628),
    (0.0, 0.316, 0.5, -2.8973, 2.8973),
    (0.0825, 0.0, 0.5, -3.0718, -0.0698),
    (-0.0825, 0.384, -0.5, -2.8973, 2.8973),
    (0.0, 0.0, 0.5, -0.0175, 3.7525),
    (0.088, 0.0, 0.5, -2.8973, 2.8973),
)
"""a and d in metres, alpha in half turns, limits in radians."""
_PANDA_FLANGE = 0.107

# Fetch Robotics arm without torso: joint origins in metres, axes, limits in radians, from fetch_description's URDF.
_FETCH = (
    ((0.119525, 0.0, 0.34858), "z", -1.6056, 1.6056),
    ((0.117, 0.0, 0.06), "y", -1.221, 1.518),
    ((0.219, 0.0, 0.0), "x", -np.pi, np.pi),
    ((0.133, 0.0, 0.0), "y", -2.251, 2.251),
    ((0.197, 0.0, 0.0), "x", -np.pi, np.pi),
    ((0.1245, 0.0, 0.0), "y", -2.16, 2.16),
    ((0.1385, 0.0, 0.0), "x", -np.pi, np.pi),
)
_FETCH_GRIPPER = 0.16645


def panda(dof: int = 7) -> Robot:
    """The Panda's arm to its flange; beyond seven joints, its joints and links are repeated in order."""
    joints = []
    for k in range(dof):
        a, d, alpha, lower, upper = _PANDA[k % 7]
        angle = np.pi * alpha
        R = np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]])
        xyz = [a, -d * np.sin(angle), d * np.cos(angle)]
        joints.append(_joint(k, xyz, matrix_to_quat(R), [0.0, 0.0, 1.0], lower, upper))
    return serial_robot(f"panda{dof}", joints, Pose.from_xyz([0.0, 0.0, _PANDA_FLANGE]))


def fetch() -> Robot:
    """The Fetch's arm to its gripper."""
    joints = []
    for k, (xyz, axis, lower, upper) in enumerate(_FETCH):
        joints.append(_joint(k, xyz, [1.0, 0.0, 0.0, 0.0], np.eye(3)["xyz".index(axis)], lower, upper))
    return serial_robot("fetch", joints, Pose.from_xyz([_FETCH_GRIPPER, 0.0, 0.0]))


def _joint(
    k: int, xyz: Sequence[float], quat: object, axis: object, lower: float, upper: float
) -> dict[str, object]:
    return {"name": f"joint{k + 1}", "xyz": xyz, "quat": quat, "axis": axis, "lower": lower, "upper": upper}


def halton_targets(robot: Robot, n: int, seed: int) -> list[Pose]:
    """Tool poses of n scrambled Halton configurations."""
    from scipy.stats import qmc

    unit = qmc.Halton(robot.dof, seed=seed).random(n)
    return [robot.fk(q) for q in robot.lower + unit * (robot.upper - robot.lower)]


def _batch_rows(n: int, seed: int, sets: Path | None) -> list[Row]:
    rows = []
    for robot, label in ((panda(), "panda"), (fetch(), "fetch")):
        targets = halton_targets(robot, n, seed)
        for batch in BATCHES:
            row = _two_phase_row(f"{label}/batch-{batch}", robot, targets, batch, seed)
            rows.append(row | {"paper_ms": _PAPER_BATCH[label][batch]})
        rows.append(_restart_row(label, robot, targets, seed))
    return rows


def _dof_rows(n: int, seed: int, sets: Path | None) -> list[Row]:
    rows = []
    for dof in DOFS:
        robot, label = panda(dof), f"panda/{dof}-dof"
        targets = halton_targets(robot, n, seed)
        row = _two_phase_row(label, robot, targets, DOF_BATCH, seed)
        rows.append(row | {"paper_ms": _PAPER_DOF[dof]})
        rows.append(_restart_row(label, robot, targets, seed))
    return rows


def _two_phase_row(label: str, robot: Robot, targets: list[Pose], batch: int, seed: int) -> Row:
    """The paper's algorithm, once for each target; the best of what it returns."""

    sweeps: dict[int, int] = {}

    def solve(k: int) -> Array:
        solution = solve_two_phase(robot, targets[k], batch, seed=seed + k)
        sweeps[k] = solution.sweeps
        best: Array = solution.q[0]
        return best

    row = _row(f"{label}/two phases (paper)", robot, targets, solve)
    return row | {"sweeps_mean": float(np.mean(list(sweeps.values())))}


def _restart_row(label: str, robot: Robot, targets: list[Pose], seed: int) -> Row:
    """Ours: one seed after the other until the target is reached, a call from Python each."""

    def solve(k: int) -> Array:
        best: Array = solve_batch(robot, targets[k : k + 1], seed=seed + k).q[0]
        return best

    return _row(f"{label}/restart until solved", robot, targets, solve)


def _throughput_rows(n: int, seed: int, sets: Path | None) -> list[Row]:
    rows = []
    for robot in (panda(), fetch()):
        targets = halton_targets(robot, n, seed)
        rows.append(_together(f"{robot.name}/one call/restart until solved", robot, targets, seed, None))
        rows.append(_single_calls(robot, targets[:CALLS], seed))
        if importlib.util.find_spec("warp") is not None:
            rows += [
                _together(f"{robot.name}/one call/warp-{device}", robot, targets, seed, device)
                for device in warp_devices()
            ]
    return rows


def _together(name: str, robot: Robot, targets: list[Pose], seed: int, device: str | None) -> Row:
    """All targets in one call, after one that is not measured. Time on a GPU is wall-clock time."""
    poses = np.array([[*target.position, *target.quat_wxyz] for target in targets])
    clock = time.process_time if device in (None, "cpu") else time.perf_counter
    solve_batch(robot, poses[:1], seed=seed, device=device)
    begun = clock()
    solution = solve_batch(robot, poses, seed=seed, device=device)
    spent = clock() - begun
    row = _figures(name, robot, targets, solution.q, [spent / len(targets)])
    return {**row, "targets_per_s": len(targets) / spent, "restarts_mean": solution.restarts / len(targets)}


def _single_calls(robot: Robot, targets: list[Pose], seed: int) -> Row:
    """One call from Python a target, as a program does that has one target at a time."""
    row = _restart_row(f"{robot.name}/one-call-each", robot, targets, seed)
    return {**row, "targets_per_s": 1e3 / row["cpu_ms_mean"], "restarts_mean": None}


def _row(name: str, robot: Robot, targets: list[Pose], solve: Callable[[int], Array]) -> Row:
    """Solve every target once, after one call that is not measured."""
    solve(0)
    configurations, cpu_s = [], []
    for k in range(len(targets)):
        begun = time.process_time()
        configurations.append(solve(k))
        cpu_s.append(time.process_time() - begun)
    return {**_figures(name, robot, targets, np.array(configurations), cpu_s), "paper_ms": None}


def _figures(name: str, robot: Robot, targets: list[Pose], q: Array, cpu_s: list[float]) -> Row:
    errors = np.array([robot.fk(row).error_to(target) for row, target in zip(q, targets, strict=True)])
    within = robot.within_limits(q)
    reached = within & np.all(errors < SUCCESS, axis=1)
    return {
        "row": name,
        "n": len(targets),
        "success": float(reached.mean()),
        "success_paper_tolerance": float((within & np.all(errors < 1e-2, axis=1)).mean()),
        "below_1e-6_mm": float((within & (errors[:, 0] < 1e-9)).mean()),
        "position_error_mm_mean": float(1e3 * errors[:, 0].mean()),
        "position_error_mm_max": float(1e3 * errors[:, 0].max()),
        "rotation_error_max": float(errors[:, 1].max()),
        **cpu_columns(cpu_s),
        "paper": None,
    }


BENCHES = (
    Bench(
        "hjcd-batch", 100, "HJCD-IK, Table I: batches of 1 to 2000 seeds in two phases; restarts", _batch_rows
    ),
    Bench("hjcd-dof", 100, "HJCD-IK, Table II: Pandas of 7 to 24 joints, two phases and restarts", _dof_rows),
    Bench("hjcd-throughput", MANY, "HJCD-IK: many targets in one call, and in a call each", _throughput_rows),
)
