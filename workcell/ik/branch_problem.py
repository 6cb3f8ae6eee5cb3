"""Problems as the branch and bound's kernels take them: plain arrays in the base's frame."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workcell.geometry.types import Piece
from workcell.ik.problem import IKProblem
from workcell.model.robot import LIMIT_SLACK
from workcell.pose import Array, quat_to_matrix

OVERLAP = 1e-5
"""Metres: "no" is proved for a clearance of c + OVERLAP at most, "yes" shown for c. Without it gaps that are just too
narrow leave thousands of tiny boxes."""
INFLATION = (1e-4, 1e-3)
"""Metres and radians of departure from the target that every proof covers at least."""
_LEVER = 0.3
KINDS = {"box": 0, "sphere": 1, "capsule": 2, "cylinder": 3, "halfspace": 4, "hull": 5}


def joint_box(problem: IKProblem) -> tuple[Array, Array]:
    """The box (n,), (n,) of all admissible configurations, with `LIMIT_SLACK`; a joint that can turn fully has one turn."""
    lower, upper = problem.robot.lower - LIMIT_SLACK, problem.robot.upper + LIMIT_SLACK
    if problem.q_reference is not None and problem.max_step is not None:
        step = np.asarray(problem.max_step) + LIMIT_SLACK
        lower = np.maximum(lower, problem.q_reference - step)
        upper = np.minimum(upper, problem.q_reference + step)
    turn = 2 * np.pi + 1e-9
    middle = 0.5 * (lower + upper)
    wide = upper - lower > turn
    return np.where(wide, middle - turn / 2, lower), np.where(wide, middle + turn / 2, upper)


@dataclass(frozen=True, slots=True)
class Arrays:
    """A problem as the kernels take it."""

    chain: Any
    world: Any
    root: Array
    sphere_order: NDArray[np.int64]


def inflation(problem: IKProblem) -> tuple[float, float]:
    """Departure from the target (m, rad) that a proof for `problem` covers."""
    allowed = problem.tolerances
    return max(allowed.position, INFLATION[0]), max(allowed.rotation, INFLATION[1])


def problem_arrays(problem: IKProblem) -> Arrays:
    """The problem in the base's frame, every joint axis turned into its frame's z, a fixed joint at either end."""
    from workcell.ik.branch_kernels.state import Chain
    from workcell.ik.branch_kernels.world import World

    robot = problem.robot
    tool = robot.tool().T_link_tool.matrix
    key = (robot.joint_xyz, robot.joint_rotation, robot.axis, tool)
    turned, frames, feet, bands, T_tool_end = _kinematics(*(values.tobytes() for values in key))
    target = problem.T_base_tool.matrix
    goal = target @ T_tool_end
    ball = np.array([*inflation(problem), *target[:3, 3]])
    chain = Chain(_rows(frames), feet, bands, _rows(goal[None])[0], ball)
    order, spheres = _spheres(problem, turned, frames[0])
    lower, upper = joint_box(problem)
    root = np.array([[0.0, *lower, 0.0], [0.0, *upper, 0.0]])
    obstacles, vertices, planes = _obstacles(problem)
    margin = np.array([problem.tolerances.safety_margin, OVERLAP])
    return Arrays(chain, World(spheres, obstacles, vertices, planes, margin), root, order)


@functools.lru_cache(maxsize=64)
def _kinematics(
    xyz: bytes, rotation: bytes, axes: bytes, tool: bytes
) -> tuple[Array, Array, Array, Array, Array]:
    """What depends on the robot alone: rotations that turn axes into z, frames, feet, bands, last frame in the tool's."""
    joint_xyz, joint_rotation = np.frombuffer(xyz).reshape(-1, 3), np.frombuffer(rotation).reshape(-1, 3, 3)
    turned = np.array([_frame_with_z(axis) for axis in np.frombuffer(axes).reshape(-1, 3)])
    fixed: list[Array] = []
    base = _line_beside(np.eye(4), _transform(joint_rotation[0] @ turned[0], joint_xyz[0]))
    before = np.linalg.inv(base)
    for k in range(len(turned)):
        fixed.append(before @ _transform(joint_rotation[k] @ turned[k], joint_xyz[k]))
        before = _transform(turned[k].T, np.zeros(3))
    T_last_tool = before @ np.frombuffer(tool).reshape(4, 4)
    end = _line_beside(T_last_tool, np.eye(4))
    frames = np.array([base, *fixed, end])
    feet = _feet(frames)
    return turned, frames, feet, _bands(frames, feet), np.linalg.inv(T_last_tool) @ end


def _transform(R: Array, p: Array) -> Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, p
    return T


def _rows(T: Array) -> Array:
    return np.ascontiguousarray(np.concatenate([T[:, :3, :3].reshape(-1, 9), T[:, :3, 3]], axis=1))


def _frame_with_z(axis: Array) -> Array:
    """A rotation whose third column is `axis`."""
    z = axis / np.linalg.norm(axis)
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _line_beside(T_frame: Array, T_joint: Array) -> Array:
    """A frame whose z axis is a line at right angles to a joint's axis and beside it: what fixes the joint's angle.

    It passes at the height of `T_frame`'s origin; both transforms are in the frame of the result.
    """
    R = T_joint[:3, :3]
    along = R[:, 2] @ (T_frame[:3, 3] - T_joint[:3, 3])
    line = np.stack([R[:, 2], R[:, 0], R[:, 1]], axis=1)
    return _transform(line, T_joint[:3, 3] + along * R[:, 2] + _LEVER * R[:, 0])


