"""The exact kernel that judges answers: forward kinematics and signed distances, sharing nothing with the solvers' own.

Kinematics are products of exponentials (Lynch and Park, Modern Robotics, section 4.1) of the joint screws in the
zero configuration, not the chain of link transforms that `Robot` uses.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence

import numpy as np

from workcell.geometry.types import Piece, SphereCover
from workcell.model.robot import Robot
from workcell.pose import Array, quat_to_matrix


def skew(vectors: Array) -> Array:
    """Matrices (..., 3, 3) of the cross products with vectors (..., 3)."""
    K = np.zeros((*vectors.shape[:-1], 3, 3))
    K[..., 2, 1], K[..., 0, 2], K[..., 1, 0] = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    return K - np.swapaxes(K, -1, -2)


class ExactKinematics:
    """World poses of a serial robot's links by products of exponentials.

    Attributes:
        zero_rotation, zero_position: (n + 1, 3, 3) and (n + 1, 3), the links in the zero configuration.
    """

    def __init__(self, robot: Robot) -> None:
        n = robot.dof
        self.robot = robot
        self.zero_rotation, self.zero_position = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3))
        self.zero_rotation[0] = robot.T_world_base.rotation
        self.zero_position[0] = robot.T_world_base.position
        for k in range(n):
            R, p = self.zero_rotation[k], self.zero_position[k]
            self.zero_rotation[k + 1] = R @ robot.joint_rotation[k]
            self.zero_position[k + 1] = R @ robot.joint_xyz[k] + p
        self._axis = np.einsum("kij,kj->ki", self.zero_rotation[1:], robot.axis)
        self._cross = skew(self._axis)
        self._cross_squared = self._cross @ self._cross
        frame = robot.tool()
        self._tool_link = frame.link
        self._tool_rotation, self._tool_position = frame.T_link_tool.rotation, frame.T_link_tool.position

    def links(self, q: Array) -> tuple[Array, Array]:
        """Rotations (n + 1, 3, 3) and positions (n + 1, 3) of the links in the world at `q` (n,)."""
        turn = np.where(self.robot.prismatic, 0.0, q)[:, None, None]
        slide = np.where(self.robot.prismatic, q, 0.0)[:, None] * self._axis
        E = np.eye(3) + np.sin(turn) * self._cross + (1.0 - np.cos(turn)) * self._cross_squared
        point = self.zero_position[1:]
        shift = point - (E @ point[..., None])[..., 0] + slide
        G, g = np.eye(3), np.zeros(3)
        rotation, position = self.zero_rotation.copy(), self.zero_position.copy()
        for k in range(len(q)):
            g = G @ shift[k] + g
            G = G @ E[k]
            rotation[k + 1] = G @ rotation[k + 1]
            position[k + 1] = G @ position[k + 1] + g
        return rotation, position

    def tool(self, rotation: Array, position: Array) -> tuple[Array, Array]:
        """World rotation (3, 3) and position (3,) of the tool, given the `links`."""
        R = rotation[self._tool_link]
        return R @ self._tool_rotation, R @ self._tool_position + position[self._tool_link]


class ExactDistances:
    """Signed distances from points to convex pieces: exact outside, and the penetration depth (negative) inside."""

    def __init__(self, pieces: Sequence[Piece]) -> None:
        by_kind: dict[str, list[int]] = {}
        for index, piece in enumerate(pieces):
            by_kind.setdefault(piece.kind, []).append(index)
        self.pieces = tuple(pieces)
        self._groups = []
        for kind, indices in by_kind.items():
            group = [pieces[i] for i in indices]
            R = quat_to_matrix(np.array([piece.pose.quat_wxyz for piece in group]))
            origin = np.array([piece.pose.position for piece in group])
            size = np.array([piece.size for piece in group])
            self._groups.append((kind, np.array(indices), R, origin, size))

    def __call__(self, points: Array) -> Array:
        """Signed distances (m, k) in metres from world points (m, 3) to the k pieces."""
        distances = np.empty((len(points), len(self.pieces)))
        for kind, indices, R, origin, size in self._groups:
            local = np.einsum("kji,mkj->mki", R, points[:, None, :] - origin)
            if kind == "hull":
                for column, index in enumerate(indices):
                    distances[:, index] = _hull(local[:, column], self.pieces[index])
            else:
                distances[:, indices] = _FORMULAS[kind](local, size)
        return distances


def smallest_clearance(
    cover: SphereCover, rotation: Array, position: Array, distances: ExactDistances
) -> tuple[float, int, int]:
    """(smallest signed distance, sphere, piece) of a cover's spheres, given the links' world poses."""
    R = rotation[cover.link]
    centres = (R @ cover.centre[..., None])[..., 0] + position[cover.link]
    gaps = distances(centres) - cover.radius[:, None]
    sphere, piece = divmod(int(np.argmin(gaps)), gaps.shape[1])
    return float(gaps[sphere, piece]), sphere, piece


def _box(x: Array, half: Array) -> Array:
    over = np.abs(x) - half
    distance: Array = np.linalg.norm(np.maximum(over, 0.0), axis=-1) + np.minimum(over.max(axis=-1), 0.0)
    return distance


def _sphere(x: Array, size: Array) -> Array:
    distance: Array = np.linalg.norm(x, axis=-1) - size[:, 0]
    return distance


def _capsule(x: Array, size: Array) -> Array:
    along = np.clip(x[..., 2], -size[:, 1], size[:, 1])
    distance: Array = np.hypot(np.hypot(x[..., 0], x[..., 1]), x[..., 2] - along) - size[:, 0]
    return distance


def _cylinder(x: Array, size: Array) -> Array:
    radial = np.hypot(x[..., 0], x[..., 1]) - size[:, 0]
    axial = np.abs(x[..., 2]) - size[:, 1]
    outside: Array = np.hypot(np.maximum(radial, 0.0), np.maximum(axial, 0.0))
    return outside + np.minimum(np.maximum(radial, axial), 0.0)


def _halfspace(x: Array, size: Array) -> Array:
    return x[..., 2]


def _ellipsoid(x: Array, axes: Array) -> Array:
    """The foot of the normal solves sum (e_i y_i / (t + e_i^2))^2 = 1 with t > -min e^2 (Eberly, Distance from a
    Point to an Ellipsoid, 2013). Coordinates are floored at 1e-13 m, which moves the point, and so the
    distance, by no more, and leaves exactly one root to bisect.
    """
    y = np.maximum(np.abs(x), 1e-13)
    squares = axes**2
    smallest = squares.min(axis=-1)
    low = np.min(np.where(squares == smallest[:, None], axes * y, np.inf), axis=-1)
    high = np.linalg.norm(axes * y, axis=-1)
    excess = squares - smallest[:, None]
    for _ in range(80):
        middle = np.sqrt(low * high)
        inside = np.sum((axes * y / (middle[..., None] + excess)) ** 2, axis=-1) > 1.0
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    t = np.sqrt(low * high)[..., None]
    foot = squares * y / (t + excess)
    distance: Array = np.linalg.norm(y - foot, axis=-1)
    return np.where(np.sum((y / axes) ** 2, axis=-1) < 1.0, -distance, distance)


_FORMULAS: dict[str, Callable[[Array, Array], Array]] = {
    "box": _box,
    "sphere": _sphere,
    "capsule": _capsule,
    "cylinder": _cylinder,
    "halfspace": _halfspace,
    "ellipsoid": _ellipsoid,
}


def _hull(x: Array, piece: Piece) -> Array:
    """Inside: the nearest facet's plane. Outside: the nearest point of any triangle of the surface."""
    assert piece.vertices is not None
    planes, triangles = _hull_surface(piece.vertices.tobytes())
    height: Array = (x @ planes[:, :3].T + planes[:, 3]).max(axis=1)
    outside = np.flatnonzero(height > 0)
    for start in range(0, len(outside), 64):
        chosen = outside[start : start + 64]
        height[chosen] = _triangle_distances(x[chosen], triangles).min(axis=1)
    return height


