"""Rigid transforms: `Pose` (SE(3)) and rotation helpers. Quaternions are `wxyz` everywhere in workcell.

Conversion to the `xyzw` order of scipy and Rerun happens only here and in `workcell.record`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workcell.errors import InputError

Array = NDArray[np.float64]

UNIT_TOLERANCE = 1e-3
"""By how much the length of a quaternion or an axis may differ from one, at every door: three digits were written down.
What is within it is made a unit; what is not is a mistake."""
_ROTATION_TOLERANCE = 1e-6


def read_only(values: ArrayLike, dtype: Any = np.float64) -> NDArray[Any]:
    """A private copy of `values` that can't be written to."""
    array = np.array(values, dtype=dtype)
    array.flags.writeable = False
    return array


def quat_to_matrix(quat_wxyz: ArrayLike) -> Array:
    """Rotation matrices (..., 3, 3) of quaternions wxyz (..., 4), normalised first."""
    q = np.asarray(quat_wxyz, dtype=float)
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    R = np.empty((*q.shape[:-1], 3, 3))
    R[..., 0, 0] = 1 - 2 * (y * y + z * z)
    R[..., 0, 1] = 2 * (x * y - w * z)
    R[..., 0, 2] = 2 * (x * z + w * y)
    R[..., 1, 0] = 2 * (x * y + w * z)
    R[..., 1, 1] = 1 - 2 * (x * x + z * z)
    R[..., 1, 2] = 2 * (y * z - w * x)
    R[..., 2, 0] = 2 * (x * z - w * y)
    R[..., 2, 1] = 2 * (y * z + w * x)
    R[..., 2, 2] = 1 - 2 * (x * x + y * y)
    return R


def matrix_to_quat(rotation: ArrayLike) -> Array:
    """Quaternion wxyz with w >= 0 of a rotation matrix (3, 3): the top eigenvector of Bar-Itzhack's 4x4 form."""
    R = np.asarray(rotation, dtype=float)
    K = np.array(
        [
            [R[0, 0] + R[1, 1] + R[2, 2], R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]],
            [0.0, R[0, 0] - R[1, 1] - R[2, 2], R[0, 1] + R[1, 0], R[0, 2] + R[2, 0]],
            [0.0, 0.0, R[1, 1] - R[0, 0] - R[2, 2], R[1, 2] + R[2, 1]],
            [0.0, 0.0, 0.0, R[2, 2] - R[0, 0] - R[1, 1]],
        ]
    )
    quat: Array = np.linalg.eigh(K, UPLO="U")[1][:, -1]
    return quat if quat[0] >= 0 else -quat


def rotation_vector(rotation: ArrayLike) -> Array:
    """Axis times angle (..., 3), angle in [0, pi], of rotation matrices (..., 3, 3)."""
    R = np.asarray(rotation, dtype=float)
    w = 0.5 * np.stack(
        [R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], axis=-1
    )
    sine = np.linalg.norm(w, axis=-1)
    cosine = 0.5 * (np.trace(R, axis1=-2, axis2=-1) - 1.0)
    angle = np.arctan2(sine, cosine)
    factor = np.where(sine > 1e-9, angle / np.maximum(sine, 1e-300), 1.0)
    vector: Array = factor[..., None] * w
    half_turn = (sine <= 1e-6) & (cosine < 0)
    if np.any(half_turn):
        vector = np.where(half_turn[..., None], angle[..., None] * _half_turn_axis(R, w), vector)
    return vector


def _half_turn_axis(R: Array, w: Array) -> Array:
    """Unit axis of rotations close to a half turn, where R - R^T vanishes: from the largest column of R + I."""
    M = 0.5 * (R + np.swapaxes(R, -1, -2)) + np.eye(3)
    column = np.argmax(np.diagonal(M, axis1=-2, axis2=-1), axis=-1)
    axis = np.take_along_axis(M, column[..., None, None], axis=-1)[..., 0]
    axis = axis / np.linalg.norm(axis, axis=-1, keepdims=True)
    sign: Array = np.where(np.sum(axis * w, axis=-1, keepdims=True) < 0, -1.0, 1.0)
    turned: Array = axis * sign
    return turned


def axis_angle_to_matrix(axis: ArrayLike, angle: ArrayLike) -> Array:
    """Rotations (..., 3, 3) about unit axes (..., 3) by angles (...), by Rodrigues' formula."""
    a, t = np.asarray(axis, dtype=float), np.asarray(angle, dtype=float)[..., None, None]
    zero = np.zeros(a.shape[:-1])
    K = np.stack(
        [
            np.stack([zero, -a[..., 2], a[..., 1]], axis=-1),
            np.stack([a[..., 2], zero, -a[..., 0]], axis=-1),
            np.stack([-a[..., 1], a[..., 0], zero], axis=-1),
        ],
        axis=-2,
    )
    rotation: Array = np.eye(3) + np.sin(t) * K + (1 - np.cos(t)) * (K @ K)
    return rotation


def slerp(quat_a: ArrayLike, quat_b: ArrayLike, fraction: float) -> Array:
    """Quaternion wxyz on the shorter great arc from `quat_a` (fraction 0) to `quat_b` (fraction 1)."""
    a, b = np.asarray(quat_a, dtype=float), np.asarray(quat_b, dtype=float)
    cosine = float(a @ b)
    if cosine < 0:
        b, cosine = -b, -cosine
    angle = np.arccos(min(cosine, 1.0))
    if angle < 1e-9:
        mixed: Array = a + fraction * (b - a)
    else:
        mixed = (np.sin((1 - fraction) * angle) * a + np.sin(fraction * angle) * b) / np.sin(angle)
    unit: Array = mixed / np.linalg.norm(mixed)
    return unit


