"""Following straight tool paths in the shelf cell: how fast, how far off the line, how continuous, and how often at all."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from workcell.bench.reports import cpu_figures
from workcell.bench.tables import Bench, Row
from workcell.ik.hjcdik import collect_solutions
from workcell.ik.problem import Budget
from workcell.model.robot import Robot
from workcell.model.scene import Scene
from workcell.motion.follow import follow, local_solver, step_solver
from workcell.motion.outcome import FollowLimits, FollowResult
from workcell.motion.route import route
from workcell.motion.toolpath import line
from workcell.motion.world import PlanningWorld
from workcell.pose import Array, Pose, axis_angle_to_matrix, matrix_to_quat

ROBOTS = ("sawyer", "ur10", "iiwa14")
LIMITS = FollowLimits(max_step=0.2, deviation_m=1e-3, deviation_rad=np.deg2rad(0.5), clearance=0.001)
LENGTH, SPACING = 1.0, 0.02
"""Metres: of a line, and between its waypoints."""
_BOX = np.array([[0.3, -0.3, 0.0], [0.7, 0.3, 0.75]])
"""Where the middles of the lines lie, metres."""
_LOOKED_AT = (0, -1, 25, 12, 37, 6, 18, 31, 44)
"""Waypoints at which a random line must have a configuration, to count."""
_BETWEEN = 8
"""Places between waypoints at which the motion is measured again."""


@dataclass(frozen=True, slots=True)
class Measured:
    """One followed line, measured again on the joint-linear motion: steps (radians), deviations, clearance (metres)."""

    largest_step: float
    deviation_m: float
    deviation_rad: float
    clearance: float

    @property
    def continuous(self) -> bool:
        """Whether steps and deviations are within the limits."""
        return (
            self.largest_step <= LIMITS.max_step + 1e-9
            and self.deviation_m <= LIMITS.deviation_m
            and self.deviation_rad <= LIMITS.deviation_rad
        )


def feasible_lines(world: PlanningWorld, seed: int) -> Iterator[tuple[Pose, ...]]:
    """Random lines of 1 m in front of and in the shelf, with a configuration at each of nine of their poses.

    That every pose has one does not mean that a continuous motion joins them.
    """
    rng = np.random.default_rng(seed)
    while True:
        poses = _random_line(rng)
        if all(_has_configuration(world, poses[row]) for row in _LOOKED_AT):
            yield poses


def _random_line(rng: np.random.Generator) -> tuple[Pose, ...]:
    """The tool points forwards or down, or between, by up to a radian to either side; its orientation is kept."""
    middle, along = rng.uniform(*_BOX), rng.normal(size=3)
    along *= 0.5 * LENGTH / np.linalg.norm(along)
    pitch, yaw, roll = rng.uniform(0.5 * np.pi, np.pi), rng.uniform(-1.0, 1.0), rng.uniform(-np.pi, np.pi)
    z, y = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
    turns = [axis_angle_to_matrix(axis, angle) for axis, angle in ((z, yaw), (y, pitch), (z, roll))]
    rotation = matrix_to_quat(turns[0] @ turns[1] @ turns[2])
    return line(Pose(middle - along, rotation), Pose(middle + along, rotation), SPACING)


def _has_configuration(world: PlanningWorld, pose: Pose) -> bool:
    problem = world.problem(pose, margin=LIMITS.clearance)
    return bool(collect_solutions(problem, 1, budget=Budget(0.05)))


def measure(robot: Robot, result: FollowResult, poses: tuple[Pose, ...]) -> Measured:
    """The motion between its waypoints against the line itself, at `_BETWEEN` places of each segment."""
    path, metrics = result.path, result.metrics
    assert path is not None and metrics is not None
    u = np.linspace(0.0, len(path) - 1, _BETWEEN * (len(path) - 1) + 1)
    tools = robot.fk_transform(path.at(u))
    begin, along = poses[0].position, poses[-1].position - poses[0].position
    apart = tools[:, :3, 3] - begin
    across = apart - np.outer(apart @ along, along) / (along @ along)
    turned = np.einsum("kij,ij->k", tools[:, :3, :3], poses[0].rotation)
    angles = np.arccos(np.clip(0.5 * (turned - 1.0), -1.0, 1.0))
    return Measured(
        path.largest_step,
        float(np.linalg.norm(across, axis=1).max()),
        float(angles.max()),
        metrics.clearance_between,
    )


def follow_line(n: int, seed: int, sets: Path | None) -> list[Row]:
    """For each arm n random lines: the start chosen and the line followed; followed from that start; by IKSPARK alone."""
    rows = []
    for robot in ROBOTS:
        world = PlanningWorld.of(Scene.load("shelf", robot=robot), seed=seed)
        lines = feasible_lines(world, seed)
        drawn = [next(lines) for _ in range(n)]
        _route(world, drawn[0], seed)  # loads and compiles
        routes, seconds = zip(*(_route(world, poses, seed + k) for k, poses in enumerate(drawn)), strict=True)
        rows.append(_row(f"{robot}/shelf/line/route", world, drawn, list(routes), list(seconds)))
        starts = [None if r.path is None or not r.followed else np.array(r.path.start) for r in routes]
        for method in ("local", "ikspark"):
            results, spent = [], []
            for poses, start in zip(drawn, starts, strict=True):
                if start is not None:
                    result, cpu = _from_start(world, poses, start, method)
                    results.append(result)
                    spent.append(cpu)
            if results:
                kept = [poses for poses, start in zip(drawn, starts, strict=True) if start is not None]
                rows.append(_row(f"{robot}/shelf/line/{method}", world, kept, results, spent))
    return rows


def _route(world: PlanningWorld, poses: tuple[Pose, ...], seed: int) -> tuple[FollowResult, float]:
    begun = time.process_time()
    result = route(world.problem(poses[0]), poses, limits=LIMITS, seed=seed)
    return result, time.process_time() - begun


def _from_start(
    world: PlanningWorld, poses: tuple[Pose, ...], start: Array, method: str
) -> tuple[FollowResult, float]:
    begun = time.process_time()
    problem = world.problem(poses[0])
    solver = (
        step_solver("ikspark", Budget(1.0)) if method == "ikspark" else local_solver(problem, limits=LIMITS)
    )
    result = follow(problem, poses, start, limits=LIMITS, solver=solver)
    return result, time.process_time() - begun


def _row(
    name: str,
    world: PlanningWorld,
    lines: list[tuple[Pose, ...]],
    results: list[FollowResult],
    spent: list[float],
) -> Row:
    robot = world.robot.robot
    followed = [k for k, result in enumerate(results) if result.followed]
    measured = [measure(robot, results[k], lines[k]) for k in followed]
    mean, median, p95 = cpu_figures([spent[k] / (len(lines[k]) - 1) for k in followed] or [float("nan")])
    return {
        "row": name,
        "n": len(results),
        "success": len(followed) / len(results),
        "discontinuities": sum(not item.continuous for item in measured),
        "cpu_ms_mean": mean,
        "cpu_ms_median": median,
        "cpu_ms_p95": p95,
        "largest_step_rad": max((item.largest_step for item in measured), default=float("nan")),
        "deviation_mm_max": 1e3 * max((item.deviation_m for item in measured), default=float("nan")),
        "deviation_deg_max": float(
            np.rad2deg(max((item.deviation_rad for item in measured), default=float("nan")))
        ),
        "clearance_mm_min": 1e3 * min((item.clearance for item in measured), default=float("nan")),
        "not_followed": sorted({result.status.value for result in results if not result.followed}),
        "paper": None,
    }


BENCHES = [
    Bench(
        "follow-line",
        100,
        "random 1 m tool paths in the shelf cell; CPU milliseconds are a waypoint's",
        follow_line,
    )
]
