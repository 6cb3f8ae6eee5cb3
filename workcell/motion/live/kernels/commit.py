"""What a live frame does before and after the guard: goals in, histories, stops, what is told."""

from __future__ import annotations

from workcell.jit import kernel, lean
from workcell.kernels.shapes import Shapes, to_shape
from workcell.motion.live.kernels.braking import stop_time, stopping
from workcell.motion.live.kernels.desk import Desk, Surroundings, condition
from workcell.motion.live.kernels.frame import Frame
from workcell.motion.live.kernels.limbs import Limbs, Place, put
from workcell.motion.live.kernels.march import drift_of_step, drifts
from workcell.motion.live.kernels.motion import ACCELERATION, NEAR, POSITION, SINGULARITY, VELOCITY, Motion
from workcell.motion.live.kernels.near import find_near, link_gaps, move_obstacles
from workcell.motion.live.kernels.rows import note
from workcell.motion.live.kernels.terms import AWARE, Wish, weigh
from workcell.pose import Array

ON_GOAL_M, ON_GOAL_RAD = 1e-3, 5e-3
"""Errors within which a tool is on its goal."""
_AT_LIMIT = 1e-3
"""Radians or metres from a limit at which a joint stands at it."""
_FULL = 0.999
"""Share of a limit that is all of it."""
_HELD = 5e-3
"""Metres beyond what rows keep, within which what is nearest holds an arm that rests off its goal."""
_REST = 1e-3
"""Share of its fastest at which a joint rests."""


@kernel
def along_stop(frame: Frame, period: float, q: Array, moved: Array) -> None:
    """Configurations q (c, n) at even times of the stop after the next state, the first at that state itself.

    And bounds (c, m) on how far joints move until the following one, in the first row from now on.
    """
    _along_stop(frame.limbs, frame.motion, period, q, moved)


@lean
def _along_stop(limbs: Limbs, motion: Motion, period: float, q: Array, moved: Array) -> None:
    """See `along_stop`."""
    count, n, whole = q.shape[0], motion.end.shape[0], 0.0
    for k in range(n):
        whole = max(
            whole, stop_time(motion.next[1, k], motion.next[2, k], limbs.rates[1, k], limbs.rates[2, k])
        )
    for i in range(count):
        t = whole * i / count
        for k in range(n):
            x = stopping(motion.next[1, k], motion.next[2, k], limbs.rates[1, k], limbs.rates[2, k], t)[0]
            q[i, k] = motion.next[0, k] + x
        drifts(limbs, motion.next, t, whole / count, motion)
        for j in range(motion.drift.shape[0]):
            moved[i, j] = motion.drift[j]
    drift_of_step(limbs, motion, motion.next, period)
    for j in range(motion.drift.shape[0]):
        moved[0, j] += motion.drift[j]


@kernel
def commit(frame: Frame, refused: bool) -> None:
    """The next state, or where it is refused the stop, becomes the present one; what is told of it is written down.

    Histories of the relaxed solution and of the arm's own go on.
    """
    _commit(frame.limbs, frame.around, frame.wish, frame.mine, frame.desk, frame.motion, refused)


@lean
def _commit(
    limbs: Limbs, around: Surroundings, wish: Wish, mine: Wish, desk: Desk, motion: Motion, refused: bool
) -> None:  # fmt: skip
    """See `commit`."""
    n, tools = motion.end.shape[0], wish.goals.shape[0]
    for k in range(n):
        for r in range(3):
            motion.now[r, k] = motion.stop[r, k] if refused else motion.next[r, k]
        motion.then[k] = motion.wanted[0, k]
    put(limbs, motion.then, desk.place)
    for t in range(tools):
        for c in range(3):
            wish.tools[t, c] = desk.place.tools[t, 9 + c]
    _remember(wish, motion.wanted[0])
    put(limbs, motion.now[0], desk.place)
    desk.near.used[0] = 0
    weigh(limbs, mine, desk.place, desk.near, motion.now[0], desk.total)
    for t in range(tools):
        desk.ratio[t] = condition(limbs, around, desk, t)
        for c in range(3):
            mine.tools[t, c] = desk.place.tools[t, 9 + c]
    _remember(mine, motion.now[0])
    _note_joints(limbs, motion)
    for t in range(tools):
        if desk.ratio[t] < 1.2 * around.least[t]:
            note(motion, SINGULARITY, t, 0, 0, desk.ratio[t])
    _tell(limbs, wish, desk, motion, refused)
    held = motion.flags[2] == 0 and motion.flags[3] != 0
    if motion.flags[1] == 0 or held:
        _note_nearest(limbs, around, desk, motion, around.keep[0] + around.keep[1] + _HELD)


@lean
def _remember(wish: Wish, q: Array) -> None:
    """The newest of three configurations (n,)."""
    for k in range(q.shape[0]):
        wish.past[2, k], wish.past[1, k], wish.past[0, k] = wish.past[1, k], wish.past[0, k], q[k]


