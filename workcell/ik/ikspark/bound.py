"""The function of a `farkas/2` certificate and its upper bound, from the chain itself.

See docs/proofs.md, section 7. F adds up what ties every link's rotation to its neighbours' and to the target, times the
certificate's multipliers; it is zero or more at every configuration that reaches the target. Here it is written as
`const + sum <N_k, R_k>` and bounded link by link. Nothing is taken from the solver's relaxation: neither its rows nor
its idea of which axes are parallel. Where links count as planar though their axes are not quite parallel, their
departure is part of the bound.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workcell.ik.claims.chain import Chain, quaternion_forms, skew
from workcell.ik.claims.eigenvalue import largest_eigenvalue
from workcell.pose import Array, Pose

ROUNDING = 1e-9
"""Part of F (for multipliers of unit length) that is kept back for rounding.

All terms of F are products of a multiplier, lengths up to `LONGEST` and entries of rotations. A product of up to
`MOST_JOINTS` rotations errs by less than 16 u each, u = 2^-53, and sums have fewer than 400 terms: together below
16 * 64 u + 400 u < 2e-13 of the terms' sizes, which add up to less than (8 + LONGEST) sqrt(3 * MOST_JOINTS) < 810.
"""
_SQRT2 = math.sqrt(2.0) * (1.0 + 1e-15)


@dataclass(frozen=True, slots=True)
class Multipliers:
    """The numbers of a certificate.

    Attributes:
        planar: links taken as planar next to the base, and next to the target.
        axes: (n, 3) of the axes that neighbouring links share.
        position: (3,) of the closure.
        limits: (n, 3) of the joint limits' cones.
        chords: (2,) of the first and the last joint's half-spaces, zero or more.
        links: (n - 1,) of the bounds on link rotations, zero or more; None without such.
        places: (m, 3) of the moving spheres' places in cuboids, in the world; None without such.
    """

    planar: tuple[int, int]
    axes: Array
    position: Array
    limits: Array
    chords: Array
    links: Array | None = None
    places: Array | None = None

    def parts(self) -> list[Array]:
        """All that is multiplied."""
        parts = [self.axes, self.position, self.limits, self.chords, self.links, self.places]
        return [part for part in parts if part is not None]

    def scaled(self) -> Multipliers | None:
        """The same proof times a power of two, its largest number near one; None if all numbers are zero."""
        largest = max((float(np.abs(part).max(initial=0.0)) for part in self.parts()), default=0.0)
        if not largest > 0.0:
            return None
        shift = -math.frexp(largest)[1]

        def times(part: Array | None) -> Array | None:
            return None if part is None else np.ldexp(part, shift)

        return Multipliers(
            self.planar,
            np.ldexp(self.axes, shift),
            np.ldexp(self.position, shift),
            np.ldexp(self.limits, shift),
            np.ldexp(self.chords, shift),
            times(self.links),
            times(self.places),
        )

    def length(self) -> float:
        """Euclidean length of all that is multiplied."""
        return math.sqrt(math.fsum(float(np.sum(part * part)) for part in self.parts()))


class Sum:
    """F without its half-spaces: `constant + sum <N[k], R_k>`."""

    def __init__(self, chain: Chain, m: Multipliers) -> None:
        n = chain.joints
        self.N = np.zeros((n + 1, 3, 3))
        self.N[:-1] += m.axes[:, :, None] * chain.along[:, None, :]
        self.N[1:] -= m.axes[:, :, None] * chain.axis[:, None, :]
        self.N[:-1] += m.position[:, None] * chain.xyz[:, None, :]
        self.N[-1] += np.outer(m.position, chain.tool)
        self.N[:-1] += m.limits[:, :, None] * chain.turned[:, None, :]
        self.N[1:] -= m.limits[:, :, None] * chain.across[:, None, :]
        self.constant = -float(m.position @ chain.position)
        self.constant += float(np.linalg.norm(m.limits, axis=1) @ (2.0 * np.sin(0.5 * chain.half)))
        if m.chords[0]:
            self.constant -= float(m.chords[0] * math.cos(chain.half[0]))
        if m.chords[1]:
            self.constant -= float(m.chords[1] * math.cos(chain.half[-1]))

    def add_references(self, links: Array, reference: Array, most: float) -> None:
        """Bounds on how far links 1 ... n - 1 turn from `reference` (n - 1, 3, 3), Frobenius norm."""
        self.N[1:-1] += links[:, None, None] * reference
        self.constant -= float(links.sum()) * (3.0 - 0.5 * most * most)

    def add_places(
        self, chain: Chain, base: Pose, places: Array, link: NDArray[np.int64], centre: Array
    ) -> None:
        """`places` (m, 3) times the spheres' centres in the world."""
        turned = places @ base.rotation
        for row, k, c in zip(turned, link.tolist(), centre, strict=True):
            self.N[:k] += row[:, None] * chain.xyz[:k, None, :]
            self.N[k] += np.outer(row, c)
        self.constant += float(np.sum(places @ base.position))


