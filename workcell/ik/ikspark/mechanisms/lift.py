"""The lifted variables of a mechanism, in which rotations, origins and slides of all links are affine.

A full node is a PSD block Q of weight one (`forms`); a planar one a point (c, s) of the unit disc; a known one nothing.
A slide by t in [0, 1] of its range needs t R. On a full node that is a second block Q1 with 0 <= Q1 <= Q: where Q has
rank 1, Q1 is t Q, and the set of all (Q, Q1) is the convex hull of those. It takes the place of the 8x8 block of
Prop. 3 (Remark 2: three 4x4). On a planar node it is a point (t, t c, t s) of two cones, on a known one t alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from workcell.ik.ikspark.mechanisms.blocks import Blocks
from workcell.ik.ikspark.mechanisms.forms import Form
from workcell.ik.ikspark.mechanisms.nodes import Nodes
from workcell.model.mechanism.mechanism import WORLD, Mechanism
from workcell.model.mechanism.placing import place
from workcell.pose import Array, matrix_to_quat


class Edge(Protocol):
    """Two links that are lifted together, so that the angle between them is affine too."""

    @property
    def size(self) -> int:
        """Number of its variables."""
        ...

    def lift(self, R: Array) -> Array:
        """Its variables (size,) at link rotations (links, 3, 3)."""
        ...


@dataclass(frozen=True, slots=True)
class Slide:
    """A slide whose length is free: where its variables are, and its range (metres)."""

    joint: int
    node: int
    start: int
    lower: float
    upper: float


class MechanismLift:
    """Variables and affine maps of a mechanism.

    Args:
        mechanism: the mechanism.
        nodes: its nodes.
        form: of the full ones.
        interval: (joints, 2) limits of hinges and slides, those of slides finite.
        edges: pairs of links that are lifted together, for joints that follow others.

    Attributes:
        size: N, number of variables.
        full: by full node, the first of its variables.
        planar: by planar node, the first of its two.
        slides: by joint.
        floating: by free joint, the first of the three of its origin.
        edges: by joint, the pair of its links and the first of its variables.
        rotations: (links, 3, 3, N + 1) link rotations over (x, 1).
        origins: (links, 3, N + 1) link origins.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        nodes: Nodes,
        form: Form,
        interval: Array,
        edges: Mapping[int, Edge] = MappingProxyType({}),
    ) -> None:
        self.mechanism, self.nodes, self.form = mechanism, nodes, form
        at = 0
        self.full: dict[int, int] = {}
        self.planar: dict[int, int] = {}
        self.floating: dict[int, int] = {}
        for n, node in enumerate(nodes.nodes):
            if node.kind == "full":
                self.full[n], at = at, at + form.size
        for n, node in enumerate(nodes.nodes):
            if node.kind == "planar":
                self.planar[n], at = at, at + 2
        self.slides: dict[int, Slide] = {}
        self._held: dict[int, float] = {}
        for k, joint in enumerate(mechanism.joints):
            if joint.kind == "free":
                self.floating[k], at = at, at + 3
            if joint.kind != "slide":
                continue
            lower, upper = interval[k]
            if lower == upper:
                self._held[k] = float(lower)
                continue
            n = int(nodes.of_link[k + 1])
            self.slides[k] = Slide(k, n, at, float(lower), float(upper))
            at += self.slide_size(k)
        self.edges: dict[int, tuple[Edge, int]] = {}
        for k, edge in edges.items():
            self.edges[k], at = (edge, at), at + edge.size
        self.size = at
        self._first = [int(np.argmax(nodes.of_link == n)) for n in range(len(nodes.nodes))]
        turned = np.stack([self._node_rotation(n) for n in range(len(nodes.nodes))])
        self.rotations = np.einsum("lijx,ljk->likx", turned[nodes.of_link], nodes.C)
        self.origins = self._origins()

    @property
    def blocks(self) -> Blocks:
        """The blocks that have to be of rank 1."""
        full, planar = (np.array([*each.values()], dtype=np.int64) for each in (self.full, self.planar))
        return Blocks(self.form, full, planar, self.size)

    def _constant(self, R: Array) -> Array:
        out = np.zeros((3, 3, self.size + 1))
        out[..., -1] = R
        return out

    def _node_rotation(self, n: int) -> Array:
        """(3, 3, N + 1) a node's rotation."""
        node = self.nodes.nodes[n]
        if node.kind == "known":
            return self._constant(node.P)
        out = np.zeros((3, 3, self.size + 1))
        if node.kind == "full":
            at = self.full[n]
            out[..., at : at + self.form.size] = self.form.rotation
            return out
        at = self.planar[n]
        out[..., at], out[..., at + 1] = _turning(node.P, node.S)
        out[..., -1] = np.outer(node.P[:, 2], node.S[2])
        return out

    def slide_size(self, joint: int) -> int:
        """Variables that a slide has."""
        kind = self.nodes.nodes[self.slides[joint].node].kind
        return {"full": self.form.size, "planar": 3, "known": 1}[kind]

    def fraction(self, joint: int) -> Array:
        """(N + 1,) t of a slide: how far it is out, as part of its range."""
        slide, row = self.slides[joint], np.zeros(self.size + 1)
        if self.nodes.nodes[slide.node].kind == "full":
            row[slide.start : slide.start + self.form.size] = self.form.weight
        else:
            row[slide.start] = 1.0
        return row

    def slide_row(self, joint: int) -> Array:
        """(N + 1,) value of a slide in metres."""
        if joint in self._held:
            row = np.zeros(self.size + 1)
            row[-1] = self._held[joint]
            return row
        slide = self.slides[joint]
        row = (slide.upper - slide.lower) * self.fraction(joint)
        row[-1] += slide.lower
        return row

    def _out(self, joint: int, link: int) -> Array:
        """(3, N + 1) how far a slide shifts its child: its value times its axis in the world."""
        axis = self.mechanism.joints[joint].axis
        along: Array = np.einsum("ijx,j->ix", self.rotations[link], axis)
        if joint in self._held:
            return self._held[joint] * along
        slide = self.slides[joint]
        node, local = self.nodes.nodes[slide.node], self.nodes.C[link] @ axis
        part = np.zeros((3, self.size + 1))
        if node.kind == "full":
            at = slice(slide.start, slide.start + self.form.size)
            part[:, at] = np.einsum("ijx,j->ix", self.form.rotation, local)
        elif node.kind == "planar":
            cosine, sine = _turning(node.P, node.S)
            part[:, slide.start] = np.outer(node.P[:, 2], node.S[2]) @ local
            part[:, slide.start + 1], part[:, slide.start + 2] = cosine @ local, sine @ local
        else:
            part[:, slide.start] = node.P @ local
        shifted: Array = slide.lower * along + (slide.upper - slide.lower) * part
        return shifted

    def _origins(self) -> Array:
        out = np.zeros((self.mechanism.link_count, 3, self.size + 1))
        for k, joint in enumerate(self.mechanism.joints):
            if joint.kind == "free":
                out[k + 1, :, self.floating[k] : self.floating[k] + 3] = np.eye(3)
                continue
            out[k + 1] = self.point(joint.parent, joint.T_parent_joint.position, out)
            if joint.kind == "slide":
                out[k + 1] += self._out(k, k + 1)
        return out

    def point(self, link: int, local: Array, origins: Array | None = None) -> Array:
        """(3, N + 1) world place of a point (3,) of a link."""
        origin = (self.origins if origins is None else origins)[link]
        placed: Array = origin + np.einsum("ijx,j->ix", self.rotations[link], local)
        return placed

    def points(self, link: NDArray[np.int64], local: Array) -> Array:
        """(m, 3, N + 1) the same of points (m, 3) of links (m,)."""
        placed: Array = self.origins[link] + np.einsum("mijx,mj->mix", self.rotations[link], local)
        return placed

    def rotation_rows(self, link: int) -> Array:
        """(9, N + 1) a link's rotation, row by row."""
        rows: Array = self.rotations[link].reshape(9, -1)
        return rows

    def origin_rows(self, link: int) -> Array:
        """(3, N + 1) a link's origin."""
        rows: Array = self.origins[link]
        return rows

    def lift(self, q: Array) -> Array:
        """The variables (N,) of a configuration (size,)."""
        placed = place(self.mechanism, q)
        x: Array = self.lift_many(q[None], placed.R[None], placed.p[None])[0]
        return x

    def lift_many(self, q: Array, R: Array, p: Array) -> Array:
        """The variables (m, N) of configurations (m, size), with links placed at (m, links, 3, 3) and (m, links, 3)."""
        x = np.zeros((len(q), self.size))
        turned = R[:, self._first] @ np.swapaxes(self.nodes.C[self._first], 1, 2)
        for n, at in self.full.items():
            x[:, at : at + self.form.size] = self.form.lift(turned[:, n])
        for n, at in self.planar.items():
            node = self.nodes.nodes[n]
            column = (turned[:, n] @ node.S[0]) @ node.P
            x[:, at : at + 2] = column[:, :2]
        for k, at in self.floating.items():
            x[:, at : at + 3] = p[:, k + 1]
        for k, slide in self.slides.items():
            value = q[:, self.mechanism.value_slices[k].start]
            t, at = ((value - slide.lower) / (slide.upper - slide.lower))[:, None], slide.start
            kind = self.nodes.nodes[slide.node].kind
            if kind == "full":
                first = self.full[slide.node]
                x[:, at : at + self.form.size] = t * x[:, first : first + self.form.size]
            else:
                x[:, at : at + 1] = t
            if kind == "planar":
                first = self.planar[slide.node]
                x[:, at + 1 : at + 3] = t * x[:, first : first + 2]
        for edge, at in self.edges.values():
            for row, placed in zip(x, R, strict=True):
                row[at : at + edge.size] = edge.lift(placed)
        return x

    def read(self, x: Array) -> Array:
        """The configuration (size,) nearest to variables (N,) whose blocks have rank 1, or nearly so."""
        mechanism = self.mechanism
        R = np.stack([_nearest(rows[..., :-1] @ x + rows[..., -1]) for rows in self.rotations])
        p = self.origins[..., :-1] @ x + self.origins[..., -1]
        q = np.array(mechanism.home)
        for k, (joint, at) in enumerate(zip(mechanism.joints, mechanism.value_slices, strict=True)):
            relative = (R[joint.parent] @ joint.T_parent_joint.rotation).T @ R[k + 1]
            if joint.kind == "slide":
                row = self.slide_row(k)
                q[at.start] = row[:-1] @ x + row[-1]
            elif joint.kind == "hinge":
                q[at.start] = _angle_about(joint.axis, relative)
            elif joint.kind == "ball":
                q[at] = matrix_to_quat(relative)
            else:
                q[at.start : at.start + 3], q[at.start + 3 : at.stop] = p[k + 1], matrix_to_quat(R[k + 1])
        return q


