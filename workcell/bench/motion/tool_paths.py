"""Following straight tool paths in the shelf cell: how fast, how far off, how continuous, how often at all."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from workcell.bench.reference.robots import ROBOTS
from workcell.bench.rows import Bench, Row
from workcell.ik.hjcd.solver import collect_solutions
from workcell.ik.problem import Budget
from workcell.model.scene import Scene
from workcell.motion.tool_paths.follow import follow, local_solver, step_solver
from workcell.motion.tool_paths.poses import line
from workcell.motion.tool_paths.result import FollowLimits, FollowResult
from workcell.motion.tool_paths.route import route
from workcell.pose import Array, Pose, axis_angle_to_matrix, matrix_to_quat
from workcell.sets.reports import cpu_figures
from workcell.world.planning_world import PlanningWorld

LIMITS = FollowLimits(max_step=0.2, deviation_m=1e-3, deviation_rad=np.deg2rad(0.5), clearance=0.001)
LENGTH, SPACING = 1.0, 0.02
"""Metres: of a line, and between its waypoints."""
_BOX = np.array([[0.3, -0.3, 0.0], [0.7, 0.3, 0.75]])
"""Where the middles of the lines lie, metres."""
_LOOKED_AT = (0, -1, 25, 12, 37, 6, 18, 31, 44)
"""Waypoints at which a random line must have a configuration, to count."""
_BETWEEN = 8
"""Places between waypoints at which the motion is measured again."""
MEASURED_TO = 1e-6
"""Metres to which MuJoCo measures distances."""
MOST = 2
"""Lines drawn for each that is to be followed, at most."""


@dataclass(frozen=True, slots=True)
class Measured:
    """One followed line, measured again on the joint-linear motion: steps (radians), deviations, clearance (metres)."""

    largest_step: float
    deviation_m: float
    deviation_rad: float
    clearance: float

    @property
    def continuous(self) -> bool:
        """Whether steps, deviations and clearance are within the limits."""
        return (
            self.largest_step <= LIMITS.max_step + 1e-9
            and self.deviation_m <= LIMITS.deviation_m
            and self.deviation_rad <= LIMITS.deviation_rad
            and self.clearance >= LIMITS.clearance - MEASURED_TO
        )


@dataclass(frozen=True, slots=True)
class _Try:
    """What became of one line, and the CPU seconds that it took."""

    poses: tuple[Pose, ...]
    result: FollowResult
    cpu_s: float


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


def measure(world: PlanningWorld, result: FollowResult, poses: tuple[Pose, ...]) -> Measured:
    """The motion against the line itself, and its clearance on the compiled model.

    Both at `_BETWEEN` places of each segment.
    """
    path = result.path
    assert path is not None
    u = np.linspace(0.0, len(path) - 1, _BETWEEN * (len(path) - 1) + 1)
    motion = path.at(u)
    tools = [world.tool_pose(q) for q in motion]
    begin, along = poses[0].position, poses[-1].position - poses[0].position
    apart = np.stack([tool.position for tool in tools]) - begin
    across = apart - np.outer(apart @ along, along) / (along @ along)
    return Measured(
        path.largest_step,
        float(np.linalg.norm(across, axis=1).max()),
        max(tool.error_to(poses[0])[1] for tool in tools),
        min(world.clearance(q).distance for q in motion),
    )


def follow_line(n: int, seed: int, sets: Path | None) -> list[Row]:
    """For each arm n random lines that can be followed, and what became of those drawn beside; see `arm_rows`."""
    return [row for robot in ROBOTS for row in arm_rows(robot, n, seed)]


def arm_rows(robot: str, n: int, seed: int) -> list[Row]:
    """The start chosen and the line followed, until n were; then those lines from that start in other ways.

    By local steps, and by IKSPARK alone.
    """
    world = PlanningWorld.of(Scene.load("shelf", robot=robot), seed=seed)
    lines = feasible_lines(world, seed)
    _route(world, next(feasible_lines(world, seed)), seed)  # loads and compiles
    tries: list[_Try] = []
    while sum(item.result.followed for item in tries) < n and len(tries) < MOST * n:
        poses = next(lines)
        tries.append(_Try(poses, *_route(world, poses, seed + len(tries))))
    rows = [_row(f"{robot}/shelf/line/route", world, tries)]
    followed = [
        (item.poses, np.array(item.result.path.start))
        for item in tries
        if item.result.followed and item.result.path
    ]
    for method in ("local", "ikspark"):
        again = [_Try(poses, *_from_start(world, poses, start, method)) for poses, start in followed]
        if again:
            rows.append(_row(f"{robot}/shelf/line/{method}", world, again))
    return rows


def _route(world: PlanningWorld, poses: tuple[Pose, ...], seed: int) -> tuple[FollowResult, float]:
    return _timed(lambda: route(world.problem(poses[0]), poses, limits=LIMITS, seed=seed))


def _from_start(
    world: PlanningWorld, poses: tuple[Pose, ...], start: Array, method: str
) -> tuple[FollowResult, float]:
    problem = world.problem(poses[0])

    def followed() -> FollowResult:
        ikspark = method == "ikspark"
        solver = step_solver("ikspark", Budget(1.0)) if ikspark else local_solver(problem, limits=LIMITS)
        return follow(problem, poses, start, limits=LIMITS, solver=solver)

    return _timed(followed)


def _timed(follow_path: Callable[[], FollowResult]) -> tuple[FollowResult, float]:
    """What comes of it, and CPU seconds; again, where kernels were compiled on the way."""
    from workcell.jit import compile_seconds

    while True:
        compiled, begun = compile_seconds(), time.process_time()
        result = follow_path()
        spent = time.process_time() - begun
        if compile_seconds() == compiled:
            return result, spent


def _row(name: str, world: PlanningWorld, tries: list[_Try]) -> Row:
    followed = [item for item in tries if item.result.followed]
    measured = [measure(world, item.result, item.poses) for item in followed]
    spent = [item.cpu_s / (len(item.poses) - 1) for item in followed]
    mean, median, p95 = cpu_figures(spent or [float("nan")])
    others = Counter(item.result.status.value for item in tries if not item.result.followed)
    return {
        "row": name,
        "n": len(tries),
        "success": len(followed) / len(tries),
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
        "not_followed": dict(sorted(others.items())),
        "cpu_s_not_followed": float(
            np.mean([item.cpu_s for item in tries if not item.result.followed] or [0.0])
        ),
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
