"""What the live kernels call, made callable."""

from __future__ import annotations

from workcell.jit import kernel
from workcell.motion.live.kernels import braking, conditioning, program
from workcell.motion.live.kernels.desk import condition
from workcell.motion.live.kernels.limbs import put


@kernel
def stopping(v, a, most, jerk, t):
    """See `braking.stopping`."""
    return braking.stopping(v, a, most, jerk, t)


@kernel
def stop_time(v, a, most, jerk):
    """See `braking.stop_time`."""
    return braking.stop_time(v, a, most, jerk)


@kernel
def stop_length(v, a, most, jerk):
    """See `braking.stop_length`."""
    return braking.stop_length(v, a, most, jerk)


@kernel
def farthest(v, a, most, jerk):
    """See `braking.farthest`."""
    return braking.farthest(v, a, most, jerk)


@kernel
def highest_jerk(state, top, fastest, most, jerk, period):
    """See `braking.highest_jerk`."""
    return braking.highest_jerk(state[0], state[1], state[2], top, fastest, most, jerk, period)


@kernel
def solve(room, H):
    """See `program`: inverts H and solves."""
    return program.invert(H, room) and program.solve(room, 1e-10)


@kernel
def conditioning_at(frame, q, slope):
    """The conditioning of the first tool at q (n,), and its gradient, into slope (n,)."""
    limbs, desk = frame.limbs, frame.desk
    put(limbs, q, desk.place)
    ratio = condition(limbs, frame.around, desk, 0)
    conditioning.conditioning_gradient(limbs, desk.place, 0, desk.total.J, desk.vectors, slope)
    return ratio
