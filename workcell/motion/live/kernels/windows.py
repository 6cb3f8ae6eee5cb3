"""What each joint may do in a period, whatever the others do: the jerks after which it can still come to rest."""

from __future__ import annotations

from workcell.jit import inlined, lean
from workcell.motion.live.kernels.braking import State, after, highest_jerk, stop_length, stopping
from workcell.motion.live.kernels.limbs import Limbs
from workcell.motion.live.kernels.motion import FREE, STOPPING, Motion
from workcell.pose import Array

_CLOSER, _CLOSE = 16, 1e-10
"""Tries to find an aim, and the radians (or metres) by which it may miss."""


@lean
def open_windows(limbs: Limbs, motion: Motion, period: float) -> None:
    """What each joint may do in the period, whatever the others do; and its stop."""
    for k in range(motion.end.shape[0]):
        x, v, a = motion.now[0, k], motion.now[1, k], motion.now[2, k]
        fastest, most, jerk = limbs.rates[0, k], limbs.rates[1, k], limbs.rates[2, k]
        dx, w, b = stopping(v, a, most, jerk, period)
        motion.stop[0, k], motion.stop[1, k], motion.stop[2, k] = x + dx, w, b
        motion.end[k] = x + stop_length(v, a, most, jerk)
        high = highest_jerk(x, v, a, limbs.bounds[1, k], fastest, most, jerk, period) / jerk
        low = -highest_jerk(-x, -v, -a, -limbs.bounds[0, k], fastest, most, jerk, period) / jerk
        if not low <= high:
            motion.held[k], motion.windows[0, k], motion.windows[1, k] = STOPPING, 0.0, 0.0
            continue
        motion.held[k], motion.windows[0, k], motion.windows[1, k] = FREE, low, high


@inlined
def _beyond_target(off: State, most: float, jerk: float, rate: float, period: float) -> float:
    """By how much a joint's stop, seen from its moving target, ends beyond it after a period of some jerk.

    A stop shorter than a period can't be carried out. Near the target a linear term outweighs it, with which a joint
    that holds this at zero from period to period comes to rest (four tenths are left after each), and not to swing.
    """
    y, w, b = after(off[0], off[1], off[2], rate, period)
    return y + period * (1.5 * w + 0.5 * period * b) + stop_length(w, b, most, jerk)


@lean
def aim(limbs: Limbs, motion: Motion, k: int, period: float) -> float:
    """The share of jerk within the window after which the joint's stop comes nearest to its moving target."""
    low, high = motion.windows[0, k], motion.windows[1, k]
    most, jerk = limbs.rates[1, k], limbs.rates[2, k]
    # seen from the target as it goes on after the period
    speed = motion.wanted[1, k]
    off = motion.now[0, k] + speed * period - motion.wanted[0, k], motion.now[1, k] - speed, motion.now[2, k]
    below = _beyond_target(off, most, jerk, low * jerk, period)
    above = _beyond_target(off, most, jerk, high * jerk, period)
    if below >= 0.0:
        return float(low)
    if above <= 0.0:
        return float(high)
    # regula falsi; the end that stays counts half (Illinois), so that both ends move
    share = low
    for _ in range(_CLOSER):
        share = low - below * (high - low) / (above - below)
        beyond = _beyond_target(off, most, jerk, share * jerk, period)
        if abs(beyond) < _CLOSE:
            break
        if beyond < 0.0:
            low, below, above = share, beyond, 0.5 * above
        else:
            high, above, below = share, beyond, 0.5 * below
    return float(share)


@lean
def state_after(limbs: Limbs, motion: Motion, shares: Array, period: float, out: Array) -> None:
    """States (3, n) after the period, each joint with its share of jerk; who has no window stops."""
    for k in range(motion.end.shape[0]):
        if motion.held[k] == STOPPING:
            out[0, k], out[1, k], out[2, k] = motion.stop[0, k], motion.stop[1, k], motion.stop[2, k]
            continue
        share = min(max(shares[k], motion.windows[0, k]), motion.windows[1, k])
        out[0, k], out[1, k], out[2, k] = after(
            motion.now[0, k], motion.now[1, k], motion.now[2, k], share * limbs.rates[2, k], period
        )


@lean
def end_of(limbs: Limbs, motion: Motion, k: int, share: float, period: float) -> float:
    """Where a joint comes to rest after a period of some jerk."""
    if motion.held[k] == STOPPING:
        return float(motion.end[k])
    jerk = limbs.rates[2, k]
    x, v, a = after(motion.now[0, k], motion.now[1, k], motion.now[2, k], share * jerk, period)
    return x + stop_length(v, a, limbs.rates[1, k], jerk)