def upper_bound(chain: Chain, m: Multipliers, total: Sum, position: float, rotation: float) -> float:
    """No less than F at any configuration that reaches the target within metres and radians."""
    n, N = chain.joints, total.N
    first, last = m.planar
    value = total.constant + float(np.trace(N[0])) + float(np.sum(N[n] * chain.last))
    value += sum(largest_eigenvalue(matrix) for matrix in quaternion_forms(N[first + 1 : n - last]))
    value += _from_base(chain, N, first, float(m.chords[0]))
    planar, moved = _from_target(chain, N, last, float(m.chords[1]))
    return value + planar + position * float(np.linalg.norm(m.position)) + rotation * _SQRT2 * moved


def _from_base(chain: Chain, N: Array, count: int, chord: float) -> float:
    d, C, off, value = chain.along[0], np.eye(3), 0.0, 0.0
    for k in range(1, count + 1):
        C = C @ chain.turn[k - 1]
        off += _departure(C @ chain.axis[k - 1], d) if k > 1 else 0.0
        weight = chord if k == 1 else 0.0
        value += _disc(N[k] @ C.T, d, weight, float(chain.middle[0]), 1.0) + off * float(np.linalg.norm(N[k]))
    return value


def _from_target(chain: Chain, N: Array, count: int, chord: float) -> tuple[float, float]:
    """What planar links next to the target add, and by how much F moves with the last link's rotation."""
    n, d, D, off, value = chain.joints, chain.axis[-1], np.eye(3), 0.0, 0.0
    fixed, moved = np.array(N[n]), 0.0
    along, across = np.outer(d, d), np.eye(3) - np.outer(d, d)
    for k in range(n - 1, n - 1 - count, -1):
        # what joint k + 1 turns about, in the last link
        off += _departure(D.T @ chain.axis[k], d) if k < n - 1 else 0.0
        D = chain.turn[k] @ D
        weight, M = chord if k == n - 1 else 0.0, N[k] @ D
        value += _disc(chain.last.T @ M, d, weight, float(chain.middle[-1]), -1.0)
        value += off * float(np.linalg.norm(N[k]))
        fixed += M @ along
        moved += math.hypot(float(np.linalg.norm(M @ across)), float(np.linalg.norm(M @ skew(d))))
    return value, moved + float(np.linalg.norm(fixed))


def _departure(axis: Array, d: Array) -> float:
    """Frobenius norm by which turning about `axis` differs from turning about d or -d, at most."""
    return 4.0 * min(float(np.linalg.norm(axis - d)), float(np.linalg.norm(axis + d)))


def _disc(M: Array, d: Array, chord: float, middle: float, sign: float) -> float:
    """Largest `<M, Rot(d, sign psi)> + chord cos(psi - middle)` over all psi."""
    fixed = float(d @ M @ d)
    c = float(np.trace(M)) - fixed + chord * math.cos(middle)
    s = sign * float(np.sum(M * skew(d))) + chord * math.sin(middle)
    return fixed + math.hypot(c, s)
