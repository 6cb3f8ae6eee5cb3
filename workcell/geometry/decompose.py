"""`decompose`: a scene as sphere covers and free-space cuboids, with their measured quality."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from workcell.errors import ModelError
from workcell.geometry.covers.outer import merge_covers, obstacle_cover, robot_cover
from workcell.geometry.covers.proof import prove_cover
from workcell.geometry.covers.reach_ball import ReachBall, part_in_reach, reach_ball
from workcell.geometry.free_space.admissible import with_table
from workcell.geometry.free_space.fill import fill_free_space, spheres_held, with_polytopes
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.pieces import move_piece, pieces_of_bodies, robot_pieces, scene_obstacles
from workcell.geometry.types import FreeSpace, Piece, SphereCover
from workcell.model.robot import Robot
from workcell.model.scene import Scene
from workcell.pose import Array, Pose

_BASE_SLACK = 5e-3
"""Metres that a robot's base frame may lie inside an obstacle: it may stand in its mounting plate."""

_SAMPLES = 200


@dataclass(frozen=True, slots=True)
class Decomposition:
    """A scene as the planners see it.

    Attributes:
        scene: name of the scene.
        robot_name: name of the robot in the scene; empty where there is none.
        robot: its kinematics; None: the cell alone, its obstacles covered whole and no free space sought.
        q: (n,) the configuration drawn: the robot's start.
        robot_pieces: all of the robot's colliding geometry, in the world at `q`.
        obstacles: all other colliding geometry, in the world.
        robot_cover: outer spheres in link frames; link 0 is what no joint moves.
        obstacle_cover: outer spheres in the world, over what the robot can reach of each obstacle.
        free_space: cuboids, polytopes where those fit badly, and the fraction they cover.
        metrics: counts, overshoots, coverage, times.
    """

    scene: str
    robot_name: str
    robot: Robot | None
    q: Array
    robot_pieces: tuple[Piece, ...]
    obstacles: tuple[Piece, ...]
    robot_cover: SphereCover
    obstacle_cover: SphereCover
    free_space: FreeSpace
    metrics: dict[str, Any]

    def robot_spheres(self) -> tuple[Array, Array]:
        """World centres (m, 3) and radii (m,) of the robot's spheres at `q`."""
        if self.robot is None:
            return np.zeros((0, 3)), np.zeros(0)
        T = self.robot.link_transforms(self.q)
        return self.robot_cover.centres_world(T), np.array(self.robot_cover.radius)

    def to_json(self) -> dict[str, Any]:
        """Plain values: spheres, cuboids and polytopes in the world frame, the configuration drawn, and the metrics."""
        body_of = {piece.name: piece.body for piece in (*self.robot_pieces, *self.obstacles)}
        centres, radii = self.robot_spheres()
        spheres = _sphere_rows("robot", self.robot_cover.source, body_of, centres, radii)
        cover = self.obstacle_cover
        spheres += _sphere_rows("obstacle", cover.source, body_of, cover.centre, cover.radius)
        return {
            "spheres": spheres,
            "q": self.q.tolist(),
            "cuboids": [
                {"lower": low.tolist(), "upper": high.tolist()}
                for low, high in zip(self.free_space.lower, self.free_space.upper, strict=True)
            ],
            "polytopes": [{"A": p.A.tolist(), "b": p.b.tolist()} for p in self.free_space.polytopes],
            "metrics": dict(self.metrics),
        }


