"""Exclusion by obstacles: a box is excluded when some sphere collides in every configuration of it.

The centre of a sphere, seen from the base or from the target, stays within its motion radius of where it is at the
box's centre; to first order it moves along the tangent of the linear step, with a second-order remainder. When all of
that lies inside an obstacle swollen by the sphere's radius, the whole box collides. Obstacles are convex, so a swept
segment is inside when its ends are; for boxes the extent is compared axis by axis.

Two spheres of the robot on links a < b: |E_{a+1} ... E_b x_b - x_a| is at most their distance at the centre, the motion
radius of x_b under the joints beyond some link l between, and that of x_a under those up to l. Joints up to a move
both.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from workcell.ik.branch.kernels.elimination import spread
from workcell.ik.branch.kernels.motion import arm, ball_radius
from workcell.ik.branch.kernels.state import SLACK, Chain, State
from workcell.ik.branch.kernels.world import World, signed_distance, to_local
from workcell.jit import exact_inner, exact_kernel
from workcell.kernels.shape_kinds import BOX
from workcell.pose import Array


class Sweep(NamedTuple):
    """Where one sphere's centre can be: a ball, and by the linear step a segment with noise around it.

    Attributes:
        ball: (4,) point and radius.
        ends: (2, 3) ends of the segment.
        noise: (6 + N, 3) shifts on top: six times the linear step's noise (see `elimination.spread`), then one for each
            joint, times a number in [-1, 1].
        rest: (3,) radius of what remains; from which end of the chain; 1 once the segment has been computed.
    """

    ball: Array
    ends: Array
    noise: Array
    rest: Array


@exact_kernel
def new_sweep(joints: int) -> Sweep:
    """Room for one."""
    return Sweep(np.zeros(4), np.zeros((2, 3)), np.zeros((6 + joints, 3)), np.zeros(3))


@exact_kernel
def find_blocked(chain: Chain, state: State, world: World, sweep: Sweep, hint: int) -> tuple[int, int, float]:
    """A sphere and an obstacle that collide all over the box, and an upper bound on their clearance.

    (-1, -1, 0) if there are none. `hint` (sphere * number of obstacles + obstacle, or -1) is tried first:
    neighbouring boxes are blocked alike.
    """
    obstacles = world.obstacles.shape[0]
    limit = world.clearance[0] + world.clearance[1]
    if obstacles == 0:
        return -1, -1, 0.0
    if hint >= 0:
        s, o = hint // obstacles, hint % obstacles
        _bound_ball(chain, state, world.spheres[s], sweep)
        bound = blocked_bound(chain, state, world, s, o, sweep)
        if bound < limit:
            return s, o, bound
    for s in range(world.spheres.shape[0]):
        radius = world.spheres[s, 4] + limit
        _bound_ball(chain, state, world.spheres[s], sweep)
        x, y, z = sweep.ball[0], sweep.ball[1], sweep.ball[2]
        for o in range(obstacles):
            row = world.obstacles[o]
            if (
                x > row[16] - radius and x < row[19] + radius
                and y > row[17] - radius and y < row[20] + radius
                and z > row[18] - radius and z < row[21] + radius
            ):  # fmt: skip
                bound = blocked_bound(chain, state, world, s, o, sweep)
                if bound < limit:
                    return s, o, bound
    return -1, -1, 0.0


@exact_kernel
def find_touching(state: State, world: World) -> tuple[int, int, float]:
    """Two spheres of the robot that collide all over the box, and a bound on their clearance; (-1, -1, 0) if none."""
    limit = world.clearance[0] + world.clearance[1]
    lines, sweep = state.lines[0], state.sweep[0]
    for p in range(world.pairs.shape[0]):
        s, o = world.pairs[p]
        one, two = world.spheres[s], world.spheres[o]
        first, last = int(one[0]), int(two[0])
        ax, ay, az = sphere_centre(state.frames[0, first], one)
        bx, by, bz = sphere_centre(state.frames[0, last], two)
        gap = np.sqrt((ax - bx) ** 2 + (ay - by) ** 2 + (az - bz) ** 2) - one[4] - two[4]
        if gap >= limit:
            continue
        moved = 0.0
        for k in range(first + 1, last + 1):
            if sweep[k] > 0.0:
                moved += sweep[k] * arm(bx, by, bz, lines[k])
        least = moved
        for k in range(first + 1, last + 1):
            if sweep[k] > 0.0:
                moved += sweep[k] * (arm(ax, ay, az, lines[k]) - arm(bx, by, bz, lines[k]))
                least = min(least, moved)
        if gap + least + SLACK < limit:
            return s, o, gap + least + SLACK
    return -1, -1, 0.0


@exact_inner
def sphere_centre(frame: Array, sphere: Array) -> tuple[float, float, float]:
    """Centre of a sphere (a row of `World.spheres`) of the link with a frame (12,)."""
    return (
        frame[9] + frame[0] * sphere[1] + frame[1] * sphere[2] + frame[2] * sphere[3],
        frame[10] + frame[3] * sphere[1] + frame[4] * sphere[2] + frame[5] * sphere[3],
        frame[11] + frame[6] * sphere[1] + frame[7] * sphere[2] + frame[8] * sphere[3],
    )


@exact_inner
def blocked_bound(chain: Chain, state: State, world: World, s: int, o: int, sweep: Sweep) -> float:
    """Upper bound on the clearance of sphere s from obstacle o over the box (inf when their centres are apart)."""
    gradient = np.empty(3)
    radius = world.spheres[s, 4]
    ball = sweep.ball
    depth = signed_distance(world, o, ball[0], ball[1], ball[2], gradient) - radius
    if depth >= world.clearance[0] + world.clearance[1]:
        return np.inf
    bound = depth + ball[3]
    if bound < world.clearance[0]:
        return bound + SLACK  # type: ignore[no-any-return]
    if sweep.rest[2] == 0.0:
        _bound_segment(chain, state, world.spheres[s], sweep)
    if world.obstacles[o, 0] == BOX:
        inside = _box_bound(chain, state, world.obstacles[o], sweep) - radius
        return min(bound, inside) + SLACK  # type: ignore[no-any-return]
    squares = 0.0
    for a in range(3):
        squares += (
            _extent(
                chain, state, sweep, 1.0 if a == 0 else 0.0, 1.0 if a == 1 else 0.0, 1.0 if a == 2 else 0.0
            )
            ** 2
        )
    rest = np.sqrt(squares)
    worst = -np.inf
    for e in range(2):
        end = sweep.ends[e]
        worst = max(worst, signed_distance(world, o, end[0], end[1], end[2], gradient))
    return min(bound, worst + rest - radius) + SLACK  # type: ignore[no-any-return]


@exact_inner
def _box_bound(chain: Chain, state: State, row: Array, sweep: Sweep) -> float:
    """Largest signed distance to a box over the sweep, the extents along its axes taken one by one."""
    ax, ay, az = to_local(row, sweep.ends[0, 0], sweep.ends[0, 1], sweep.ends[0, 2])
    bx, by, bz = to_local(row, sweep.ends[1, 0], sweep.ends[1, 1], sweep.ends[1, 2])
    cx, cy, cz = to_local(row, sweep.ball[0], sweep.ball[1], sweep.ball[2])
    squares, inside = 0.0, -np.inf
    for axis in range(3):
        extent = _extent(chain, state, sweep, row[1 + axis], row[4 + axis], row[7 + axis])
        first, second, middle = (ax, bx, cx) if axis == 0 else ((ay, by, cy) if axis == 1 else (az, bz, cz))
        reach = min(max(abs(first), abs(second)) + extent, abs(middle) + sweep.ball[3])
        over = reach - row[13 + axis]
        inside = max(inside, over)
        if over > 0.0:
            squares += over * over
    return np.sqrt(squares) if squares > 0.0 else inside


@exact_inner
def _extent(chain: Chain, state: State, sweep: Sweep, u: float, v: float, w: float) -> float:
    """How far the noise and the remainder reach along a unit direction."""
    weights = np.empty(6)
    extent = sweep.rest[0]
    for k in range(sweep.noise.shape[0]):
        along = u * sweep.noise[k, 0] + v * sweep.noise[k, 1] + w * sweep.noise[k, 2]
        if k < 6:
            weights[k] = along
        else:
            extent += abs(along)
    if state.tangent[0, 0] > 0.0:
        extent += spread(weights, state.tangent[0, 3:9], state.tangent[0, 9:12], chain.ball)
    return extent  # type: ignore[no-any-return]


@exact_inner
def _bound_ball(chain: Chain, state: State, sphere: Array, sweep: Sweep) -> None:
    """The ball, from whichever end of the chain bounds the sphere's centre better."""
    joints = state.lower.shape[0]
    k = int(sphere[0])
    best = np.inf
    for side in range(2):
        x, y, z = sphere_centre(state.frames[side, k], sphere)
        count = k + 1 if side == 0 else joints - 1 - k
        radius = 0.0 if side == 0 else ball_radius(x, y, z, chain.ball)
        for j in range(count):
            if state.sweep[side, j] > 0.0:
                radius += state.sweep[side, j] * arm(x, y, z, state.lines[side, j])
                if radius >= best:
                    break
        if radius < best:
            best = radius
            sweep.ball[0], sweep.ball[1], sweep.ball[2], sweep.ball[3] = x, y, z, radius
            sweep.rest[1], sweep.rest[2] = float(side), 0.0


