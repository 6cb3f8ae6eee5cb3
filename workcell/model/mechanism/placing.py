"""Where a mechanism's links are at a configuration, how points of them move, and what its ties miss."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import polynomial

from workcell.model.mechanism.mechanism import Mechanism
from workcell.pose import Array, axis_angle_to_matrix, quat_to_matrix, rotation_vector

_TINY = 1e-12


@dataclass(frozen=True, slots=True)
class Placed:
    """All links of a mechanism in the world.

    Attributes:
        mechanism: whose.
        q: (size,) at which configuration.
        R: (links, 3, 3) rotations.
        p: (links, 3) origins, metres.
    """

    mechanism: Mechanism
    q: Array
    R: Array
    p: Array

    def point(self, link: int, local: Array) -> Array:
        """World place (..., 3) of points (..., 3) of a link."""
        placed: Array = local @ self.R[link].T + self.p[link]
        return placed

    def columns(self, link: int, point: Array) -> tuple[Array, Array]:
        """How a world point (3,) of a link, and the link's rotation, move: (3, dof) each, in the world."""
        mechanism = self.mechanism
        linear, angular = np.zeros((3, mechanism.dof)), np.zeros((3, mechanism.dof))
        for k in np.flatnonzero(mechanism.ancestors[link]):
            joint, at = mechanism.joints[k], mechanism.rate_slices[k]
            R = self.R[k + 1]
            if joint.kind == "slide":
                linear[:, at.start] = R @ joint.axis
            elif joint.kind == "hinge":
                axis = R @ joint.axis
                linear[:, at.start] = np.cross(axis, point - self.p[k + 1])
                angular[:, at.start] = axis
            else:
                turning = slice(at.stop - 3, at.stop)
                linear[:, turning] = np.cross(R.T, point - self.p[k + 1]).T
                angular[:, turning] = R
                if joint.kind == "free":
                    linear[:, at.start : at.start + 3] = np.eye(3)
        return linear, angular


def place(mechanism: Mechanism, q: Array) -> Placed:
    """The links at a configuration (size,)."""
    R = np.empty((mechanism.link_count, 3, 3))
    p = np.empty((mechanism.link_count, 3))
    R[0], p[0] = np.eye(3), 0.0
    for k, (joint, at) in enumerate(zip(mechanism.joints, mechanism.value_slices, strict=True)):
        if joint.kind == "free":
            p[k + 1], R[k + 1] = q[at.start : at.start + 3], quat_to_matrix(q[at.start + 3 : at.stop])
            continue
        above, T = R[joint.parent], joint.T_parent_joint
        frame = above @ T.rotation
        p[k + 1] = p[joint.parent] + above @ T.position
        if joint.kind == "slide":
            R[k + 1] = frame
            p[k + 1] += float(q[at.start]) * (frame @ joint.axis)
        elif joint.kind == "hinge":
            R[k + 1] = frame @ axis_angle_to_matrix(joint.axis, float(q[at.start]))
        else:
            R[k + 1] = frame @ quat_to_matrix(q[at])
    return Placed(mechanism, q, R, p)


def moved(mechanism: Mechanism, q: Array, tangent: Array) -> Array:
    """The configuration (size,) that a tangent (dof,) leads to in unit time."""
    found = np.array(q, dtype=float)
    for joint, at, rate in zip(mechanism.joints, mechanism.value_slices, mechanism.rate_slices, strict=True):
        step = tangent[rate]
        if joint.kind in ("hinge", "slide"):
            found[at.start] += step[0]
            continue
        if joint.kind == "free":
            found[at.start : at.start + 3] += step[:3]
        found[at.stop - 4 : at.stop] = _turned(found[at.stop - 4 : at.stop], step[-3:])
    return found


def difference(mechanism: Mechanism, q: Array, other: Array) -> Array:
    """The tangent (dof,) that leads from a configuration to another in unit time."""
    tangent = np.zeros(mechanism.dof)
    for joint, at, rate in zip(mechanism.joints, mechanism.value_slices, mechanism.rate_slices, strict=True):
        if joint.kind in ("hinge", "slide"):
            tangent[rate.start] = other[at.start] - q[at.start]
            continue
        if joint.kind == "free":
            tangent[rate.start : rate.start + 3] = (other - q)[at.start : at.start + 3]
        R = quat_to_matrix(np.stack([q[at.stop - 4 : at.stop], other[at.stop - 4 : at.stop]]))
        tangent[rate.stop - 3 : rate.stop] = rotation_vector(R[0].T @ R[1])
    return tangent


def _turned(quat: Array, vector: Array) -> Array:
    """quat times the rotation vector's quaternion, in the child."""
    angle = float(np.linalg.norm(vector))
    half = 0.5 * angle
    w = np.cos(half)
    v = vector * (0.5 if angle < _TINY else np.sin(half) / angle)
    a, b = quat[0], quat[1:]
    product = np.concatenate([[a * w - b @ v], a * v + w * b + np.cross(b, v)])
    unit: Array = product / np.linalg.norm(product)
    return unit


def missed(placed: Placed) -> tuple[Array, Array]:
    """What all ties miss (r,), metres and radians, and how that changes (r, dof).

    Rows in the order of closures (three of a connect, six of a weld), followers, and sums held at one number.
    """
    mechanism = placed.mechanism
    values, rows = [np.zeros(0)], [np.zeros((0, mechanism.dof))]
    for closure in mechanism.closures:
        (a, b), (F, G) = closure.links, closure.frames
        one, two = placed.point(a, F.position), placed.point(b, G.position)
        (linear_a, angular_a), (linear_b, angular_b) = placed.columns(a, one), placed.columns(b, two)
        values.append(one - two)
        rows.append(linear_a - linear_b)
        if closure.kind == "weld":
            A, B = placed.R[a] @ F.rotation, placed.R[b] @ G.rotation
            values.append(rotation_vector(A @ B.T))
            rows.append(angular_a - angular_b)
    for follower in mechanism.followers:
        value, row = _missed_by_follower(
            mechanism, follower.joint, follower.leader, follower.coefficients, placed.q
        )
        values.append(value)
        rows.append(row)
    for total in mechanism.sums:
        if total.lower == total.upper:
            row = np.zeros((1, mechanism.dof))
            held = np.array([-total.lower])
            for joint, multiple in zip(total.joints, total.multiples, strict=True):
                held += multiple * placed.q[mechanism.value_slices[joint]]
                row[0, mechanism.rate_slices[joint]] += multiple
            values.append(held)
            rows.append(row)
    return np.concatenate(values), np.concatenate(rows)


def _missed_by_follower(
    mechanism: Mechanism, joint: int, leader: int, coefficients: Array, q: Array
) -> tuple[Array, Array]:
    row = np.zeros((1, mechanism.dof))
    row[0, mechanism.rate_slices[joint]] = 1.0
    value = q[mechanism.value_slices[joint]]
    if leader < 0:
        return value - coefficients[0], row
    x = q[mechanism.value_slices[leader]]
    row[0, mechanism.rate_slices[leader]] -= polynomial.polyval(x, polynomial.polyder(coefficients))
    found: Array = value - polynomial.polyval(x, coefficients)
    return found, row