def decompose(
    scene: Scene,
    robot: str | None = None,
    *,
    overshoot: float = 0.02,
    seed: int = 0,
    progress: Callable[[], object] | None = None,
) -> Decomposition:
    """Cover a scene's robot and obstacles with spheres, its free space with cuboids and polytopes.

    Polytopes stand where cuboids fit badly. All of it is proved and measured.

    Obstacles are covered where the robot can get: inside the ball of `reach_ball`, with boxes and half-spaces cut down
    to it (`part_in_reach`). The metrics name those that were cut (`obstacles_cut_to_reach`) or that lie outside it
    (`obstacles_out_of_reach`), and the ball's radius (`reach_radius_m`). The free space knows all obstacles, uncut.

    A scene without a robot gets its obstacles covered, whole, and nothing else: without a reach there is no end to
    the free space.

    Args:
        scene: the scene.
        robot: the robot's name; None: the only one, if there is one.
        overshoot: metres that a sphere may stick out.
        seed: of the random seeds and of the sampler that measures coverage.
        progress: called after each of the six parts: robot cover, obstacle cover, cuboids, polytopes, table,
            measurement.

    Raises:
        ModelError: an obstacle that contains the robot's base, or a geom that is not supported.
    """
    step = progress or (lambda: None)
    if robot is None and not scene.robots:
        return _cell_alone(scene, overshoot, step)
    actor = scene.robot(robot)
    kinematics, q = actor.robot, np.array(actor.start)
    times: dict[str, float] = {}
    clock = time.perf_counter()

    def lap(name: str) -> None:
        nonlocal clock
        times[name], clock = round(time.perf_counter() - clock, 4), time.perf_counter()
        step()

    cover = robot_cover(scene.model, actor, overshoot=overshoot, base=True)
    lap("robot_cover_s")
    obstacles = scene_obstacles(scene, actor.name)
    check_base_is_free(kinematics, obstacles)
    ball = reach_ball(kinematics, cover)
    around = obstacle_cover(obstacles, overshoot=overshoot, reach=ball)
    lap("obstacle_cover_s")
    goals = np.array([goal.pose.position for goal in scene.goals.values() if goal.robot == actor.name])
    free_space = fill_free_space(kinematics, cover, obstacles, [q], points=goals, seed=seed)
    lap("cuboid_build_s")
    free_space = with_polytopes(free_space, kinematics, cover, obstacles, seed=seed)
    lap("polytope_build_s")
    free_space = with_table(kinematics, cover, free_space)
    lap("table_build_s")
    held = spheres_held(free_space, kinematics, cover, obstacles, samples=_SAMPLES, seed=seed + 1)
    links = robot_pieces(scene.model, actor)
    metrics = {
        **_robot_metrics(links, cover),
        **_obstacle_metrics(obstacles, around, ball),
        "cuboids": len(free_space),
        "cuboid_margin_m": float(np.min(free_space.margin, initial=np.inf))
        if free_space.margin is not None
        else None,
        "polytopes": len(free_space.polytopes),
        "polytope_margin_m": min((p.margin for p in free_space.polytopes), default=None),
        "cuboid_fraction": held.in_cuboids,
        "covered_fraction": held.in_any,
        "admissible_pairs_fraction": _admissible_fraction(cover, free_space),
        "skipped_seeds": free_space.skipped_seeds,
    }
    lap("measurement_s")
    poses = [Pose.from_matrix(T) for T in kinematics.link_transforms(q)]
    placed = [move_piece(piece, pose) for pose, link in zip(poses, links, strict=True) for piece in link]
    measured = replace(free_space, covered_fraction=held.in_any)
    return Decomposition(
        scene.name,
        actor.name,
        kinematics,
        q,
        tuple(placed),
        obstacles,
        cover,
        around,
        measured,
        metrics | times,
    )


