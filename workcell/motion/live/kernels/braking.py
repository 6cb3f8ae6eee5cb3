"""Coming to rest within acceleration and jerk limits, joint by joint, in closed form; and what room that leaves.

A joint's state is position, velocity and acceleration. It comes to rest in three phases: jerk until the acceleration is
at its (negative) peak, that acceleration held, jerk back to none. The rest of such a stop is the stop of every state on
it, so that a stop that was looked at once stays valid while it is carried out.
"""

from __future__ import annotations

import math

from workcell.jit import lean

Stop = tuple[float, float, float, float]
"""Sign of the motion that remains once the acceleration has gone, and the times of the three phases."""
State = tuple[float, float, float]
"""Position, velocity, acceleration."""

_HALVINGS = 24


@lean
def stop_of(v: float, a: float, most: float, jerk: float) -> Stop:
    """How a joint with velocity v and acceleration a comes to rest."""
    left = v + a * abs(a) / (2.0 * jerk)
    sign = 1.0 if left >= 0.0 else -1.0
    v, a = sign * v, sign * a
    peak = math.sqrt(max(jerk * v + 0.5 * a * a, 0.0))
    held = 0.0
    if peak > most:
        peak = most
        held = max((v + (a * a - 2.0 * most * most) / (2.0 * jerk)) / most, 0.0)
    return sign, max((a + peak) / jerk, 0.0), held, peak / jerk


@lean
def _under(v: float, a: float, jerk: float, t: float) -> State:
    """Displacement, velocity and acceleration after t seconds of constant jerk."""
    return t * (v + t * (0.5 * a + t * jerk / 6.0)), v + t * (a + 0.5 * t * jerk), a + t * jerk


@lean
def stopping(v: float, a: float, most: float, jerk: float, t: float) -> State:
    """Displacement, velocity and acceleration t seconds into the stop; at rest after its end."""
    sign, first, second, third = stop_of(v, a, most, jerk)
    x, left = 0.0, t
    for phase in range(3):
        length = first if phase == 0 else second if phase == 1 else third
        rate = -sign * jerk if phase == 0 else 0.0 if phase == 1 else sign * jerk
        part = min(left, length)
        dx, v, a = _under(v, a, rate, part)
        x += dx
        left -= part
        if left <= 0.0:
            return x, v, a
    return x, 0.0, 0.0


@lean
def stop_time(v: float, a: float, most: float, jerk: float) -> float:
    """Seconds until rest."""
    _, first, second, third = stop_of(v, a, most, jerk)
    return first + second + third


@lean
def stop_length(v: float, a: float, most: float, jerk: float) -> float:
    """Displacement until rest."""
    sign, first, second, third = stop_of(v, a, most, jerk)
    x, v, a = _under(v, a, -sign * jerk, first)
    x += second * (v + 0.5 * second * a)
    return x + third * (v + second * a + third * (0.5 * a + third * sign * jerk / 6.0))


@lean
def farthest(v: float, a: float, most: float, jerk: float) -> float:
    """The largest displacement on the way to rest: where the velocity ends, or first turns back."""
    end = max(stop_length(v, a, most, jerk), 0.0)
    if v > 0.0 and a < 0.0:
        # it may turn back before the acceleration is gone: v + a t + jerk t^2 / 2 = 0
        inside = a * a - 2.0 * jerk * v
        if inside > 0.0:
            t = (-a - math.sqrt(inside)) / jerk
            end = max(end, _under(v, a, jerk, t)[0])
    return end


@lean
def fits(x: float, v: float, a: float, top: float, fastest: float, most: float, jerk: float) -> bool:
    """Whether a state stays below `top` and its velocity below `fastest` on its way to rest."""
    peak = v + a * a / (2.0 * jerk) if a > 0.0 else v
    return peak <= fastest and x + farthest(v, a, most, jerk) <= top


@lean
def after(x: float, v: float, a: float, jerk: float, period: float) -> State:
    """The state after one period of constant jerk."""
    dx, v, a = _under(v, a, jerk, period)
    return x + dx, v, a


@lean
def _keeps(
    v: float, a: float, after: State, top: float, fastest: float, most: float, jerk: float, rate: float
) -> bool:
    """Whether the velocity stays below its limit in the period of a constant jerk `rate`, and `fits` holds after it."""
    x, w, b = after
    peak = v - a * a / (2.0 * rate) if a > 0.0 > b else v
    return peak <= fastest and fits(x, w, b, top, fastest, most, jerk)


@lean
def highest_jerk(
    x: float, v: float, a: float, top: float, fastest: float, most: float, jerk: float, period: float
) -> float:
    """The largest constant jerk of a period after which a joint can come to rest below `top`; nan: there is none.

    Velocity and acceleration stay below their limits in the period and until rest.
    """
    high = min(jerk, (most - a) / period)
    low = max(-jerk, (-most - a) / period)
    if low > high:
        return math.nan
    if _keeps(v, a, after(x, v, a, high, period), top, fastest, most, jerk, high):
        return high
    if not _keeps(v, a, after(x, v, a, low, period), top, fastest, most, jerk, low):
        return math.nan
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if _keeps(v, a, after(x, v, a, middle, period), top, fastest, most, jerk, middle):
            low = middle
        else:
            high = middle
    return low
