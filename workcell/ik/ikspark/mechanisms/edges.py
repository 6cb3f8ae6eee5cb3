"""Pairs of links whose angle is affine in the lifted variables: what joints that follow others need.

The cosine and sine of a hinge are products of its two links' rotations. Three lifts make them affine, all exact at rank
one. Next to a known link nothing is needed. Two planar links of one direction have the moment matrix (5x5) of
(c, s, c', s', 1). Else the quaternion of one link is `q' = q (x) h` with h = (cos, sin) of half the angle, linear in
h (x) q, whose outer product Y is a PSD block (8x8; 4x4 on a planar link, whose q is linear in its own half angle): the
blocks of both links and h h^T are linear in it, and it is such a product where it has rank 1 and its off-diagonal block
is symmetric.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from workcell.ik.ikspark.lift import frame_with_z
from workcell.ik.ikspark.mechanisms.lift import MechanismLift
from workcell.ik.ikspark.mechanisms.nodes import Node, Nodes
from workcell.ik.ikspark.mechanisms.rows import Rows
from workcell.ik.shared.conic import svec
from workcell.model.mechanism.mechanism import Mechanism
from workcell.pose import Array, axis_angle_to_matrix, matrix_to_quat

_TRIANGLE = [(i, j) for j in range(4) for i in range(j + 1)]
"""Places in a 4x4 block, in the order of its triangle."""


@dataclass(frozen=True, slots=True)
class PlanarPair:
    """Two planar nodes of one direction: the moments of (c, s, c', s', 1).

    Attributes:
        nodes: the two nodes' indices; joint: the hinge between their links; links: its parent and child.
    """

    nodes: tuple[int, int]
    joint: int
    links: tuple[int, int]
    planes: tuple[Node, Node]
    C: tuple[Array, Array]

    size = 15

    def lift(self, R: Array) -> Array:
        """The moments (15,) at link rotations (links, 3, 3)."""
        parts = []
        for link, C, node in zip(self.links, self.C, self.planes, strict=True):
            M = node.P.T @ R[link] @ C.T @ node.S.T
            parts += [M[0, 0], M[1, 0]]
        v = np.array([*parts, 1.0])
        return svec(np.outer(v, v))

    def rows(self, lift: MechanismLift, start: int) -> Iterator[Rows]:
        """What ties the moments to the discs."""
        one = _triangle_rows(lift.size, start, 5)
        yield Rows("edge", self.joint, "psd", one.triangle)
        tied = [_less(one.entry(4, 4), 1.0)]
        for first, node in zip((0, 2), self.nodes, strict=True):
            tied.append(_less(one.entry(first, first) + one.entry(first + 1, first + 1), 1.0))
            for k in range(2):
                row = one.entry(first + k, 4)
                row[lift.planar[node] + k] -= 1.0
                tied.append(row)
        yield Rows("edge ties", self.joint, "zero", np.stack(tied))

    def turn(self, lift: MechanismLift, start: int) -> Array:
        """(2, N + 1) cosine and sine of the joint's angle."""
        one = _triangle_rows(lift.size, start, 5)
        cosine = one.entry(0, 2) + one.entry(1, 3)
        sine = one.entry(0, 3) - one.entry(1, 2)
        joint = lift.mechanism.joints[self.joint]
        E = frame_with_z(joint.axis)
        # e1 of the parent's side seen from its plane, e1 of the child's from its own: angles differ by constants
        near = self.planes[0].S @ self.C[0] @ joint.T_parent_joint.rotation @ E
        far = self.planes[1].S @ self.C[1] @ E
        rows = []
        for k in range(2):
            u, w = near[:, k], far[:, 0]
            c, s = float(u[:2] @ w[:2]), float(u[1] * w[0] - u[0] * w[1])
            row = c * cosine + s * sine
            row[-1] += u[2] * w[2]
            rows.append(row)
        return np.stack(rows)


