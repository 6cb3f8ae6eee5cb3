"""Facial reduction: the linear dependencies among a skeleton's vectors, found from sampled configurations.

Points of one link that lie in a plane, axes shared by two links, and the closure of the chain at the goal make columns
of X linearly dependent at every configuration. A positive semidefinite Z over dependent columns is singular: the
relaxation has no interior. Here every vector is written as a combination of a few independent ones, of the base's
unit vectors and of the goals' columns; only the independent ones become variables.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from workcell.ik.cidgik.skeleton import Skeleton
from workcell.ik.trees.query import Goal
from workcell.pose import Array, read_only

_DEPENDENT = 1e-8
_NEGLIGIBLE = 1e-10
_EXACT = 2e-11
"""Largest error of a vector written in terms of others with which proofs may be given: products of unit vectors are off
by twice as much, which a hundred rows with multipliers of unit length make less than proofs keep back for rounding."""
_SEED = 20220225


@dataclass(frozen=True, slots=True)
class Vectors:
    """Vectors as combinations: of the basis X (r, d), the base's unit vectors, and the goals' columns G (g, d).

    The world value (in the base frame) of vector i is `alpha[i] @ X + base[i] + goal[i] @ G`.

    Attributes:
        alpha: (..., r).
        base: (..., d).
        goal: (..., g).
    """

    alpha: Array
    base: Array
    goal: Array

    def __post_init__(self) -> None:
        for name in ("alpha", "base", "goal"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    def one(self, k: int) -> Vectors:
        """The k-th of some vectors."""
        return Vectors(self.alpha[k], self.base[k], self.goal[k])

    def part(self, start: int, stop: int | None) -> Vectors:
        """Those from `start` to `stop`."""
        return Vectors(self.alpha[start:stop], self.base[start:stop], self.goal[start:stop])

    def plus(self, other: Vectors) -> Vectors:
        """Their sum."""
        return Vectors(self.alpha + other.alpha, self.base + other.base, self.goal + other.goal)

    def mix(self, weights: Array) -> Vectors:
        """Combinations (..., m) of these m vectors."""
        return Vectors(weights @ self.alpha, weights @ self.base, weights @ self.goal)

    def at(self, G: Array) -> Array:
        """(..., r + d) coefficients over [X; I] for the goals' columns G (g, d)."""
        return np.concatenate([self.alpha, self.base + self.goal @ G], axis=-1)


def stack(vectors: Sequence[Vectors], like: Vectors) -> Vectors:
    """Single vectors as one `Vectors` (t, ...); `like` gives the widths where there are none."""
    parts = []
    for name in ("alpha", "base", "goal"):
        width = getattr(like, name).shape[-1]
        parts.append(np.array([getattr(v, name) for v in vectors]).reshape(len(vectors), width))
    return Vectors(*parts)


