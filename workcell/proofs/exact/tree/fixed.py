"""Arithmetic on arrays of whole numbers that count 2^-30."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from workcell.proofs.exact.reading import RefusedError
from workcell.proofs.exact.spans import BITS, PI, Span

SHIFT = 30
ONE = 1 << SHIFT
TRIG_ERROR = 4
"""No cosine or sine of `cos_sin` is off by more."""

Ints = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

_FINE = 50
_RIGHT_ANGLE = (PI.low + PI.high) >> (BITS + 2 - _FINE)
"""A quarter turn in units of 2^-50, off by less than one."""


def down(product: Ints) -> Ints:
    """A product of two numbers as a number, rounded down."""
    return product >> SHIFT


def up(product: Ints) -> Ints:
    """A product of two numbers as a number, rounded up."""
    return -(-product >> SHIFT)


def root_up(squares: Ints) -> Ints:
    """Whole numbers whose squares are no less: guessed with doubles, then put right."""
    if np.any(squares < 0):
        raise RefusedError("a number is too large for 64 bits")
    guess: Ints = np.sqrt(squares.astype(np.float64)).astype(np.int64)
    guess += guess * guess < squares
    guess += guess * guess < squares
    if np.any(guess * guess < squares):
        raise RefusedError("a root came out too small")
    return guess


def root_down(squares: Ints) -> Ints:
    """Whole numbers whose squares are no more."""
    guess = root_up(squares)
    guess -= guess * guess > squares
    guess -= guess * guess > squares
    if np.any(guess * guess > squares):
        raise RefusedError("a root came out too large")
    return guess


def cos_sin(angles: Ints) -> tuple[Ints, Ints]:
    """Cosines and sines of angles below 120 rad, each off by `TRIG_ERROR` at most.

    What is left beyond quarter turns, |x| < 0.8, is rounded to 2^-30 (off by 1: a step of one and less than 100
    steps of 2^-50). Taylor's series is summed by Horner's rule with terms to x^12 and x^13; what is left out is
    below 2^-37. Every step rounds twice by 1 at most, and the steps after it shrink that: below 3 together.
    """
    fine = angles << (_FINE - SHIFT)
    quarters = (fine + _RIGHT_ANGLE // 2) // _RIGHT_ANGLE
    x = (fine - quarters * _RIGHT_ANGLE) >> (_FINE - SHIFT)
    square = down(x * x)
    cosine, sine = np.full_like(x, ONE), np.full_like(x, ONE)
    for k in (12, 10, 8, 6, 4, 2):
        cosine = ONE - down(square * cosine) // (k * (k - 1))
        sine = ONE - down(square * sine) // (k * (k + 1))
    sine = down(sine * x)
    odd, phase = quarters % 2 == 1, quarters % 4
    cosine, sine = np.where(odd, sine, cosine), np.where(odd, cosine, sine)
    cosine = np.where((phase == 1) | (phase == 2), -cosine, cosine)
    return cosine, np.where(phase >= 2, -sine, sine)


def nearest(x: Span, units: int = 0) -> int:
    """A span's middle as a number, in units of length of so many halvings: off by 1 at most, for short spans."""
    return (x.low + x.high) >> (BITS + 1 - SHIFT + units)


def cross(a: Any, b: Any) -> Ints:
    """Cross products of vectors whose components stand along the first axis: products, not yet shifted."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