def _feet(frames: Array) -> Array:
    """(N, 2) where along its axis each joint is nearest to the axis before it, and after it."""
    feet = np.zeros((len(frames), 2))
    for k in range(1, len(frames)):
        p, z = frames[k][:3, 3], frames[k][:3, 2]
        across = z[0] ** 2 + z[1] ** 2
        if across > 1e-12:
            feet[k, 0] = -(p[0] * z[0] + p[1] * z[1]) / across
            feet[k - 1, 1] = p[2] + feet[k, 0] * z[2]
        else:
            feet[k - 1, 1] = p[2]
    feet[0, 0], feet[-1, 1] = feet[0, 1], feet[-1, 0]
    return feet


def _bands(frames: Array, feet: Array) -> Array:
    """(2, N, 4, 3) coefficients of the invariants about each joint, for both views (see `branch_kernels.invariants`)."""
    count = len(frames)
    bands = np.zeros((2, count, 4, 3))
    for i in range(1, count - 1):
        back = np.linalg.inv(frames[i])
        y = (back @ np.array([0.0, 0.0, feet[i - 1, 0], 1.0]))[:3]
        zy = back[:3, 2]
        zx = frames[i + 1][:3, 2]
        x = frames[i + 1][:3, 3] + feet[i + 1, 1] * zx
        distance = -2 * _turning(y, x) + np.array([x @ x + y @ y, 0.0, 0.0])
        near = _turning(zy, x) - np.array([zy @ y, 0.0, 0.0])
        far = np.array([zx @ x, 0.0, 0.0]) - _turning(y, zx)
        between = _turning(zy, zx)
        bands[0, i] = distance, near, far, between
        bands[1, count - 1 - i] = distance, -far, -near, between
    return bands


def _turning(u: Array, v: Array) -> Array:
    """(a, b, c) of u . Rz(t) v = a + b cos t + c sin t."""
    return np.array([u[2] * v[2], u[0] * v[0] + u[1] * v[1], u[1] * v[0] - u[0] * v[1]])


def _spheres(problem: IKProblem, turned: Array, base: Array) -> tuple[NDArray[np.int64], Array]:
    """Spheres in the kernels' frames, the largest of each link first, from the tool to the base; and their order."""
    cover = problem.cover
    if cover is None or not len(cover) or not problem.obstacles:
        return np.zeros(0, dtype=np.int64), np.zeros((0, 5))
    back = np.linalg.inv(base)
    into = np.concatenate([back[None, :3, :3], np.swapaxes(turned, 1, 2)])[cover.link]
    centres = np.einsum("mij,mj->mi", into, cover.centre)
    centres[cover.link == 0] += back[:3, 3]
    order = np.lexsort((-cover.radius, -cover.link))
    rows = np.column_stack([cover.link, centres, cover.radius])[order]
    return order.astype(np.int64), rows


def _obstacles(problem: IKProblem) -> tuple[Array, Array, Array]:
    """Obstacle rows in the base's frame with vertices and planes of the hulls."""
    pieces = problem.obstacles if problem.cover is not None else ()
    vertices, planes = [np.zeros((0, 3))], [np.zeros((0, 4))]
    rows = np.zeros((len(pieces), 24))
    if not pieces:
        return rows, vertices[0], planes[0]
    from_world = problem.robot.T_world_base.inverse()
    rotations = from_world.rotation @ quat_to_matrix(np.array([piece.pose.quat_wxyz for piece in pieces]))
    origins = from_world.apply(np.array([piece.pose.position for piece in pieces]))
    rows[:, 1:10], rows[:, 10:13] = rotations.reshape(-1, 9), origins
    counts = [0, 0]
    for row, piece, R, origin in zip(rows, pieces, rotations, origins, strict=True):
        row[0] = KINDS[piece.kind]
        row[13 : 13 + len(piece.size)] = piece.size
        half = _half_extent(piece, R)
        row[16:19], row[19:22] = origin - half, origin + half
        if piece.kind == "hull":
            corners, facets = _hull(piece)
            world = corners @ R.T + origin
            row[16:19], row[19:22] = world.min(axis=0), world.max(axis=0)
            row[13:15] = counts[0], counts[0] + len(corners)
            row[22:24] = counts[1], counts[1] + len(facets)
            counts = [counts[0] + len(corners), counts[1] + len(facets)]
            vertices.append(corners)
            planes.append(facets)
    return rows, np.concatenate(vertices), np.concatenate(planes)


def _half_extent(piece: Piece, R: Array) -> Array:
    """Half the size of an axis-aligned box around the piece's origin that holds it; inf for a half-space."""
    size = piece.size
    if piece.kind == "box":
        extent: Array = np.abs(R) @ size
        return extent
    if piece.kind == "sphere":
        return np.full(3, size[0])
    if piece.kind in ("capsule", "cylinder"):
        return np.asarray(np.abs(R[:, 2]) * size[1] + size[0])
    return np.full(3, 1e9)


def _hull(piece: Piece) -> tuple[Array, Array]:
    from scipy.spatial import ConvexHull

    assert piece.vertices is not None
    hull = ConvexHull(piece.vertices)
    return piece.vertices[hull.vertices], np.asarray(hull.equations)
