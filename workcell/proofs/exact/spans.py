"""Interval arithmetic on whole numbers: a span holds a real number for certain.

Ends are multiples of 2^-160. Sums are exact; products, quotients, roots, sines and cosines are rounded outwards.
"""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from math import isqrt

BITS = 160
ONE = 1 << BITS

Number = int | float | Fraction


class Span:
    """All real numbers from `low` to `high`, both counted in units of 2^-160."""

    __slots__ = ("high", "low")

    def __init__(self, low: int, high: int) -> None:
        self.low, self.high = low, high

    def __add__(self, other: Span) -> Span:
        return Span(self.low + other.low, self.high + other.high)

    def __sub__(self, other: Span) -> Span:
        return Span(self.low - other.high, self.high - other.low)

    def __neg__(self) -> Span:
        return Span(-self.high, -self.low)

    def __mul__(self, other: Span) -> Span:
        a, b, c, d = self.low, self.high, other.low, other.high
        if a >= 0 and c >= 0:
            low, high = a * c, b * d
        else:
            products = (a * c, a * d, b * c, b * d)
            low, high = min(products), max(products)
        return Span(low >> BITS, -(-high >> BITS))

    def __truediv__(self, other: Span) -> Span:
        if other.low <= 0:
            raise ZeroDivisionError("a divisor has to be positive for certain")
        low = min((self.low << BITS) // other.low, (self.low << BITS) // other.high)
        high = max(-((-self.high << BITS) // other.low), -((-self.high << BITS) // other.high))
        return Span(low, high)

    def __abs__(self) -> Span:
        if self.low >= 0:
            return self
        if self.high <= 0:
            return -self
        return Span(0, max(-self.low, self.high))

    def __repr__(self) -> str:
        return f"Span({float(Fraction(self.low, ONE))!r}, {float(Fraction(self.high, ONE))!r})"

    @property
    def surely_positive(self) -> bool:
        """Whether every number of the span is above zero."""
        return self.low > 0

    @property
    def surely_negative(self) -> bool:
        """Whether every number of the span is below zero."""
        return self.high < 0


def span(value: Number) -> Span:
    """The span of a number: a double or a fraction is taken as the real number that it is."""
    if isinstance(value, float):
        value = Fraction(value)
    scaled = value * ONE
    if isinstance(scaled, int):
        return Span(scaled, scaled)
    low = scaled.numerator // scaled.denominator
    return Span(low, low if scaled.denominator == 1 else low + 1)


ZERO = span(0)
UNIT = span(1)


def total(terms: Iterable[Span]) -> Span:
    """The sum of spans."""
    low = high = 0
    for term in terms:
        low += term.low
        high += term.high
    return Span(low, high)


def larger(first: Span, second: Span) -> Span:
    """The larger of two numbers."""
    return Span(max(first.low, second.low), max(first.high, second.high))


def smaller(first: Span, second: Span) -> Span:
    """The smaller of two numbers."""
    return Span(min(first.low, second.low), min(first.high, second.high))


def square(x: Span) -> Span:
    """The square of a number: never below zero."""
    x = abs(x)
    return x * x


def root(x: Span) -> Span:
    """The square root; what lies below zero by roundings counts as zero."""
    low, high = max(x.low, 0), max(x.high, 0)
    above = isqrt(high << BITS)
    return Span(isqrt(low << BITS), above if above * above == high << BITS else above + 1)


def length(numbers: Iterable[Span]) -> Span:
    """The Euclidean length of some numbers."""
    return root(total(square(number) for number in numbers))


def _pi() -> Span:
    """Machin's formula: pi = 16 atan(1/5) - 4 atan(1/239), both by their alternating series."""

    def atan_of_inverse(n: int) -> Span:
        power, sum_, k = ONE // n, 0, 0
        while power:
            sum_ += (-1) ** k * (power // (2 * k + 1))
            power //= n * n
            k += 1
        return Span(
            sum_ - 3 * (k + 1), sum_ + 3 * (k + 1)
        )  # two roundings a term, and the tail: below 3 a term

    return span(16) * atan_of_inverse(5) - span(4) * atan_of_inverse(239)


PI = _pi()


def cos_sin(angle: Span) -> tuple[Span, Span]:
    """Cosine and sine of an angle in radians: at the span's middle, both widened by how far its ends are away."""
    middle = (angle.low + angle.high) // 2
    reach = angle.high - middle + 1
    right_angle = (PI.low + PI.high) // 4
    quarters = (2 * middle + right_angle) // (2 * right_angle)
    rest = middle - quarters * right_angle
    reach += (abs(quarters) + 1) * (PI.high - PI.low + 2)
    sums = [0, 0]
    term, k = ONE, 0
    while term:
        sums[k % 2] += term if k % 4 < 2 else -term
        k += 1
        term = (term * abs(rest) >> BITS) // k
    reach += 3 * (
        k + 1
    )  # a term is off by less than 3 units (its own two roundings and, shrunk, the last one's)
    cosine, sine = sums[0], sums[1] if rest >= 0 else -sums[1]
    for _ in range(quarters % 4):
        cosine, sine = -sine, cosine
    return _clipped(cosine, reach), _clipped(sine, reach)


def _clipped(value: int, reach: int) -> Span:
    return Span(max(value - reach, -ONE), min(value + reach, ONE))
