"""The tree: boxes are contracted, excluded or split, depth first, and every decision is written down."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from workcell.ik.branch.kernels.coupled import contract_coupled
from workcell.ik.branch.kernels.invariants import contract_invariants, contract_through
from workcell.ik.branch.kernels.linear import contract_linear
from workcell.ik.branch.kernels.local import search_from
from workcell.ik.branch.kernels.neighbours import contract_neighbours
from workcell.ik.branch.kernels.obstacles import Sweep, find_blocked, find_touching
from workcell.ik.branch.kernels.state import Chain, State, recentre
from workcell.ik.branch.kernels.world import World
from workcell.jit import exact_inner, exact_kernel
from workcell.pose import Array

DONE, FOUND, PAUSED, FULL = 0, 1, 2, 3
"""How a run of the search ended: every box excluded (or left), a configuration in `found`, node count reached, no
room."""
EMPTY, AGAIN, STALLED = 0, 1, 2
"""How a contraction ended."""
ROUNDS = 8
"""Times the contractors are repeated on a box."""
SHRINK = 0.85
"""Share of its width below which some joint must come for another round."""
SMALL = 0.1
"""Width of all joints below which obstacles are looked at between two contractions."""
SMALLEST = 1e-7
"""Width in radians of all joints at which a box is given up."""

_PATIENCE = 16
"""Boxes after which a local search starts wherever the search stands."""


class Tree(NamedTuple):
    """The search's memory.

    Attributes:
        stack: (depth, 2, N) boxes to come.
        nodes: (capacity, 4) in pre-order: joint (from 0) of a split or -1 (kinematics), -2 (obstacle), -3 (two
            spheres), -4 (given up); then the split's value; for an obstacle sphere and obstacle and the bound on their
            clearance, for two spheres the same.
        counts: (8,) boxes on the stack; nodes; leaves: kinematic, colliding, given up; local searches; hint;
            boxes since the last local search.
        found: (N,) a configuration that the local search reached.
        best_gap: (1,) by how much the best configuration in reach of the target kept (missed, if negative) the
            clearance.
    """

    stack: Array
    nodes: Array
    counts: NDArray[np.int64]
    found: Array
    best_gap: Array


@exact_kernel
def contract(chain: Chain, state: State) -> bool:
    """Shrink the box by all contractors until little changes; False if it holds no solution."""
    for _ in range(ROUNDS):
        outcome = contract_once(chain, state)
        if outcome != AGAIN:
            return outcome != EMPTY
    return True


@exact_inner
def contract_once(chain: Chain, state: State) -> int:
    """Shrink the box once: EMPTY if it holds no solution, AGAIN if that paid, else STALLED.

    The cheap contractors go on alone as long as they pay.
    """
    joints = state.lower.shape[0]
    width = np.empty(joints)
    for k in range(joints):
        width[k] = state.upper[k] - state.lower[k]
    if not contract_coupled(chain, state):
        return EMPTY
    recentre(chain, state)
    if not contract_neighbours(chain, state) or not contract_invariants(chain, state):
        return EMPTY
    if not contract_coupled(chain, state):
        return EMPTY
    if _shrunk(state, width):
        return AGAIN
    if not contract_through(chain, state) or not contract_linear(chain, state):
        return EMPTY
    if not contract_coupled(chain, state):
        return EMPTY
    return AGAIN if _shrunk(state, width) else STALLED


@exact_inner
def _is_small(state: State) -> bool:
    """Whether the box is small enough that one more look at the obstacles costs less than contracting it further."""
    widest = 0.0
    for k in range(state.lower.shape[0]):
        widest = max(widest, state.upper[k] - state.lower[k])
    return widest <= SMALL


@exact_inner
def _shrunk(state: State, width: Array) -> bool:
    """Whether some joint's interval is much narrower than `width` (N,)."""
    shrunk = False
    for k in range(width.shape[0]):
        shrunk = shrunk or state.upper[k] - state.lower[k] < SHRINK * width[k]
    return shrunk


@exact_kernel
def choose_split(chain: Chain, state: State) -> tuple[int, float]:
    """Joint (of the kernels) to split, and where; (-1, 0) when the box is too small."""
    joints = state.lower.shape[0]
    joint, widest = -1, 0.0
    largest = 0.0
    for k in range(1, joints - 1):
        width = state.upper[k] - state.lower[k]
        largest = max(largest, width)
        width *= chain.weights[0 if state.tangent[0, 0] == 0.0 else 1, k]
        if width > widest:
            joint, widest = k, width
    if largest < SMALLEST:
        return -1, 0.0
    width = state.upper[joint] - state.lower[joint]
    # Few digits keep certificates short; where the cut falls within the middle third doesn't matter.
    grid = 10.0 ** np.floor(np.log10(width) - 1.0)
    return joint, np.round(0.5 * (state.lower[joint] + state.upper[joint]) / grid) * grid


