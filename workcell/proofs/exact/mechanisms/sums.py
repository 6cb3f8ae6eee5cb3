"""The function F of 12.4: constant, N of every link, m of slides, o of floating bodies."""

from __future__ import annotations

from workcell.proofs.exact.mechanisms.derived import BLUR, HALF, MISSED, ROOT_OF_8, TWISTED, Derived
from workcell.proofs.exact.mechanisms.multipliers import Multipliers
from workcell.proofs.exact.mechanisms.question import Question
from workcell.proofs.exact.spans import PI, ZERO, Span, cos_sin, length, smaller, span, total
from workcell.proofs.exact.vectors import (
    Matrix,
    Vector,
    add,
    add_matrices,
    dot,
    frobenius,
    inner,
    multiply,
    outer,
    scale,
    transpose,
    turn,
)

ZEROS: Matrix = ((ZERO, ZERO, ZERO),) * 3
_NOTHING: Vector = (ZERO, ZERO, ZERO)
_THREE, _LINK_SLACK = span(3), span(1e-9)


def turned_by(angle: Span) -> Span:
    """tau: Frobenius norm by which a rotation misses a goal's that it reaches within an angle."""
    return ROOT_OF_8 * cos_sin(angle * HALF)[1] + BLUR


def negative(m: Matrix) -> Matrix:
    """All entries with their signs turned."""
    return tuple(tuple(-entry for entry in row) for row in m)  # type: ignore[return-value]


def times(factor: Span, m: Matrix) -> Matrix:
    """A multiple of a matrix."""
    first, second, third = (scale(factor, row) for row in m)
    return first, second, third


class Sum:
    """F but for the half-spaces of hinges.

    Attributes:
        N: of every link. m, o: of slides and floating bodies, by joint. touched: which of those count.
        terms: what is constant, charges included.
    """

    def __init__(
        self,
        question: Question,
        derived: Derived,
        m: Multipliers,
        covered: tuple[Span, ...],
        *,
        reached: bool,
    ) -> None:
        n = len(question.joints)
        self.question, self.derived = question, derived
        self.N = [ZEROS] * (n + 1)
        self.m, self.o = [_NOTHING] * n, [_NOTHING] * n
        self.touched = [False] * n
        self.terms: list[Span] = []
        self._joints(m)
        self._ties(m, covered)
        self._goals(m, covered, reached)
        self._regions(m, covered)
        self._links(m)

    def add(self, link: int, *matrices: Matrix) -> None:
        """Add to N of a link."""
        self.N[link] = add_matrices(self.N[link], *matrices)

    def place(self, m: Vector, link: int, local: Vector, until: int = 0) -> None:
        """Add `m . p` of a point of a link, down to the link `until`."""
        joints = self.question.joints
        counts = any(entry.low or entry.high for entry in m)
        while link != until:
            self.add(link, outer(m, local))
            k = link - 1
            kind = joints[k].kind
            if kind in ("free", "slide"):
                into = self.o if kind == "free" else self.m
                into[k] = add(into[k], m)
                self.touched[k] = self.touched[k] or counts
            if kind == "free":
                return
            local, link = joints[k].offset, joints[k].parent
        self.add(link, outer(m, local))

    def _joints(self, m: Multipliers) -> None:
        d = self.derived
        for k, joint in enumerate(self.question.joints):
            before, after = joint.parent, k + 1
            opening = cos_sin(d.half[k] * HALF)[1]
            if joint.kind == "hinge":
                self.add(before, outer(m.axes[k], d.axis_before[k]), outer(m.limits[k], d.u_before[k]))
                self.add(after, negative(outer(m.axes[k], joint.axis)), negative(outer(m.limits[k], d.e[k])))
                self.terms.append(length(m.limits[k]) * (opening + opening))
            if joint.kind in ("hinge", "ball"):
                self.add(before, multiply(m.turns[k], transpose(d.rest[k])))
                self.add(after, negative(m.turns[k]))
                self.terms.append(frobenius(m.turns[k]) * ROOT_OF_8 * opening)
            if joint.kind == "ball" and (theta := d.theta[k]) is not None:
                self.add(before, multiply(m.steps[k], transpose(d.relative[k])))
                self.add(after, negative(m.steps[k]))
                self.terms.append(frobenius(m.steps[k]) * ROOT_OF_8 * cos_sin(theta * HALF)[1])

    def _ties(self, m: Multipliers, covered: tuple[Span, ...]) -> None:
        for tie, w, weld in zip(self.question.ties, m.closures, m.welds, strict=True):
            one, two = tie.ends
            common = self._common(one.link, two.link)
            self.place(w, one.link, one.place, common)
            self.place(scale(span(-1), w), two.link, two.place, common)
            self.terms.append(MISSED * covered[2] * length(w))
            if tie.is_weld:
                self.add(one.link, multiply(weld, transpose(one.rotation)))
                self.add(two.link, negative(multiply(weld, transpose(two.rotation))))
                self.terms.append(TWISTED * covered[2] * frobenius(weld))

    def _common(self, one: int, two: int) -> int:
        """The last link that both hang on, or are."""
        ways = []
        for link in (one, two):
            way = [link]
            while way[-1]:
                way.append(self.question.joints[way[-1] - 1].parent)
            ways.append(way)
        return next(link for link in ways[0] if link in ways[1])

    def _goals(self, m: Multipliers, covered: tuple[Span, ...], reached: bool) -> None:
        tau = turned_by(covered[1])
        for g, goal in enumerate(self.question.goals):
            frame = goal.frame
            if goal.position is not None:
                self.place(m.positions[g], frame.link, frame.place)
                self.terms.append(-dot(m.positions[g], goal.position))
                if reached:
                    self.terms.append(covered[0] * length(m.positions[g]))
            if goal.rotation is not None:
                self.add(frame.link, multiply(m.rotations[g], transpose(frame.rotation)))
                self.terms.append(-inner(m.rotations[g], goal.rotation))
                if reached:
                    self.terms.append(tau * frobenius(m.rotations[g]))
            if goal.axis is not None and goal.direction is not None:
                along = turn(frame.rotation, goal.axis)
                weight = add(m.directions[g], scale(m.cones[g], goal.direction))
                self.add(frame.link, outer(weight, along))
                wide = smaller(span(goal.within) + covered[1], PI)
                self.terms.append(-dot(m.directions[g], goal.direction))
                self.terms.append((covered[1] + BLUR) * length(m.directions[g]))
                self.terms.append(m.cones[g] * (BLUR - cos_sin(wide)[0]))

    def _regions(self, m: Multipliers, covered: tuple[Span, ...]) -> None:
        first = 0
        for region in self.question.regions:
            point = region.frame.point(region.point)
            for normal, end in zip(region.normals, region.ends, strict=True):
                mu = m.regions[first]
                first += 1
                self.place(scale(-mu, normal), region.frame.link, point)
                self.terms.append(mu * end + covered[3] * abs(mu))

    def _links(self, m: Multipliers) -> None:
        if self.question.reference is None:
            return
        for link, nu in enumerate(m.links):
            most, held = ROOT_OF_8, self.question.link_rotation
            if held is not None:
                most = smaller(most, span(held) + _LINK_SLACK)
            if link and self.question.joints[link - 1].kind == "free":
                theta = self.derived.theta[link - 1]
                most = most if theta is None else smaller(most, ROOT_OF_8 * cos_sin(theta * HALF)[1])
            self.add(link, times(nu, self.question.reference.rotations[link]))
            self.terms.append(nu * (most * most * HALF - _THREE))

    def constant(self) -> Span:
        """What does not depend on the configuration."""
        return total(self.terms)
