"""`cidgik/2` (section 8): inner products of the chain's vectors, tied together by multipliers."""

from __future__ import annotations

from collections.abc import Sequence

from workcell.proofs.exact.certificates import Array, Certificate, Claim, index, poses_missed, tolerances
from workcell.proofs.exact.convex.farkas import quaternion_form
from workcell.proofs.exact.convex.joints import Range, last_rotation, ranges
from workcell.proofs.exact.problems import Problem
from workcell.proofs.exact.reading import RefusedError
from workcell.proofs.exact.spans import UNIT, ZERO, Span, length, span, square, total
from workcell.proofs.exact.vectors import Matrix, Vector, cross, turn, vector

Row = list[Span]
"""A vector as coefficients of the columns of X."""
_HALF, _QUARTER = span(0.5), span(0.25)


def cidgik(problem: Problem, certificate: Certificate) -> Claim:
    """An upper bound below zero of a function that is not below zero at any candidate.

    Raises:
        RefusedError: an array breaks a rule.
    """
    n = len(problem.arm.joints)
    u = 3 * n
    given, facts, hands, turned, limits, keys, rows, factor, frames = certificate.arrays(
        tolerances=(3,), facts=(n + 1, u), hands=(n, 2), turned=(2, 3), limits=(n,), keys=("r", 2), rows=("r",),
        S=(u, "rank"), frames=(n - 1, 4, 4),
    )  # fmt: skip
    blur, rotation = tolerances(given.values)
    if n < 2 or factor.shape[1] > u:
        raise RefusedError("an arm of one joint, or a factor with too many columns")
    if min((*limits.values, *rows.values, 0.0)) < 0:
        raise RefusedError("a multiplier of an inequality is below zero")
    sizes = [length(span(v) for v in array.values) for array in (facts, hands, turned, limits, rows)]
    sizes += [square(length(span(v) for v in array)) for array in (factor.values, *_matrices(frames))]
    size = total(sizes)
    if not size.surely_positive:
        raise RefusedError("all multipliers are zero")
    sums = _Sums(problem, span(blur), span(rotation))
    sums.facts([[span(v) for v in row] for row in facts.rows()])
    for k, row in enumerate(hands.rows(), 1):
        sums.hands(k, span(row[0]), span(row[1]))
    first, last = (vector(row) for row in turned.rows())
    sums.turned(first, last)
    for k, value in enumerate(limits.values, 1):
        sums.limit(k, span(value))
    touched = set()
    for pair, value in zip(keys.rows(), rows.values, strict=True):
        o = index(pair[1], len(problem.obstacles), "an obstacle")
        touched.add(o)
        sums.sphere(
            index(pair[0], len(problem.arm.spheres), "a sphere"), o, span(value), span(given.values[2])
        )
    sums.positive([[span(v) for v in row] for row in factor.rows()])
    for k, values in enumerate(_matrices(frames), 1):
        sums.frame(k, [[span(v) for v in values[4 * i : 4 * i + 4]] for i in range(4)])
    statement = f"{poses_missed(blur, rotation)}, obstacles aside."
    if touched:
        statement = (
            f"{poses_missed(blur, rotation)} with all spheres clear of {len(touched)} of the obstacles, "
            f"{1e3 * given.values[2]:g} mm of penetration allowed."
        )
    return Claim("geometry" if touched else "kinematics", statement, -sums.bound() / size - span(1e-9))


def _matrices(frames: Array) -> list[tuple[float, ...]]:
    return [frames.values[16 * k : 16 * k + 16] for k in range(frames.shape[0])]