@dataclass(frozen=True, slots=True)
class HalfAngle:
    """A link's quaternion and the half angle of the hinge to another one, multiplied.

    Attributes:
        joint: the hinge; near, far: the link whose quaternion is lifted, and the other, whose block is full.
        basis: (4, d) the near link's quaternion is `basis a`; d = 4, or 2 where its node is planar.
        turned: (2, 4, 4) the far link's quaternion is `sum h_k turned_k q_near`.
    """

    joint: int
    near: int
    far: int
    basis: Array
    turned: Array
    nodes: tuple[int, int]
    C: tuple[Array, Array]
    plane: Node | None

    @property
    def order(self) -> int:
        """Of the PSD block."""
        return 2 * int(self.basis.shape[1])

    @property
    def size(self) -> int:
        """Number of its variables."""
        return self.order * (self.order + 1) // 2

    def lift(self, R: Array) -> Array:
        """Its variables at link rotations (links, 3, 3)."""
        a = self.basis.T @ matrix_to_quat(R[self.near])
        a = a / np.linalg.norm(a)
        far = matrix_to_quat(R[self.far])
        h = np.array([far @ turned @ self.basis @ a for turned in self.turned])
        return svec(np.outer(np.kron(h, a), np.kron(h, a)))

    def rows(self, lift: MechanismLift, start: int) -> Iterator[Rows]:
        """What ties the block to the blocks of its links."""
        d, one = self.basis.shape[1], _triangle_rows(lift.size, start, self.order)
        yield Rows("edge", self.joint, "psd", one.triangle)
        tied = [one.entry(i, d + j) - one.entry(j, d + i) for i in range(d) for j in range(i)]
        inner = [[one.entry(i, j) + one.entry(d + i, d + j) for j in range(d)] for i in range(d)]
        near = _quadratic(self.basis, np.array(inner))
        wide = np.hstack([turned @ self.basis for turned in self.turned])
        whole = np.array([[one.entry(i, j) for j in range(2 * d)] for i in range(2 * d)])
        far = _quadratic(wide, whole)
        if self.plane is None:
            tied += list(_same_block(lift, self.nodes[0], self.C[0], near))
        else:
            tied += list(_same_disc(lift, self.nodes[0], self.C[0], self.plane, near))
        tied += list(_same_block(lift, self.nodes[1], self.C[1], far))
        yield Rows("edge ties", self.joint, "zero", np.stack(tied))

    def turn(self, lift: MechanismLift, start: int) -> Array:
        """(2, N + 1) cosine and sine of the joint's angle."""
        d, one = self.basis.shape[1], _triangle_rows(lift.size, start, self.order)
        first = sum((one.entry(i, i) for i in range(d)), np.zeros(lift.size + 1))
        last = sum((one.entry(d + i, d + i) for i in range(d)), np.zeros(lift.size + 1))
        cross = sum((one.entry(i, d + i) for i in range(d)), np.zeros(lift.size + 1))
        return np.stack([first - last, 2.0 * cross])


@dataclass(frozen=True, slots=True)
class Direct:
    """A hinge next to a known link: nothing has to be lifted."""

    joint: int

    size = 0

    def lift(self, R: Array) -> Array:
        """Nothing."""
        return np.zeros(0)

    def rows(self, lift: MechanismLift, start: int) -> Iterator[Rows]:
        """None."""
        yield from ()

    def turn(self, lift: MechanismLift, start: int) -> Array:
        """(2, N + 1) cosine and sine of the joint's angle."""
        joint = lift.mechanism.joints[self.joint]
        E = frame_with_z(joint.axis)
        parent, child = lift.rotations[joint.parent], lift.rotations[self.joint + 1]
        w = np.einsum("ijx,j->ix", child, E[:, 0])
        rows = []
        for k in range(2):
            u = np.einsum("ijx,j->ix", parent, joint.T_parent_joint.rotation @ E[:, k])
            known, other = (u, w) if not np.any(u[:, :-1]) else (w, u)
            rows.append(known[:, -1] @ other)
        return np.stack(rows)


AnyEdge = PlanarPair | HalfAngle | Direct


def edge_of(mechanism: Mechanism, nodes: Nodes, joint: int) -> AnyEdge | None:
    """What makes the angle of a hinge affine; None: its links turn together, it has none."""
    parent, child = mechanism.joints[joint].parent, joint + 1
    pair = int(nodes.of_link[parent]), int(nodes.of_link[child])
    if pair[0] == pair[1]:
        return None
    one, two = (nodes.nodes[n] for n in pair)
    if "known" in (one.kind, two.kind):
        return Direct(joint)
    C = nodes.C[parent], nodes.C[child]
    if one.kind == two.kind == "planar" and one.side == two.side and np.allclose(one.P, two.P):
        return PlanarPair(pair, joint, (parent, child), (one, two), C)
    if two.kind == "full":
        return _half_angle(mechanism, joint, (parent, child), pair, C, one)
    if one.kind == "full":
        return _half_angle(mechanism, joint, (child, parent), pair[::-1], C[::-1], two)
    return None


