"""The exact kernel that judges answers: kinematics and signed distances, sharing nothing with the solvers' own.

Kinematics are products of exponentials (Lynch and Park, Modern Robotics, section 4.1) of the joint screws in the
zero configuration, not the chain of link transforms that `Robot` uses.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence

import numpy as np

from workcell.geometry.types import Piece, SphereCover
from workcell.identity_cache import ByIdentity
from workcell.ik.problem import IKProblem
from workcell.model.robot import Robot
from workcell.pose import Array

_IDENTITY = np.eye(4)


def skew(vectors: Array) -> Array:
    """Matrices (..., 3, 3) of the cross products with vectors (..., 3)."""
    K = np.zeros((*vectors.shape[:-1], 3, 3))
    K[..., 2, 1], K[..., 0, 2], K[..., 1, 0] = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    return K - np.swapaxes(K, -1, -2)


def _quadratic_forms() -> Array:
    """(16, 9) the entries of a rotation matrix as quadratic forms of its unit quaternion wxyz."""
    form = np.zeros((4, 4, 3, 3))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        form[range(4), range(4), i, i] = -1.0
        form[0, 0, i, i] = form[i + 1, i + 1, i, i] = 1.0
        form[i + 1, j + 1, i, j] = form[i + 1, j + 1, j, i] = 2.0
        form[0, k + 1, i, j], form[0, k + 1, j, i] = -2.0, 2.0
    return form.reshape(16, 9)


_FORM = _quadratic_forms()


def rotations(unit_quats: Array) -> Array:
    """Rotation matrices (k, 3, 3) of unit quaternions wxyz (k, 4)."""
    squares = unit_quats[:, :, None] * unit_quats[:, None, :]
    R: Array = (squares.reshape(-1, 16) @ _FORM).reshape(-1, 3, 3)
    return R


def target_rotation(problem: IKProblem) -> Array:
    """Rotation (3, 3) of a problem's target."""
    R: Array = rotations(problem.target.quat_wxyz[None])[0]
    return R