def _turning(P: Array, S: Array) -> tuple[Array, Array]:
    """What P Rz(phi) S has with cos phi and with sin phi, (3, 3) each."""
    cosine = np.outer(P[:, 0], S[0]) + np.outer(P[:, 1], S[1])
    sine = np.outer(P[:, 1], S[0]) - np.outer(P[:, 0], S[1])
    return cosine, sine


def _nearest(M: Array) -> Array:
    """The rotation nearest to a matrix (3, 3)."""
    U, _, V = np.linalg.svd(M)
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ V)) or 1.0])
    rotation: Array = U @ flip @ V
    return rotation


def _angle_about(axis: Array, R: Array) -> float:
    """The angle by which a rotation (3, 3) turns about an axis, in (-pi, pi]."""
    sine = 0.5 * float(axis @ np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]))
    cosine = 0.5 * (float(np.trace(R)) - float(axis @ R @ axis))
    return float(np.arctan2(sine, cosine))


def fixed_rotations(mechanism: Mechanism, rotations: Mapping[str, Array]) -> dict[int, Array]:
    """Rotations (3, 3) of links that those of frames, by name, fix; the world's is known anyway."""
    found: dict[int, Array] = {}
    for name, R in rotations.items():
        frame = mechanism.frame(name)
        if frame.link != WORLD:
            found.setdefault(frame.link, R @ frame.T_link_frame.rotation.T)
    return found