def _cell_alone(scene: Scene, overshoot: float, step: Callable[[], object]) -> Decomposition:
    """Obstacles and their spheres, of a scene without a robot."""
    began = time.perf_counter()
    model = scene.model
    obstacles = pieces_of_bodies(model, range(model.nbody), scene.initial_qpos())
    step()
    around = obstacle_cover(obstacles, overshoot=overshoot)
    covered = [piece for piece in obstacles if piece.kind != "halfspace"]
    times = {"obstacle_cover_s": round(time.perf_counter() - began, 4)}
    step()
    metrics = {
        "obstacle_pieces": len(obstacles),
        "half_spaces_not_covered": [piece.name for piece in obstacles if piece.kind == "halfspace"],
        "obstacle_spheres": len(around),
        **_overshoots("obstacle", around),
        "obstacle_cover_proved": prove_cover(covered, around.centre, around.radius) is None,
    }
    for _ in range(4):
        step()
    nothing = FreeSpace(np.zeros((0, 3)), np.zeros((0, 3)))
    return Decomposition(
        scene.name, "", None, np.zeros(0), (), obstacles, merge_covers(), around, nothing, metrics | times
    )


def _admissible_fraction(cover: SphereCover, free_space: FreeSpace) -> float:
    """Share of the pairs of moving sphere and cuboid that the table leaves."""
    assert free_space.admissible is not None
    pairs = free_space.admissible[cover.link > 0]
    return float(pairs.mean()) if pairs.size else float("nan")


def check_base_is_free(robot: Robot, obstacles: Sequence[Piece]) -> None:
    """Raise ModelError, naming them, when obstacles contain the robot's base."""
    if not obstacles:
        return
    depth = ObstacleArrays(obstacles).distances(robot.T_world_base.position)
    inside = [
        f"{piece.name} ({-1e3 * d:.0f} mm deep)"
        for piece, d in zip(obstacles, depth, strict=True)
        if d < -_BASE_SLACK
    ]
    if inside:
        raise ModelError(
            f"the base of {robot.name} lies inside {', '.join(inside)}",
            where=robot.name,
            remedy="move the robot's mount or the obstacle",
        )


def _robot_metrics(links: Sequence[Sequence[Piece]], cover: SphereCover) -> dict[str, Any]:
    moving = cover.link > 0
    began = time.perf_counter()
    proved = all(
        prove_cover(pieces, cover.centre[cover.link == link], cover.radius[cover.link == link]) is None
        for link, pieces in enumerate(links)
    )
    return {
        "robot_spheres": int(moving.sum()),
        "base_spheres": int((~moving).sum()),
        **_overshoots("robot", cover),
        "robot_cover_proved": proved,
        "robot_proof_s": round(time.perf_counter() - began, 4),
    }


def _obstacle_metrics(obstacles: Sequence[Piece], cover: SphereCover, ball: ReachBall) -> dict[str, Any]:
    began = time.perf_counter()
    parts = [part_in_reach(piece, ball) for piece in obstacles]
    proved = prove_cover([part for part in parts if part is not None], cover.centre, cover.radius) is None
    pairs = list(zip(obstacles, parts, strict=True))
    return {
        "obstacle_pieces": len(obstacles),
        "reach_radius_m": ball.radius,
        "obstacles_cut_to_reach": [
            piece.name for piece, part in pairs if part is not None and part is not piece
        ],
        "obstacles_out_of_reach": [piece.name for piece, part in pairs if part is None],
        "obstacle_spheres": len(cover),
        **_overshoots("obstacle", cover),
        "obstacle_cover_proved": proved,
        "obstacle_proof_s": round(time.perf_counter() - began, 4),
    }


def _overshoots(name: str, cover: SphereCover) -> dict[str, float]:
    measured = np.zeros(1) if cover.overshoot is None or len(cover) == 0 else cover.overshoot
    return {
        f"{name}_overshoot_max_m": float(np.max(measured)),
        f"{name}_overshoot_mean_m": float(np.mean(measured)),
    }


def _sphere_rows(
    of: str, sources: Sequence[str], body_of: dict[str, str], centres: Array, radii: Array
) -> list[dict[str, Any]]:
    return [
        {
            "of": of,
            "kind": "outer",
            "body": body_of.get(source, source),
            "centre": centre.tolist(),
            "radius": float(radius),
        }
        for source, centre, radius in zip(sources, centres, radii, strict=True)
    ]
