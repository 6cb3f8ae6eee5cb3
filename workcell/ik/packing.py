"""Problems as arrays for the compiled kernels: chains, sphere covers and obstacles, each packed once and remembered."""

from __future__ import annotations

import functools
import importlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from workcell.errors import InputError
from workcell.geometry.types import Piece, SphereCover
from workcell.ik.problem import IKProblem
from workcell.ik.remember import ByIdentity
from workcell.model.robot import Robot
from workcell.pose import Array, quat_to_matrix

if TYPE_CHECKING:
    from workcell.ik.kernels.options import Arm, World
    from workcell.ik.kernels.search import Memory

KINDS = {"box": 0, "sphere": 1, "capsule": 2, "cylinder": 3, "ellipsoid": 4, "halfspace": 5, "hull": 6}
"""Codes of `workcell.ik.kernels.distance`."""
_TURN = 2 * np.pi
_UPRIGHT = np.eye(3).ravel()


@functools.cache
def kernels() -> Any:
    """The compiled kernels (`workcell.ik.kernels.entries`), imported on first use: numba takes half a second."""
    return importlib.import_module("workcell.ik.kernels.entries")


_arms, _frames, _covers = ByIdentity(), ByIdentity(), ByIdentity()


def pack_arm(robot: Robot) -> Arm:
    """The robot's chain to its default tool, with its own limits."""
    return _arms.get((robot,), lambda: _arm(robot))


def narrowed_arm(problem: IKProblem) -> Arm:
    """The chain of a problem, its limits narrowed by `max_step` around `q_reference`."""
    arm = pack_arm(problem.robot)
    if problem.max_step is None or problem.q_reference is None:
        return arm
    lower = np.maximum(problem.robot.lower, problem.q_reference - problem.max_step)
    upper = np.minimum(problem.robot.upper, problem.q_reference + problem.max_step)
    return arm._replace(bounds=_bounds(problem.robot, lower, np.maximum(upper, lower)))


def _bounds(robot: Robot, lower: Array, upper: Array) -> Array:
    whole_turns = ~robot.prismatic & (upper - lower >= _TURN - 1e-9)
    return np.stack([lower, upper, whole_turns.astype(float)])


def _arm(robot: Robot) -> Arm:
    tool = robot.tool()
    if tool.link != robot.dof:
        raise InputError(
            f"the tool {tool.name!r} of {robot.name} sits on link {tool.link} of {robot.dof}",
            where="robot",
            remedy="pass robot.chain(tool), the joints up to the tool",
        )
    turned = axis_frames(robot)
    frames = np.zeros((robot.dof + 2, 13))
    frames[0, :9], frames[0, 9:12] = robot.T_world_base.rotation.ravel(), robot.T_world_base.position
    for k in range(robot.dof):
        back = turned[k].T
        frames[k + 1, :9] = (back @ robot.joint_rotation[k] @ turned[k + 1]).ravel()
        frames[k + 1, 9:12] = back @ robot.joint_xyz[k]
        frames[k + 1, 12] = float(robot.prismatic[k])
    frames[-1, :9] = (turned[-1].T @ tool.T_link_tool.rotation).ravel()
    frames[-1, 9:12] = turned[-1].T @ tool.T_link_tool.position
    arm: Arm = kernels().Arm(frames, _bounds(robot, robot.lower, robot.upper))
    return arm


def axis_frames(robot: Robot) -> Array:
    """(n + 1, 3, 3) for each link a frame in it whose z is the axis of its joint; the base's own for link 0."""
    return _frames.get((robot,), lambda: _axis_frames(robot))