@exact_inner
def _bound_segment(chain: Chain, state: State, sphere: Array, sweep: Sweep) -> None:
    """The segment, on the side that `_bound_ball` chose; without a tangent every joint is noise of its own."""
    joints = state.lower.shape[0]
    side = int(sweep.rest[1])
    k = int(sphere[0])
    x, y, z = sweep.ball[0], sweep.ball[1], sweep.ball[2]
    count = k + 1 if side == 0 else joints - 1 - k
    tangent = state.tangent
    known = tangent[0, 0] > 0.0
    noise = sweep.noise
    noise[:] = 0.0
    shift, slope = np.zeros(3), np.zeros(3)
    # The ball also turns what the joints have moved.
    rest, turned = (0.0, 0.0) if side == 0 else (ball_radius(x, y, z, chain.ball), chain.ball[1])
    outer = 0.0
    for j in range(count):
        if state.sweep[side, j] == 0.0:
            continue
        joint = j if side == 0 else joints - 1 - j
        sign = 1.0 if side == 0 else -1.0
        line = state.lines[side, j]
        u, v, w = x - line[3], y - line[4], z - line[5]
        mx, my, mz = line[1] * w - line[2] * v, line[2] * u - line[0] * w, line[0] * v - line[1] * u
        low, high = state.lower[joint] - state.centre[joint], state.upper[joint] - state.centre[joint]
        half = max(high, -low)
        # The second order as the third in `linear`: the term in which the joint isn't differentiated integrates to
        # outer^2 half / 6.
        if line[9] > 0.0:
            mx, my, mz = line[0], line[1], line[2]
            rest += ((1.0 + outer / 6.0) * outer + turned) * half
        else:
            bent = 0.5 * ((outer + half) ** 2 - outer**2) + (outer**2 / 6.0 + turned) * half
            rest += bent * np.sqrt(mx * mx + my * my + mz * mz)
            outer += half
        mx, my, mz = sign * mx, sign * my, sign * mz
        if known:
            row = tangent[joint]
            _add(shift, row[1], mx, my, mz)
            _add(slope, row[2], mx, my, mz)
            for r in range(6):
                _add(noise[r], row[3 + r], mx, my, mz)
            if tangent[0, 2] > 1.0:
                for f in range(1, joints - 1):
                    _add(noise[6 + f], row[12 + f], mx, my, mz)
        else:
            _add(shift, 0.5 * (low + high), mx, my, mz)
            _add(noise[6 + j], 0.5 * (high - low), mx, my, mz)
    first, second = 0.0, 0.0
    if known and tangent[0, 1] >= 0.0:
        free = int(tangent[0, 1]) + 1
        first, second = state.lower[free] - state.centre[free], state.upper[free] - state.centre[free]
    if known and tangent[0, 2] > 1.0:
        # The other free joints are noise as well, around the middle of their ranges.
        for f in range(1, joints - 1):
            low, high = state.lower[f] - state.centre[f], state.upper[f] - state.centre[f]
            for a in range(3):
                shift[a] += 0.5 * (low + high) * noise[6 + f, a]
                noise[6 + f, a] *= 0.5 * (high - low)
    for a in range(3):
        start = (x if a == 0 else (y if a == 1 else z)) + shift[a]
        sweep.ends[0, a] = start + first * slope[a]
        sweep.ends[1, a] = start + second * slope[a]
    sweep.rest[0], sweep.rest[2] = rest + SLACK, 1.0


@exact_inner
def _add(out: Array, scale: float, x: float, y: float, z: float) -> None:
    out[0] += scale * x
    out[1] += scale * y
    out[2] += scale * z
