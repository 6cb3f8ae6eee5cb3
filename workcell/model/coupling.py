"""`Coupling`: joints that follow others by polynomials, so that a robot has fewer variables than joints."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike, NDArray

from workcell.pose import Array, read_only

MOST_DEGREE = 16
"""Largest degree of a polynomial: two of MuJoCo's, one after the other."""


@dataclass(frozen=True, slots=True)
class Coupling:
    """How the m joints of a robot follow from its n variables.

    Joint k is at `sum_i coefficients[k, i] q[variable[k]]^i`.

    Attributes:
        joint_names: m names.
        variable: (m,) the variable that each joint follows.
        coefficients: (m, d + 1) in rising powers; (0, 1, 0, ...) for the variable's own joint.
        own: (n,) for each variable the joint that it is the value of.
    """

    joint_names: tuple[str, ...]
    variable: NDArray[np.int64]
    coefficients: Array
    own: NDArray[np.int64]

    def __post_init__(self) -> None:
        for name in ("variable", "own"):
            object.__setattr__(self, name, read_only(getattr(self, name), np.int64))
        object.__setattr__(self, "coefficients", read_only(self.coefficients))

    @property
    def followers(self) -> NDArray[np.int64]:
        """(m - n,) the joints that are no variable's own."""
        return np.setdiff1d(np.arange(len(self.variable)), self.own)

    @property
    def is_affine(self) -> bool:
        """Whether no joint follows by more than a multiple and an offset."""
        return not np.any(self.coefficients[:, 2:])

    def values(self, q: ArrayLike) -> Array:
        """Joint values (..., m) at variables q (..., n)."""
        return self._evaluate(self.coefficients, q)

    def slopes(self, q: ArrayLike) -> Array:
        """(..., m) derivative of each joint by its variable."""
        return self._evaluate(_derivative(self.coefficients), q)

    def bends(self, q: ArrayLike) -> Array:
        """(..., m) second derivative of each joint by its variable."""
        return self._evaluate(_derivative(_derivative(self.coefficients)), q)

    def spans(self, q: ArrayLike, half: ArrayLike) -> Array:
        """(..., m) how far each joint may get from its value at q (..., n) while each variable stays within `half`."""
        width = np.asarray(half, dtype=float)[..., self.variable]
        total, rates, power = np.zeros_like(width), self.coefficients, np.ones_like(width)
        for i in range(1, self.coefficients.shape[1]):
            # the Taylor series is exact: its terms have the sizes |p^(i)| h^i / i!
            rates, power = _derivative(rates), power * width / i
            total += np.abs(self._evaluate(rates, q)) * power
        spans: Array = total * (1.0 + 1e-12)
        return np.where(np.arange(len(self.variable)) == self.own[self.variable], width, spans)

    def _evaluate(self, coefficients: Array, q: ArrayLike) -> Array:
        x = np.asarray(q, dtype=float)[..., self.variable]
        value: Array = np.zeros_like(x) + coefficients[:, -1]
        for power in range(coefficients.shape[1] - 2, -1, -1):
            value = value * x + coefficients[:, power]
        value[..., self.own] = (
            np.asarray(q, dtype=float) if coefficients is self.coefficients else value[..., self.own]
        )
        return value

    def moving(self, q: Array, qd: Array, qdd: Array) -> tuple[Array, Array, Array]:
        """Values, velocities and accelerations (..., m) of the joints, of those of the variables (..., n)."""
        slopes, v = self.slopes(q), self.variable
        bent = self.bends(q) * qd[..., v] ** 2
        return self.values(q), slopes * qd[..., v], slopes * qdd[..., v] + bent

    def variables(self, joints: ArrayLike) -> Array:
        """Variables (..., n) of joint values (..., m) that keep the coupling."""
        values: Array = np.asarray(joints, dtype=float)[..., self.own]
        return values

    def gathered(self, columns: Array, q: ArrayLike) -> Array:
        """Derivatives (..., n) by variables at q, from `columns` (..., m) by joints.

        Axes of `columns` beyond those of q (..., n) stand before the last: (..., 6, m) becomes (..., 6, n).
        """
        slopes = self.slopes(q)
        slopes = slopes.reshape(*slopes.shape[:-1], *(1,) * (columns.ndim - slopes.ndim), slopes.shape[-1])
        by_variable = np.zeros((*columns.shape[:-1], len(self.own)))
        for joint, variable in enumerate(self.variable):
            by_variable[..., variable] += columns[..., joint] * slopes[..., joint]
        return by_variable

    def part(self, joints: Iterable[int]) -> Coupling:
        """The coupling of some of the joints, which hold their variables' own."""
        kept = list(joints)
        variables = sorted({int(self.variable[k]) for k in kept})
        return Coupling(
            tuple(self.joint_names[k] for k in kept),
            np.array([variables.index(int(self.variable[k])) for k in kept]),
            self.coefficients[kept],
            np.array([kept.index(int(self.own[v])) for v in variables]),
        )

    def lost(self, joints: Iterable[int]) -> list[tuple[int, int]]:
        """(joint, its variable's own joint) where the second is not among some joints and the first is."""
        kept = set(joints)
        pairs = [(k, int(self.own[self.variable[k]])) for k in sorted(kept)]
        return [pair for pair in pairs if pair[1] not in kept]