class _Sums:
    """F = const + <H, X^T X>, and the charges."""

    def __init__(self, problem: Problem, position: Span, rotation: Span) -> None:
        self.problem, self.position, self.rotation = problem, position, rotation
        self.joints = problem.arm.joints
        self.n = len(self.joints)
        self.ranges: list[Range] = ranges(problem)
        self.last: Matrix = last_rotation(problem)
        width = 3 * self.n
        self.h = [[ZERO] * width for _ in range(width)]
        self.constant = ZERO
        self.charges = ZERO

    def fixed(self, link: int, v: Vector) -> Row:
        """[link: v], rule 8.2."""
        row = [ZERO] * (3 * self.n)
        if link == self.n:
            v = turn(self.last, v)
        start = 3 * (self.n - 1) if link in (0, self.n) else 3 * (link - 1)
        row[start : start + 3] = v
        return row

    def size(self, row: Row) -> Span:
        """A(w): no less than the vector is long."""
        return total(length(row[i : i + 3]) for i in range(0, len(row), 3))

    def product(self, a: Row, b: Row, factor: Span = UNIT) -> None:
        """Add an inner product, times a factor."""
        half = factor * _HALF
        first = [(i, half * x) for i, x in enumerate(a) if x.low or x.high]
        second = [(j, y) for j, y in enumerate(b) if y.low or y.high]
        for i, x in first:
            for j, y in second:
                entry = x * y
                self.h[i][j] = self.h[i][j] + entry
                self.h[j][i] = self.h[j][i] + entry

    def facts(self, w: Sequence[Row]) -> None:
        """The position's row and the axes' rows."""
        tool = self.problem.arm.tool
        parts = [self.fixed(k, joint.offset) for k, joint in enumerate(self.joints)]
        f = _sum(*parts, self.fixed(self.n, tool), _negative(self.fixed(0, self.problem.target)))
        self.product(f, w[0])
        self.charges += (self.position + self.rotation * length(tool)) * self.size(w[0])
        for k, (joint, range_) in enumerate(zip(self.joints, self.ranges, strict=True), 1):
            row = _sum(self.fixed(k - 1, range_.axis_before), _negative(self.fixed(k, joint.axis)))
            self.product(row, w[k])
        self.charges += self.rotation * self.size(w[self.n])

    def hands(self, k: int, beta: Span, gamma: Span) -> None:
        """What normals of an axis keep on both sides of it."""
        r = self.ranges[k - 1]
        e, f = self.fixed(k, r.e), self.fixed(k, r.f)
        e_before, f_before = self.fixed(k - 1, r.e_before), self.fixed(k - 1, r.f_before)
        self.product(e_before, e, beta)
        self.product(f_before, f, -beta)
        self.product(e_before, f, gamma)
        self.product(f_before, e, gamma)
        if k == self.n:
            self.charges += self.rotation * (abs(beta) + abs(gamma)) * span(2)

    def turned(self, first: Vector, last: Vector) -> None:
        """f = axis x e, next to the base and next to the target, where the axis is known."""
        r = self.ranges[0]
        self._quarter(first, r.axis_before, self.fixed(1, r.f), self.fixed(1, r.e))
        r, link = self.ranges[-1], self.n - 1
        axis = turn(self.last, self.joints[-1].axis)
        self._quarter(last, axis, self.fixed(link, r.f_before), self.fixed(link, r.e_before))
        self.charges += self.rotation * length(last)

    def _quarter(self, tau: Vector, axis: Vector, f: Row, e: Row) -> None:
        """tau . (f - axis x e): tau . (axis x e) = (tau x axis) . e."""
        self.product(self.fixed(0, tau), f)
        self.product(self.fixed(0, cross(tau, axis)), e, -UNIT)

    def limit(self, k: int, mu: Span) -> None:
        """A joint's range."""
        r = self.ranges[k - 1]
        self.product(self.fixed(k - 1, r.u_before), self.fixed(k, r.e), mu)
        self.constant -= mu * r.cos_half
        if k == self.n:
            self.charges += self.rotation * mu

    def sphere(self, s: int, o: int, nu: Span, allowed: Span) -> None:
        """A sphere that keeps clear of an obstacle that is one.

        Raises:
            RefusedError: the obstacle is none.
        """
        sphere, obstacle = self.problem.arm.spheres[s], self.problem.obstacles[o]
        if obstacle.sort != "sphere":
            raise RefusedError(f"obstacle {o} is no sphere")
        link = sphere.link
        parts = [self.fixed(k, joint.offset) for k, joint in enumerate(self.joints[:link])]
        y = _sum(*parts, self.fixed(link, sphere.centre), _negative(self.fixed(0, obstacle.centre)))
        self.product(y, y, nu)
        kept = span(sphere.radius) + span(obstacle.sizes[0]) - allowed
        self.constant -= nu * square(Span(max(kept.low, 0), max(kept.high, 0)))
        if link == self.n:
            stray, size = self.rotation * length(sphere.centre), self.size(y)
            self.charges += nu * stray * (size + size + stray)

    def positive(self, factor: Sequence[Row]) -> None:
        """<S S^T, X^T X>."""
        columns = [[row[c] for row in factor] for c in range(len(factor[0]))]
        for column in columns:
            self.product(column, column)

    def frame(self, link: int, factor: Sequence[Row]) -> None:
        """<M M^T, q q^T> of a link's unit quaternion q, which is linear in its rotation."""
        p = [[total(a * b for a, b in zip(x, y, strict=True)) for y in factor] for x in factor]
        for i in range(3):
            for j in range(3):
                entry = quaternion_form(_single(i, j))
                weight = total(p[a][b] * entry[a][b] for a in range(4) for b in range(4))
                column = self.fixed(link, _axis(j))
                self.product(self.fixed(0, _axis(i)), column, weight * _QUARTER)
        self.constant += total(p[a][a] for a in range(4)) * _QUARTER

    def bound(self) -> Span:
        """Rule 8.4: what F is at most, and the charges."""
        width = range(3 * self.n)
        diagonal = total(self.h[i][i] for i in width)
        off = total(abs(self.h[i][j]) for i in width for j in width if i // 3 != j // 3)
        return self.constant + diagonal + off + self.charges


def _sum(*rows: Row) -> Row:
    return [total(column) for column in zip(*rows, strict=True)]


def _negative(row: Row) -> Row:
    return [-entry for entry in row]


def _axis(i: int) -> Vector:
    x, y, z = (UNIT if k == i else ZERO for k in range(3))
    return x, y, z


def _single(i: int, j: int) -> Matrix:
    """The matrix with a one in row i, column j."""
    rows = [_axis(j) if k == i else (ZERO, ZERO, ZERO) for k in range(3)]
    return rows[0], rows[1], rows[2]
