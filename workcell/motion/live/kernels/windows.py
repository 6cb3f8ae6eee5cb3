"""What each joint may do in a period, whatever the others do: the jerks after which it can still come to rest."""

from __future__ import annotations

from workcell.jit import inner
from workcell.motion.live.kernels.braking import after, highest_jerk, stop_length, stopping
from workcell.motion.live.kernels.limbs import Limbs
from workcell.motion.live.kernels.motion import FREE, STOPPING, Motion
from workcell.pose import Array


@inner
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


@inner
def _beyond_target(limbs: Limbs, motion: Motion, k: int, share: float, period: float) -> float:
    """By how much the joint's stop, seen from its moving target, ends beyond it after a jerk.

    A stop shorter than a period can't be carried out. Near the target a linear term outweighs it, with which a joint
    that holds this at zero from period to period comes to rest (four tenths are left after each), and not to swing.
    """
    x, v, a = motion.now[0, k], motion.now[1, k], motion.now[2, k]
    jerk, most = limbs.rates[2, k], limbs.rates[1, k]
    y, w, b = after(x, v, a, share * jerk, period)
    faster = w - motion.wanted[1, k]
    calm = period * (1.5 * faster + 0.5 * period * b)
    return float(y - motion.wanted[0, k] + calm + stop_length(faster, b, most, jerk))


@inner
def aim(limbs: Limbs, motion: Motion, k: int, period: float) -> float:
    """The share of jerk within the window after which the joint's stop comes nearest to its moving target."""
    low, high = motion.windows[0, k], motion.windows[1, k]
    if _beyond_target(limbs, motion, k, low, period) >= 0.0:
        return float(low)
    if _beyond_target(limbs, motion, k, high, period) <= 0.0:
        return float(high)
    for _ in range(24):
        middle = 0.5 * (low + high)
        if _beyond_target(limbs, motion, k, middle, period) <= 0.0:
            low = middle
        else:
            high = middle
    return float(low)


@inner
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


@inner
def end_of(limbs: Limbs, motion: Motion, k: int, share: float, period: float) -> float:
    """Where a joint comes to rest after a period of some jerk."""
    if motion.held[k] == STOPPING:
        return float(motion.end[k])
    jerk = limbs.rates[2, k]
    x, v, a = after(motion.now[0, k], motion.now[1, k], motion.now[2, k], share * jerk, period)
    return x + stop_length(v, a, limbs.rates[1, k], jerk)
