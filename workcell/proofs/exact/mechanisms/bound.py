"""What F is at most, node by node (12.6)."""

from __future__ import annotations

from itertools import product

from workcell.proofs.exact.convex.eigenvalues import largest_eigenvalue
from workcell.proofs.exact.convex.farkas import quaternion_form
from workcell.proofs.exact.mechanisms.derived import HALF, Derived
from workcell.proofs.exact.mechanisms.hanging import WORLD, Hanging, Known
from workcell.proofs.exact.mechanisms.multipliers import Multipliers
from workcell.proofs.exact.mechanisms.question import Question
from workcell.proofs.exact.mechanisms.sums import ZEROS, Sum, negative, times, turned_by
from workcell.proofs.exact.reading import RefusedError
from workcell.proofs.exact.spans import ZERO, Span, cos_sin, larger, length, smaller, total
from workcell.proofs.exact.vectors import (
    IDENTITY,
    Matrix,
    Vector,
    add_matrices,
    cross_matrix,
    dot,
    frobenius,
    inner,
    multiply,
    outer,
    scale,
    transpose,
    turn,
)

CORNERS = 6


def upper_bound(
    question: Question, derived: Derived, m: Multipliers, sums: Sum, hanging: Hanging, rotation: Span
) -> Span:
    """U(F).

    Raises:
        RefusedError: by rule 12.5 or 12.6, or nothing bounds F.
    """
    tau = turned_by(rotation)
    terms = _half_spaces(question, derived, m, sums, hanging, tau)
    terms += [sums.constant(), *_floating(question, derived, sums)]
    roots: dict[int, tuple[Matrix, Span]] = {}
    for node in sorted(set(derived.node)):
        one, known = Node(question, derived, sums, node), hanging.of(node)
        if known is None:
            terms.append(one.free())
            continue
        chord = (known.turned, m.chords[known.turned]) if known.turned >= 0 else None
        terms.append(one.known(known, chord))
        N, eta = one.middle()
        terms.append(known.delta * (frobenius(N) + eta))
        if known.root != WORLD:
            steady, swinging = roots.get(known.root, (ZEROS, ZERO))
            Y, y = _parts(multiply(N, transpose(known.D)), known.axis)
            roots[known.root] = add_matrices(steady, Y), swinging + y + eta
    terms += [tau * (frobenius(steady) + swinging) for steady, swinging in roots.values()]
    return total(terms)


def _half_spaces(
    question: Question, derived: Derived, m: Multipliers, sums: Sum, hanging: Hanging, tau: Span
) -> list[Span]:
    terms = []
    for k, value in enumerate(m.chords):
        if not value.surely_positive:
            continue
        parent, child = question.joints[k].parent, k + 1
        ends = [hanging.of(derived.node[link]) for link in (parent, child)]
        if any(known is not None and known.turned == k for known in ends):
            continue
        if (rigid := hanging.rigid(parent)) is not None:
            known, R = rigid
            sums.add(child, outer(scale(value, turn(R, derived.u_before[k])), derived.e[k]))
        elif (rigid := hanging.rigid(child)) is not None:
            known, R = rigid
            sums.add(parent, outer(scale(value, turn(R, derived.e[k])), derived.u_before[k]))
        else:
            raise RefusedError(f"the half-space of joint {k} is next to nothing that is known")
        stray = known.delta + (tau if known.root != WORLD else ZERO)
        terms.append(value * (stray - cos_sin(derived.half[k])[0]))
    return terms


def _floating(question: Question, derived: Derived, sums: Sum) -> list[Span]:
    terms = []
    for k, joint in enumerate(question.joints):
        if joint.kind != "free" or not sums.touched[k]:
            continue
        reach, room = derived.reach[k + 1], derived.room[k]
        if reach is None:
            raise RefusedError(f"nothing bounds where link {k + 1} is")
        most = reach * length(sums.o[k])
        if room is not None and question.reference is not None:
            near = dot(sums.o[k], question.reference.origins[k + 1])
            most = smaller(most, near + total(abs(o) * r for o, r in zip(sums.o[k], room, strict=True)))
        terms.append(most)
    return terms


