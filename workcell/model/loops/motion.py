"""How far passive joints can move while driven joints stay within an interval: Krawczyk's test.

With A an inverse of the loop's derivative by its passive joints u at the middle, and d the joints that are given,

    |A f(middle)| + |A J_d| h + 1/2 sum |A| M h h + (|I - A J_u| + |A| M (h, r)) r <= r

proves that to all d within h of the middle belongs one u within r of its middle, and no other there. M bounds the
second derivatives of what must coincide, by lengths that no configuration exceeds.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from workcell.model.loops.closing import LoopSystem
from workcell.model.loops.elements import Element, bodies_to, joints_on, joints_to
from workcell.pose import Array

if TYPE_CHECKING:
    import mujoco

_ROUNDS, _ROOM = 30, 1.02
"""How often the box is widened until it holds, and by how much beyond what is asked."""
_LARGEST = 0.5
"""Radians (metres) beyond which a box proves nothing of use."""


class LoopBounds:
    """Bounds on a loop's passive joints; what depends on the model alone is computed once.

    Args:
        model: compiled model.
        system: the loop's equations.
    """

    def __init__(self, model: mujoco.MjModel, system: LoopSystem) -> None:
        self._system = system
        self._joints = [*system.passive.tolist(), *system.given.tolist()]
        self._blocks: list[tuple[slice, Array]] = []
        row = 0
        for element in system.elements:
            count = 0 if element.points is None else element.points.shape[1]
            for point in range(count):
                self._blocks.append((slice(row, row + 3), self._bends(model, element, point)))
                row += 3
            row += 0 if count else 1  # a sum of multiples of joints does not bend

    def radii(self, qpos: Array, half: Array) -> Array | None:
        """(k,) how far the passive joints can be from where they are at `qpos`; None: not proved.

        Args:
            qpos: (nq,) raw positions with the loop closed.
            half: (d,) how far each given joint may be from its value there.
        """
        missed, by_passive, by_given = self._system.at(qpos)
        k = by_passive.shape[1]
        A = np.linalg.pinv(by_passive)
        bent = np.zeros((k, len(self._joints), len(self._joints)))
        for rows, bends in self._blocks:
            bent += np.linalg.norm(A[:, rows], axis=1)[:, None, None] * bends
        off = np.abs(A @ missed) + np.abs(A @ by_given) @ half + 0.5 * bent[:, k:, k:] @ half @ half
        slack = np.abs(np.eye(k) - A @ by_passive)
        r = _ROOM * off + 1e-12
        for _ in range(_ROUNDS):
            needed = off + (slack + bent[:, :k, :] @ np.concatenate([r, half])) @ r
            if np.all(needed <= r):
                return r
            r = _ROOM * needed + 1e-12
            if not np.all(r < _LARGEST):
                return None
        return None

    def _bends(self, model: mujoco.MjModel, element: Element, point: int) -> Array:
        """(j, j) bounds on the second derivatives of the difference of an element's two points, metres."""
        assert element.points is not None
        bends = np.zeros((len(self._joints), len(self._joints)))
        hinge = _hinge()
        for body, points in zip(element.bodies, element.points, strict=True):
            chain = joints_to(model, body)
            reach = [_reach(model, joint, body, points[point]) for joint in chain]
            places = [self._joints.index(joint) if joint in self._joints else -1 for joint in chain]
            for first, upper in enumerate(chain):
                if places[first] < 0 or model.jnt_type[upper] != hinge:
                    continue
                for second in range(first, len(chain)):
                    if places[second] < 0:
                        continue
                    turns = model.jnt_type[chain[second]] == hinge
                    bound = reach[second] if turns else 1.0
                    bends[places[first], places[second]] += bound
                    if second != first:
                        bends[places[second], places[first]] += bound
        return bends


def _hinge() -> int:
    import mujoco

    return int(mujoco.mjtJoint.mjJNT_HINGE)


def _reach(model: mujoco.MjModel, joint: int, body: int, point: Array) -> float:
    """Metres that no configuration exceeds between a joint's anchor and a point of a body that it moves."""
    owner, anchor = int(model.jnt_bodyid[joint]), model.jnt_pos[joint]
    path = bodies_to(model, body)
    below = path[path.index(owner) + 1 :]
    length = 0.0
    for one in (owner, *below):
        for other in joints_on(model, one):
            length += 0.0 if other == joint else _slack(model, other)
    at = np.array(anchor)
    for one in below:
        length += float(np.linalg.norm(model.body_pos[one] - at))
        at = np.zeros(3)
    return length + float(np.linalg.norm(point - at))


def _slack(model: mujoco.MjModel, joint: int) -> float:
    """Metres by which a joint can move its body's origin, apart from turning about it."""
    if model.jnt_type[joint] == _hinge():
        return 2.0 * float(np.linalg.norm(model.jnt_pos[joint]))
    if not model.jnt_limited[joint]:
        return math.inf
    reference = float(model.qpos0[model.jnt_qposadr[joint]])
    return float(np.abs(model.jnt_range[joint] - reference).max())


def seen_motion(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    geom: int,
    away: dict[int, float],
    links: dict[int, int],
    count: int,
) -> Array:
    """(count,) metres by which points of a geom can move as seen from each link that carries it; inf beyond them.

    Args:
        model, data: with everything placed.
        geom: id.
        away: by joint (id), how far it may be from where it is.
        links: by joint (id) of the chain, the link that it moves.
        count: links, base included.
    """
    centre, radius = data.geom_xpos[geom], float(model.geom_rbound[geom]) or math.inf
    seen, moved = np.full(count, np.inf), 0.0
    level = max((links.get(joint, 0) for joint in joints_to(model, int(model.geom_bodyid[geom]))), default=0)
    for joint in reversed(joints_to(model, int(model.geom_bodyid[geom]))):
        link = links.get(joint)
        if link is not None:
            seen[link : level + 1] = np.minimum(seen[link : level + 1], moved)
        half = away.get(joint, 0.0)
        if model.jnt_type[joint] == _hinge():
            axis = data.xaxis[joint]
            arm = float(np.linalg.norm(np.cross(centre - data.xanchor[joint], axis))) + radius
            moved += 2.0 * math.sin(0.5 * min(half, math.pi)) * (arm + moved)
        else:
            moved += half
    seen[0] = moved
    return seen
