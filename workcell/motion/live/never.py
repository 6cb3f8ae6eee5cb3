"""Links of one arm that can't touch whatever its joints do: found once, by the compiled model's own distances."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from workcell.identity_cache import ByIdentity
from workcell.motion.live.packing import levers
from workcell.motion.live.surroundings import Arms
from workcell.world.planning_world import PlanningWorld

_MOST_LOOKS = 20_000
"""Distances that are asked for, at most, of two links."""
_MOST_JOINTS = 2
_APART = 2e-4
"""Metres below which links are not said to be apart."""

_found = ByIdentity()


def never_touch(arms: Arms, links: Collection[tuple[int, int]]) -> set[tuple[int, int]]:
    """Which of some pairs of links, numbered as in `arms.robot`, the lower first, can't touch within joint limits.

    Between two links that one or two joints part, distances are a function of these. The box of their limits is cut
    until everywhere the distance at a part's centre is more than the links can move within it.
    """
    proved = set()
    for world, first in zip(arms.worlds, arms.first_link, strict=True):
        known: dict[tuple[int, int], bool] = _found.get((world,), dict)
        for pair in links:
            a, b = (link - first if link else 0 for link in pair)
            if not 0 <= a < b <= world.robot.robot.joint_count:
                continue
            if (a, b) not in known:
                known[a, b] = _are_apart(world, a, b)
            if known[a, b]:
                proved.add(pair)
    return proved


def _are_apart(world: PlanningWorld, a: int, b: int) -> bool:
    robot, loops = world.robot.robot, world.robot.loops
    if robot.coupling is not None or (loops is not None and (loops.loops or loops.limits)):
        return False
    lever = levers(robot, world.cover)[a, b]
    joints = np.flatnonzero(lever > 0.0)
    rows = np.flatnonzero((world.collision.pair_links == [a, b]).all(axis=1))
    if not (0 < len(joints) <= _MOST_JOINTS and len(rows) > 0):
        return False
    model, lever, q = world.collision.only(rows), lever[joints], np.array(world.robot.start)
    low, high = robot.lower[joints], robot.upper[joints]
    around = (high - low >= 2.0 * np.pi) & ~robot.prismatic[joints]
    low, high = np.where(around, -np.pi, low), np.where(around, np.pi, high)
    boxes, looks = [(0.5 * (low + high), 0.5 * (high - low))], 0
    while boxes:
        centre, half = boxes.pop()
        q[joints] = centre
        distance, looks = model.distance(q).distance, looks + 1
        if not distance > _APART or looks > _MOST_LOOKS:
            return False
        if distance - _APART > lever @ half:
            continue
        longest = int(np.argmax(lever * half))
        part = half.copy()
        part[longest] *= 0.5
        for side in (-1.0, 1.0):
            moved = centre.copy()
            moved[longest] += side * part[longest]
            boxes.append((moved, part))
    return True
