"""Where a mechanism's links are at a configuration, how points of them move, and what its ties miss."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import polynomial

from workcell.model.mechanism.mechanism import Mechanism
from workcell.model.mechanism.tables import Index, tables_of
from workcell.pose import Array, quat_to_matrix, rotation_vector

_TINY = 1e-12


@dataclass(frozen=True)
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

    def points(self, links: Index, local: Array) -> Array:
        """World places (m, 3) of points (m, 3), each of its own link (m,)."""
        placed: Array = (self.R[links] @ local[..., None])[..., 0] + self.p[links]
        return placed

    def columns(self, link: int, point: Array) -> tuple[Array, Array]:
        """How a world point (3,) of a link, and the link's rotation, move: (3, dof) each, in the world."""
        linear, angular = self.jacobians(np.array([link]), point[None])
        return linear[0], angular[0]

    def jacobians(self, links: Index, points: Array) -> tuple[Array, Array]:
        """The same of world points (m, 3), each of its own link (m,): (m, 3, dof) each."""
        linear, angular = self.screws
        moves = tables_of(self.mechanism).moves[links][:, None, :]
        return (np.cross(angular.T, points[:, None]).swapaxes(1, 2) + linear) * moves, angular * moves

    @cached_property
    def screws(self) -> tuple[Array, Array]:
        """Velocities of the world's origin as a part of what moves, and angular ones, (3, dof) each."""
        mechanism, tables = self.mechanism, tables_of(self.mechanism)
        linear, angular = np.zeros((mechanism.dof, 3)), np.zeros((mechanism.dof, 3))
        axes = (self.R[1:] @ tables.axis[..., None])[..., 0]
        hinges, slides = tables.hinges, tables.slides
        rate = np.array([at.start for at in mechanism.rate_slices])
        angular[rate[hinges]], linear[rate[slides]] = axes[hinges], axes[slides]
        for joint in tables.balls:
            angular[rate[joint] : rate[joint] + 3] = self.R[joint + 1].T
        for joint in tables.frees:
            linear[rate[joint] : rate[joint] + 3] = np.eye(3)
            angular[rate[joint] + 3 : rate[joint] + 6] = self.R[joint + 1].T
        linear += np.cross(self.p[1:][tables.rate_joint], angular)
        return linear.T, angular.T


def place(mechanism: Mechanism, q: Array) -> Placed:
    """The links at a configuration (size,)."""
    tables = tables_of(mechanism)
    R_parent_child, p_parent_child = tables.local(q)
    R = np.empty((mechanism.link_count, 3, 3))
    p = np.empty((mechanism.link_count, 3))
    R[0], p[0] = np.eye(3), 0.0
    for k, parent in enumerate(tables.parents):
        above = R[parent]
        np.matmul(above, R_parent_child[k], out=R[k + 1])
        np.add(above @ p_parent_child[k], p[parent], out=p[k + 1])
    return Placed(mechanism, q, R, p)


def moved(mechanism: Mechanism, q: Array, tangent: Array) -> Array:
    """The configuration (size,) that a tangent (dof,) leads to in unit time."""
    tables, found = tables_of(mechanism), np.array(q, dtype=float)
    found[tables.single_values] += tangent[tables.single_rates]
    for joint in (*tables.balls, *tables.frees):
        at, step = mechanism.value_slices[joint], tangent[mechanism.rate_slices[joint]]
        if len(step) == 6:
            found[at.start : at.start + 3] += step[:3]
        found[at.stop - 4 : at.stop] = _turned(found[at.stop - 4 : at.stop], step[-3:])
    return found


def difference(mechanism: Mechanism, q: Array, other: Array) -> Array:
    """The tangent (dof,) that leads from a configuration to another in unit time."""
    tables, tangent = tables_of(mechanism), np.zeros(mechanism.dof)
    tangent[tables.single_rates] = (other - q)[tables.single_values]
    for joint in (*tables.balls, *tables.frees):
        at, rate = mechanism.value_slices[joint], mechanism.rate_slices[joint]
        if rate.stop - rate.start == 6:
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

    Rows in the order of closures (three of a connect, six of a weld), followers, and sums held at one number. The
    rows of a weld's rotation are how its rotation vector changes where that is zero.
    """
    mechanism = placed.mechanism
    values, rows = [np.zeros(0)], [np.zeros((0, mechanism.dof))]
    if mechanism.closures:
        value, row = _missed_by_closures(placed)
        values.append(value)
        rows.append(row)
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


def _missed_by_closures(placed: Placed) -> tuple[Array, Array]:
    closures = placed.mechanism.closures
    links = np.array([closure.links for closure in closures])
    local = np.array([[frame.position for frame in closure.frames] for closure in closures])
    ends = [placed.points(links[:, side], local[:, side]) for side in (0, 1)]
    moving = [placed.jacobians(links[:, side], ends[side]) for side in (0, 1)]
    apart = ends[0] - ends[1]
    linear, angular = (moving[0][part] - moving[1][part] for part in (0, 1))
    values, rows = [], []
    for k, closure in enumerate(closures):
        values.append(apart[k])
        rows.append(linear[k])
        if closure.kind == "weld":
            A, B = (
                placed.R[link] @ frame.rotation
                for link, frame in zip(closure.links, closure.frames, strict=True)
            )
            values.append(rotation_vector(A @ B.T))
            rows.append(angular[k])
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
