"""Pairs of a robot's own spheres that must not touch.

All but those of adjacent links, those that always touch, and those proved apart.
"""

from __future__ import annotations

import importlib
import itertools
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workcell.errors import InputError
from workcell.geometry.packing import NO_GRADIENT, pack_spheres, pack_tree
from workcell.geometry.types import SphereCover
from workcell.model.robot import LIMIT_SLACK, Robot
from workcell.pose import Array, read_only

Index = NDArray[np.int64]
Mask = NDArray[np.bool_]
Links = tuple[tuple[int, int], ...]
_NONE = np.empty((0, 2), dtype=np.int64)
_MOST_GAPS = 400_000
"""Gaps that may be computed to prove one pair of links apart."""
_ROUNDING = 1e-9
"""Metres that a proved gap must exceed."""


@dataclass(frozen=True, slots=True)
class SelfCollisionPairs:
    """Which of a cover's spheres are checked against each other, and which are not, and why.

    Attributes:
        pairs: (p, 2) numbers of spheres, the one on the lower link first: those to check.
        always: (a, 2) left out because they touched at every configuration that was looked at.
        tolerated: (t, 2) left out because they touch where the robot is known not to hit itself: the covers' overshoot.
        never: (v, 2) left out because they are proved apart at all configurations within the limits.
        links: pairs of links that were looked at, the lower first.
    """

    pairs: Index
    always: Index = field(default_factory=_NONE.copy)
    tolerated: Index = field(default_factory=_NONE.copy)
    never: Index = field(default_factory=_NONE.copy)
    links: Links = ()

    def __post_init__(self) -> None:
        for name in ("pairs", "always", "tolerated", "never"):
            object.__setattr__(self, name, read_only(np.reshape(getattr(self, name), (-1, 2)), np.int64))

    def __len__(self) -> int:
        return len(self.pairs)

    def tolerating(self, robot: Robot, cover: SphereCover, known_free: ArrayLike) -> SelfCollisionPairs:
        """The same without the pairs that touch where the robot is known to be free.

        Args:
            robot, cover: of these pairs.
            known_free: configurations (n,) or (c, n) at which the robot is known not to hit itself.

        Raises:
            InputError: configurations of the wrong shape, or not finite.
        """
        touching = np.any(_gaps(robot, cover, self.pairs, _free(robot, known_free)) <= 0, axis=0)
        tolerated = np.concatenate([self.tolerated, self.pairs[touching]])
        return replace(self, pairs=self.pairs[~touching], tolerated=tolerated)


def self_collision_pairs(
    robot: Robot,
    cover: SphereCover,
    *,
    links: Iterable[tuple[int, int]] | None = None,
    carried: Collection[int] = (),
    known_free: ArrayLike | None = None,
    samples: int = 1000,
    seed: int = 0,
    prove: bool = True,
) -> SelfCollisionPairs:
    """The pairs of spheres that a robot may hit itself with.

    Left out are spheres of one link and of adjacent links (a link and the one that carries it), pairs that touch at
    every one of `samples` random configurations, pairs that touch at a configuration known to be free, and pairs proved
    never to touch. A pair that merely didn't touch at the samples is kept.

    Args:
        robot: a tree or a chain.
        cover: its spheres, by link.
        links: pairs of links that can collide at all, such as `CollisionModel.self_links` of the compiled model; None:
            any.
        carried: spheres (numbers) of an object in the hand: it is no part of the link that carries it, and may hit the
            link that carries that one.
        known_free: configurations (n,) or (c, n) at which the robot is known not to hit itself; None: not known.
        samples: random configurations within the limits.
        seed: of these.
        prove: look for pairs that can never touch (a fraction of a second); False: they are kept.

    Raises:
        InputError: a link that is not there, configurations of the wrong shape or not finite, no samples.
    """
    chosen, adjacent = _link_pairs(robot, links)
    if samples < 1:
        raise InputError(f"{samples} samples tell nothing", where="samples", remedy="1 or more")
    besides = _sphere_pairs(cover, adjacent)
    besides = besides[np.isin(besides, list(carried)).any(axis=1)]
    candidates = np.concatenate([_sphere_pairs(cover, chosen), besides])
    rng = np.random.default_rng(seed)
    touching: Mask = _gaps(robot, cover, candidates, robot.random_configuration(rng, samples)) <= 0
    always: Mask = np.all(touching, axis=0)
    tolerated: Mask = np.zeros(len(candidates), dtype=bool)
    never = tolerated
    if known_free is not None:
        free = _free(robot, known_free)
        tolerated = np.any(_gaps(robot, cover, candidates, free) <= 0, axis=0) & ~always
    if prove:
        never = _never_touch(robot.uncoupled, cover, candidates, ~np.any(touching, axis=0) & ~tolerated)
    kept = ~(always | tolerated | never)
    return SelfCollisionPairs(
        candidates[kept], candidates[always], candidates[tolerated], candidates[never], chosen
    )


def _free(robot: Robot, known_free: ArrayLike) -> Array:
    """Configurations (c, n), looked at for what makes no sense."""
    return np.array([robot.configuration(row, where="known_free") for row in np.atleast_2d(known_free)])


