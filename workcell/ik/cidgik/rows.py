"""CIDGIK's constraints on Z = [X I]^T [X I], as symmetric matrices.

They are what every configuration that reaches the goals keeps. A product of two vectors a . b, each a
combination of the columns of [X I], is `<sym(a b^T), Z>`: linear in Z. All rows are such sums of products
(Eq. 4 to 7 of the paper, in inner products instead of squared distances).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workcell.ik.cidgik.reduction import Reduction, Vectors, stack
from workcell.ik.cidgik.skeleton import Limited, frame_about
from workcell.ik.shared.conic import triangle
from workcell.pose import Array


def products(a: Array, b: Array) -> Array:
    """(..., k) triangles of sym(a b^T) for combinations a, b (..., N): inner products with svec(Z) are a . b."""
    rows, columns, factor = triangle(a.shape[-1])
    packed: Array = (a[..., rows] * b[..., columns] + a[..., columns] * b[..., rows]) * (0.5 * factor)
    return packed


@dataclass(frozen=True, slots=True)
class Products:
    """Rows `sum_t weight_t left_t . right_t - constant`, term t belonging to row[t].

    Attributes:
        row: (t,) in ascending order.
        weight: (t,).
        left, right: `Vectors` (t, ...).
        constant: (m,).
    """

    row: NDArray[np.int64]
    weight: Array
    left: Vectors
    right: Vectors
    constant: Array

    def at(self, G: Array, weight: Array | None = None) -> tuple[Array, Array]:
        """(m, k) triangles and (m,) constants at the goals' columns G."""
        terms = products(self.left.at(G), self.right.at(G))
        terms = terms * (self.weight if weight is None else weight)[:, None]
        packed = np.zeros((len(self.constant), terms.shape[1]))
        np.add.at(packed, self.row, terms)
        return packed, self.constant


class ProductsBuilder:
    """Collects `Products` row by row."""

    def __init__(self) -> None:
        self._row: list[int] = []
        self._weight: list[float] = []
        self._left: list[Vectors] = []
        self._right: list[Vectors] = []
        self._constant: list[float] = []

    def add(self, terms: list[tuple[float, Vectors, Vectors]], constant: float) -> None:
        """One row `sum weight a . b = constant`."""
        for weight, left, right in terms:
            self._row.append(len(self._constant))
            self._weight.append(weight)
            self._left.append(left)
            self._right.append(right)
        self._constant.append(constant)

    def build(self, like: Vectors) -> Products:
        """The rows; `like` gives the widths when there are none."""
        return Products(
            np.array(self._row, dtype=np.int64),
            np.array(self._weight),
            stack(self._left, like),
            stack(self._right, like),
            np.array(self._constant),
        )


def rigid_rows(reduction: Reduction) -> Products:
    """Equalities: the directions of each link are orthonormal, and neighbouring frames are of one hand."""
    builder = ProductsBuilder()
    skeleton = reduction.skeleton
    for link in reduction.links:
        if link in skeleton.known:
            continue
        directions = reduction.directions[link]
        for i in range(len(directions.alpha)):
            for j in range(i + 1):
                builder.add([(1.0, directions.one(i), directions.one(j))], float(i == j))
    for joint in joints_within(reduction):
        _handed_rows(builder, reduction, joint)
    return builder.build(reduction.like)


def joints_within(reduction: Reduction) -> list[int]:
    """Joints between two links of a reduction."""
    links, parents = set(reduction.links), reduction.skeleton.robot.parents
    return [joint for joint, parent in enumerate(parents) if {int(parent), joint + 1} <= links]


def _handed_rows(builder: ProductsBuilder, reduction: Reduction, joint: int) -> None:
    """a . x = b . y and a . y = -b . x for the frames (x, y) before and (a, b) after a joint, about its axis."""
    skeleton = reduction.skeleton
    robot = skeleton.robot
    parent, child = int(robot.parents[joint]), joint + 1
    if not {parent, child} <= skeleton.framed or {parent, child} <= skeleton.known:
        return
    frame = frame_about(robot.axis[joint])
    a, b = (reduction.direction(child, frame[:, i]) for i in (1, 2))
    x, y = (reduction.direction(parent, robot.joint_rotation[joint] @ frame[:, i]) for i in (1, 2))
    builder.add([(1.0, a, x), (-1.0, b, y)], 0.0)
    builder.add([(1.0, a, y), (1.0, b, x)], 0.0)


class LimitRows:
    """Rows `>= 0` of the joint limits (cos(angle - middle) >= cos(half)); their weights change with the limits.

    Attributes:
        limited: the joints, in order of the rows.
        products: the rows, but for their weights (cosines and sines) and constants.
    """

    def __init__(self, reduction: Reduction) -> None:
        within = set(joints_within(reduction))
        self.limited = tuple(plan for plan in reduction.skeleton.limited if plan.joint in within)
        builder = ProductsBuilder()
        for plan in self.limited:
            terms = [(1.0, a, b) for a, b in _limit_vectors(reduction, plan)]
            builder.add(terms, 0.0)
        self.products = builder.build(reduction.like)

    def at(self, G: Array, middle: Array, half: Array) -> tuple[Array, Array]:
        """(m, k) triangles and (m,) constants: inner product with svec(Z) less the constant is >= 0."""
        weights: list[float] = []
        for plan in self.limited:
            c, s = np.cos(middle[plan.joint]), np.sin(middle[plan.joint])
            if plan.how == "aligned":
                weights.append(plan.sign)
            else:
                weights += [c, s] if plan.how == "parent" else [c, -s]
        packed, _ = self.products.at(G, np.array(weights))
        return packed, np.array([np.cos(half[plan.joint]) for plan in self.limited])


