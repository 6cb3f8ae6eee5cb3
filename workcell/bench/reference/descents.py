"""Random descents towards planted solutions, compiled: millions of boxes with one, which no contractor may lose."""

from __future__ import annotations

import numpy as np

from workcell.ik.branch.checker.closure import Box, stand_at_centre
from workcell.ik.branch.checker.closure import Robot as Proof
from workcell.ik.branch.checker.linear import follow_closure
from workcell.ik.branch.checker.lines import contract as prove
from workcell.ik.branch.checker.lines import contract_near
from workcell.ik.branch.checker.lines import contract_through as prove_through
from workcell.ik.branch.checker.obstacles import Scene, collides, touch
from workcell.ik.branch.kernels.invariants import contract_invariants, contract_through
from workcell.ik.branch.kernels.linear import contract_linear
from workcell.ik.branch.kernels.neighbours import contract_neighbours
from workcell.ik.branch.kernels.obstacles import Sweep, find_blocked, find_touching
from workcell.ik.branch.kernels.search import contract
from workcell.ik.branch.kernels.state import Chain, State, recentre
from workcell.ik.branch.kernels.world import World
from workcell.jit import exact_kernel
from workcell.pose import Array

EDGE = 1e-9
"""Radians by which a planted angle may stick out of its box: the target of the test is itself rounded."""
SEARCH = ("C1", "C2", "C3", "linear", "all")
"""What of the search is tried, by its number."""
CHECKER = ("near", "through", "linear", "all")
"""What of the checker is tried, by its number."""
FINEST = 1e-7
"""Width of all joints at which a descent ends."""


@exact_kernel
def seed(value: int) -> None:
    """Seed the numbers of the compiled descents."""
    np.random.seed(value)


@exact_kernel
def cut(lower: Array, upper: Array, planted: Array) -> bool:
    """Cut a box at random joints and places so that it still holds `planted`; False when it is small."""
    joints = planted.shape[0]
    share = 0.7 * np.random.random()
    widest = 0.0
    for k in range(1, joints - 1):
        if np.random.random() < share:
            continue
        place = lower[k] + np.random.random() * (upper[k] - lower[k])
        if np.random.random() < 0.2:
            place = planted[k]
        if place < planted[k] or (place == planted[k] and np.random.random() < 0.5):
            lower[k] = place
        else:
            upper[k] = place
    for k in range(1, joints - 1):
        widest = max(widest, upper[k] - lower[k])
    return widest > FINEST


@exact_kernel
def lost(lower: Array, upper: Array, planted: Array) -> bool:
    """Whether a box leaves the planted configuration out."""
    out = False
    for k in range(planted.shape[0]):
        out = out or not (lower[k] - EDGE <= planted[k] <= upper[k] + EDGE)
    return out


@exact_kernel
def descend_search(
    chain: Chain, world: World, state: State, sweep: Sweep, root: Array, planted: Array, which: int, boxes: int
) -> tuple[int, int]:  # fmt: skip
    """Descend until `boxes` have been tried; (boxes, 0), or (box, what) at the first loss.

    What was lost: 1 by a contractor, 2 by an obstacle, 3 by two spheres. The box is left in `state`.
    """
    lower, upper = root[0].copy(), root[1].copy()
    for box in range(boxes):
        state.lower[:] = lower
        state.upper[:] = upper
        recentre(chain, state)
        if which == 0:
            kept = contract_neighbours(chain, state)
        elif which == 1:
            kept = contract_invariants(chain, state)
        elif which == 2:
            kept = contract_through(chain, state)
        elif which == 3:
            kept = contract_linear(chain, state)
        else:
            kept = contract(chain, state)
        if not kept or lost(state.lower, state.upper, planted):
            return box, 1
        if find_blocked(chain, state, world, sweep, -1)[0] >= 0:
            return box, 2
        if find_touching(state, world)[0] >= 0:
            return box, 3
        lower[:] = state.lower
        upper[:] = state.upper
        if not cut(lower, upper, planted):
            lower[:] = root[0]
            upper[:] = root[1]
            cut(lower, upper, planted)
    return boxes, 0


@exact_kernel
def descend_checker(
    robot: Proof, scene: Scene, pairs: Array, box: Box, root: Array, planted: Array, which: int, boxes: int
) -> tuple[int, int]:  # fmt: skip
    """The same with the checker's contractors and collision tests."""
    lower, upper = root[0].copy(), root[1].copy()
    for count in range(boxes):
        box.lower[:] = lower
        box.upper[:] = upper
        stand_at_centre(robot, box)
        if which == 0:
            kept = contract_near(robot, box)
        elif which == 1:
            kept = prove_through(robot, box)
        elif which == 2:
            kept = follow_closure(robot, box)
        else:
            kept = prove(robot, box)
        if not kept or lost(box.lower, box.upper, planted):
            return count, 1
        for s in range(scene.spheres.shape[0]):
            for o in range(scene.obstacles.shape[0]):
                if collides(robot, box, scene, s, o, 0.0):
                    return count, 2
        for p in range(pairs.shape[0]):
            if touch(robot, box, scene, int(pairs[p, 0]), int(pairs[p, 1]), 0.0):
                return count, 3
        lower[:] = box.lower
        upper[:] = box.upper
        if not cut(lower, upper, planted):
            lower[:] = root[0]
            upper[:] = root[1]
            cut(lower, upper, planted)
    return boxes, 0
