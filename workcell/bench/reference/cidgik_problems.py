"""The arms and the sphere environments of CIDGIK's experiments, and random problems in them (paper, section V)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from workcell.errors import UnknownNameError
from workcell.geometry.types import Piece, SphereCover
from workcell.ik.problem import IKProblem, Tolerances
from workcell.model.robot import Robot
from workcell.model.serial import serial_robot
from workcell.pose import Array, Pose, axis_angle_to_matrix, matrix_to_quat

POINT_RADIUS = 0.01
"""Metres: a point is a sphere of this radius, and the obstacles are smaller by it: the same distances count."""
ROBOTS = ("ur10", "kuka", "lwa4d")
ENVIRONMENTS = ("free", "octahedron", "cube", "icosahedron")
_GOLDEN = 0.5 * (1.0 + np.sqrt(5.0))

# KUKA iiwa of the CIDGIK experiments, from graphIK's kuka_iiwr.urdf: standard Denavit-Hartenberg d in metres, alpha in
# right angles, all a zero. Its wrist has no offset; the tool frame is that of the last link.
_KUKA = ((0.36, -1), (0.0, 1), (0.42, 1), (0.0, -1), (0.4, -1), (0.0, 1), (0.081, 0))
# SCHUNK LWA 4D, from graphIK's lwa4d.urdf.
_LWA4D = ((0.24, -1), (0.0, 1), (0.328, -1), (0.0, 1), (0.323, -1), (0.0, 1), (0.0824, 0))
# The nine-joint arm of Table IV, from graphIK's load_9_dof.
_HYPER9 = (
    (0.0, -1),
    (0.0, 1),
    (0.46965, -1),
    (0.0, 1),
    (0.45645, -1),
    (0.0, 1),
    (0.35955, -1),
    (0.0, 1),
    (0.2217, 0),
)
# UR10, from ur_description's DH parameters: a, d in metres, alpha in right angles.
_UR10 = (
    (0.0, 0.1273, 1),
    (-0.612, 0.0, 0),
    (-0.5723, 0.0, 0),
    (0.0, 0.163941, 1),
    (0.0, 0.1157, -1),
    (0.0, 0.0922, 0),
)


def bench_arm(name: str) -> Robot:
    """An arm of the experiments, all joints from -pi to pi: `ur10`, `kuka`, `lwa4d`, `hyper9`."""
    rows = {
        "ur10": _UR10,
        "kuka": tuple((0.0, d, turn) for d, turn in _KUKA),
        "lwa4d": tuple((0.0, d, turn) for d, turn in _LWA4D),
        "hyper9": tuple((0.0, d, turn) for d, turn in _HYPER9),
    }
    if name not in rows:
        raise UnknownNameError("arm", name, rows)
    return standard_dh(name, rows[name])


def standard_dh(name: str, rows: Sequence[tuple[float, float, int]]) -> Robot:
    """A serial arm from standard Denavit-Hartenberg rows (a, d, alpha in right angles), joints from -pi to pi."""
    joints, offset = [], Pose.identity()
    for k, (a, d, turn) in enumerate(rows):
        joints.append(
            {
                "name": f"joint_{k + 1}",
                "xyz": offset.position,
                "quat": offset.quat_wxyz,
                "axis": [0.0, 0.0, 1.0],
                "lower": -np.pi,
                "upper": np.pi,
            }
        )
        rotation = axis_angle_to_matrix(np.array([1.0, 0.0, 0.0]), 0.5 * np.pi * turn)
        offset = Pose(np.array([a, 0.0, d]), matrix_to_quat(rotation))
    return serial_robot(name, joints, offset)


def environment(name: str) -> tuple[Array, float]:
    """Centres (k, 3) and the radius of an environment's spheres, metres, in the base frame (graphIK's figures)."""
    one, none = (-1.0, 1.0), np.zeros((0, 3))
    if name == "free":
        return none, 1.0
    if name == "octahedron":
        corners = [(x, y, 0.0) for x in one for y in one] + [(0.0, 0.0, z) for z in one]
        return 0.75 * np.array(corners), 0.4
    if name == "cube":
        return 0.5 * np.array([(x, y, z) for x in one for y in one for z in one]), 0.45
    if name == "icosahedron":
        corners = [(0.0, a, b * _GOLDEN) for a in one for b in one]
        turned = [np.roll(corner, shift) for corner in corners for shift in range(3)]
        return 0.5 * np.array(turned), 0.5
    if name == "table":
        top = [(0.1 * (i + 0.5), 0.1 * (j + 0.5), 0.95) for i in range(-4, 4) for j in range(-4, 4)]
        legs = [(x, y, 0.05 + 0.1 * k) for x in (-0.35, 0.35) for y in (-0.35, 0.35) for k in range(9)]
        return np.array(top + legs), 0.1
    raise UnknownNameError("environment", name, (*ENVIRONMENTS, "table"))


def joint_points(robot: Robot) -> SphereCover:
    """The paper's p_i, as spheres of `POINT_RADIUS`; those that the base fixes are left out, as in the paper."""
    return _moving(robot, np.arange(1, robot.dof + 1), np.zeros((robot.dof, 3)))


