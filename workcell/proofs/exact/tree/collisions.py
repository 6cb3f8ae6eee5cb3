"""Spheres that are inside an obstacle all over a box (rule 6.8)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workcell.proofs.exact.problems import Problem
from workcell.proofs.exact.tree.fixed import ONE, SHIFT, Flags, Ints, cross, down, nearest, root_up, up
from workcell.proofs.exact.tree.relations import Blur
from workcell.proofs.exact.tree.views import FixedArm, View
from workcell.proofs.exact.vectors import Vector

_LARGEST_SIZE = 4 * ONE
_SORTS = ("box", "sphere", "cylinder")


@dataclass(frozen=True, slots=True)
class Pairs:
    """Spheres and obstacles that leaves name, in whole numbers; or those of N boxes, one each.

    Attributes:
        link: (pairs,) of the sphere.
        centre: (3, pairs) in its link.
        reach: (pairs,) r + c, rounded down.
        sort: (pairs,) of the obstacle: 0 a box, 1 a sphere, 2 a cylinder.
        place, axes, sizes: (3, pairs), (3, 3, pairs), (3, pairs) of the obstacle; sizes rounded down.
    """

    link: Ints
    centre: Ints
    reach: Ints
    sort: Ints
    place: Ints
    axes: Ints
    sizes: Ints

    def of(self, which: Ints) -> Pairs:
        """One for each of some boxes."""
        parts = (self.link, self.centre, self.reach, self.sort, self.place, self.axes, self.sizes)
        return Pairs(*(part[..., which] for part in parts))


def named_pairs(problem: Problem, named: list[tuple[int, int]], clearance: float, units: int) -> Pairs:
    """The spheres and obstacles that leaves name, in units of length of `2 ** units` metres."""

    def floor(metres: float) -> int:
        numerator, denominator = metres.as_integer_ratio()
        return min((numerator << SHIFT + 20) // (denominator << 20 + units), _LARGEST_SIZE)

    def array(rows: list[list[int]], *shape: int) -> Ints:
        return np.array(rows, dtype=np.int64).reshape(len(named), *shape)

    def vector(v: Vector, of: int) -> list[int]:
        return [nearest(entry, of) for entry in v]

    spheres = [problem.arm.spheres[s] for s, _ in named]
    obstacles = [problem.obstacles[o] for _, o in named]
    axes = [[entry for row in o.axes for entry in vector(row, 0)] for o in obstacles]
    sizes = [[floor(size) for size in (*o.sizes, 0.0, 0.0)[:3]] for o in obstacles]
    return Pairs(
        np.array([s.link for s in spheres], dtype=np.int64),
        array([vector(s.centre, units) for s in spheres], 3).T,
        np.array([floor(s.radius) + floor(clearance) for s in spheres], dtype=np.int64),
        np.array([_SORTS.index(o.sort) for o in obstacles], dtype=np.int64),
        array([vector(o.centre, units) for o in obstacles], 3).T,
        array(axes, 3, 3).transpose(1, 2, 0),
        array(sizes, 3).T,
    )


def inside(arm: FixedArm, base: View, target: View, half: Ints, blur: Blur, named: Pairs) -> Flags:
    """(N,) whether a box's sphere is nearer to its obstacle than c at every candidate."""
    slack = 8 * arm.error
    chord = np.minimum(half, 2 * ONE)
    joint = np.arange(1, arm.joints + 1)[:, None]
    each = np.arange(half.shape[1])
    proved = np.zeros(half.shape[1], dtype=bool)
    for view in (base, target):
        rotation = view.rotation[named.link, :, :, each].transpose(1, 2, 0)
        centre = view.origin[named.link, :, each].T + down((rotation * named.centre[None]).sum(axis=1))
        levers = down(cross(centre[:, None] - view.near[:, 1:-1], view.along[:, 1:-1]))
        moved = up(chord * (root_up((levers * levers).sum(axis=0)) + slack))
        between = joint <= named.link if view is base else joint > named.link
        stray = np.where(between, moved, 0).sum(axis=0)
        if view is target:
            from_pole = centre - arm.pole[:, None]
            stray += blur.position + up(
                blur.rotation * (root_up((from_pole * from_pole).sum(axis=0)) + slack)
            )
        proved |= distance_up(named, centre) + slack + stray < named.reach
    return proved


def distance_up(named: Pairs, centre: Ints) -> Ints:
    """The signed distances of places to obstacles, rounded up but for the errors of the places and axes."""
    apart = centre - named.place
    u = np.abs(down((named.axes * apart[:, None]).sum(axis=0))) + 1
    round_, ball = named.sort == 2, named.sort == 1
    across = root_up((u[:2] * u[:2]).sum(axis=0))
    beyond = np.stack(
        [
            np.where(ball, root_up((u * u).sum(axis=0)), np.where(round_, across, u[0])) - named.sizes[0],
            np.where(round_, u[2], u[1]) - named.sizes[1],
            u[2] - named.sizes[2],
        ]
    )
    beyond[1:, ball] = -2 * _LARGEST_SIZE
    beyond[2, round_] = -2 * _LARGEST_SIZE
    outside = np.maximum(beyond, 0)
    distance: Ints = root_up((outside * outside).sum(axis=0)) + np.minimum(beyond.max(axis=0), 0)
    return distance