def rotation_angle(rotation: Array) -> float:
    """Angle in [0, pi] of a rotation (3, 3), from the sine and the cosine that the matrix holds."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation.tolist()
    return math.atan2(0.5 * math.hypot(zy - yz, xz - zx, yx - xy), 0.5 * (xx + yy + zz - 1.0))


def joint_positions(robot: Robot, q: Array) -> Array:
    """Values (..., m) of all joints at `q` (..., n), those included that follow others by a polynomial."""
    if robot.coupling is None:
        return q
    led = q[..., robot.coupling.variable]
    powers = led[..., None] ** np.arange(robot.coupling.coefficients.shape[1])
    values: Array = np.einsum("...ki,ki->...k", powers, robot.coupling.coefficients)
    return values


class ExactKinematics:
    """World poses of a robot's links, a chain's or a tree's, by products of exponentials.

    Attributes:
        zero_rotation, zero_position: (m + 1, 3, 3) and (m + 1, 3), the links with all m joints at zero.
    """

    def __init__(self, robot: Robot) -> None:
        n = robot.joint_count
        self.robot = robot
        self._parents = robot.parents.tolist()
        zero = np.tile(np.eye(4), (n + 1, 1, 1))
        self.zero_rotation, self.zero_position = zero[:, :3, :3], zero[:, :3, 3]
        self.zero_rotation[0] = robot.T_world_base.rotation
        self.zero_position[0] = robot.T_world_base.position
        for k, parent in enumerate(self._parents):
            R, p = self.zero_rotation[parent], self.zero_position[parent]
            self.zero_rotation[k + 1] = R @ robot.joint_rotation[k]
            self.zero_position[k + 1] = R @ robot.joint_xyz[k] + p
        self._zero = zero
        self._turning, self._sliding = (~robot.prismatic).astype(float), robot.prismatic.astype(float)
        axis = np.einsum("kij,kj->ki", self.zero_rotation[1:], robot.axis)
        # exp of a screw is I + sin(turn) A + (1 - cos(turn)) B + slide C
        cross = skew(axis)
        self._screws = np.zeros((3, n, 4, 4))
        for part, linear in zip(self._screws, (cross, cross @ cross), strict=False):
            part[:, :3, :3] = linear
            part[:, :3, 3] = -(linear @ self.zero_position[1:, :, None])[..., 0]
        self._screws[2, :, :3, 3] = axis
        frame = robot.tool()
        self._tool_link = frame.link
        self._tool_rotation, self._tool_position = frame.T_link_tool.rotation, frame.T_link_tool.position

    def links(self, q: Array) -> tuple[Array, Array]:
        """Rotations (m + 1, 3, 3) and positions (m + 1, 3) of the links in the world at `q` (n,)."""
        q = joint_positions(self.robot, q)
        turn, slide = q * self._turning, q * self._sliding
        A, B, C = self._screws
        joints = np.sin(turn)[:, None, None] * A + (1.0 - np.cos(turn))[:, None, None] * B
        joints += slide[:, None, None] * C + _IDENTITY
        moved = np.empty_like(self._zero)
        moved[0] = _IDENTITY
        for k, parent in enumerate(self._parents):
            np.matmul(moved[parent], joints[k], out=moved[k + 1])
        T = moved @ self._zero
        return T[:, :3, :3], T[:, :3, 3]

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
        if not pieces:
            return
        R = rotations(np.concatenate([piece.pose.quat_wxyz for piece in pieces]).reshape(-1, 4))
        origin = np.concatenate([piece.pose.position for piece in pieces]).reshape(-1, 3)
        shift = (origin[:, None, :] @ R)[:, 0]
        for kind, indices in by_kind.items():
            size = np.concatenate([pieces[i].size for i in indices]).reshape(len(indices), -1)
            chosen: slice | list[int] = slice(None) if len(by_kind) == 1 else indices
            into_local = R[chosen].transpose(1, 0, 2).reshape(3, -1)
            self._groups.append((kind, chosen, into_local, shift[chosen], size))

    def __call__(self, points: Array) -> Array:
        """Signed distances (m, k) in metres from world points (m, 3) to the k pieces."""
        distances = np.empty((len(points), len(self.pieces)))
        if not len(points):
            return distances
        for kind, chosen, into_local, shift, size in self._groups:
            local = (points @ into_local).reshape(len(points), -1, 3) - shift
            if kind == "hull":
                hulls = [piece for piece in self.pieces if piece.kind == "hull"]
                columns = [_hull(local[:, column], piece) for column, piece in enumerate(hulls)]
                distances[:, chosen] = np.stack(columns, axis=1)
            else:
                distances[:, chosen] = _FORMULAS[kind](local, size)
        return distances


_kinematics, _distances = ByIdentity(), ByIdentity()


def exact_kinematics(robot: Robot) -> ExactKinematics:
    """The robot's kinematics, remembered."""
    return _kinematics.get((robot,), lambda: ExactKinematics(robot))


def exact_distances(pieces: tuple[Piece, ...]) -> ExactDistances:
    """Distances to the pieces, remembered for this very tuple; a list, which may change, is looked at afresh."""
    if not isinstance(pieces, tuple):
        return ExactDistances(pieces)
    return _distances.get((pieces,), lambda: ExactDistances(pieces))


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
    largest = np.maximum(np.maximum(over[..., 0], over[..., 1]), over[..., 2])
    return _length(np.maximum(over, 0.0)) + np.minimum(largest, 0.0)


def _sphere(x: Array, size: Array) -> Array:
    return _length(x) - size[:, 0]


def _length(x: Array) -> Array:
    """Euclidean norms (...) of (..., 3)."""
    length: Array = np.sqrt(np.einsum("...i,...i->...", x, x))
    return length


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
    """Distances (m, f) from points (m, 3) to triangles (f, 3, 3): the plane where it projects inside, else an edge."""
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