def to_xyzw(quat_wxyz: ArrayLike) -> Array:
    """Quaternions (..., 4) in the order of scipy and Rerun."""
    return np.roll(np.asarray(quat_wxyz, dtype=float), -1, axis=-1)


def from_xyzw(quat_xyzw: ArrayLike) -> Array:
    """Quaternions (..., 4) from the order of scipy and Rerun."""
    return np.roll(np.asarray(quat_xyzw, dtype=float), 1, axis=-1)


@dataclass(frozen=True, slots=True)
class Pose:
    """A rigid transform: `T_a_b` maps coordinates in b to coordinates in a.

    Attributes:
        position: (3,) metres, read-only.
        quat_wxyz: (4,) unit quaternion, w first, read-only.

    Raises:
        InputError: a component is not finite, or the quaternion is not of unit length (to 1e-3).
    """

    position: Array
    quat_wxyz: Array

    def __post_init__(self) -> None:
        position = _vector(self.position, 3, "position")
        quat = _vector(self.quat_wxyz, 4, "quat_wxyz")
        with np.errstate(over="ignore"):  # what overflows is refused
            norm = float(np.linalg.norm(quat))
        if abs(norm - 1.0) > UNIT_TOLERANCE:
            raise InputError(
                f"the quaternion {quat.tolist()} has length {norm:.6g}",
                where="quat_wxyz",
                remedy="a rotation is a unit quaternion [w, x, y, z]",
            )
        object.__setattr__(self, "position", read_only(position))
        object.__setattr__(self, "quat_wxyz", read_only(quat / norm))

    @staticmethod
    def identity() -> Pose:
        """The transform that moves nothing."""
        return Pose(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))

    @staticmethod
    def from_xyz(xyz: Sequence[float] | Array) -> Pose:
        """A pure translation."""
        return Pose(np.asarray(xyz, dtype=float), np.array([1.0, 0.0, 0.0, 0.0]))

    @staticmethod
    def from_rotation(position: ArrayLike, rotation: ArrayLike) -> Pose:
        """From a position (3,) and a rotation matrix (3, 3).

        Raises:
            InputError: the matrix is not a rotation (orthonormal to 1e-6, determinant +1).
        """
        R = np.asarray(rotation, dtype=float)
        if R.shape != (3, 3) or not np.all(np.isfinite(R)):
            raise InputError("the rotation must be a finite 3x3 matrix", where="rotation")
        if np.abs(R @ R.T - np.eye(3)).max() > _ROTATION_TOLERANCE or np.linalg.det(R) < 0:
            raise InputError(
                "the matrix is not a rotation",
                where="rotation",
                remedy="it must be orthonormal, with determinant +1",
            )
        return Pose(np.asarray(position, dtype=float), matrix_to_quat(R))

    @staticmethod
    def from_matrix(matrix: ArrayLike) -> Pose:
        """From a homogeneous matrix (4, 4); raises InputError as `from_rotation`."""
        T = np.asarray(matrix, dtype=float)
        if T.shape != (4, 4) or not np.allclose(T[3], [0, 0, 0, 1]):
            raise InputError("a homogeneous transform is a 4x4 matrix with last row 0 0 0 1", where="matrix")
        return Pose.from_rotation(T[:3, 3], T[:3, :3])

    @property
    def rotation(self) -> Array:
        """The rotation matrix (3, 3)."""
        return quat_to_matrix(self.quat_wxyz)

    @property
    def matrix(self) -> Array:
        """The homogeneous matrix (4, 4)."""
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = self.rotation, self.position
        return T

    def inverse(self) -> Pose:
        """`T_b_a` of a `T_a_b`."""
        conjugate = self.quat_wxyz * np.array([1.0, -1.0, -1.0, -1.0])
        return Pose(-(self.rotation.T @ self.position), conjugate)

    def __matmul__(self, other: Pose) -> Pose:
        """`T_a_c = T_a_b @ T_b_c`."""
        return Pose(self.apply(other.position), quat_multiply(self.quat_wxyz, other.quat_wxyz))

    def apply(self, points: ArrayLike) -> Array:
        """Points (..., 3) given in the inner frame, in the outer one."""
        moved: Array = np.asarray(points, dtype=float) @ self.rotation.T + self.position
        return moved

    def error_to(self, target: Pose) -> tuple[float, float]:
        """(distance in metres, rotation angle in radians) between this pose and `target`."""
        angle = float(np.linalg.norm(rotation_vector(target.rotation @ self.rotation.T)))
        return float(np.linalg.norm(target.position - self.position)), angle

    def interpolate(self, other: Pose, fraction: float) -> Pose:
        """Straight line in position, shortest great arc in rotation."""
        position = (1 - fraction) * self.position + fraction * other.position
        return Pose(position, slerp(self.quat_wxyz, other.quat_wxyz, fraction))


def quat_multiply(a: ArrayLike, b: ArrayLike) -> Array:
    """Hamilton product of quaternions wxyz (4,)."""
    aw, ax, ay, az = np.asarray(a, dtype=float)
    bw, bx, by, bz = np.asarray(b, dtype=float)
    return np.array(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ]
    )


def _vector(values: ArrayLike, size: int, name: str) -> Array:
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be {size} numbers, not {values!r}", where=name) from None
    if array.shape != (size,):
        raise InputError(f"{name} must be {size} numbers, not an array of shape {array.shape}", where=name)
    if not np.all(np.isfinite(array)):
        raise InputError(f"{name} is not finite: {array.tolist()}", where=name)
    return array
