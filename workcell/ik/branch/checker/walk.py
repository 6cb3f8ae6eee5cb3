"""Walking a proof's tree: every box is contracted afresh, split where the tree says, and every leaf proved."""

from __future__ import annotations

import numpy as np

from workcell.ik.branch.checker.closure import Box, Robot, stand_at_centre
from workcell.ik.branch.checker.lines import EMPTY, ROUNDS, STALLED, contract, contract_once
from workcell.ik.branch.checker.obstacles import Scene, collides, touch
from workcell.jit import exact_inner, exact_kernel
from workcell.pose import Array

PROVED, TOO_SHORT, TOO_LONG, BAD_NODE, BAD_SPLIT, BAD_PAIR, UNPROVED, TOO_DEEP = 0, 1, 2, 3, 4, 5, 6, 7
KINEMATIC, OBSTACLE, SPHERES = -1.0, -2.0, -3.0
_DEPTH = 400


@exact_kernel
def walk(
    robot: Robot,
    scene: Scene,
    root: Array,
    tree: Array,
    splits: Array,
    pairs: Array,
    clearance: float,
    spare: int,
    box: Box,
) -> tuple[int, int]:
    """Check a tree in pre-order (see `workcell.ik.branch.checker.check`); (outcome, index of the node at the end).

    A leaf that can't be proved at once is halved, and its halves are proved by the same reason; `spare` such halvings
    are allowed in all.
    """
    joints = root.shape[1]
    stack = np.zeros((_DEPTH, 2, joints))
    reason = np.zeros((_DEPTH, 3))
    stack[0] = root
    top, node, split, pair = 1, 0, 0, 0
    while top > 0:
        if top + 2 > _DEPTH:
            return TOO_DEEP, node
        top -= 1
        box.lower[:] = stack[top, 0]
        box.upper[:] = stack[top, 1]
        code, s, o = reason[top]
        from_tree = code == 0.0
        if from_tree:
            if node >= tree.shape[0]:
                return TOO_SHORT, node
            code = tree[node]
            node += 1
        if from_tree and code in (OBSTACLE, SPHERES):
            if pair >= pairs.shape[1]:
                return BAD_PAIR, node
            s, o = pairs[0, pair], pairs[1, pair]
            pair += 1
            others = scene.obstacles.shape[0] if code == OBSTACLE else scene.spheres.shape[0]
            if not (0 <= s < scene.spheres.shape[0] and 0 <= o < others):
                return BAD_PAIR, node
        empty = False
        for k in range(joints):
            empty = empty or box.lower[k] > box.upper[k]
        if code in (KINEMATIC, OBSTACLE, SPHERES):
            if empty or _proved(robot, box, scene, code, int(s), int(o), clearance):
                continue
        else:
            empty = empty or not contract(robot, box)
        if code >= 0.0:
            # as a double: one that is too large for an integer would become any
            if not (code <= joints - 3.0) or code != np.floor(code) or split >= splits.shape[0]:
                return BAD_NODE, node
            joint = int(code) + 1
            value = splits[split]
            split += 1
            if not root[0, joint] <= value <= root[1, joint]:
                return BAD_SPLIT, node
            if empty:
                box.lower[joint], box.upper[joint] = 1.0, -1.0
        elif code in (KINEMATIC, OBSTACLE, SPHERES):
            if spare == 0:
                return UNPROVED, node
            spare -= 1
            joint = int(np.argmax(box.upper - box.lower))
            value = 0.5 * (box.lower[joint] + box.upper[joint])
            if box.upper[joint] - box.lower[joint] < 1e-9:
                return UNPROVED, node
        else:
            return BAD_NODE, node
        for half in range(2):
            stack[top + half, 0] = box.lower
            stack[top + half, 1] = box.upper
            reason[top + half] = (0.0, 0.0, 0.0) if code >= 0.0 else (code, s, o)
        if code >= 0.0 and empty:
            top += 2
            continue
        stack[top, 0, joint] = max(box.lower[joint], value)
        stack[top + 1, 1, joint] = min(box.upper[joint], value)
        top += 2
    if node < tree.shape[0] or split < splits.shape[0] or pair < pairs.shape[1]:
        return TOO_LONG, node
    return PROVED, node


@exact_inner
def _proved(robot: Robot, box: Box, scene: Scene, code: float, s: int, o: int, clearance: float) -> bool:
    """Whether a leaf's box is excluded, by the collision it names or because it empties; tried after every round."""
    stand_at_centre(robot, box)
    for _ in range(ROUNDS):
        if code == OBSTACLE and collides(robot, box, scene, s, o, clearance):
            return True
        if code == SPHERES and touch(robot, box, scene, s, o, clearance):
            return True
        outcome = contract_once(robot, box)
        if outcome == EMPTY:
            return True
        if outcome == STALLED:
            break
    if code == OBSTACLE:
        return collides(robot, box, scene, s, o, clearance)
    return code == SPHERES and touch(robot, box, scene, s, o, clearance)
