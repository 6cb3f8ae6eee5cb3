"""RelaxedIK's frame: the weighted sum made smaller from where the last frame's solution stands (section 4).

Each round takes the quadratic model of the sum within the joints' velocity limits (Eq. 8), the rows of all that is near
and those of tools near a singularity; what of the step makes the sum larger is given back by halves.
"""

from __future__ import annotations

from workcell.jit import kernel, lean
from workcell.motion.live.kernels.conditioning import conditioning_gradient
from workcell.motion.live.kernels.desk import Desk, Surroundings, condition, look
from workcell.motion.live.kernels.frame import Frame
from workcell.motion.live.kernels.limbs import Limbs
from workcell.motion.live.kernels.motion import Motion
from workcell.motion.live.kernels.near import move_obstacles
from workcell.motion.live.kernels.program import add_row, invert, solve
from workcell.motion.live.kernels.rows import note_guards
from workcell.motion.live.kernels.terms import AWARE, Wish, weigh
from workcell.pose import Array

_SLACK = 1e4
"""How much stiffer the shared slack of soft rows is than the stiffest direction of the sum."""
_SETTLED = 1e-4
"""Radians of a step below which a frame is settled: what is left is a thousandth of it, and less."""
_HARDLY, _FAR, _PATIENT = 0.03, 0.05, 10
"""Share of its fastest at which an arm is held, radians from its solution, and frames after which that follows it."""


@lean
def _add_near_rows(desk: Desk, around: Surroundings, n: int, part: float) -> None:
    """Rows over steps and slack: a step may use up `part` of what is left of a gap, and opens what is too narrow."""
    near, keep = desk.near, around.keep[0] + around.keep[1]
    for c in range(near.used[0]):
        spare = near.gap[c] - keep
        bound = -part * spare if spare > 0.0 else min(-spare, 0.02)
        row = desk.program.rows[add_row(desk.program, bound)]
        for k in range(n):
            row[k] = near.gradient[c, k]
        row[n] = 1.0


@lean
def _add_singular_rows(limbs: Limbs, around: Surroundings, desk: Desk, wish: Wish, n: int) -> None:
    """Rows that keep tools at their conditioning's least, or let it grow where they are below."""
    for t in range(wish.goals.shape[0]):
        if around.least[t] <= 0.0 or desk.ratio[t] > 4.0 * around.least[t]:
            continue
        ratio = condition(limbs, around, desk, t)
        if ratio > 2.0 * around.least[t]:
            continue
        conditioning_gradient(limbs, desk.place, t, desk.total.J, desk.vectors, desk.slope)
        spare = ratio - around.least[t]
        row = desk.program.rows[add_row(desk.program, -0.5 * spare if spare > 0.0 else 0.0)]
        for k in range(n):
            row[k] = desk.slope[k]
        row[n] = 0.02


@lean
def _step(
    limbs: Limbs, around: Surroundings, wish: Wish, desk: Desk, low: Array, high: Array, q: Array
) -> bool:  # fmt: skip
    """The quadratic model's step from q within [low, high], into the program's x (n + 1,)."""
    n, program, total = q.shape[0], desk.program, desk.total
    stiffest = 1e-9
    for k in range(n):
        stiffest = max(stiffest, total.matrix[k, k])
    for k in range(n):
        for m in range(n):
            desk.matrix[k, m] = total.matrix[k, m]
        desk.matrix[k, k] += 1e-9 * stiffest
        desk.matrix[k, n], desk.matrix[n, k] = 0.0, 0.0
    desk.matrix[n, n] = _SLACK * stiffest
    if not invert(desk.matrix, program):
        return False
    for k in range(n):
        step = 0.0
        for m in range(n):
            step -= program.inverse[k, m] * total.gradient[m]
        program.x[k] = step
    program.x[n], program.used[0] = 0.0, 0
    for k in range(n):
        program.rows[add_row(program, low[k] - q[k]), k] = 1.0
        program.rows[add_row(program, q[k] - high[k]), k] = -1.0
    _add_near_rows(desk, around, n, 0.5)
    _add_singular_rows(limbs, around, desk, wish, n)
    return solve(program, 1e-9)


@lean
def _set_box(limbs: Limbs, desk: Desk, wish: Wish, now: Array, period: float, q: Array) -> None:
    """Where the solution may go in this frame, and q, the last one within that.

    It keeps within the velocity limits (Eq. 8), and is no farther from the arm than it takes to stop.
    """
    _follow_a_held_arm(limbs, desk, wish, now)
    for k in range(q.shape[0]):
        last, low, high = wish.past[0, k], limbs.bounds[0, k], limbs.bounds[1, k]
        v, a, j = limbs.rates[0, k], limbs.rates[1, k], limbs.rates[2, k]
        ahead = v * v / (2.0 * a) + v * a / (2.0 * j) + v * period
        low = min(max(last - v * period, now[0, k] - ahead, low), high)
        high = min(max(min(last + v * period, now[0, k] + ahead), low), high)
        desk.box[0, k], desk.box[1, k] = low, high
        q[k] = min(max(last, low), high)


