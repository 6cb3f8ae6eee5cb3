"""The function of a `cidgik/2` certificate and its upper bound, from the chain itself.

See docs/proofs.md, section 8. All vectors of the chain are combinations of the columns of X = [R_1 ... R_m I], m the
last link whose rotation is not given. F is a sum of inner products of such vectors, `constant + <H, X^T X>`, zero or
more at every configuration that solves the problem. Of X^T X all entries are known but those between the frames of
different links, which are cosines.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from workcell.ik.claims.chain import Chain, quaternion_forms, rotation_sums
from workcell.ik.problem import IKProblem
from workcell.pose import Array

ROUNDING = 1e-9
"""Part of F (for multipliers of unit size) that is kept back for rounding: terms are products of a multiplier and of at
most two lengths below `LONGEST`; their errors, below 1e-14 of the terms, add up to less than a tenth of it."""


@dataclass(frozen=True, slots=True)
class Multipliers:
    """The numbers of a certificate; u columns, n joints, m links that are not given.

    Attributes:
        facts: (facts, u) vectors by which what is zero is multiplied: closure, axes, and the axis of the target.
        hands: (n, 2) of the two frames about each joint.
        turned: (2, 3) of the frames whose axis is known, next to the base and next to the target.
        limits: (n,) of the joint limits, zero or more.
        keys: (r, 2) spheres and obstacles, and `rows` (r,) their multipliers, zero or more.
        pairs: (p, 2) spheres of the robot, and `own` (p,) their multipliers, zero or more.
        S: (u, ...) factor of a positive semidefinite matrix.
        frames: (m, 4, 4) factors of such matrices.
    """

    facts: Array
    hands: Array
    turned: Array
    limits: Array
    keys: NDArray[np.int64]
    rows: Array
    pairs: NDArray[np.int64]
    own: Array
    S: Array
    frames: Array

    def size(self) -> float:
        """What the margin is counted in: factors count squared, as they enter."""
        linear = (self.facts, self.hands, self.turned, self.limits, self.rows, self.own)
        size = math.fsum(float(np.linalg.norm(part)) for part in linear)
        return size + math.fsum([float(np.sum(self.S**2)), float(np.sum(self.frames**2))])

    def scaled(self) -> Multipliers | None:
        """The same proof times a power of four, its largest number near one; None if all numbers are zero."""
        largest = max(
            float(np.abs(getattr(self, f.name)).max(initial=0.0)) ** (2 if f.name in ("S", "frames") else 1)
            for f in fields(self)
            if f.name not in ("keys", "pairs")
        )
        if not 0.0 < largest < math.inf:
            return None
        half = -(math.frexp(largest)[1] // 2)
        names = ("facts", "hands", "turned", "limits", "rows", "own")
        changed = {name: np.ldexp(getattr(self, name), 2 * half) for name in names}
        return replace(self, **changed, S=np.ldexp(self.S, half), frames=np.ldexp(self.frames, half))


class Columns:
    """Vectors of a problem's chain as coefficients over the columns of X.

    Attributes:
        chain: of the problem.
        posed: whether the target gives the last link's rotation.
        links: m, number of links that are not given.
        width: u.
        of_link: (n + 1, 3, u): `v @ of_link[k]` is a vector v that link k carries.
    """

    def __init__(self, problem: IKProblem) -> None:
        self.chain, self.posed = Chain.of(problem), problem.goal == "pose"
        n = self.chain.joints
        self.links = n - 1 if self.posed else n
        self.width = 3 * self.links + 3
        self.of_link = np.zeros((n + 1, 3, self.width))
        self.of_link[0, :, -3:] = np.eye(3)
        for k in range(1, self.links + 1):
            self.of_link[k, :, 3 * k - 3 : 3 * k] = np.eye(3)
        if self.posed:
            self.of_link[n, :, -3:] = self.chain.last.T

    def origin(self, link: int) -> Array:
        """(u,) the origin of a link, from the base's."""
        total: Array = np.einsum("ka,kau->u", self.chain.xyz[:link], self.of_link[:link])
        return total

    def point(self, link: int, local: Array) -> Array:
        """(u,) a point of a link, from the base's origin."""
        placed: Array = self.origin(link) + local @ self.of_link[link]
        return placed

    def facts(self, problem: IKProblem) -> Array:
        """(facts, u) vectors that are zero: closure, the axes of the joints, the axis of the target where it counts."""
        chain, n = self.chain, self.chain.joints
        closure = self.point(n, chain.tool) - chain.position @ self.of_link[0]
        axes = np.einsum("ka,kau->ku", chain.along, self.of_link[:-1])
        axes -= np.einsum("ka,kau->ku", chain.axis, self.of_link[1:])
        rows = [closure[None], axes]
        if problem.goal == "axis":
            pointing = problem.robot.tool().T_link_tool.rotation[:, 2] @ self.of_link[n]
            rows.append((pointing - problem.T_base_tool.rotation[:, 2] @ self.of_link[0])[None])
        return np.concatenate(rows)

    def sides(self) -> tuple[Array, Array, Array, Array]:
        """(n, u) each: e and f about every joint in the link before, and in the link it moves."""
        chain = self.chain
        side = np.cross(chain.axis, chain.across)
        before = (np.einsum("kab,kb->ka", chain.turn, v) for v in (chain.across, side))
        e, f = (np.einsum("ka,kau->ku", v, self.of_link[:-1]) for v in before)
        c, d = (np.einsum("ka,kau->ku", v, self.of_link[1:]) for v in (chain.across, side))
        return e, f, c, d

    def lengths(self, vectors: Array) -> Array:
        """(...) upper bounds of vectors (..., u) at any configuration: link by link."""
        blocks = vectors.reshape(*vectors.shape[:-1], -1, 3)
        total: Array = np.linalg.norm(blocks, axis=-1).sum(axis=-1)
        return total

    def between(self) -> NDArray[np.bool_]:
        """(u, u) entries of X^T X between different blocks."""
        block = np.arange(self.width) // 3
        different: NDArray[np.bool_] = block[:, None] != block
        return different


