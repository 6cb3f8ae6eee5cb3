"""`farkas/2` (section 7): every link's rotation by itself, tied to its neighbours by multipliers."""

from __future__ import annotations

from workcell.proofs.exact.certificates import Certificate, Claim, index, poses_missed, tolerances
from workcell.proofs.exact.convex.eigenvalues import largest_eigenvalue
from workcell.proofs.exact.convex.joints import Range, last_rotation, ranges
from workcell.proofs.exact.problems import Problem
from workcell.proofs.exact.reading import RefusedError
from workcell.proofs.exact.spans import UNIT, ZERO, Span, length, root, smaller, span, total
from workcell.proofs.exact.vectors import (
    IDENTITY,
    Matrix,
    Vector,
    add,
    add_matrices,
    cross_matrix,
    dot,
    frobenius,
    inner,
    multiply,
    outer,
    subtract,
    transpose,
    turn,
    vector,
)

_ZEROS: Matrix = ((ZERO, ZERO, ZERO),) * 3
_FOUR = span(4)
_ROOT_OF_TWO = root(span(2))


def farkas(problem: Problem, certificate: Certificate) -> Claim:
    """An upper bound below zero of a function that is not below zero at any candidate.

    Raises:
        RefusedError: an array breaks a rule.
    """
    n = len(problem.arm.joints)
    given, planar, axes, position, limits, chords = certificate.arrays(
        tolerances=(2,), planar=(2,), axes=(n, 3), position=(3,), limits=(n, 3), chords=(2,)
    )
    blur, turned = tolerances(given.values)
    base, end = (index(value, n, "how many links are planar") for value in planar.values)
    if base + end > n - 1:
        raise RefusedError(f"{base + end} of {n - 1} links are planar")
    first, last = chords.values
    if first < 0 or last < 0 or (first > 0 and base == 0) or (last > 0 and end == 0):
        raise RefusedError("a chord has no planar link, or a multiplier below zero")
    numbers = [span(v) for array in (axes, position, limits, chords) for v in array.values]
    size = length(numbers)
    if not size.surely_positive:
        raise RefusedError("all multipliers are zero")
    sums = _Sums(
        problem,
        [vector(row) for row in axes.rows()],
        vector(position.values),
        [vector(row) for row in limits.rows()],
        (span(first), span(last)),
    )
    margin = -(sums.bound(base, end) + sums.blur(end, span(blur), span(turned))) / size - span(1e-9)
    return Claim("kinematics", f"{poses_missed(blur, turned)}, obstacles aside.", margin)


class _Sums:
    """The function F of rule 7.3 and its bounds."""

    def __init__(
        self,
        problem: Problem,
        alpha: list[Vector],
        pi: Vector,
        v: list[Vector],
        chords: tuple[Span, Span],
    ) -> None:
        self.problem, self.pi, self.chords = problem, pi, chords
        self.joints = problem.arm.joints
        self.ranges: list[Range] = ranges(problem)
        self.last = last_rotation(problem)
        n = len(self.joints)
        self.coefficients = []  # N_0 ... N_n
        for k in range(n + 1):
            parts = [_ZEROS]
            if k < n:
                following = self.ranges[k]
                parts.append(outer(alpha[k], following.axis_before))
                parts.append(outer(pi, self.joints[k].offset))
                parts.append(outer(v[k], following.u_before))
            else:
                parts.append(outer(pi, problem.arm.tool))
            if k > 0:
                parts.append(_negative(outer(alpha[k - 1], self.joints[k - 1].axis)))
                parts.append(_negative(outer(v[k - 1], self.ranges[k - 1].e)))
            self.coefficients.append(add_matrices(*parts))
        limits = total(length(v[k]) * self.ranges[k].chord for k in range(n))
        bends = chords[0] * self.ranges[0].cos_half + chords[1] * self.ranges[-1].cos_half
        self.constant = limits - dot(pi, problem.target) - bends

    def bound(self, base: int, end: int) -> Span:
        """Rules 7.3 and 7.4: what F is at most, at the target itself."""
        n = len(self.joints)
        terms = [self.constant, inner(self.coefficients[0], IDENTITY), inner(self.coefficients[n], self.last)]
        for k in range(1, n):
            if k <= base:
                terms.append(self._from_base(k))
            elif k >= n - end:
                terms.append(self._from_target(k))
            else:
                terms.append(largest_eigenvalue(quaternion_form(self.coefficients[k])))
        return total(terms)

    def _from_base(self, k: int) -> Span:
        d = self.ranges[0].axis_before
        turned, strays = IDENTITY, []
        for j, joint in enumerate(self.joints[:k]):
            turned = multiply(turned, joint.rotation)
            if j > 0:
                strays.append(_apart(turn(turned, joint.axis), d))
        m = multiply(self.coefficients[k], transpose(turned))
        chord = self.chords[0] if k == 1 else ZERO
        return _turned_about(d, m, chord, self.ranges[0], UNIT) + _FOUR * total(strays) * frobenius(m)

    def _from_target(self, k: int) -> Span:
        d = self.joints[-1].axis
        strays = [
            _apart(turn(transpose(self._behind(j)), self.joints[j - 1].axis), d)
            for j in range(k + 1, len(self.joints))
        ]
        m = multiply(transpose(self.last), self.coefficients[k], self._behind(k))
        chord = self.chords[1] if k == len(self.joints) - 1 else ZERO
        return _turned_about(d, m, chord, self.ranges[-1], -UNIT) + _FOUR * total(strays) * frobenius(m)

    def _behind(self, k: int) -> Matrix:
        """D_k = J_(k+1) ... J_n."""
        return multiply(IDENTITY, *(joint.rotation for joint in self.joints[k:]))

    def blur(self, end: int, position: Span, rotation: Span) -> Span:
        """Rule 7.5: what the tolerances add."""
        n = len(self.joints)
        d = self.joints[-1].axis
        along, around = outer(d, d), cross_matrix(d)
        across = add_matrices(IDENTITY, _negative(along))
        steady, swinging = self.coefficients[n], ZERO
        for k in range(n - end, n):
            m = multiply(self.coefficients[k], self._behind(k))
            steady = add_matrices(steady, multiply(m, along))
            swinging += length((frobenius(multiply(m, across)), frobenius(multiply(m, around))))
        return length(self.pi) * position + rotation * _ROOT_OF_TWO * (frobenius(steady) + swinging)


def _turned_about(d: Vector, m: Matrix, chord: Span, range_: Range, sign: Span) -> Span:
    """The largest <M, Rot(d, +-psi)> + chord cos(psi - mid)."""
    along = dot(d, turn(m, d))
    trace = total(m[i][i] for i in range(3))
    cosine = trace - along + chord * range_.cos_middle
    sine = sign * inner(m, cross_matrix(d)) + chord * range_.sin_middle
    return along + length((cosine, sine))


def _apart(a: Vector, d: Vector) -> Span:
    """How far two directions are from being one, or opposite."""
    return smaller(length(subtract(a, d)), length(add(a, d)))


def _negative(m: Matrix) -> Matrix:
    return tuple(tuple(-entry for entry in row) for row in m)  # type: ignore[return-value]


def quaternion_form(m: Matrix) -> list[list[Span]]:
    """K of rule 7.4: <N, R> = q^T K q for the unit quaternion q of R."""
    (a, b, c), (d, e, f), (g, h, i) = m
    return [
        [a + e + i, h - f, c - g, d - b],
        [h - f, a - e - i, b + d, c + g],
        [c - g, b + d, e - a - i, f + h],
        [d - b, c + g, f + h, i - a - e],
    ]