def _link_pairs(robot: Robot, links: Iterable[tuple[int, int]] | None) -> tuple[Links, Links]:
    """Pairs of links, the lower first, and those of adjacent ones."""
    count = robot.joint_count + 1
    listed = itertools.combinations(range(count), 2) if links is None else links
    chosen = set()
    for pair in listed:
        a, b = sorted(map(int, pair)) if len(pair) == 2 else (0, 0)
        if a < 0 or b >= count or a == b:
            raise InputError(
                f"no pair of links {tuple(pair)}", where="links", remedy=f"two of 0 (the base) to {count - 1}"
            )
        chosen.add((a, b))
    adjacent = {(a, b) for a, b in chosen if int(robot.parents[b - 1]) == a}
    return tuple(sorted(chosen - adjacent)), tuple(sorted(adjacent))


def _sphere_pairs(cover: SphereCover, links: Links) -> Index:
    """All pairs (p, 2) of spheres of these pairs of links."""
    members = {link: np.flatnonzero(cover.link == link) for link in {link for pair in links for link in pair}}
    grids = [np.stack(np.meshgrid(members[a], members[b], indexing="ij"), axis=-1) for a, b in links]
    return np.concatenate([_NONE, *(grid.reshape(-1, 2) for grid in grids)])


def _gaps(robot: Robot, cover: SphereCover, pairs: Index, q: Array) -> Array:
    """Gaps (c, p) of pairs (p, 2) at configurations (c, n)."""
    q = robot.joint_values(q)
    kernels: Any = importlib.import_module("workcell.kernels.sphere_gaps")
    gap = np.empty((len(q), len(pairs)))
    kernels.self_gaps(
        pack_tree(robot), pack_spheres(robot, cover), np.array(pairs), np.array(q), gap, NO_GRADIENT
    )
    return gap


def _never_touch(robot: Robot, cover: SphereCover, pairs: Index, asked: Mask) -> Mask:
    """Which of the pairs (p, 2) that are asked for are proved apart at all configurations that count as admissible."""
    proved = np.zeros(len(pairs), dtype=bool)
    links = cover.link[pairs]
    for a, b in np.unique(links[asked], axis=0):
        rows = np.flatnonzero((links == (a, b)).all(axis=1) & asked)
        proved[rows] = _proved_apart(robot, cover, pairs[rows], int(a), int(b))
    return proved


def _proved_apart(robot: Robot, cover: SphereCover, pairs: Index, a: int, b: int) -> Mask:
    """Which pairs (p, 2) between two links are apart in every cell of the joints between them.

    In a cell around q with half widths h a gap is at least gap(q) - sum_k lever_k h_k, where lever_k bounds the
    distance of the carried centre from joint k. Cells in which that is not positive are halved until none is left or
    too many gaps have been computed.
    """
    joints = sorted(set(robot.path_to(a)) ^ set(robot.path_to(b)))
    levers = _levers(robot, cover, pairs, a, b, joints)
    middle = 0.5 * (robot.lower + robot.upper)[joints][None]
    half = 0.5 * (robot.upper - robot.lower)[joints][None] + LIMIT_SLACK
    live, unproved, spent = np.ones(len(pairs), dtype=bool), np.ones(len(pairs), dtype=bool), 0
    while len(middle) and live.any() and spent + len(middle) * live.sum() <= _MOST_GAPS:
        q = np.repeat(robot.home[None], len(middle), axis=0)
        q[:, joints] = middle
        columns = np.flatnonzero(live)
        gap = _gaps(robot, cover, pairs[columns], q)
        spent += gap.size
        touching = (gap <= _ROUNDING).any(axis=0)
        live[columns[touching]] = False
        columns, gap = columns[~touching], gap[:, ~touching]
        opened = gap - half @ levers[columns].T <= _ROUNDING
        unproved[columns] = opened.any(axis=0)
        left = np.flatnonzero(opened.any(axis=1))
        if len(left):
            middle, half = _halved(middle[left], half[left], levers[columns].max(axis=0))
        else:
            break
    # A pair that is apart in all of the last cells is proved, even where others used up the budget.
    return live & ~unproved


def _halved(middle: Array, half: Array, lever: Array) -> tuple[Array, Array]:
    """Cells (2 c, d), each cut across the joint that moves the spheres most."""
    rows, widest = np.arange(len(middle)), np.argmax(half * lever, axis=1)
    smaller, shift = half.copy(), np.zeros_like(half)
    smaller[rows, widest] *= 0.5
    shift[rows, widest] = smaller[rows, widest]
    return np.concatenate([middle - shift, middle + shift]), np.concatenate([smaller, smaller])


def _levers(robot: Robot, cover: SphereCover, pairs: Index, a: int, b: int, joints: list[int]) -> Array:
    """(p, joints) metres per radian (1: prismatic) by which a joint moves the centre that it carries, at most.

    The centre's distance from the joint's axis is no longer than the way along the links.
    """
    levers = np.empty((len(pairs), len(joints)))
    for column, joint in enumerate(joints):
        side, link = (1, b) if joint in robot.path_to(b) else (0, a)
        if robot.prismatic[joint]:
            levers[:, column] = 1.0
            continue
        centre = cover.centre[pairs[:, side]]
        if joint == link - 1:
            levers[:, column] = np.linalg.norm(np.cross(robot.axis[joint], centre), axis=1)
            continue
        later = [k for k in robot.path_to(link) if k > joint]
        farthest = np.maximum(np.abs(robot.lower), np.abs(robot.upper)) + LIMIT_SLACK
        travel = np.where(robot.prismatic, farthest, 0.0)
        way = np.linalg.norm(robot.joint_xyz[later], axis=1).sum() + travel[later].sum()
        levers[:, column] = way + np.linalg.norm(centre, axis=1)
    return levers