@functools.lru_cache(maxsize=512)
def _hull_surface(vertex_bytes: bytes) -> tuple[Array, Array]:
    """Facet planes (f, 4) with outward unit normals, and triangles (f, 3, 3)."""
    from scipy.spatial import ConvexHull

    vertices = np.frombuffer(vertex_bytes).reshape(-1, 3)
    hull = ConvexHull(vertices)
    return np.asarray(hull.equations), vertices[hull.simplices]


def _triangle_distances(x: Array, triangles: Array) -> Array:
    """Distances (m, f) from points (m, 3) to triangles (f, 3, 3): to the plane where it projects inside, else an edge."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    above = np.ones((len(x), len(triangles)), dtype=bool)
    nearest = np.full((len(x), len(triangles)), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        edge, offset = end - start, x[:, None, :] - start
        above &= np.einsum("fi,mfi->mf", np.cross(normal, edge), offset) >= 0
        length = np.maximum(np.einsum("fi,fi->f", edge, edge), 1e-300)
        along = np.clip(np.einsum("fi,mfi->mf", edge, offset) / length, 0.0, 1.0)
        nearest = np.minimum(nearest, np.linalg.norm(offset - along[..., None] * edge, axis=-1))
    height = np.abs(np.einsum("fi,mfi->mf", normal, x[:, None, :] - a))
    return np.where(above, height, nearest)
