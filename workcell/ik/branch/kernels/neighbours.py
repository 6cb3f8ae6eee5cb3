"""C1: a joint from the next axis, as seen from the base and from the target.

A point x of axis i + 1 goes round axis i. From the base it is at E_1 ... E_i x; from the target at x', uncertain by the
joints beyond i + 1 and the tolerance ball. Undoing E_1 ... E_{i-1} on x' gives |E_i x - x'| <= R with R the sum of its
motion radii: a bound on the distance along the axis, on the distance from it, and an arc for the angle. The same holds
for the direction of axis i + 1, and for the chain counted from the target (view 1). A joint i that slides instead goes
along its axis by -(x - x') . z, give or take what R leaves of the distance across; and points of a sliding axis i + 1
move with it, which widens R.
"""

from __future__ import annotations

import numpy as np

from workcell.ik.branch.kernels.arcs import clip_to_arcs
from workcell.ik.branch.kernels.motion import ball_radius, direction_radius, own_slide, point_radius
from workcell.ik.branch.kernels.state import SLACK, Chain, State, tighten
from workcell.jit import exact_inner, exact_kernel
from workcell.pose import Array


@exact_inner
def turn_arc(
    z: Array, ux: float, uy: float, uz: float, vx: float, vy: float, vz: float, radius: float
) -> tuple[float, float]:
    """(phase, half width) of the turns about the unit axis z that bring u within `radius` of v; width -1 if none."""
    along = z[0] * (ux - vx) + z[1] * (uy - vy) + z[2] * (uz - vz)
    room = (radius + SLACK) ** 2 - max(abs(along) - SLACK, 0.0) ** 2
    if room < 0.0:
        return 0.0, -1.0
    du = z[0] * ux + z[1] * uy + z[2] * uz
    dv = z[0] * vx + z[1] * vy + z[2] * vz
    ux, uy, uz = ux - du * z[0], uy - du * z[1], uz - du * z[2]
    vx, vy, vz = vx - dv * z[0], vy - dv * z[1], vz - dv * z[2]
    length_u, length_v = np.sqrt(ux * ux + uy * uy + uz * uz), np.sqrt(vx * vx + vy * vy + vz * vz)
    room -= max(abs(length_u - length_v) - SLACK, 0.0) ** 2
    if room < 0.0:
        return 0.0, -1.0
    product = 4.0 * length_u * length_v
    if room >= product * (1.0 - 1e-9) or product < 1e-12:
        return 0.0, np.pi
    cross = z[0] * (uy * vz - uz * vy) + z[1] * (uz * vx - ux * vz) + z[2] * (ux * vy - uy * vx)
    # The phase errs by rounding over length; half the chord is room's root over the geometric mean of both.
    width = 2.0 * np.arcsin(np.sqrt(room / product)) + 8.0 * SLACK / np.sqrt(product)
    return np.arctan2(cross, ux * vx + uy * vy + uz * vz), width


@exact_inner
def turn_joint(state: State, view: int, k: int, phase: float, width: float) -> bool:
    """Keep of the joint at index k of a view the departures within `width` of `phase`; False if none is left."""
    if width < 0.0:
        return False
    if width >= np.pi:
        return True
    joint = k if view == 0 else state.lower.shape[0] - 1 - k
    sign = 1.0 if view == 0 else -1.0
    # Departures are measured from the centre at which the frames were computed, wherever the box has shrunk to.
    phase = state.centre[joint] + sign * phase
    lower, upper = clip_to_arcs(phase, 0.0, width, state.lower[joint], state.upper[joint])
    return lower <= upper and tighten(state, joint, lower, upper)


@exact_inner
def _slide_joint(state: State, view: int, k: int, x: float, y: float, w: float, radius: float) -> bool:
    """Keep of a sliding joint the departures that bring u within `radius` of v, u - v given; False if none is left."""
    z = state.lines[view, k]
    along = z[0] * x + z[1] * y + z[2] * w
    room = (radius + SLACK) ** 2 - max(x * x + y * y + w * w - along * along - SLACK, 0.0)
    if room < 0.0:
        return False
    joint = k if view == 0 else state.lower.shape[0] - 1 - k
    middle = state.centre[joint] + (-along if view == 0 else along)
    return tighten(state, joint, middle - np.sqrt(room), middle + np.sqrt(room))  # type: ignore[no-any-return]


@exact_kernel
def contract_neighbours(chain: Chain, state: State) -> bool:
    """Apply C1 to every joint from both ends; False if the box holds no solution."""
    joints = state.lower.shape[0]
    for view in range(2):
        lines, others = state.lines[view], state.lines[1 - view]
        sweep, sweeps = state.sweep[view], state.sweep[1 - view]
        for k in range(1, joints - 1):
            beyond = joints - 2 - k
            axis, u, v = lines[k], lines[k + 1], others[beyond]
            radius = (
                ball_radius(v[3], v[4], v[5], chain.ball)
                + point_radius(v[3], v[4], v[5], lines, sweep, k)
                + point_radius(v[3], v[4], v[5], others, sweeps, beyond)
                + own_slide(others, sweeps, beyond)
            )
            if axis[9] > 0.0:
                if not _slide_joint(state, view, k, u[6] - v[3], u[7] - v[4], u[8] - v[5], radius):
                    return False
            else:
                phase, width = turn_arc(
                    axis[:3],
                    u[6] - axis[3], u[7] - axis[4], u[8] - axis[5],
                    v[3] - axis[3], v[4] - axis[4], v[5] - axis[5],
                    radius,
                )  # fmt: skip
                if not turn_joint(state, view, k, phase, width):
                    return False
            radius = (
                chain.ball[1]
                + direction_radius(v[0], v[1], v[2], lines, sweep, k)
                + direction_radius(v[0], v[1], v[2], others, sweeps, beyond)
            )
            if axis[9] > 0.0:
                if (u[0] - v[0]) ** 2 + (u[1] - v[1]) ** 2 + (u[2] - v[2]) ** 2 > (radius + SLACK) ** 2:
                    return False
                continue
            phase, width = turn_arc(axis[:3], u[0], u[1], u[2], v[0], v[1], v[2], radius)
            if not turn_joint(state, view, k, phase, width):
                return False
    return True
