"""A way between two configurations of a mechanism: motors straight, or by one configuration between them.

The configurations between are those in which every motor has gone some share of its way, each another: what one motor
does first may keep another clear. Ways are looked at moment by moment; this is no proof, and no search that would find
a way whenever there is one.
"""

from __future__ import annotations

import numpy as np

from workcell.model.mechanism.following import close, given_rates
from workcell.model.mechanism.placing import difference, moved
from workcell.motion.mechanisms.looking import Measure
from workcell.motion.mechanisms.path import MechanismPath
from workcell.pose import Array

TRIES = 200
"""Configurations between that are tried."""
_AROUND = 0.15
"""Radians or metres by which a motor between may be off its straight way."""


def way_between(
    path: MechanismPath, measure: Measure, spacing: float, seed: int
) -> tuple[MechanismPath | None, str]:
    """The path itself where nothing is wrong along it, or one with a configuration between its two.

    Args:
        path: two configurations.
        measure: the judge's measure of a configuration.
        spacing: radians or metres that a number changes at most between two looks.
        seed: of the configurations that are tried.

    Returns:
        the way, or None, and then what is wrong on the straight one.
    """
    first = _wrong(path, measure, spacing)
    if not first:
        return path, ""
    mechanism, rng = path.mechanism, np.random.default_rng(seed)
    step, motors = difference(mechanism, path.start, path.end), given_rates(mechanism)
    for _ in range(TRIES):
        share = rng.uniform(0.0, 1.0, mechanism.dof)
        aside = rng.uniform(-_AROUND, _AROUND, mechanism.dof)
        between = close(
            mechanism, moved(mechanism, path.start, np.where(motors, share * step + aside, 0.5 * step))
        )
        if not between.is_closed or not measure(between.q).accepted:
            continue
        way = MechanismPath(mechanism, np.array([path.start, between.q, path.end]))
        if not _wrong(way, measure, spacing):
            return way, ""
    return None, first


def _wrong(path: MechanismPath, measure: Measure, spacing: float) -> str:
    """What is wrong first, from one end to the other; empty: nothing was seen."""
    for k, step in enumerate(path.steps):
        count = max(int(np.ceil(np.abs(step).max(initial=0.0) / spacing)), 1)
        for share in _spread(count):
            found = path.at(k, share)
            if not found.is_closed:
                return f"ties can't be closed: {1e3 * found.missed:.3g} mm (mrad) are missing"
            seen = measure(found.q)
            if not seen.accepted:
                return "; ".join(seen.reasons)
    return ""


def _spread(count: int) -> Array:
    """Shares of a stretch, its end among them, the middle first: what is in the way is found early."""
    shares = np.arange(1, count + 1) / count
    order = np.argsort(np.abs(shares - 0.5), kind="stable")
    spread: Array = shares[order]
    return spread
