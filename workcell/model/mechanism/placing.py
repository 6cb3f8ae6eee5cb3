"""Where a mechanism's links are at a configuration, how points of them move, and what its ties miss."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import polynomial

from workcell.model.mechanism.mechanism import Mechanism
from workcell.model.mechanism.tables import Index, crossed, rotations, tables_of
from workcell.pose import Array, rotation_vector

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
        x, y, z = points.T
        cross = np.zeros((len(points), 3, 3))
        cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = z, -y, x
        cross[:, 1, 0], cross[:, 2, 0], cross[:, 2, 1] = -z, y, -x
        return (cross @ angular + linear) * moves, angular * moves

    @cached_property
    def screws(self) -> tuple[Array, Array]:
        """Velocities of the world's origin as a part of what moves, and angular ones, (3, dof) each."""
        mechanism, tables = self.mechanism, tables_of(self.mechanism)
        linear, angular = np.zeros((mechanism.dof, 3)), np.zeros((mechanism.dof, 3))
        axes = (self.R[1:] @ tables.axis[..., None])[..., 0]
        hinges, slides, rate = tables.hinges, tables.slides, tables.first_rates
        angular[rate[hinges]], linear[rate[slides]] = axes[hinges], axes[slides]
        turning = np.concatenate([tables.balls, tables.frees])
        angular[tables.turns] = self.R[turning + 1].swapaxes(1, 2)
        linear[tables.shifts] = np.eye(3)
        linear += crossed(self.p[1:][tables.rate_joint], angular)
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


def place_many(mechanism: Mechanism, q: Array) -> tuple[Array, Array]:
    """Rotations (m, links, 3, 3) and origins (m, links, 3) of all links at configurations (m, size)."""
    tables = tables_of(mechanism)
    R_parent_child, p_parent_child = tables.local(q)
    R = np.empty((len(q), mechanism.link_count, 3, 3))
    p = np.empty((len(q), mechanism.link_count, 3))
    R[:, 0], p[:, 0] = np.eye(3), 0.0
    for k, parent in enumerate(tables.parents):
        R[:, k + 1] = R[:, parent] @ R_parent_child[:, k]
        p[:, k + 1] = (R[:, parent] @ p_parent_child[:, k, :, None])[..., 0] + p[:, parent]
    return R, p


def moved(mechanism: Mechanism, q: Array, tangent: Array) -> Array:
    """The configuration (size,) that a tangent (dof,) leads to in unit time."""
    tables, found = tables_of(mechanism), np.array(q, dtype=float)
    found[tables.single_values] += tangent[tables.single_rates]
    found[tables.places] += tangent[tables.shifts]
    if len(tables.quats):
        found[tables.quats] = _turned(found[tables.quats], tangent[tables.turns])
    return found


def difference(mechanism: Mechanism, q: Array, other: Array) -> Array:
    """The tangent (dof,) that leads from a configuration to another in unit time."""
    tables, tangent = tables_of(mechanism), np.zeros(mechanism.dof)
    tangent[tables.single_rates] = (other - q)[tables.single_values]
    tangent[tables.shifts] = (other - q)[tables.places]
    if len(tables.quats):
        R, S = rotations(q[tables.quats]), rotations(other[tables.quats])
        tangent[tables.turns] = rotation_vector(R.swapaxes(1, 2) @ S)
    return tangent


def _turned(quats: Array, vectors: Array) -> Array:
    """Quaternions (k, 4) times those of rotation vectors (k, 3), in the child."""
    angle = np.sqrt((vectors * vectors).sum(axis=1))[:, None]
    v = vectors * np.where(angle < _TINY, 0.5, np.sin(0.5 * angle) / np.maximum(angle, _TINY))
    w, a, b = np.cos(0.5 * angle), quats[:, :1], quats[:, 1:]
    real = a * w - (b * v).sum(axis=1, keepdims=True)
    product = np.concatenate([real, a * v + w * b + crossed(b, v)], axis=1)
    unit: Array = product / np.sqrt((product * product).sum(axis=1, keepdims=True))
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