def _axis_frames(robot: Robot) -> Array:
    z = robot.axis
    across = np.eye(3)[np.argmin(np.abs(z), axis=1)]
    x = np.cross(across, z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    turned = np.stack([x, np.cross(z, x), z], axis=-1)
    return np.concatenate([np.eye(3)[None], turned])


def pack_cover(robot: Robot, cover: SphereCover, shrunk: bool = False) -> tuple[Array, Array]:
    """A cover's spheres (m, 6) and the links' balls (n + 1, 6), as in `World`; shrunk: without their overshoot."""
    packed = _covers.get((robot, cover), lambda: (_cover(robot, cover, False), _cover(robot, cover, True)))
    return packed[1] if shrunk else packed[0]


def _cover(robot: Robot, cover: SphereCover, shrunk: bool) -> tuple[Array, Array]:
    order = np.argsort(cover.link, kind="stable")
    link = cover.link[order]
    centre = np.einsum("kji,kj->ki", axis_frames(robot)[link], cover.centre[order])
    radius = cover.radius - cover.overshoot if shrunk and cover.overshoot is not None else cover.radius
    radius = np.maximum(radius, 0.0)[order]
    spheres = np.column_stack([centre, radius, order.astype(float), link.astype(float)])
    balls = np.zeros((robot.dof + 1, 6))
    first, last = np.searchsorted(link, np.arange(robot.dof + 1), "left"), np.searchsorted(link, np.arange(robot.dof + 1), "right")  # fmt: skip
    for k, (a, b) in enumerate(zip(first, last, strict=True)):
        balls[k, 4:] = a, b
        if a < b:
            middle = 0.5 * (centre[a:b] + radius[a:b, None]).max(0) + 0.5 * (
                centre[a:b] - radius[a:b, None]
            ).min(0)
            balls[k, :3] = middle
            balls[k, 3] = (np.linalg.norm(centre[a:b] - middle, axis=1) + radius[a:b]).max()
    return spheres, balls


def pack_obstacles(pieces: Sequence[Piece]) -> tuple[Array, Array]:
    """Obstacles (k, 19) and triangles of hulls (f, 13), as in `World`."""
    rows = np.zeros((len(pieces), 19))
    faces: list[Array] = []
    if not pieces:
        return rows, np.zeros((0, 13))
    poses = [piece.pose for piece in pieces]
    sizes = [piece.size for piece in pieces]
    rows[:, 0] = [KINDS[piece.kind] for piece in pieces]
    rows[:, 1:4] = np.concatenate([pose.position for pose in poses]).reshape(-1, 3)
    rows[:, 4:13] = _rotations(np.concatenate([pose.quat_wxyz for pose in poses]).reshape(-1, 4))
    flat = np.concatenate(sizes)
    if len(flat) == 3 * len(pieces):
        rows[:, 13:16] = flat.reshape(-1, 3)
    else:
        widths = np.array([len(size) for size in sizes])
        rows[:, 13:16][np.arange(3) < widths[:, None]] = flat
    rows[:, 16] = np.sqrt(rows[:, 13:16] ** 2 @ np.ones(3))
    kind = rows[:, 0]
    if not kind.any():
        return rows, np.zeros((0, 13))
    capsule = kind == KINDS["capsule"]
    rows[capsule, 16] = rows[capsule, 13] + rows[capsule, 14]
    for row in map(int, np.flatnonzero(kind == KINDS["hull"])):
        vertices = pieces[row].vertices
        assert vertices is not None
        surface = _surface(vertices.tobytes())
        rows[row, 16] = np.linalg.norm(vertices, axis=1).max()
        start = sum(map(len, faces))
        rows[row, 17:19] = start, start + len(surface)
        faces.append(surface)
    return rows, np.concatenate(faces) if faces else np.zeros((0, 13))


def _rotations(quats: Array) -> Array:
    """Rows (k, 9) of rotations; most obstacles stand upright."""
    if not np.any(quats[:, 1:]):
        return _UPRIGHT
    return quat_to_matrix(quats).reshape(-1, 9)


@functools.lru_cache(maxsize=512)
def _surface(vertex_bytes: bytes) -> Array:
    """The triangles (f, 13) of a hull: outward unit normal, offset, corners counter-clockwise about the normal."""
    from scipy.spatial import ConvexHull

    vertices = np.frombuffer(vertex_bytes).reshape(-1, 3)
    hull = ConvexHull(vertices)
    corners = vertices[hull.simplices]
    normal = hull.equations[:, :3]
    turn = np.einsum(
        "fi,fi->f", np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), normal
    )
    corners[turn < 0] = corners[turn < 0][:, [0, 2, 1]]
    return np.column_stack([hull.equations, corners.reshape(-1, 9)])


def pack_world(problem: IKProblem) -> World:
    """The problem's spheres and obstacles; without either, a world in which nothing collides."""
    if problem.cover is None or not has_collisions(problem):
        empty = np.zeros((0, 6)), np.zeros((problem.robot.dof + 1, 6)), np.zeros((0, 19)), np.zeros((0, 13))
        nothing: World = kernels().World(*empty, 0.0)
        return nothing
    spheres, balls = pack_cover(problem.robot, problem.cover)
    obstacles, faces = pack_obstacles(problem.obstacles)
    margin = float(problem.tolerances.safety_margin)
    world: World = kernels().World(spheres, balls, obstacles, faces, margin)
    return world


def shrunk_world(problem: IKProblem, world: World) -> World:
    """The same with the spheres of an outer cover shrunk by their overshoot: for problems with another judge."""
    if problem.cover is None or not has_collisions(problem):
        return world
    spheres, balls = pack_cover(problem.robot, problem.cover, shrunk=True)
    return world._replace(spheres=spheres, balls=balls)


def has_collisions(problem: IKProblem) -> bool:
    """Whether there are spheres and obstacles in the solvers' model."""
    return problem.cover is not None and len(problem.cover) > 0 and len(problem.obstacles) > 0


def new_memory(dof: int, seed: int) -> Memory:
    """A search that has not begun."""
    entries = kernels()
    counts = np.zeros(8)
    counts[entries.ARC], counts[entries.BEST] = -1.0, np.inf
    misses = np.full((entries.MISSES, dof + 3), -1e3)
    points = np.empty((entries.MEMORY, 2 * dof + 1))
    memory: Memory = entries.Memory(
        random_state(seed), counts, points, np.zeros(1), np.zeros(dof), np.zeros(dof), misses
    )
    return memory


def random_state(seed: int) -> NDArray[np.uint64]:
    """The kernels' random stream for a seed."""
    return np.array([seed % 2**64], dtype=np.uint64)
