"""Spans hold what they stand for: against truths in fractions, and known angles."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from workcell.proofs.exact.convex.eigenvalues import largest_eigenvalue
from workcell.proofs.exact.spans import ONE, PI, Span, cos_sin, length, root, span

NUMBERS = st.fractions(-1000, 1000)
PI_50 = Fraction("3.14159265358979323846264338327950288419716939937510")


def holds(found: Span, value: Fraction) -> bool:
    return found.low <= value * ONE <= found.high


@given(NUMBERS, NUMBERS)
def test_arithmetic_holds_the_truth_and_is_narrow(a, b):
    for found, true in (
        (span(a) + span(b), a + b),
        (span(a) - span(b), a - b),
        (span(a) * span(b), a * b),
        (abs(span(a)), abs(a)),
    ):
        assert holds(found, true)
        assert found.high - found.low < 1e4
    if b > Fraction(1, 1000):
        assert holds(span(a) / span(b), a / b)


@given(st.fractions(0, 1000))
def test_a_root_is_no_less_and_no_more(a):
    found = root(span(a))
    assert Fraction(found.low, ONE) ** 2 <= a <= Fraction(found.high, ONE) ** 2
    assert holds(length((span(3 * a), span(-4 * a))), 5 * a)


def test_pi_has_fifty_right_digits():
    assert abs(Fraction(PI.low, ONE) - PI_50) < Fraction(1, 10**44)
    assert PI.low < PI.high < PI.low + 10**4


@given(st.floats(-100, 100))
def test_cosine_and_sine_hold_the_double_and_the_identity(x):
    cosine, sine = cos_sin(span(x))
    for found, double in ((cosine, math.cos(x)), (sine, math.sin(x))):
        assert abs(Fraction(found.low, ONE) - Fraction(double)) < Fraction(1, 10**15)
        assert found.high - found.low < 1e6
    assert holds(cosine * cosine + sine * sine, Fraction(1))


def test_known_angles():
    sixth = cos_sin(PI / span(3))
    assert holds(sixth[0], Fraction(1, 2))
    assert holds(sixth[1] * sixth[1], Fraction(3, 4))
    assert holds(cos_sin(span(0))[0], Fraction(1))
    for turns in (-3, 1, 7):
        cosine, sine = cos_sin(PI * span(turns))
        assert holds(cosine, Fraction(-1))
        assert holds(sine, Fraction(0))


@given(
    st.lists(st.integers(-9, 9), min_size=4, max_size=4), st.lists(st.integers(-3, 3), min_size=4, max_size=4)
)
def test_an_eigenvalue_is_bounded_from_above_and_closely(values, vector):
    size = sum(v * v for v in vector)
    if size == 0:
        return
    # I - 2 v v^T / v.v is orthogonal: the eigenvalues are the ones put in
    q = [
        [Fraction(int(i == j)) - Fraction(2 * vector[i] * vector[j], size) for j in range(4)]
        for i in range(4)
    ]
    m = [[sum(q[i][k] * values[k] * q[j][k] for k in range(4)) for j in range(4)] for i in range(4)]
    found = largest_eigenvalue([[span(entry) for entry in row] for row in m])
    assert holds(found, Fraction(max(values)))
    assert found.high - found.low < ONE >> 40


def test_a_divisor_that_may_be_zero_is_refused():
    with pytest.raises(ZeroDivisionError):
        span(1) / Span(0, 1)