def _derivative(coefficients: Array) -> Array:
    if coefficients.shape[1] == 1:
        return np.zeros_like(coefficients)
    derivative: Array = coefficients[:, 1:] * np.arange(1, coefficients.shape[1])
    return derivative


def side_by_side(couplings: Iterable[Coupling | None], joints: Iterable[tuple[str, ...]]) -> Coupling | None:
    """The coupling of several robots' joints in a row; None where none of them has one.

    Args:
        couplings: each robot's.
        joints: each robot's joint names, for those without one.
    """
    pairs = list(zip(couplings, joints, strict=True))
    if all(coupling is None for coupling, _ in pairs):
        return None
    parts = [uncoupled(names) if coupling is None else coupling for coupling, names in pairs]
    width = max(part.coefficients.shape[1] for part in parts)
    variable: list[int] = []
    own: list[int] = []
    names: list[str] = []
    rows: list[Array] = []
    for part in parts:
        variable += (part.variable + len(own)).tolist()
        own += (part.own + len(names)).tolist()
        names += part.joint_names
        rows.append(np.pad(part.coefficients, ((0, 0), (0, width - part.coefficients.shape[1]))))
    return Coupling(tuple(names), np.array(variable), np.concatenate(rows), np.array(own))


def uncoupled(joint_names: tuple[str, ...]) -> Coupling:
    """Every joint its own variable."""
    every = np.arange(len(joint_names))
    return Coupling(joint_names, every, np.tile([0.0, 1.0], (len(every), 1)), every)


def value_range(coefficients: Array, lower: float, upper: float) -> tuple[float, float]:
    """Smallest and largest value of a polynomial (d + 1,) on [lower, upper]; by its ends and stationary points."""
    p = Polynomial(coefficients)
    values = [float(p(x)) for x in (lower, upper, *_real_roots(p.deriv(), lower, upper))]
    return min(values), max(values)


def _real_roots(p: Polynomial, lower: float, upper: float) -> list[float]:
    """Roots in (lower, upper), rising."""
    p = p.trim(0.0)
    if p.degree() < 1:
        return []
    roots = p.roots()
    real = roots.real[np.abs(roots.imag) <= 1e-7 * (1.0 + np.abs(roots.real))]
    return sorted(float(root) for root in real if lower < root < upper)


def preimage(
    coefficients: Array, lower: float, upper: float, least: float, most: float, slack: float = 1e-9
) -> list[tuple[float, float]]:
    """Intervals within [lower, upper] in which a polynomial is in [least, most].

    For an affine one the ends may be infinite.
    """
    if not np.any(coefficients[2:]):
        offset, multiple = float(coefficients[0]), float(coefficients[1]) if len(coefficients) > 1 else 0.0
        if multiple == 0.0:
            return [(lower, upper)] if least - slack <= offset <= most + slack else []
        ends = sorted([(least - offset) / multiple, (most - offset) / multiple])
        low, high = max(lower, ends[0]), min(upper, ends[1])
        if low > high and low - high <= slack:
            low = high = min(max(0.5 * (low + high), lower), upper)
        return [(low, high)] if low <= high else []
    p = Polynomial(coefficients)
    cuts = [lower, upper]
    for bound in (least, most):
        if np.isfinite(bound):
            cuts += _real_roots(p - bound, lower, upper)
    cuts.sort()
    found: list[tuple[float, float]] = []
    for a, b in pairwise(cuts):
        if not least - slack <= float(p(0.5 * (a + b))) <= most + slack:
            continue
        if found and found[-1][1] == a:
            found[-1] = (found[-1][0], b)
        else:
            found.append((a, b))
    if not found:
        points = [x for x in cuts if least - slack <= float(p(x)) <= most + slack]
        found = [(x, x) for x in dict.fromkeys(points)]
    return found
