"""Kinematics and sphere-to-obstacle gaps of many configurations at once, with derivatives: the arithmetic of the samplers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workcell.geometry.clearance import ObstacleArrays
from workcell.geometry.types import Piece, SphereCover
from workcell.model.robot import Robot
from workcell.pose import Array, Pose, rotation_vector

Index = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Links:
    """World frames of a batch of b configurations.

    Attributes:
        rotation: (b, n + 1, 3, 3), base first.
        position: (b, n + 1, 3).
        axis: (b, n, 3) world axis of each joint.
        moment: (b, n, 3) joint origin x axis: a revolute joint moves the point x by axis x (point) + moment.
    """

    rotation: Array
    position: Array
    axis: Array
    moment: Array


class BatchKinematics:
    """Forward kinematics and geometric Jacobians of a serial robot for batches (b, n)."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        K = np.zeros((robot.dof, 3, 3))
        a = robot.axis
        K[:, 0, 1], K[:, 0, 2], K[:, 1, 2] = -a[:, 2], a[:, 1], -a[:, 0]
        K -= np.swapaxes(K, 1, 2)
        self._turn, self._turn_squared = robot.joint_rotation @ K, robot.joint_rotation @ K @ K
        self._slides = bool(np.any(robot.prismatic))
        self._slide = np.einsum("kij,kj->ki", robot.joint_rotation, a)
        self._base = robot.T_world_base.rotation, robot.T_world_base.position
        frame = robot.tool()
        self.tool_link = frame.link
        self._tool_rotation, self._tool_position = frame.T_link_tool.rotation, frame.T_link_tool.position

    def links(self, q: Array) -> Links:
        """All link frames at configurations (b, n)."""
        robot, (b, n) = self.robot, q.shape
        angle = np.where(robot.prismatic, 0.0, q)[..., None, None] if self._slides else q[..., None, None]
        motion = (
            robot.joint_rotation + np.sin(angle) * self._turn + (1.0 - np.cos(angle)) * self._turn_squared
        )
        rotation, position = np.empty((b, n + 1, 3, 3)), np.empty((b, n + 1, 3))
        rotation[:, 0], position[:, 0] = self._base
        for k in range(n):
            offset = robot.joint_xyz[k]
            if robot.prismatic[k]:
                offset = offset + q[:, k, None] * self._slide[k]
            np.matmul(rotation[:, k], motion[:, k], out=rotation[:, k + 1])
            position[:, k + 1] = (rotation[:, k] @ offset[..., None])[..., 0] + position[:, k]
        axis = (rotation[:, 1:] @ robot.axis[:, :, None])[..., 0]
        return Links(rotation, position, axis, _cross(position[:, 1:], axis))

    def pose_error(self, links: Links, target: Pose, target_rotation: Array) -> tuple[Array, Array]:
        """(b, 6) metres and radians from the tool to the target in the world, and the tool's Jacobian (b, 6, n)."""
        R = links.rotation[:, self.tool_link] @ self._tool_rotation
        p = links.rotation[:, self.tool_link] @ self._tool_position + links.position[:, self.tool_link]
        error = np.concatenate(
            [target.position - p, rotation_vector(target_rotation @ np.swapaxes(R, 1, 2))], axis=1
        )
        J = np.empty((len(p), 6, self.robot.dof))
        J[:, :3] = np.swapaxes(_cross(links.axis, p[:, None, :]) + links.moment, 1, 2)
        J[:, 3:] = np.swapaxes(links.axis, 1, 2)
        if self._slides:
            J[:, :3, self.robot.prismatic] = np.swapaxes(links.axis[:, self.robot.prismatic], 1, 2)
            J[:, 3:, self.robot.prismatic] = 0.0
        return error, J

    def point_rates(self, links: Links, lane: Index, link: Index, point: Array, normal: Array) -> Array:
        """(p, n) rates of world points (p, 3), carried by `link` (p,) in batch row `lane` (p,), along `normal` (p, 3)."""
        axis = links.axis[lane]
        rates: Array = (axis @ _cross(point, normal)[..., None])[..., 0]
        rates += (links.moment[lane] @ normal[..., None])[..., 0]
        if self._slides:
            along = (axis @ normal[..., None])[..., 0]
            rates = np.where(self.robot.prismatic, along, rates)
        return np.where(np.arange(self.robot.dof) < link[:, None], rates, 0.0)


@dataclass(frozen=True, slots=True)
class Contacts:
    """Sphere-obstacle pairs closer than a margin, flattened over a batch.

    Attributes:
        lane, sphere, piece: (p,) where each pair stands.
        gap: (p,) signed distance in metres.
        point, normal: (p, 3) the sphere's centre, and the direction of growing gap, in the world.
    """

    lane: Index
    sphere: Index
    piece: Index
    gap: Array
    point: Array
    normal: Array


class Surroundings:
    """Obstacles packed for batches of sphere centres: bounding balls first, then the compiled distances."""

    def __init__(self, cover: SphereCover, pieces: Sequence[Piece]) -> None:
        self.cover, self.pieces = cover, tuple(pieces)
        self._obstacles = ObstacleArrays(self.pieces)
        self._origin = np.array([p.pose.position for p in pieces]).reshape(-1, 3)
        self._bound = np.array([_bounding_radius(p) for p in pieces])

    def centres(self, links: Links) -> Array:
        """World centres (b, m, 3) of the robot's spheres."""
        R, link = links.rotation, self.cover.link
        centres: Array = (R[:, link] @ self.cover.centre[:, :, None])[..., 0] + links.position[:, link]
        return centres

    def contacts(self, centres: Array, margin: float) -> Contacts:
        """Every pair with a gap below `margin` metres, for world centres (b, m, 3)."""
        b, m, _ = centres.shape
        flat = centres.reshape(-1, 3)
        squared = (flat**2).sum(1)[:, None] + (self._origin**2).sum(1) - 2.0 * (flat @ self._origin.T)
        reach = (self.cover.radius + margin)[:, None] + self._bound
        near = squared.reshape(b, m, -1) < reach**2
        lane, sphere, piece = np.nonzero(near)
        point = centres[lane, sphere]
        distance, normal = self._obstacles.distances_to(point, piece)
        gap = distance - self.cover.radius[sphere]
        kept = np.flatnonzero(gap < margin)
        return Contacts(lane[kept], sphere[kept], piece[kept], gap[kept], point[kept], normal[kept])


def _cross(a: Array, b: Array) -> Array:
    first = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    out = np.empty((*first.shape, 3))
    out[..., 0] = first
    out[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    out[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return out


def _bounding_radius(piece: Piece) -> float:
    if piece.kind == "halfspace":
        return float("inf")
    if piece.kind == "hull" and piece.vertices is not None:
        return float(np.linalg.norm(piece.vertices, axis=1).max())
    if piece.kind == "capsule":
        return float(piece.size.sum())
    return float(np.linalg.norm(piece.size)) if piece.kind in ("box", "cylinder") else float(piece.size.max())