@lean
def _note_nearest(limbs: Limbs, around: Surroundings, desk: Desk, motion: Motion, margin: float) -> None:
    """Write down what the limbs, as they have been put, are nearest to, if it is nearer than the margin."""
    near, nearest = desk.near, -1
    move_obstacles(around.movers, 0.0)
    find_near(limbs, around.shapes, around.movers, around.skipped, desk.place, margin, margin, near)
    for c in range(near.used[0]):
        if nearest < 0 or near.gap[c] < near.gap[nearest]:
            nearest = c
    if nearest >= 0:
        who = near.who[nearest]
        note(motion, NEAR, who[0], who[1], who[2], near.gap[nearest])


@lean
def _note_joints(limbs: Limbs, motion: Motion) -> None:
    """Write down which limits joints are at."""
    for k in range(motion.end.shape[0]):
        q, qd = motion.now[0, k], abs(motion.now[1, k])
        room = min(q - limbs.bounds[0, k], limbs.bounds[1, k] - q)
        if room < _AT_LIMIT:
            note(motion, POSITION, k, 0, 0, room)
        if qd >= _FULL * limbs.rates[0, k]:
            note(motion, VELOCITY, k, 0, 0, qd / limbs.rates[0, k])
        if motion.limited[k] != 0:
            note(motion, ACCELERATION, k, 0, 0, abs(motion.now[2, k]) / limbs.rates[1, k])


@lean
def _tell(limbs: Limbs, wish: Wish, desk: Desk, motion: Motion, refused: bool) -> None:
    """Write down the arm's state, its errors and how the frame went."""
    n, tools, out = motion.end.shape[0], wish.goals.shape[0], motion.out
    on_goal, rests = True, True
    for k in range(n):
        out[k], out[n + k] = motion.now[0, k], motion.now[1, k]
        rests = rests and abs(motion.now[1, k]) <= _REST * limbs.rates[0, k]
    for t in range(tools):
        for c in range(2):
            out[2 * n + c * tools + t] = desk.total.errors[t, c]
        on_goal = on_goal and desk.total.errors[t, 0] <= ON_GOAL_M and desk.total.errors[t, 1] <= ON_GOAL_RAD
        out[2 * n + 2 * tools + 7 + t] = desk.ratio[t]
    for c in range(7):
        out[2 * n + 2 * tools + c] = desk.total.terms[c]
    out[2 * n + 3 * tools + 7] = motion.report[2]
    motion.flags[0] = refused or motion.report[0] < 1.0
    motion.flags[1] = motion.report[1] != 0.0
    motion.flags[2], motion.flags[3] = on_goal, rests


@kernel
def set_goal(frame: Frame, t: int, position: Array, quat_wxyz: Array, weight: float) -> None:
    """Tool t is to go to a pose, exactly."""
    goal = frame.wish.goals[t]
    w, x, y, z = quat_wxyz[0], quat_wxyz[1], quat_wxyz[2], quat_wxyz[3]
    goal[0], goal[1], goal[2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    goal[3], goal[4], goal[5] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    goal[6], goal[7], goal[8] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    for c in range(3):
        goal[9 + c] = position[c]
    goal[12] = weight
    for c in range(12):
        goal[13 + c] = 0.0
    goal[25] = 1.0 if weight > 0.0 else 0.0


@kernel
def sample(frame: Frame, q: Array, ratios: Array, gaps: Array) -> None:
    """What is usual at configurations (b, n).

    Conditioning (b, k) of every tool, and gaps (b, m + 1, m + 1) of the links' own pairs, a lower and a higher link.
    """
    _sample(frame.limbs, frame.around, frame.desk, q, ratios, gaps)


@lean
def _sample(
    limbs: Limbs, around: Surroundings, desk: Desk, q: Array, ratios: Array, gaps: Array
) -> None:  # fmt: skip
    """See `sample`."""
    shapes, movers, skipped, near = around.shapes, around.movers, around.skipped, desk.near
    for b in range(q.shape[0]):
        put(limbs, q[b], desk.place)
        link_gaps(limbs, shapes, movers, skipped, desk.place, AWARE, desk.gaps, near.close)
        for i in range(gaps.shape[1]):
            for j in range(gaps.shape[2]):
                gaps[b, i, j] = desk.gaps[i + 1, j]
        for t in range(ratios.shape[1]):
            ratios[b, t] = condition(limbs, around, desk, t)


@kernel
def gaps_at(frame: Frame, q: Array, out: Array) -> None:
    """Gaps (s, k) of all spheres to all shapes at q (n,), whether they count or not."""
    _gaps_at(frame.limbs, frame.around.shapes, frame.desk.place, q, out)


@lean
def _gaps_at(limbs: Limbs, shapes: Shapes, place: Place, q: Array, out: Array) -> None:
    """See `gaps_at`."""
    put(limbs, q, place)
    for i in range(out.shape[0]):
        x, y, z = place.centres[i, 0], place.centres[i, 1], place.centres[i, 2]
        for j in range(out.shape[1]):
            out[i, j] = to_shape(shapes, j, x, y, z)[0] - limbs.spheres[i, 3]