def _limit_vectors(reduction: Reduction, plan: Limited) -> list[tuple[Vectors, Vectors]]:
    robot = reduction.skeleton.robot
    parent, child = int(robot.parents[plan.joint]), plan.joint + 1
    u, v = reduction.direction(parent, plan.parent), reduction.direction(child, plan.child)
    if plan.how == "aligned":
        return [(u, v)]
    if plan.how == "parent":
        return [(u, v), (reduction.direction(parent, plan.parent_side), v)]
    return [(u, v), (u, reduction.direction(child, plan.child_side))]


class FrameRows:
    """What keeps the hand of frames: linear in X.

    A frame whose axis is known is `b = z x a`, three equalities. Any other one is a rotation: the matrix of its
    quaternion, Q = q q^T, is linear in it and positive semidefinite, which no reflection's is (its least eigenvalue
    would be -1/2).

    Attributes:
        turned: frames with a known axis: a, b and z of each.
        free: the others, three directions each; `free_links` says of which links.
    """

    def __init__(self, reduction: Reduction) -> None:
        skeleton = reduction.skeleton
        self.dimension = skeleton.dimension
        turned: list[tuple[Vectors, Vectors, Vectors]] = []
        self.free: list[Vectors] = []
        self.free_links: list[int] = []
        for link in sorted((skeleton.framed - skeleton.known) & set(reduction.links)):
            frame = reduction.directions[link]
            if self.dimension == 2:
                turned.append((frame.one(0), frame.one(1), frame.one(0)))
                continue
            axis = self._known_axis(reduction, link)
            if axis is None:
                self.free.append(frame)
                self.free_links.append(link)
            else:
                side = frame_about(axis)
                turned.append(tuple(reduction.direction(link, side[:, i]) for i in (1, 2, 0)))  # type: ignore[arg-type]
        like = reduction.like
        self.turned = tuple(stack([t[i] for t in turned], like) for i in range(3))

    @staticmethod
    def _known_axis(reduction: Reduction, link: int) -> Array | None:
        """A joint axis (3,) of the link that the base or a goal fixes."""
        robot = reduction.skeleton.robot
        axes = [robot.axis[link - 1]]
        axes += [robot.joint_rotation[k] @ robot.axis[k] for k in np.flatnonzero(robot.parents == link)]
        for axis in axes:
            if not np.any(reduction.direction(link, axis).alpha):
                return np.asarray(axis)
        return None

    def equalities(self, G: Array) -> Array:
        """(m, k) triangles whose inner product with svec(Z) is zero."""
        if not len(self.turned[0].alpha):
            return np.zeros((0, len(triangle(self.turned[0].alpha.shape[1] + self.dimension)[0])))
        a, b = self.turned[0].at(G), self.turned[1].at(G)
        d, count, width = self.dimension, len(a), a.shape[1]
        left, right = np.zeros((count, d, width)), np.zeros((count, d, width))
        left[:, :, -d:] = np.eye(d)
        if d == 2:
            right[:, :, -2:] = np.array([[0.0, -1.0], [1.0, 0.0]])
        else:
            x, y, z = self.turned[2].at(G)[:, -3:].T
            # e_i . (z x a) = (e_i x z) . a
            right[:, 0, -2], right[:, 0, -1] = -z, y
            right[:, 1, -3], right[:, 1, -1] = z, -x
            right[:, 2, -3], right[:, 2, -2] = -y, x
        packed = products(np.broadcast_to(b[:, None], left.shape), left)
        packed -= products(np.broadcast_to(a[:, None], right.shape), right)
        rows: Array = packed.reshape(count * d, packed.shape[-1])
        return rows

    def quaternions(self, G: Array) -> tuple[Array, Array]:
        """(f, 10, k) triangles and (10,) constants, for each frame: constants + inner products are Q's triangle."""
        k = len(triangle(self.turned[0].alpha.shape[1] + self.dimension)[0])
        blocks = np.zeros((len(self.free), 10, k))
        constant = np.zeros(10)
        constant[[0, 2, 5, 9]] = 0.25
        for i, frame in enumerate(self.free):
            f = frame.at(G)
            axes = np.zeros((3, f.shape[1]))
            axes[:, -3:] = np.eye(3)
            R = products(np.repeat(axes, 3, axis=0), np.tile(f, (3, 1))).reshape(3, 3, -1)
            blocks[i] = np.einsum("sij,ijk->sk", _QUATERNION, R)
        return blocks, constant


def _quaternion_map() -> Array:
    """(10, 3, 3): the triangle of Q = q q^T, q wxyz, less a quarter of the identity, linear in the rotation."""
    out = np.zeros((4, 4, 3, 3))
    for i in range(3):
        out[0, 0, i, i] = 0.25
        for k in range(3):
            out[k + 1, k + 1, i, i] = 0.25 if k == i else -0.25
    for i, j, k in ((2, 1, 0), (0, 2, 1), (1, 0, 2)):
        out[0, k + 1, i, j], out[0, k + 1, j, i] = 0.25, -0.25
        out[i + 1, j + 1, i, j] = out[i + 1, j + 1, j, i] = 0.25
        out[j + 1, i + 1] = out[i + 1, j + 1]
    rows, columns, factor = triangle(4)
    packed: Array = out[rows, columns] * factor[:, None, None]
    return packed


_QUATERNION = _quaternion_map()
