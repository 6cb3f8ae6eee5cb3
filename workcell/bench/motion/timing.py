"""Bench of timing: limits used between samples, durations, and TOPP-RA's own implementation beside ours."""

from __future__ import annotations

import importlib
import importlib.util
import time
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from workcell.bench.reference.robots import ROBOTS
from workcell.bench.rows import Bench, Row
from workcell.errors import InputError
from workcell.model.robot import Robot
from workcell.motion.path import Path
from workcell.motion.polynomials import PolynomialMotion
from workcell.motion.timing.retime import retime
from workcell.motion.timing.spline import spline_within_limits
from workcell.motion.timing.torque_limits import TorqueLimits
from workcell.motion.timing.torques import ChainDynamics
from workcell.pose import Array
from workcell.sets.reports import cpu_columns

EFFORTS = (1.0, 0.3)
"""Shares of the robots' effort limits; at the smaller one torques bind."""
_SUPPORT, _GRID = 0.02, 800
_FINE = 5
"""Evaluations for each time step of 2 ms."""


def retime_rows(n: int, seed: int, sets: FilePath | None) -> list[Row]:
    """Random paths of four lines a robot, timed at velocity, acceleration and torque limits."""
    from workcell.model.scene import robot_scene

    rows = []
    for name in ROBOTS:
        scene = robot_scene(name)
        robot, dynamics = scene.robot().robot, ChainDynamics(scene)
        for share in EFFORTS:
            limits = TorqueLimits.of(dynamics, share * robot.effort)
            rng = np.random.default_rng(seed)
            ours, theirs, refused = [], [], 0
            for _ in range(n):
                path = _random_path(robot, rng)
                try:
                    ours.append(_ours(path, limits))
                except InputError:
                    refused += 1  # the arm can't hold itself there with so little torque
                    continue
                if importlib.util.find_spec("toppra") is not None:
                    theirs.append(_toppra(path, limits))
            rows += [_row(f"{name}/effort-{share:g}/ours", ours, n, refused)]
            rows += [_row(f"{name}/effort-{share:g}/toppra", theirs, n, refused)] if theirs else []
    return rows


def _random_path(robot: Robot, rng: np.random.Generator) -> Path:
    steps = rng.normal(size=(4, robot.dof)) * 0.5
    corners = np.cumsum(np.vstack([robot.home, steps]), axis=0)
    return Path(robot, np.clip(corners, robot.lower + 0.1, robot.upper - 0.1))


def _ours(path: Path, limits: TorqueLimits) -> tuple[float, float, Array]:
    """Duration, CPU seconds, and the largest shares of velocity, acceleration and torque limits between samples."""
    began = time.process_time()
    trajectory = retime(path, dynamics=limits.dynamics, effort=limits.effort, support=_SUPPORT)
    cpu = time.process_time() - began
    motion = PolynomialMotion.of_trajectory(trajectory)
    t = np.linspace(0.0, trajectory.duration, _FINE * len(trajectory))
    return trajectory.duration, cpu, _use(path.robot, limits, motion.at(t), motion.at(t, 1), motion.at(t, 2))


def _toppra(path: Path, limits: TorqueLimits) -> tuple[float, float, Array]:
    """The same of the package `toppra` along the same spline."""
    toppra, constraint, algorithm = (
        importlib.import_module(name) for name in ("toppra", "toppra.constraint", "toppra.algorithm")
    )
    toppra.setup_logging("ERROR")
    robot, spline = path.robot, spline_within_limits(path, _SUPPORT)
    curve = toppra.SplineInterpolator(spline.knots, spline.points, bc_type="natural")

    def torque(q: Array, qd: Array, qdd: Array) -> Any:
        return limits.dynamics.at(q[None], qd[None], qdd[None])[0]

    def symmetric(values: Array) -> Array:
        return np.column_stack([-values, values])

    rows = [
        constraint.JointVelocityConstraint(symmetric(robot.velocity)),
        constraint.JointAccelerationConstraint(symmetric(robot.acceleration)),
        constraint.JointTorqueConstraint(torque, symmetric(limits.effort), np.zeros(robot.dof)),
    ]
    began = time.process_time()
    grid = np.linspace(0.0, spline.length, _GRID)
    timed = algorithm.TOPPRA(rows, curve, gridpoints=grid, solver_wrapper="seidel").compute_trajectory(0, 0)
    cpu = time.process_time() - began
    t = np.linspace(0.0, timed.duration, int(_FINE * timed.duration / 0.002))
    return float(timed.duration), cpu, _use(robot, limits, timed(t), timed(t, 1), timed(t, 2))


def _use(robot: Robot, limits: TorqueLimits, q: Array, qd: Array, qdd: Array) -> Array:
    torque = np.abs(limits.dynamics.at(q, qd, qdd)) / limits.effort
    return np.array(
        [(np.abs(qd) / robot.velocity).max(), (np.abs(qdd) / robot.acceleration).max(), torque.max()]
    )


def _row(name: str, found: list[tuple[float, float, Array]], n: int, refused: int) -> Row:
    """Of the largest of the three shares of each motion, the smallest and largest over all motions."""
    largest = [float(use.max()) for _, _, use in found]
    return {
        "row": name,
        "n": n,
        "too_weak": refused,
        "duration_s_mean": float(np.mean([duration for duration, _, _ in found])) if found else None,
        "use_smallest": min(largest, default=float("nan")),
        "use_largest": max(largest, default=float("nan")),
        "violations": sum(value > 1.0 + 1e-3 for value in largest),
        **cpu_columns([cpu for _, cpu, _ in found]),
    }


BENCHES = (
    Bench(
        "retime",
        10,
        "limits used by timed motions, and the package toppra beside ours (extra: timing)",
        retime_rows,
    ),
)