def _moving(robot: Robot, links: NDArray[np.int64], centres: Array) -> SphereCover:
    cover = SphereCover(links, centres, np.full(len(links), POINT_RADIUS))
    q = robot.random_configuration(np.random.default_rng(0), 2)
    here, there = cover.centres_world(robot.link_transforms(q))
    moves = np.linalg.norm(here - there, axis=1) > 1e-9
    return SphereCover(cover.link[moves], cover.centre[moves], cover.radius[moves])


def link_points(robot: Robot, between: int = 2) -> SphereCover:
    """The joint points, and `between` more on each link from its joint to the next (or to the tool)."""
    ahead = [*robot.joint_xyz[1:], robot.tool().T_link_tool.position]
    links, centres = [], []
    for link, step in enumerate(ahead, start=1):
        for share in np.linspace(0.0, 1.0, between + 2)[:-1]:
            if share == 0.0 or np.linalg.norm(step) > POINT_RADIUS:
                links.append(link)
                centres.append(share * step)
    return _moving(robot, np.array(links), np.array(centres))


def off_centre(robot: Robot) -> Robot:
    """The arm with limits that are not symmetric: every other joint from -2.9 to 2.2, the others from -1.8 to 2.6."""
    even = np.arange(robot.dof) % 2 == 0
    return replace(robot, lower=np.where(even, -2.9, -1.8), upper=np.where(even, 2.2, 2.6))


def spheres(centres: Array, radius: float) -> tuple[Piece, ...]:
    """Obstacles, smaller by `POINT_RADIUS`."""
    size = np.array([radius - POINT_RADIUS])
    return tuple(
        Piece(f"sphere_{k}", "sphere", Pose.from_xyz(centre), size) for k, centre in enumerate(centres)
    )


def random_problems(
    robot: Robot, cover: SphereCover, centres: Array, radius: float, n: int, seed: int
) -> list[IKProblem]:
    """Tool poses of n configurations, drawn evenly in the limits, whose points keep out of the spheres."""
    rng = np.random.default_rng(seed)
    pieces = spheres(centres, radius)
    problems: list[IKProblem] = []
    while len(problems) < n:
        batch = robot.random_configuration(rng, 64)
        for q in batch[_clear(robot, cover, centres, radius, batch)]:
            problems.append(IKProblem(robot, robot.fk(q), pieces, cover if len(pieces) else None))
    return problems[:n]


def _clear(robot: Robot, cover: SphereCover, centres: Array, radius: float, q: Array) -> Array:
    points = cover.centres_world(robot.link_transforms(q))
    if not len(centres):
        return np.ones(len(q), dtype=bool)
    distance = np.linalg.norm(points[:, :, None] - centres, axis=-1)
    clear: Array = np.all(distance >= radius, axis=(1, 2))
    return clear


def loosened(problem: IKProblem) -> IKProblem:
    """The problem at the paper's tolerances: 0.01 m, 0.01 rad, 0.01 m of penetration."""
    pieces = tuple(
        replace(piece, size=piece.size - 0.01) for piece in problem.obstacles if piece.size[0] > 0.01
    )
    return replace(problem, obstacles=pieces, tolerances=Tolerances(0.01, 0.01))