def _parts(M: Matrix, axis: Vector | None) -> tuple[Matrix, Span]:
    """Y and y of a node, without eta."""
    if axis is None:
        return M, ZERO
    along = outer(axis, axis)
    across = add_matrices(IDENTITY, negative(along))
    swing = length((frobenius(multiply(M, across)), frobenius(multiply(M, cross_matrix(axis)))))
    return multiply(M, along), swing


class Node:
    """What F has of a node: N, and of its touched slides m, M and ends."""

    def __init__(self, question: Question, derived: Derived, sums: Sum, node: int) -> None:
        self.derived, self.N = derived, ZEROS
        self.slides: list[tuple[Vector, Vector, Span, Span]] = []
        for link, of in enumerate(derived.node):
            if of != node:
                continue
            self.N = add_matrices(self.N, multiply(sums.N[link], transpose(derived.inner[link])))
            if link and question.joints[link - 1].kind == "slide" and sums.touched[link - 1]:
                lower, upper = derived.ends[link - 1]
                if lower is None or upper is None:
                    raise RefusedError(f"the slide {link - 1} has no ends")
                axis = turn(derived.inner[link], question.joints[link - 1].axis)
                self.slides.append((sums.m[link - 1], axis, lower, upper))

    def _at(self, values: list[Span]) -> Matrix:
        parts = [
            times(value, outer(m, axis)) for value, (m, axis, _, _) in zip(values, self.slides, strict=True)
        ]
        return add_matrices(self.N, *parts)

    def middle(self) -> tuple[Matrix, Span]:
        """N' and eta."""
        return self._at([_middle(slide) for slide in self.slides]), total(_spread(s) for s in self.slides)

    def corners(self) -> tuple[list[Matrix], Span]:
        """N at all combinations of the first slides' ends, and what the others add."""
        rest = self.slides[CORNERS:]
        middles = [_middle(slide) for slide in rest]
        ends = product(*((lower, upper) for _, _, lower, upper in self.slides[:CORNERS]))
        return [self._at([*chosen, *middles]) for chosen in ends], total(_spread(slide) for slide in rest)

    def free(self) -> Span:
        """The largest eigenvalue."""
        corners, more = self.corners()
        found = [largest_eigenvalue(quaternion_form(N)) for N in corners]
        return _largest(found) + more

    def known(self, known: Known, chord: tuple[int, Span] | None) -> Span:
        """With an axis or without one."""
        if known.axis is None:
            R = multiply(known.rotation, known.D)
            value = inner(self.N, R)
            for m, axis, lower, upper in self.slides:
                way = dot(m, turn(R, axis))
                value += larger(lower * way, upper * way)
            return value
        corners, more = self.corners()
        found = [self._turned(known, known.axis, N, chord) for N in corners]
        return _largest(found) + more

    def _turned(self, known: Known, d: Vector, N: Matrix, chord: tuple[int, Span] | None) -> Span:
        M = multiply(transpose(known.rotation), N, transpose(known.D))
        along = dot(d, turn(M, d))
        cosine = total(M[i][i] for i in range(3)) - along
        sine = known.sigma * inner(M, cross_matrix(d))
        less = ZERO
        if chord is not None:
            k, value = chord
            c, s = cos_sin(self.derived.middle[k])
            cosine, sine = cosine + value * c, sine + value * s
            less = value * cos_sin(self.derived.half[k])[0]
        return along + length((cosine, sine)) - less


def _middle(slide: tuple[Vector, Vector, Span, Span]) -> Span:
    return (slide[2] + slide[3]) * HALF


def _spread(slide: tuple[Vector, Vector, Span, Span]) -> Span:
    return abs(slide[3] - slide[2]) * HALF * length(slide[0])


def _largest(values: list[Span]) -> Span:
    found = values[0]
    for value in values[1:]:
        found = larger(found, value)
    return found
