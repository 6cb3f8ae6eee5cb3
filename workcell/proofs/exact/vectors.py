"""Vectors and matrices of spans: tuples of three, and of three rows."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

from workcell.proofs.exact.spans import ONE, UNIT, ZERO, Number, Span, length, root, span, square, total

Vector = tuple[Span, Span, Span]
Matrix = tuple[Vector, Vector, Vector]

IDENTITY: Matrix = ((UNIT, ZERO, ZERO), (ZERO, UNIT, ZERO), (ZERO, ZERO, UNIT))


def vector(values: Sequence[Number]) -> Vector:
    """Three numbers as spans."""
    x, y, z = values
    return span(x), span(y), span(z)


def add(*vectors: Vector) -> Vector:
    """The sum of vectors."""
    return total(v[0] for v in vectors), total(v[1] for v in vectors), total(v[2] for v in vectors)


def subtract(a: Vector, b: Vector) -> Vector:
    """Their difference."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def scale(factor: Span, v: Vector) -> Vector:
    """A multiple."""
    return factor * v[0], factor * v[1], factor * v[2]


def dot(a: Sequence[Span], b: Sequence[Span]) -> Span:
    """The inner product."""
    return total(x * y for x, y in zip(a, b, strict=True))


def cross(a: Vector, b: Vector) -> Vector:
    """The cross product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def transpose(m: Matrix) -> Matrix:
    """Rows as columns."""
    a, b, c = m
    return (a[0], b[0], c[0]), (a[1], b[1], c[1]), (a[2], b[2], c[2])


def turn(m: Matrix, v: Vector) -> Vector:
    """Matrix times vector."""
    return dot(m[0], v), dot(m[1], v), dot(m[2], v)


def multiply(*matrices: Matrix) -> Matrix:
    """The product of matrices."""
    product = matrices[0]
    for factor in matrices[1:]:
        columns = transpose(factor)
        product = tuple(tuple(dot(row, column) for column in columns) for row in product)  # type: ignore[assignment]
    return product


def outer(a: Vector, b: Vector) -> Matrix:
    """a b^T."""
    return scale(a[0], b), scale(a[1], b), scale(a[2], b)


def add_matrices(*matrices: Matrix) -> Matrix:
    """The sum of matrices."""
    first, second, third = zip(*matrices, strict=True)
    return add(*first), add(*second), add(*third)


def inner(m: Matrix, n: Matrix) -> Span:
    """The sum of products of entries."""
    return total(dot(a, b) for a, b in zip(m, n, strict=True))


def frobenius(m: Matrix) -> Span:
    """The length of a matrix as a vector of nine."""
    return length(entry for row in m for entry in row)


def cross_matrix(d: Vector) -> Matrix:
    """[d]: what turns v into d x v."""
    return (ZERO, -d[2], d[1]), (d[2], ZERO, -d[0]), (-d[1], d[0], ZERO)


def rotation_of(quaternion: Sequence[float]) -> Matrix:
    """The rotation of a quaternion `[w, x, y, z]` that is divided by its length: exact in fractions.

    Raises:
        ZeroDivisionError: its length is zero.
    """
    w, x, y, z = (Fraction(value) for value in quaternion)
    squares = w * w + x * x + y * y + z * z
    rows = (
        (w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z),
    )
    first, second, third = (vector([entry / squares for entry in row]) for row in rows)
    return first, second, third


def unit(values: Sequence[float]) -> Vector:
    """A direction divided by its length.

    Raises:
        ZeroDivisionError: its length is zero.
    """
    largest = Fraction(max(abs(value) for value in values))
    x, y, z = vector([Fraction(value) / largest for value in values])
    size = root(total((square(x), square(y), square(z))))
    return x / size, y / size, z / size


def about(axis: Vector, cosine: Span, sine: Span) -> Matrix:
    """Rot(axis, q) of rule 1.2, from cosine and sine of q."""
    versine = UNIT - cosine
    rows = outer(axis, axis)
    turned = cross_matrix(axis)
    return tuple(  # type: ignore[return-value]
        tuple((cosine if i == j else ZERO) + sine * turned[i][j] + versine * rows[i][j] for j in range(3))
        for i in range(3)
    )


def upper(x: Span) -> float:
    """A double near the upper end, for texts alone."""
    return float(Fraction(x.high, ONE))
