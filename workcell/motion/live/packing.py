"""Robots and scenes as the live kernels take them, and the room that a frame works in: all made once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from workcell.geometry.packing import axis_frames, pack_obstacles, pack_spheres, pack_tree
from workcell.geometry.types import Piece, SphereCover
from workcell.model.robot import LIMIT_SLACK, Robot
from workcell.motion.live.limits import LiveLimits
from workcell.pose import Array

if TYPE_CHECKING:
    from workcell.kernels.coupling import Couple
    from workcell.motion.live.kernels.desk import Desk
    from workcell.motion.live.kernels.limbs import Limbs
    from workcell.motion.live.kernels.motion import Motion
    from workcell.motion.live.kernels.near import Movers

Index = NDArray[np.int64]
_ENDLESS = 1e9
"""Stands for a limit that there is none of."""


def pack_limbs(
    robot: Robot, tools: Sequence[str], cover: SphereCover, pairs: Index, limits: LiveLimits
) -> tuple[Limbs, Index]:
    """The robot for the kernels, and for each sphere of the cover (in its own order) its row there."""
    from workcell.motion.live.kernels.limbs import Limbs

    order = np.argsort(cover.link, kind="stable")
    row_of = np.empty(len(order), dtype=np.int64)
    row_of[order] = np.arange(len(order))
    spheres = np.ascontiguousarray(pack_spheres(robot, cover)[order]).reshape(-1, 5)
    links = np.arange(robot.joint_count + 1)
    rows = np.column_stack(
        [np.searchsorted(cover.link[order], links, side) for side in ("left", "right")]
    ).astype(np.int64)
    turned = axis_frames(robot)
    frames = np.zeros((len(tools), 13))
    for t, name in enumerate(tools):
        tool = robot.tool(name)
        back = turned[tool.link].T
        frames[t, 0] = tool.link
        frames[t, 1:10] = (back @ tool.T_link_tool.rotation).ravel()
        frames[t, 10:] = back @ tool.T_link_tool.position
    rates = np.minimum(np.stack([limits.velocity, limits.acceleration, limits.jerk]), _ENDLESS)
    own, runs = _by_links(np.reshape(row_of[pairs], (-1, 2)), cover.link[order])
    limbs = Limbs(
        pack_tree(robot),
        _couple(robot),
        frames,
        spheres,
        rows,
        _balls(spheres, links),
        own,
        runs,
        levers(robot, cover),
        np.full((len(links), len(links)), np.nan),
        np.stack([robot.lower, robot.upper]),
        rates,
    )
    return limbs, row_of


def _balls(spheres: Array, links: Index) -> Array:
    """(m + 1, 4) a ball around the spheres of each link, in its axis frame; a radius of -1 where there are none."""
    balls = np.zeros((len(links), 4))
    balls[:, 3] = -1.0
    for link in links:
        mine = spheres[spheres[:, 4] == link]
        if len(mine):
            low, high = (mine[:, :3] - mine[:, 3:4]).min(axis=0), (mine[:, :3] + mine[:, 3:4]).max(axis=0)
            centre = 0.5 * (low + high)
            # a little larger: sums of distances round
            radius = np.max(np.linalg.norm(mine[:, :3] - centre, axis=1) + mine[:, 3]) + 1e-9
            balls[link] = *centre, radius
    return balls


def _by_links(pairs: Index, link: Index) -> tuple[Index, Index]:
    """Pairs (p, 2) of spheres sorted by links, the lower one first, and their runs (b, 5)."""
    pairs = np.where((link[pairs[:, 0]] > link[pairs[:, 1]])[:, None], pairs[:, ::-1], pairs)
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0], link[pairs[:, 1]], link[pairs[:, 0]]))]
    both = np.column_stack([link[pairs], pairs[:, 0]])
    first = (
        np.flatnonzero(np.r_[True, np.any(both[1:] != both[:-1], axis=1)]) if len(pairs) else np.zeros(0, int)
    )
    runs = np.column_stack([both[first], first, np.r_[first[1:], len(pairs)][: len(first)]])
    return np.ascontiguousarray(pairs, dtype=np.int64), np.ascontiguousarray(runs, dtype=np.int64)


def _couple(robot: Robot) -> Couple:
    from workcell.kernels.coupling import Couple

    if robot.coupling is not None:
        return Couple(np.array(robot.coupling.variable), np.array(robot.coupling.coefficients))
    return Couple(np.arange(robot.dof), np.tile([0.0, 1.0], (robot.dof, 1)))


def levers(robot: Robot, cover: SphereCover) -> Array:
    """(m + 1, m + 1, m) bounds on how far a radian (or metre) of each joint moves points of link b seen from a < b.

    Row 0 is seen from the world. A point's distance from a joint's axis is at most the way along the links to it, at
    any configuration within the limits.
    """
    links, joints = robot.joint_count + 1, robot.joint_count
    radius = np.zeros(links)
    np.maximum.at(radius, cover.link, np.linalg.norm(cover.centre, axis=1) + cover.radius)
    reaches = np.stack([reach(robot, link, radius[link]) for link in range(links)])
    made = np.zeros((links, links, joints))
    for b in range(1, links):
        for a in range(b):
            made[a, b] = between(robot, a, b, reaches[a], reaches[b])
    return made


def reach(robot: Robot, link: int, radius: float) -> Array:
    """(m,) bounds on how far a radian (or metre) of each joint moves points of a link within a radius of its frame."""
    plain = robot.uncoupled
    farthest = np.maximum(np.abs(plain.lower), np.abs(plain.upper)) + LIMIT_SLACK
    farthest = np.where(np.isfinite(farthest), farthest, _ENDLESS)
    step = np.linalg.norm(plain.joint_xyz, axis=1) + np.where(plain.prismatic, farthest, 0.0)
    found, way = np.zeros(robot.joint_count), radius
    for joint in reversed(plain.path_to(link)):
        if joint != link - 1:
            way += step[_child(plain, joint, link)]
        found[joint] = 1.0 if plain.prismatic[joint] else way
    return found


def between(robot: Robot, a: int, b: int, reach_a: Array, reach_b: Array) -> Array:
    """(m,) bounds on how far joints move points of link b seen from link a, by the reaches (m,) of both."""
    plain = robot.uncoupled
    made = np.zeros(robot.joint_count)
    for joint in set(plain.path_to(a)) ^ set(plain.path_to(b)):
        made[joint] = max(reach_a[joint], reach_b[joint])
    return made


def _child(robot: Robot, joint: int, link: int) -> int:
    """The joint after `joint` on the way to a link."""
    path = robot.path_to(link)
    return path[path.index(joint) + 1]


def pack_movers(pieces: Sequence[Piece]) -> Movers:
    """Obstacles that move, at rest where they are."""
    from workcell.motion.live.kernels.near import Movers

    rows, faces = pack_obstacles(pieces)
    moves = np.zeros((len(pieces), 9))
    moves[:, 6:] = rows[:, 1:4]
    return Movers(rows, faces, moves, rows.copy())


def make_desk(limbs: Limbs, shapes: int) -> Desk:
    """Room for the frames of these limbs among some shapes that stand."""
    from workcell.motion.live.kernels.desk import Desk
    from workcell.motion.live.kernels.limbs import Place
    from workcell.motion.live.kernels.near import MOST_NEAR, Near
    from workcell.motion.live.kernels.program import Program
    from workcell.motion.live.kernels.terms import Sum

    n, m = limbs.bounds.shape[1], len(limbs.couple.variable)
    tools, spheres, links = len(limbs.tools), len(limbs.spheres), m + 1
    small = min(6, n)
    rows = 2 * n + 2 * MOST_NEAR + 2 * tools
    place = Place(
        np.empty(m), np.empty(m), np.empty((links, 12)), np.empty((tools, 12)), np.empty((spheres, 3)),
        np.empty((links, 3)), np.empty(m),
    )  # fmt: skip
    total = Sum(
        np.empty(n), np.eye(n), np.zeros(7), np.zeros((tools, 2)), np.empty((6, n)), np.empty(6), np.empty((6, n)),
        np.empty(3),
    )  # fmt: skip
    near = Near(
        np.empty(MOST_NEAR), np.empty(MOST_NEAR), np.zeros((MOST_NEAR, 3), dtype=np.int64), np.empty((MOST_NEAR, n)),
        np.zeros(1, dtype=np.int64), np.zeros(shapes, dtype=np.int64),
    )  # fmt: skip
    program = Program(
        np.empty((n + 1, n + 1)), np.empty((n + 1, n + 1)), np.empty(n + 1), np.empty((rows, n + 1)), np.empty(rows),
        np.zeros(2, dtype=np.int64), np.zeros(n + 2, dtype=np.int64), np.empty(n + 2), np.empty((n + 2, n + 1)),
        np.empty((n + 2, n + 2)), np.empty(n + 1), np.empty(n + 2), np.empty(n + 1), np.zeros(rows, dtype=np.bool_),
    )  # fmt: skip
    return Desk(
        place, total, near, program, np.empty((n + 1, n + 1)), np.zeros(tools), np.empty((4 + tools, 6 + n)),
        np.empty((small, small)), np.empty((small, small)), np.empty(n), np.empty(n), np.empty((links + 1, links)),
        np.empty((links + 1, links)), np.zeros((2, n)), np.zeros(1, dtype=np.int64),
    )  # fmt: skip


def make_motion(limbs: Limbs) -> Motion:
    """Room for the arm's state."""
    from workcell.motion.live.kernels.motion import MOST_GUARDS, Motion

    n, m, tools = limbs.bounds.shape[1], len(limbs.couple.variable), len(limbs.tools)
    guards = MOST_GUARDS + 1 + 3 * n + tools
    return Motion(
        np.zeros((3, n)), np.zeros((3, n)), np.zeros((2, n)), np.zeros((3, n)), np.zeros(n), np.zeros((2, n)),
        np.zeros(n, dtype=np.int64), np.zeros(n), np.zeros(n, dtype=np.int64), np.zeros((3, n)), np.zeros(n),
        np.zeros(m), np.zeros(6),
        np.zeros((guards, 4), dtype=np.int64), np.zeros(guards), np.zeros(1, dtype=np.int64),
        np.zeros(2 * n + 3 * tools + 8), np.zeros(4, dtype=np.int64),
    )  # fmt: skip
