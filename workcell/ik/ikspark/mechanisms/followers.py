"""Joints that follow others: equalities where they are linear, the convex hull of the curve where not.

A hinge that follows another one is a point (cos, sin, cos', sin') of a curve on a sphere. The hull of the curve holds
no other points of the sphere, so that at rank one, where both pairs are of length one, hull and curve are the same. The
hull is not written down: where a point is outside, a plane parts it from the curve. A slide is there with its value.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import polynomial

from workcell.ik.ikspark.mechanisms.edges import AnyEdge, edge_of
from workcell.ik.ikspark.mechanisms.lift import MechanismLift
from workcell.ik.ikspark.mechanisms.nodes import Nodes
from workcell.ik.ikspark.mechanisms.rows import Rows
from workcell.model.mechanism.mechanism import Follower, Mechanism
from workcell.pose import Array

_SAMPLES = 257
"""Points of a curve that its hull is seen by."""
_OUTSIDE = 1e-6
"""Distance from a hull beyond which a point counts as outside."""


def edges_for(mechanism: Mechanism, nodes: Nodes) -> dict[int, AnyEdge]:
    """By hinge that follows, or is followed, what makes its angle affine."""
    hinges = set()
    for follower in mechanism.followers:
        both = [k for k in (follower.joint, follower.leader) if k >= 0]
        hinges |= {k for k in both if mechanism.joints[k].kind == "hinge"}
    found = {k: edge_of(mechanism, nodes, k) for k in sorted(hinges)}
    return {k: edge for k, edge in found.items() if edge is not None}


def edge_rows(lift: MechanismLift) -> Iterator[Rows]:
    """What the lifted pairs are by themselves."""
    for edge, start in lift.edges.values():
        yield from edge.rows(lift, start)  # type: ignore[attr-defined]


@dataclass(frozen=True, slots=True)
class Curve:
    """What one joint that follows says.

    Attributes:
        index: of the follower.
        coordinates: (k, N + 1) of both joints, affine in the variables.
        points: (samples, k) of the curve.
        slack: by how much the curve may leave the hull of the points.
    """

    index: int
    coordinates: Array
    points: Array
    slack: float

    def cut(self, x: Array) -> Rows | None:
        """A row that x (N,) breaks and the curve keeps; None: x is in its hull."""
        from scipy.optimize import nnls

        here = self.coordinates[:, :-1] @ x + self.coordinates[:, -1]
        weight = 1e3  # the weights sum up to one
        A = np.vstack([self.points.T, weight * np.ones(len(self.points))])
        combination = nnls(A, np.append(here, weight))[0]
        away = here - self.points.T @ combination
        length = float(np.linalg.norm(away))
        if length <= _OUTSIDE + self.slack:
            return None
        normal = away / length
        row = -normal @ self.coordinates
        row[-1] += float((self.points @ normal).max()) + self.slack
        return Rows("curve", self.index, "nonneg", row[None])


def tied(lift: MechanismLift, interval: Array) -> tuple[list[Rows], list[Curve]]:
    """Equalities of what follows linearly, and the curves of what does not; the rest is left to the polish."""
    rows, curves = [], []
    for i, follower in enumerate(lift.mechanism.followers):
        kinds = [lift.mechanism.joints[k].kind for k in (follower.joint, follower.leader) if k >= 0]
        if "hinge" not in kinds:
            if np.any(follower.coefficients[2:]):
                curves += _curve(lift, i, follower, interval)
            continue
        angles = [_angle(lift, k) for k in (follower.joint, follower.leader) if k >= 0]
        slope = follower.coefficients[1] if len(follower.coefficients) > 1 else 0.0
        plain = kinds == ["hinge", "hinge"] and abs(slope) == 1.0 and not np.any(follower.coefficients[2:])
        if any(angle is None for angle in angles) or follower.leader < 0:
            continue
        if plain:
            rows.append(Rows("follower", i, "zero", _turned_along(angles, follower.coefficients)))
        else:
            curves += _curve(lift, i, follower, interval)
    return rows, curves


def _angle(lift: MechanismLift, joint: int) -> Array | None:
    """(2, N + 1) cosine and sine of a hinge, (1, N + 1) value of a slide."""
    if lift.mechanism.joints[joint].kind == "slide":
        return lift.slide_row(joint)[None]
    if joint not in lift.edges:
        return None
    edge, start = lift.edges[joint]
    found: Array = edge.turn(lift, start)  # type: ignore[attr-defined]
    return found


def _turned_along(angles: list[Array | None], coefficients: Array) -> Array:
    """(cos, sin) of what follows less those of its leader, turned by the offset, mirrored where it runs back."""
    one, two = angles
    assert one is not None and two is not None
    c, s, sign = np.cos(coefficients[0]), np.sin(coefficients[0]), coefficients[1]
    rows: Array = one - np.array([[c, -sign * s], [s, sign * c]]) @ two
    return rows


def _curve(lift: MechanismLift, index: int, follower: Follower, interval: Array) -> list[Curve]:
    joints = [lift.mechanism.joints[k] for k in (follower.leader, follower.joint)]
    parts = [_angle(lift, k) for k in (follower.leader, follower.joint)]
    if any(part is None for part in parts):
        return []
    lower, upper = interval[follower.leader]
    if not np.isfinite(lower + upper):
        lower, upper = -np.pi, np.pi
    value = np.linspace(lower, upper, _SAMPLES)
    follows = polynomial.polyval(value, follower.coefficients)
    low, high = interval[follower.joint]
    kept = (follows >= low - 1e-6) & (follows <= high + 1e-6)
    value, follows = value[kept], follows[kept]
    if len(value) < 2:
        return []
    points = np.hstack([_coordinates(joints[0].kind, value), _coordinates(joints[1].kind, follows)])
    bend = np.linalg.norm(np.diff(points, n=2, axis=0), axis=1).max(initial=0.0)
    return [Curve(index, np.vstack([part for part in parts if part is not None]), points, 0.25 * float(bend))]


def _coordinates(kind: str, value: Array) -> Array:
    return np.stack([np.cos(value), np.sin(value)], axis=1) if kind == "hinge" else value[:, None]
