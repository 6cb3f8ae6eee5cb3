"""What the kernels of this folder know about a robot and its surroundings, and how fast its spheres move.

Along a motion q(t) a sphere's centre x has x' = sum q_k' c_k with c_k the joint's column of its Jacobian, and

    |x''| <= sum_k |c_k| (|q_k''| + |q_k'| (|q_k'| + 2 sum_{j < k} |q_j'|)),

since turning joint j before joint k turns the column c_k, whose length no configuration makes larger than `reach`.
Relative to link a only the joints after a count. Where joints follow others, configurations are of the n variables and
all of that of the m joints.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from workcell.jit import inner
from workcell.kernels.chain import forward
from workcell.kernels.coupling import Couple, follow, spread
from workcell.pose import Array


class Body(NamedTuple):
    """A serial robot's spheres, what they must keep clear of, and what its tool must keep.

    Attributes:
        frames, bounds: the chain, as in `Arm`.
        spheres, balls, obstacles, faces: as in `World`.
        reach: (n + 1, n) largest distance of a link's sphere centres from each joint's axis (1 for a prismatic joint).
        pairs: (p, 2) links with spheres that must keep clear of each other; the first is nearer to the base.
        apart: (m, m) 1 for rows of spheres that must, else 0.
        cone: (7,) an axis in the tool's frame, a direction in the world, and the least cosine between them (-2: any).
        floor: metres of clearance to keep.
        couple: how joints follow from the variables; empty where each joint is one.
    """

    frames: Array
    bounds: Array
    spheres: Array
    balls: Array
    obstacles: Array
    faces: Array
    reach: Array
    pairs: NDArray[np.int64]
    apart: NDArray[np.uint8]
    cone: Array
    floor: float
    couple: Couple


class Room(NamedTuple):
    """Scratch of one query.

    Attributes:
        T: (m + 2, 12) frames. W: (m + 1, 6) each link's velocity: of the point at the world's origin, angular.
        A: (m + 1, m + 1) bound on accelerations of link b's spheres relative to link a.
        q, rate, speed, push: (m,) joint values, their derivatives, and bounds on first and second derivatives.
        lead: (5, n) the same of the variables where joints follow them, and how far they get from the middle.
        slope: (m,) of the joints by their variables, there.
        queue: (.., 2) intervals still to be proved.
    """

    T: Array
    W: Array
    A: Array
    q: Array
    rate: Array
    speed: Array
    push: Array
    lead: Array
    slope: Array
    queue: Array


@inner
def room(body: Body, intervals: int) -> Room:
    """Scratch for a body and that many open intervals."""
    n = body.frames.shape[0] - 2
    return Room(
        np.empty((n + 2, 12)),
        np.zeros((n + 1, 6)),
        np.zeros((n + 1, n + 1)),
        np.empty(n),
        np.empty(n),
        np.empty(n),
        np.zeros(n),
        np.zeros((5, body.bounds.shape[1])),
        np.empty(n),
        np.empty((intervals, 2)),
    )


@inner
def stand(body: Body, q: Array, work: Room) -> None:
    """Frames at the configuration q (n,), into work.T; joints that follow and their slopes beside them."""
    if body.couple.variable.shape[0] == 0:
        forward(body.frames, q, work.T)
    else:
        follow(body.couple, q, work.q, work.slope)
        forward(body.frames, work.q, work.T)


@inner
def lead(body: Body, work: Room) -> None:
    """Rates of all joints, and bounds on them, from those of the variables in work.lead; the joints stand already.

    With p the polynomial by which a joint follows x: (p(x))' = p' x', and |(p(x))''| <= |p'| |x''| + |p''| |x'|^2.
    """
    for k in range(work.q.shape[0]):
        v = body.couple.variable[k]
        steep, bent = spread(body.couple, k, work.lead[0, v], work.lead[4, v])
        speed = work.lead[2, v]
        work.rate[k] = work.slope[k] * work.lead[1, v]
        work.speed[k] = steep * speed
        work.push[k] = steep * work.lead[3, v] + bent * speed * speed


@inner
def twists(frames: Array, T: Array, rate: Array, W: Array) -> None:
    """Velocities W (n + 1, 6) of the links at frames T when the joints move at `rate` (n,)."""
    for k in range(rate.shape[0]):
        zx, zy, zz = T[k + 1, 2], T[k + 1, 5], T[k + 1, 8]
        px, py, pz = T[k + 1, 9], T[k + 1, 10], T[k + 1, 11]
        for r in range(6):
            W[k + 1, r] = W[k, r]
        if frames[k + 1, 12] == 0.0:
            W[k + 1, 0] += rate[k] * (py * zz - pz * zy)
            W[k + 1, 1] += rate[k] * (pz * zx - px * zz)
            W[k + 1, 2] += rate[k] * (px * zy - py * zx)
            W[k + 1, 3] += rate[k] * zx
            W[k + 1, 4] += rate[k] * zy
            W[k + 1, 5] += rate[k] * zz
        else:
            W[k + 1, 0] += rate[k] * zx
            W[k + 1, 1] += rate[k] * zy
            W[k + 1, 2] += rate[k] * zz


@inner
def accelerations(body: Body, speed: Array, push: Array, A: Array) -> float:
    """Bounds A (n + 1, n + 1) for joint rates up to `speed` and their derivatives up to `push` (n,).

    Returns the same for a unit vector that the last link carries.
    """
    n, turning, twisting = speed.shape[0], 0.0, 0.0
    for link in range(1, n + 1):
        total, beyond = 0.0, 0.0
        for k in range(link - 1, -1, -1):
            column = body.reach[link, k]
            if body.frames[k + 1, 12] == 0.0:
                total += speed[k] * (column * speed[k] + 2.0 * beyond)
            total += column * push[k]
            beyond += column * speed[k]
            A[k, link] = total
    for k in range(n):
        if body.frames[k + 1, 12] == 0.0:
            turning += speed[k]
            twisting += push[k]
    return turning * turning + twisting


@inner
def span(spare: float, slope: float, bend: float) -> float:
    """The largest s >= 0 with `spare + slope s - bend s^2 / 2 >= 0`, for spare >= 0."""
    root = math.sqrt(slope * slope + 2.0 * bend * spare)
    if slope < 0.0:
        return 2.0 * spare / (root - slope)
    if bend > 1e-12:
        return (slope + root) / bend
    return 1e12
