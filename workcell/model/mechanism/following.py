"""Where a mechanism's other joints are when those that motors move are given: Newton's method on what ties miss."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workcell.model.mechanism.mechanism import Mechanism
from workcell.model.mechanism.placing import difference, missed, moved, place
from workcell.pose import Array

CLOSED = 1e-6
"""Metres (radians) that ties may miss in a configuration that counts as closed."""
_CONVERGED, _ITERATIONS = 1e-11, 20
_PATIENCE = 4
"""Iterations without an improvement that end the search."""
_STEP = 0.1
"""Radians or metres that a number changes at most in a step of `approach`."""
_RANK = 1e-9
"""Singular values below this share of the largest are zero."""


@dataclass(frozen=True, slots=True)
class Closed:
    """A configuration (size,), what its ties miss at worst (metres, radians), and whether given joints had to move."""

    q: Array
    missed: float
    yielded: bool = False

    @property
    def is_closed(self) -> bool:
        """Whether the ties hold."""
        return self.missed <= CLOSED


def given_rates(mechanism: Mechanism) -> NDArray[np.bool_]:
    """(dof,) which numbers of a tangent motors say: those of driven hinges and slides that follow no other joint."""
    given = np.zeros(mechanism.dof, dtype=bool)
    following = {follower.joint for follower in mechanism.followers}
    for k, joint in enumerate(mechanism.joints):
        if joint.driven and joint.kind in ("hinge", "slide") and k not in following:
            given[mechanism.rate_slices[k]] = True
    return given


def given_joints(mechanism: Mechanism) -> tuple[int, ...]:
    """Indices of the joints that `given_rates` are of, in order."""
    given = given_rates(mechanism)
    return tuple(k for k, at in enumerate(mechanism.rate_slices) if given[at.start])


def close(mechanism: Mechanism, q: Array, given: NDArray[np.bool_] | None = None) -> Closed:
    """The configuration near `q` (size,) whose ties hold, with the given joints where they are in `q`.

    Joints that no tie determines move as little as can be. Where motors say more than the ties leave free, as two arms
    on one object do, and the given joints contradict each other, all joints move as little as can be.

    Args:
        mechanism: whose.
        q: where to begin: Newton's method finds the nearest assembly.
        given: (dof,) numbers of a tangent that stay; None: `given_rates`.
    """
    fixed = given_rates(mechanism) if given is None else given
    found = _newton(mechanism, q, ~fixed)
    if found.is_closed or not fixed.any():
        return found
    free = _newton(mechanism, q, np.ones(mechanism.dof, dtype=bool))
    return Closed(free.q, free.missed, True)


def approach(mechanism: Mechanism, q_from: Array, q_to: Array) -> Closed:
    """The configuration at `q_to` (size,) that is reached continuously from `q_from`, small step by small step.

    All numbers go straight to where `q_to` has them, but for what the ties demand of the joints that no motor moves.
    """
    steps = max(int(np.ceil(np.abs(difference(mechanism, q_from, q_to)).max(initial=0.0) / _STEP)), 1)
    here = close(mechanism, q_from)
    for k in range(1, steps + 1):
        ahead = difference(mechanism, here.q, q_to) / (steps - k + 1)
        here = close(mechanism, moved(mechanism, here.q, np.where(given_rates(mechanism), ahead, 0.0)))
    return here


def _newton(mechanism: Mechanism, q: Array, columns: NDArray[np.bool_]) -> Closed:
    """Move some numbers of a tangent to where the ties hold; the best that was seen on the way."""
    best = Closed(np.array(q, dtype=float), np.inf)
    here, before, idle = best.q, np.inf, 0
    for _ in range(_ITERATIONS):
        values, rows = missed(place(mechanism, here))
        worst = float(np.abs(values).max(initial=0.0))
        idle = 0 if worst < best.missed else idle + 1
        if worst < best.missed:
            best = Closed(here, worst)
        settled = worst < CLOSED and worst >= 0.5 * before
        if worst < _CONVERGED or settled or idle >= _PATIENCE or not columns.any():
            break
        before = worst
        step = np.zeros(mechanism.dof)
        step[columns] = -np.linalg.lstsq(rows[:, columns], values, rcond=_RANK)[0]
        if not np.all(np.isfinite(step)):
            break
        here = moved(mechanism, here, step)
    return best