class Reduction:
    """The independent vectors of a skeleton, and all others in terms of them.

    Attributes:
        skeleton: what was reduced.
        links: whose directions and origins take part, in ascending order.
        rank: r, number of independent unknown vectors.
        directions: by link, its basis directions as `Vectors` (s, ...).
        origins: by link, its origin as a single `Vectors`.
        like: any `Vectors`, for their widths.
        chosen: (r,) which of all links' directions and origins, in this order, the basis is.
        exact: whether what is written in terms of others is so but for rounding; where axes are nearly parallel, or
            nearly meet, vectors may depend on each other nearly. That is good enough to search with, not for proofs.
    """

    def __init__(self, skeleton: Skeleton, links: tuple[int, ...] | None = None) -> None:
        self.skeleton = skeleton
        self.links = tuple(range(skeleton.robot.dof + 1)) if links is None else links
        starts = np.concatenate([[0], np.cumsum([skeleton.basis[k].shape[1] for k in self.links])])
        d, total = skeleton.dimension, int(starts[-1]) + len(self.links)
        q = np.random.default_rng(_SEED).uniform(-np.pi, np.pi, (2 * total // d + 8, skeleton.robot.dof))
        T = _base_transforms(skeleton, q)
        unknown = np.swapaxes(self._values(T), 1, 2).reshape(len(q) * d, -1)
        goals = np.swapaxes(_goal_columns_of(skeleton, T), 1, 2).reshape(len(q) * d, -1)
        known = np.hstack([np.tile(np.eye(d), (len(q), 1)), goals])
        self.chosen, coefficients, error = _independent(unknown, known)
        self.exact = error < _EXACT
        self.rank = len(self.chosen)
        alpha, rest = coefficients[: self.rank].T, coefficients[self.rank :].T
        self.like = Vectors(alpha, rest[:, :d], rest[:, d:])
        bounds = list(pairwise(starts.tolist()))
        self.directions = {k: self.like.part(a, b) for k, (a, b) in zip(self.links, bounds, strict=True)}
        self.origins = {k: self.like.one(int(starts[-1]) + i) for i, k in enumerate(self.links)}
        self._directions_end = int(starts[-1])

    def _values(self, T: Array) -> Array:
        """(samples, vectors, d) directions of all links, then their origins."""
        skeleton, links = self.skeleton, list(self.links)
        parts = [T[:, k, :3, :3] @ skeleton.basis[k] for k in links]
        directions = np.swapaxes(np.concatenate(parts, axis=2), 1, 2)
        return np.concatenate([directions, T[:, links][..., :3, 3]], axis=1) @ skeleton.plane.T

    def basis_at(self, q: Array) -> Array:
        """X (r, d) of a configuration (n,)."""
        values: Array = self._values(_base_transforms(self.skeleton, q[None]))[0][self.chosen]
        return values

    def direction(self, link: int, vector: Array) -> Vectors:
        """A direction (3,) fixed to a link, within the span of its basis."""
        return self.directions[link].mix(self.skeleton.in_link(link, vector))

    def point(self, link: int, local: Array) -> Vectors:
        """A point (3,) of a link, within the span of its basis."""
        return self.origins[link].plus(self.direction(link, local))

    def points(self, links: NDArray[np.int64], local: Array) -> Vectors:
        """Several points, (m,) links and (m, 3) places in them."""
        return stack([self.point(int(k), c) for k, c in zip(links, local, strict=True)], self.like)

    def columns_at(self, q: Array) -> Array:
        """The goals' columns (g, d) if the robot stood at q (n,)."""
        columns: Array = _goal_columns_of(self.skeleton, _base_transforms(self.skeleton, q[None]))[0]
        return columns

    def bounds(self) -> Array:
        """(r,) an upper bound of each basis vector's length: one for directions, the chain's length for origins."""
        robot = self.skeleton.robot
        reach = np.zeros(robot.dof + 1)
        for joint in range(robot.dof):
            reach[joint + 1] = reach[int(robot.parents[joint])] + np.linalg.norm(robot.joint_xyz[joint])
        lengths = np.concatenate([np.ones(self._directions_end), reach[list(self.links)]])
        chosen: Array = lengths[self.chosen]
        return chosen


def _base_transforms(skeleton: Skeleton, q: Array) -> Array:
    """Link poses (samples, n + 1, 4, 4) seen from the base."""
    T = skeleton.robot.link_transforms(q)
    seen: Array = skeleton.robot.T_world_base.inverse().matrix @ T
    return seen


def _goal_columns_of(skeleton: Skeleton, T: Array) -> Array:
    """(samples, g, d) what the goals' columns would be at these configurations."""
    columns = []
    for goal in skeleton.goals:
        tool = skeleton.robot.tool(goal.tool)
        pose = T[:, tool.link] @ tool.T_link_tool.matrix
        columns += [pose[:, :3, 3]] + [pose[:, :3, :3] @ axis for axis in goal.axes]
    return np.stack(columns, axis=1) @ skeleton.plane.T


def goal_columns(skeleton: Skeleton, goals: tuple[Goal, ...]) -> Array:
    """(g, d) the goals' columns, in the base frame: position, then directions, goal by goal."""
    base = skeleton.robot.T_world_base
    columns = []
    for goal in goals:
        columns += [base.rotation.T @ (goal.position - base.position)]
        columns += list(goal.directions @ base.rotation)
    return np.stack(columns) @ skeleton.plane.T


def _independent(unknown: Array, known: Array) -> tuple[NDArray[np.int64], Array, float]:
    """Independent columns of `unknown` (of `known` too), all of them in terms of both, and the largest error."""
    from scipy.linalg import qr

    left, sizes, _ = np.linalg.svd(known, full_matrices=False)
    span = left[:, sizes > _DEPENDENT * sizes[0]]
    rest = unknown - span @ (span.T @ unknown)
    rest -= span @ (span.T @ rest)
    _, R, order = qr(rest, mode="economic", pivoting=True)
    scale = np.abs(np.diag(R))
    rank = int(np.count_nonzero(scale > _DEPENDENT * np.sqrt(len(unknown))))
    chosen = np.sort(order[:rank])
    columns = np.hstack([unknown[:, chosen], known])
    coefficients = np.linalg.lstsq(columns, unknown, rcond=1e-10)[0]
    cleaned: Array = np.where(np.abs(coefficients) < _NEGLIGIBLE, 0.0, coefficients)
    return chosen.astype(np.int64), cleaned, float(np.abs(columns @ cleaned - unknown).max(initial=0.0))