def turned_terms(columns: Columns, tau: Array) -> tuple[Array, Array]:
    """Vectors (t, u) whose inner products add up to what `turned` multiplies (2, 3)."""
    chain, n, base = columns.chain, columns.chain.joints, columns.of_link[0]
    e, f, c, d = columns.sides()
    left, right = [], []
    if columns.links >= 1:
        left += [tau[0] @ base, -np.cross(tau[0], chain.along[0]) @ base]
        right += [d[0], c[0]]
    if columns.posed and n >= 2:
        left += [tau[1] @ base, -np.cross(tau[1], chain.last @ chain.axis[-1]) @ base]
        right += [f[-1], e[-1]]
    return np.array(left).reshape(-1, columns.width), np.array(right).reshape(-1, columns.width)


class Sum:
    """F as `constant + <H, X^T X>`, and by how much it may be less than zero because of what is allowed.

    Args:
        problem: what the proof is about.
        m: its multipliers.
        covered: (3,) metres, radians and metres of penetration.
    """

    def __init__(self, problem: IKProblem, m: Multipliers, covered: Array) -> None:
        self.columns = columns = Columns(problem)
        self._problem, self._covered = problem, covered
        self._H = np.zeros((columns.width, columns.width))
        self.constant, self.charge = 0.0, 0.0
        self._add_facts(m.facts)
        self._add_joints(m.hands, m.limits)
        left, right = turned_terms(columns, m.turned)
        self._H += left.T @ right
        if columns.posed:
            self.charge += float(covered[1]) * float(np.linalg.norm(m.turned[1]))
        self._add_spheres(m)
        self._H += m.S @ m.S.T
        self._add_frames(m.frames)

    @property
    def H(self) -> Array:
        """(u, u) symmetric."""
        symmetric: Array = 0.5 * (self._H + self._H.T)
        return symmetric

    def value(self) -> float:
        """No less than F at any configuration, whatever it reaches; what is allowed not counted."""
        H, between = self.H, self.columns.between()
        return self.constant + float(np.trace(H)) + float(np.abs(H[between]).sum())

    def _add_facts(self, multipliers: Array) -> None:
        columns, (metres, radians) = self.columns, self._covered[:2]
        self._H += columns.facts(self._problem).T @ multipliers
        lengths = columns.lengths(multipliers)
        off = np.zeros(len(lengths))
        off[0] = metres
        if columns.posed:
            off[0] += radians * np.linalg.norm(columns.chain.tool)
            off[-1] = radians
        elif self._problem.goal == "axis":
            off[-1] = radians
        self.charge += float(off @ lengths)

    def _add_joints(self, hands: Array, limits: Array) -> None:
        columns, chain = self.columns, self.columns.chain
        e, f, c, d = columns.sides()
        beta, gamma = hands.T
        self._H += (beta[:, None] * e + gamma[:, None] * f).T @ c
        self._H += (gamma[:, None] * e - beta[:, None] * f).T @ d
        turned = np.einsum("ka,kau->ku", chain.turned, columns.of_link[:-1])
        self._H += (limits[:, None] * turned).T @ c
        self.constant -= float(limits @ np.cos(chain.half))
        if columns.posed:
            moved = 2.0 * float(np.abs(hands[-1]).sum()) + float(limits[-1])
            self.charge += float(self._covered[1]) * moved

    def _add_spheres(self, m: Multipliers) -> None:
        problem, cover = self._problem, self._problem.cover
        if cover is None:
            return
        spare = problem.tolerances.safety_margin - float(self._covered[2])
        for (s, o), nu in zip(m.keys.tolist(), m.rows.tolist(), strict=True):
            piece = problem.obstacles[o]
            centre = problem.robot.T_world_base.inverse().apply(piece.pose.position)
            y, off = self._place(s)
            least = float(cover.radius[s]) + float(piece.size[0]) + spare
            self._keep_apart(y - centre @ self.columns.of_link[0], off, least, nu)
        for (s, o), nu in zip(m.pairs.tolist(), m.own.tolist(), strict=True):
            (y, off), (other, more) = self._place(s), self._place(o)
            self._keep_apart(y - other, off + more, float(cover.radius[s] + cover.radius[o]) + spare, nu)

    def _place(self, sphere: int) -> tuple[Array, float]:
        """A sphere's centre (u,), and by how much it may lie elsewhere because the last link may be turned."""
        cover = self._problem.cover
        assert cover is not None
        link, centre = int(cover.link[sphere]), cover.centre[sphere]
        given = self.columns.posed and link == self.columns.chain.joints
        off = float(self._covered[1]) * float(np.linalg.norm(centre)) if given else 0.0
        return self.columns.point(link, centre), off

    def _keep_apart(self, y: Array, off: float, least: float, nu: float) -> None:
        self._H += nu * np.outer(y, y)
        self.constant -= nu * max(least, 0.0) ** 2
        self.charge += nu * off * (2.0 * float(self.columns.lengths(y)) + off)

    def _add_frames(self, frames: Array) -> None:
        """Products of positive semidefinite matrices with those of quaternions, Q(R) = K(R) / 4 + I / 4."""
        P = frames @ np.swapaxes(frames, 1, 2)
        self.constant += 0.25 * float(np.trace(P, axis1=1, axis2=2).sum())
        for k, N in enumerate(rotation_sums(P), start=1):
            self._H += 0.25 * self.columns.of_link[0].T @ N @ self.columns.of_link[k]


def margin(problem: IKProblem, m: Multipliers, covered: Array) -> float:
    """By how much the multipliers prove that nothing solves a problem; they prove nothing unless it is positive."""
    scaled = m.scaled()
    if scaled is None:
        return -math.inf
    total = Sum(problem, scaled, covered)
    return -(total.value() + total.charge) / scaled.size() - ROUNDING


def quaternion_of(rotation: Array) -> Array:
    """(4,) unit quaternion wxyz of a rotation (3, 3)."""
    chosen: Array = np.linalg.eigh(quaternion_forms(rotation[None])[0])[1][:, -1]
    return chosen
