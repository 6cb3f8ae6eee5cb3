"""The same proof for joints that follow polynomials of time.

Over an interval the polynomial is expanded at the middle: with p_m its coefficients there, |q'| <= sum m |p_m| h^(m-1)
and |q''| <= sum m (m-1) |p_m| h^(m-2) for times at most h away, exactly in the limit of short intervals.
"""

from __future__ import annotations

from workcell.jit import inner, kernel
from workcell.kernels.chain import forward
from workcell.motion.kernels.body import Body, Room, accelerations, lead, room, stand, twists
from workcell.motion.kernels.line import BLOCKED, INTERVALS, PROVED, SPENT, TIGHT, WHOLE, Verdict
from workcell.motion.kernels.steps import safe_steps
from workcell.pose import Array


@inner
def _expand(body: Body, coefficients: Array, t: float, half: float, work: Room) -> float:
    """Frames and rates at t, and bounds on first and second derivatives within `half` of it, into `work`.

    Returns how far the variables can get from the middle, added up.
    """
    n, size = coefficients.shape
    total, coupled = 0.0, body.couple.variable.shape[0] > 0
    for k in range(n):
        speed, push, travel, power, place, rate = 0.0, 0.0, 0.0, 1.0, 0.0, 0.0
        for m in range(size):
            # coefficient m of the polynomial around t: sum over j >= m of binomial(j, m) c_j t^(j - m)
            value, binomial, lift = 0.0, 1.0, 1.0
            for j in range(m, size):
                value += binomial * coefficients[k, j] * lift
                binomial *= (j + 1.0) / (j + 1.0 - m)
                lift *= t
            if m == 0:
                place = value
            elif m == 1:
                rate = value
            # power is half^max(m - 2, 0)
            if m >= 1:
                speed += m * abs(value) * (1.0 if m == 1 else power * half)
                travel += abs(value) * (half if m == 1 else power * half * half)
            if m >= 2:
                push += m * (m - 1.0) * abs(value) * power
                power *= half
        if coupled:
            work.lead[0, k], work.lead[1, k], work.lead[2, k] = place, rate, speed
            work.lead[3, k], work.lead[4, k] = push, travel
        else:
            work.q[k], work.rate[k], work.speed[k], work.push[k] = place, rate, speed, push
        total += travel
    if coupled:
        stand(body, work.lead[0], work)
        lead(body, work)
    else:
        forward(body.frames, work.q, work.T)
    return total


@inner
def prove_curve(
    body: Body,
    coefficients: Array,
    duration: float,
    keep: float,
    level: float,
    finest: float,
    most: int,
    work: Room,
) -> Verdict:
    """Prove the motion q_k(t) = sum coefficients[k, m] t^m for t in [0, duration]; arguments as in `prove_line`."""
    gap, first, second, place = 1e3, -1, -1, 0.5
    work.queue[0, 0], work.queue[0, 1] = 0.0, duration
    head, tail, looks, size = 0, 1, 0, work.queue.shape[0]
    while head < tail:
        begin, end = work.queue[head % size, 0], work.queue[head % size, 1]
        head += 1
        t, half = 0.5 * (begin + end), 0.5 * (end - begin)
        travel = _expand(body, coefficients, t, half, work)
        twisting = accelerations(body, work.speed, work.push, work.A)
        twists(body.frames, work.T, work.rate, work.W)
        steps = safe_steps(body, work.T, work.W, work.A, twisting, half, keep, level)
        looks += 1
        if steps.gap < gap:
            gap, first, second, place = steps.gap, steps.first, steps.second, t / duration
        if steps.forward < 0.0:
            return Verdict(BLOCKED, t / duration, -1e3, gap, first, second, looks)
        level = steps.level
        short = min(steps.forward, steps.backward)
        if short >= half * WHOLE:
            continue
        if travel * short < finest * half or travel < finest:
            return Verdict(TIGHT, t / duration, -1e3, gap, first, second, looks)
        if looks >= most or tail - head + 2 > size:
            return Verdict(SPENT, t / duration, -1e3, gap, first, second, looks)
        if steps.backward < half * WHOLE:
            work.queue[tail % size, 0], work.queue[tail % size, 1] = begin, t - steps.backward
            tail += 1
        if steps.forward < half * WHOLE:
            work.queue[tail % size, 0], work.queue[tail % size, 1] = t + steps.forward, end
            tail += 1
    return Verdict(PROVED, place, level, gap, first, second, looks)


@kernel
def prove_curves(
    body: Body, coefficients: Array, durations: Array, keep: float, finest: float, most: int, out: Array
) -> int:
    """Prove k polynomial pieces (k, n, m) in turn, until one fails; `out` as in `prove_lines`."""
    level, looks = 1e3, 0
    work = room(body, 16 * INTERVALS)
    gap, place, first, second = 1e3, 0.0, -1, -1
    code = PROVED
    for i in range(coefficients.shape[0]):
        verdict = prove_curve(body, coefficients[i], durations[i], keep, level, finest, most - looks, work)
        code = verdict.code
        looks += verdict.looks
        if verdict.gap < gap or code != PROVED:
            gap, place, first, second = verdict.gap, i + verdict.at, verdict.first, verdict.second
        level = verdict.level
        if code != PROVED:
            place = i + verdict.at
            break
    out[0], out[1], out[2], out[3] = float(code), place, level, gap
    out[4], out[5], out[6] = float(first), float(second), float(looks)
    return code
