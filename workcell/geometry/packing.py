"""Robots, sphere covers and obstacles as arrays for the compiled kernels, each packed once and remembered."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from workcell.errors import InputError, ModelError
from workcell.geometry.types import Piece, SphereCover
from workcell.identity_cache import ByIdentity
from workcell.kernels.constants import TURN
from workcell.kernels.shape_kinds import BOX, CAPSULE, HULL, KINDS
from workcell.model.robot import Robot
from workcell.pose import Array, quat_to_matrix

if TYPE_CHECKING:
    from workcell.kernels.chain import Arm, Tree
    from workcell.kernels.coupling import Couple
    from workcell.kernels.shapes import Shapes

_UPRIGHT = np.eye(3).ravel()
NO_GRADIENT = np.empty((0, 0, 0))
"""What kernels take in place of an array for gradients where none are wanted."""

_arms, _frames, _covers = ByIdentity(), ByIdentity(), ByIdentity()
_trees, _spheres = ByIdentity(), ByIdentity()


def pack_arm(robot: Robot) -> Arm:
    """The robot's chain of m joints to its default tool, with its own limits."""
    return _arms.get((robot,), lambda: _arm(robot.uncoupled))


def joint_bounds(robot: Robot, lower: Array, upper: Array) -> Array:
    """Limits (3, n) as in `Arm`."""
    whole_turns = robot.repeats & (upper - lower >= TURN - 1e-9)
    return np.stack([lower, upper, whole_turns.astype(float)])


def _arm(robot: Robot) -> Arm:
    from workcell.kernels.chain import Arm

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
    return Arm(frames, joint_bounds(robot, robot.lower, robot.upper))


def pack_variables(robot: Robot) -> Arm:
    """The same chain, its limits those of the robot's n variables."""
    arm = pack_arm(robot)
    return (
        arm if robot.coupling is None else arm._replace(bounds=joint_bounds(robot, robot.lower, robot.upper))
    )


def pack_couple(robot: Robot) -> Couple:
    """How the robot's joints follow from its variables; empty where each joint is one."""
    from workcell.kernels.coupling import Couple

    if robot.coupling is None:
        return Couple(np.zeros(0, dtype=np.int64), np.zeros((0, 2)))
    return Couple(np.array(robot.coupling.variable), np.array(robot.coupling.coefficients))


def axis_frames(robot: Robot) -> Array:
    """(m + 1, 3, 3) for each link a frame in it whose z is the axis of its joint; the base's own for link 0."""
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
    radius = (cover.bare_radius if shrunk else cover.radius)[order]
    spheres = np.column_stack([centre, radius, order.astype(float), link.astype(float)])
    balls = np.zeros((robot.joint_count + 1, 6))
    links = np.arange(robot.joint_count + 1)
    first, last = np.searchsorted(link, links, "left"), np.searchsorted(link, links, "right")
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
    """Obstacles (k, 19) and triangles of hulls (f, 13), for the kernels of `workcell.kernels.distance`.

    A row is the kind (see `KINDS`), position (3) and rotation (9, row-major) of the frame, size (3), radius of the ball
    around the position that holds all of it, first and last row in the triangles. A triangle is the outward unit normal
    (3), offset, and corners (9) in that frame, whose origin is, for a hull, in its middle.

    Raises:
        ModelError: a hull without volume.
    """
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
    capsule = kind == CAPSULE
    rows[capsule, 16] = rows[capsule, 13] + rows[capsule, 14]
    for row in map(int, np.flatnonzero(kind == HULL)):
        vertices = pieces[row].vertices
        assert vertices is not None
        middle, radius, surface = _surface(vertices.tobytes(), pieces[row].name)
        rows[row, 1:4] = poses[row].apply(middle)
        rows[row, 16] = radius
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
def _surface(vertex_bytes: bytes, name: str) -> tuple[Array, float, Array]:
    """A hull's middle (3,), the radius of the ball around it there, and its triangles (f, 13), seen from the middle:
    outward unit normal, offset, corners counter-clockwise about the normal.
    """
    from scipy.spatial import ConvexHull, QhullError

    vertices = np.frombuffer(vertex_bytes).reshape(-1, 3)
    middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    vertices = vertices - middle
    try:
        hull = ConvexHull(vertices)
    except QhullError:
        raise ModelError("the hull is flat", where=name, remedy="give the mesh a thickness") from None
    corners = vertices[hull.simplices]
    normal = hull.equations[:, :3]
    turn = np.einsum(
        "fi,fi->f", np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), normal
    )
    corners[turn < 0] = corners[turn < 0][:, [0, 2, 1]]
    radius = float(np.linalg.norm(vertices, axis=1).max())
    return middle, radius, np.column_stack([hull.equations, corners.reshape(-1, 9)])


def pack_shapes(pieces: Sequence[Piece]) -> Shapes:
    """Pieces for the kernels of `workcell.kernels.shapes`.

    Raises:
        ModelError: a hull without volume.
    """
    from workcell.kernels.shapes import Shapes

    rows, faces = pack_obstacles(pieces)
    turned = rows[:, 4:13].reshape(-1, 3, 3)
    # A quarter turn is still along the axes; the rounding of its rotation is dropped with it.
    along = np.abs(turned) > 0.5
    upright = (rows[:, 0] == BOX) & np.all(np.abs(turned - np.round(turned)) < 1e-15, axis=(1, 2))
    half = np.einsum("kij,kj->ki", along.astype(float), rows[:, 13:16])
    boxes = np.ascontiguousarray(np.column_stack([rows[:, 1:4], half])[upright].T)
    order = np.concatenate([np.flatnonzero(upright), np.flatnonzero(~upright)])
    return Shapes(boxes, np.ascontiguousarray(rows[~upright]), faces, order)


def pack_tree(robot: Robot) -> Tree:
    """The robot's links, tools left out; it need not be serial."""
    return _trees.get((robot,), lambda: _tree(robot.uncoupled))


def _tree(robot: Robot) -> Tree:
    from workcell.kernels.chain import Tree

    turned, parents = axis_frames(robot), robot.parents
    frames = np.zeros((robot.dof + 1, 13))
    frames[0, :9], frames[0, 9:12] = robot.T_world_base.rotation.ravel(), robot.T_world_base.position
    for k in range(robot.dof):
        back = turned[parents[k]].T
        frames[k + 1, :9] = (back @ robot.joint_rotation[k] @ turned[k + 1]).ravel()
        frames[k + 1, 9:12] = back @ robot.joint_xyz[k]
        frames[k + 1, 12] = float(robot.prismatic[k])
    return Tree(frames, np.concatenate([[-1], parents]).astype(np.int64))


def pack_spheres(robot: Robot, cover: SphereCover) -> Array:
    """A cover's spheres (m, 5) in its own order: centre in the link's axis frame, radius, link."""
    return _spheres.get((robot, cover), lambda: _sphere_rows(robot, cover))


def _sphere_rows(robot: Robot, cover: SphereCover) -> Array:
    if len(cover) and not (cover.link.min() >= 0 and cover.link.max() <= robot.joint_count):
        raise InputError(
            f"spheres on links {cover.link.min()} to {cover.link.max()} of {robot.name}",
            where="cover",
            remedy=f"links 0 (the base) to {robot.joint_count}",
        )
    centre = np.einsum("kji,kj->ki", axis_frames(robot)[cover.link], cover.centre)
    return np.column_stack([centre, cover.radius, cover.link.astype(float)])


def random_state(seed: int) -> NDArray[np.uint64]:
    """The kernels' random stream for a seed."""
    return np.array([seed % 2**64], dtype=np.uint64)