@exact_kernel
def run(
    chain: Chain, world: World, root: Array, state: State, sweep: Sweep, tree: Tree, tolerance: Array, limit: int
) -> int:  # fmt: skip
    """Work on up to `limit` boxes of the stack; returns DONE, FOUND, PAUSED or FULL. `root` (2, N) bounds solutions."""
    counts, nodes = tree.counts, tree.nodes
    for _ in range(limit):
        if counts[0] == 0:
            return DONE
        if counts[0] + 2 > tree.stack.shape[0] or counts[1] + 1 > nodes.shape[0]:
            return FULL
        counts[0] -= 1
        state.lower[:] = tree.stack[counts[0], 0]
        state.upper[:] = tree.stack[counts[0], 1]
        node = nodes[counts[1]]
        node[:] = 0.0
        counts[1] += 1
        if _excluded(chain, state, world, sweep, tree, node):
            continue
        joint, value = choose_split(chain, state)
        if joint < 0:
            node[0] = -4.0
            counts[4] += 1
        else:
            _push(state, tree, node, joint, value)
        counts[7] += 1
        if counts[7] >= _PATIENCE or (state.tangent[0, 0] > 0.0 and counts[7] >= 2):
            _pick_start(state, tree)
            if search_from(chain, world, root[0], root[1], tree.found, tolerance, 12, tree.best_gap):
                return FOUND
    return PAUSED


@exact_inner
def _excluded(chain: Chain, state: State, world: World, sweep: Sweep, tree: Tree, node: Array) -> bool:
    """Contract the box; whether it holds no solution, with the reason written down in `node`."""
    looked = False
    for _ in range(ROUNDS):
        outcome = contract_once(chain, state)
        if outcome == EMPTY:
            node[0] = -1.0
            tree.counts[2] += 1
            return True
        if outcome == STALLED:
            break
        if not looked and _is_small(state):
            looked = True
            if _collides(chain, state, world, sweep, tree, node):
                return True
    return _collides(chain, state, world, sweep, tree, node)


@exact_inner
def _collides(chain: Chain, state: State, world: World, sweep: Sweep, tree: Tree, node: Array) -> bool:
    """Whether a sphere collides all over the box, written down in `node`."""
    counts = tree.counts
    sphere, other, bound = find_blocked(chain, state, world, sweep, counts[6])
    node[0] = -2.0
    if sphere >= 0:
        counts[6] = sphere * world.obstacles.shape[0] + other
    else:
        sphere, other, bound = find_touching(state, world)
        node[0] = -3.0
    if sphere < 0:
        node[0] = 0.0
        return False
    node[1], node[2], node[3] = sphere, other, bound
    counts[3] += 1
    return True


@exact_inner
def _pick_start(state: State, tree: Tree) -> None:
    """Where the next local search begins: the box's centre and, in turn, a random place in a box still to come."""
    counts = tree.counts
    counts[5] += 1
    counts[7] = 0
    if counts[5] % 2 == 1 or counts[0] == 0:
        for k in range(state.lower.shape[0]):
            tree.found[k] = 0.5 * (state.lower[k] + state.upper[k])
        return
    waiting = counts[5] // 2 % counts[0]
    for k in range(state.lower.shape[0]):
        # Kronecker's sequence: a different irrational for every joint.
        share = counts[5] * np.sqrt(k + 0.7)
        share -= np.floor(share)
        lower, upper = tree.stack[waiting, 0, k], tree.stack[waiting, 1, k]
        tree.found[k] = lower + share * (upper - lower)


@exact_inner
def _push(state: State, tree: Tree, node: Array, joint: int, value: float) -> None:
    """Put both halves on the stack and write the split down."""
    top = tree.counts[0]
    node[0], node[1] = joint - 1.0, value
    for half in range(2):
        tree.stack[top + half, 0] = state.lower
        tree.stack[top + half, 1] = state.upper
    tree.stack[top, 0, joint] = value
    tree.stack[top + 1, 1, joint] = value
    tree.counts[0] = top + 2