def _half_angle(
    mechanism: Mechanism,
    joint: int,
    links: tuple[int, int],
    pair: tuple[int, int],
    C: tuple[Array, Array],
    near: Node,
) -> HalfAngle:
    one = mechanism.joints[joint]
    frame = matrix_to_quat(one.T_parent_joint.rotation)
    axis = np.concatenate([[0.0], one.axis])
    if links[0] == one.parent:
        turned = np.stack([_right(frame), _right(axis) @ _right(frame)])
    else:  # q_parent = q_child (x) conj(h) (x) conj(frame)
        back = _right(frame * np.array([1.0, -1.0, -1.0, -1.0]))
        turned = np.stack([back, back @ _right(-axis)])
    basis, plane = np.eye(4), None
    if near.kind == "planar":
        # P Rz(phi) S C: the quaternions at phi = 0 and at half a turn span all of them
        ends = [
            matrix_to_quat(near.P @ axis_angle_to_matrix(np.array([0.0, 0.0, 1.0]), angle) @ near.S @ C[0])
            for angle in (0.0, np.pi)
        ]
        basis, plane = np.linalg.qr(np.stack(ends, axis=1))[0], near
    return HalfAngle(joint, links[0], links[1], basis, turned, pair, C, plane)


@dataclass(frozen=True, slots=True)
class _Triangle:
    """Rows that pick entries of a symmetric block out of the variables."""

    triangle: Array
    order: int

    def entry(self, i: int, j: int) -> Array:
        pick = np.zeros((self.order, self.order))
        pick[i, j] += 0.5
        pick[j, i] += 0.5
        row: Array = svec(pick) @ self.triangle
        return row


def _triangle_rows(N: int, start: int, order: int) -> _Triangle:
    size = order * (order + 1) // 2
    rows = np.zeros((size, N + 1))
    rows[np.arange(size), start + np.arange(size)] = 1.0
    return _Triangle(rows, order)


def _quadratic(L: Array, M: Array) -> Array:
    """(4, 4, N + 1) `L M L^T` for a matrix M (d, d, N + 1) of rows."""
    product: Array = np.einsum("ia,abx,jb->ijx", L, M, L)
    return product


def _same_block(lift: MechanismLift, node: int, C: Array, Q_link: Array) -> Iterator[Array]:
    """Rows that say that a link's quaternion block (4, 4, N + 1) is that of its node."""
    at, turn = lift.full[node], _right(matrix_to_quat(C))
    # q_link = q_node (x) c, so that the node's block is turned^T Q turned
    for k, (i, j) in enumerate(_TRIANGLE):
        row = np.einsum("a,abx,b->x", turn[:, i], Q_link, turn[:, j]) * (1.0 if i == j else np.sqrt(2.0))
        row[at + k] -= 1.0
        yield row


def _same_disc(lift: MechanismLift, node: int, C: Array, plane: Node, Q_link: Array) -> Iterator[Array]:
    """Rows that say that a planar link's quaternion block belongs to its (c, s), and has trace 1."""
    from workcell.ik.ikspark.lift import rotation_map

    packed = np.stack([Q_link[i, j] * (1.0 if i == j else np.sqrt(2.0)) for i, j in _TRIANGLE])
    R = np.einsum("ijk,kx->ijx", rotation_map(), packed)
    M = np.einsum("ai,abx,bj->ijx", plane.P, np.einsum("abx,bc->acx", R, C.T), plane.S.T)
    for k in range(2):
        row = np.array(M[k, 0])
        row[lift.planar[node] + k] -= 1.0
        yield row
    yield _less(sum((Q_link[i, i] for i in range(4)), np.zeros(lift.size + 1)), 1.0)


def _right(quat: Array) -> Array:
    """(4, 4) q -> q (x) quat."""
    w, x, y, z = quat
    return np.array([[w, -x, -y, -z], [x, w, z, -y], [y, -z, w, x], [z, y, -x, w]])


def _less(row: Array, constant: float) -> Array:
    row = np.array(row)
    row[-1] -= constant
    return row