@lean
def _follow_a_held_arm(limbs: Limbs, desk: Desk, wish: Wish, now: Array) -> None:
    """Where the arm has hardly moved for some frames, far from its solution, this begins anew where the arm is.

    The way of the solution may lead around what the straight way of the arm does not.
    """
    n, rests, far = now.shape[1], True, False
    for k in range(n):
        rests = rests and abs(now[1, k]) <= _HARDLY * limbs.rates[0, k]
        far = far or abs(wish.past[0, k] - now[0, k]) > _FAR
    desk.held[0] = desk.held[0] + 1 if rests and far else 0
    if desk.held[0] < _PATIENT:
        return
    desk.held[0] = 0
    for k in range(n):
        for r in range(wish.past.shape[0]):
            wish.past[r, k] = now[0, k]


@kernel
def relax(frame: Frame, period: float, rounds: int, fresh: bool) -> float:
    """Up to `rounds` rounds of the frame's relaxed solution, `motion.wanted`, which a fresh frame begins anew.

    Returns the length of the last step, 0 where it is settled. Movers are looked at where they are after the period.
    """
    return _relax(frame.limbs, frame.around, frame.wish, frame.desk, frame.motion, period, rounds, fresh)


@lean
def _relax(
    limbs: Limbs, around: Surroundings, wish: Wish, desk: Desk, motion: Motion, period: float, rounds: int, fresh: bool
) -> float:  # fmt: skip
    """See `relax`."""
    q, past = motion.wanted[0], wish.past[0]
    if fresh:
        motion.used[0] = 0
        _set_box(limbs, desk, wish, motion.now, period, q)
        move_obstacles(around.movers, period)
    look(limbs, around, desk, q, AWARE)
    value, length = weigh(limbs, wish, desk.place, desk.near, q, desk.total), 0.0
    if fresh:
        value = _go_on(limbs, around, wish, desk, q, value)
    for _ in range(rounds):
        length = 0.0
        if _step(limbs, around, wish, desk, desk.box[0], desk.box[1], q):
            motion.used[0] = 0
            note_guards(motion, desk, 2 * q.shape[0])
            value, length = _go(limbs, around, wish, desk, q, value)
        if length < _SETTLED:
            length = 0.0
            break
    for k in range(q.shape[0]):
        motion.wanted[1, k] = (q[k] - past[k]) / period
    return length


@lean
def _go_on(limbs: Limbs, around: Surroundings, wish: Wish, desk: Desk, q: Array, value: float) -> float:
    """Begin where the solution comes to if it moves on as it did, if the sum is smaller there."""
    for k in range(q.shape[0]):
        further = 2.0 * wish.past[0, k] - wish.past[1, k]
        desk.trial[k] = min(max(further, desk.box[0, k]), desk.box[1, k])
    look(limbs, around, desk, desk.trial, AWARE)
    trial = weigh(limbs, wish, desk.place, desk.near, desk.trial, desk.total)
    if trial < value:
        for k in range(q.shape[0]):
            q[k] = desk.trial[k]
        return trial
    look(limbs, around, desk, q, AWARE)
    return weigh(limbs, wish, desk.place, desk.near, q, desk.total)


@kernel
def objective(frame: Frame, q: Array, gradient: Array) -> float:
    """The frame's weighted sum at q (n,), and its gradient (n,)."""
    return _objective(frame.limbs, frame.around, frame.wish, frame.desk, q, gradient)


@lean
def _objective(
    limbs: Limbs, around: Surroundings, wish: Wish, desk: Desk, q: Array, gradient: Array
) -> float:  # fmt: skip
    """See `objective`."""
    look(limbs, around, desk, q, AWARE)
    value = weigh(limbs, wish, desk.place, desk.near, q, desk.total)
    for k in range(q.shape[0]):
        gradient[k] = desk.total.gradient[k]
    return value


@lean
def _go(
    limbs: Limbs, around: Surroundings, wish: Wish, desk: Desk, q: Array, value: float
) -> tuple[float, float]:  # fmt: skip
    """Take of the program's step what makes the sum smaller; the sum there and the step's length, 0: none taken."""
    n, length = q.shape[0], 0.0
    for k in range(n):
        desk.slope[k] = desk.program.x[k]
        length = max(length, abs(desk.slope[k]))
    share, forced = 1.0, _is_forced(desk, n)
    for _ in range(4):
        for k in range(n):
            desk.trial[k] = min(max(q[k] + share * desk.slope[k], desk.box[0, k]), desk.box[1, k])
        look(limbs, around, desk, desk.trial, AWARE)
        trial = weigh(limbs, wish, desk.place, desk.near, desk.trial, desk.total)
        if forced or trial <= value + 1e-12 * abs(value):
            for k in range(n):
                q[k] = desk.trial[k]
            return trial, length
        share *= 0.5
    look(limbs, around, desk, q, AWARE)
    weigh(limbs, wish, desk.place, desk.near, q, desk.total)
    return value, 0.0


@lean
def _is_forced(desk: Desk, n: int) -> bool:
    """Whether a row that is no bound of a joint asks for a step: something is too near, or a tool too singular."""
    forced = False
    for row in range(2 * n, desk.program.used[0]):
        forced = forced or desk.program.bounds[row] > 1e-9
    return forced
