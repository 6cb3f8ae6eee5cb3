"""Spheres that stand for a mechanism's links, and which of them must keep apart."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from workcell.errors import InputError
from workcell.geometry.covers.outer import cover_of, merge_covers
from workcell.geometry.pieces import mechanism_pieces
from workcell.geometry.self_collision import SelfCollisionPairs
from workcell.geometry.types import SphereCover
from workcell.model.mechanism.mechanism import WORLD, Mechanism
from workcell.model.mechanism.placing import place
from workcell.pose import Array

_FREE = 1e-6
"""Metres that spheres are apart which were made smaller until they don't touch."""


def mechanism_cover(
    mechanism: Mechanism,
    *,
    overshoot: float = 0.02,
    geoms: Collection[int] | None = None,
    standing: Collection[int] = (),
) -> SphereCover:
    """Outer cover of what a mechanism moves, in link frames: every point of a link lies in one of its spheres.

    Args:
        mechanism: with its compiled model.
        overshoot: metres that a sphere may stick out of its link.
        geoms: ids of those that count; None: all that can collide.
        standing: ids of geoms that no joint moves and that get spheres too, on link 0, the world.

    Raises:
        ModelError: no compiled model, or a geom that has no convex form; InputError: an overshoot that makes no sense.
    """
    links = mechanism_pieces(mechanism, geoms)
    world = [piece for piece in links[WORLD] if piece.geom in standing]
    return merge_covers(
        *(
            cover_of(pieces if link != WORLD else world, overshoot, link=link)
            for link, pieces in enumerate(links)
        )
    )


def sphere_geoms(mechanism: Mechanism, cover: SphereCover) -> NDArray[np.int64]:
    """(m,) ids of the geoms that the spheres of a mechanism's cover are of; -1: of none."""
    known = {piece.name: piece.geom for pieces in mechanism_pieces(mechanism) for piece in pieces}
    return np.array([known.get(name, -1) for name in cover.source], dtype=np.int64)


def apart_pairs(
    mechanism: Mechanism,
    cover: SphereCover,
    may_collide: NDArray[np.int64],
    configurations: Array,
    known_free: Array | None = None,
) -> SelfCollisionPairs:
    """The pairs of spheres that must keep apart: those of geoms that may collide, if spheres can tell.

    Left out are pairs that touch in every one of some configurations, and those that touch where the mechanism is known
    to be free: both are the covers' overshoot.

    Args:
        mechanism: whose.
        cover: its spheres, as `mechanism_cover` makes them.
        may_collide: (p, 2) ids of geoms.
        configurations: (c, size) at which ties hold.
        known_free: (k, size) at which the mechanism is known to hit nothing; None: not known.

    Raises:
        InputError: no configurations.
    """
    if not len(configurations):
        raise InputError("no configurations tell nothing", where="configurations")
    pairs, links = _candidates(cover, sphere_geoms(mechanism, cover), may_collide)
    always = np.arange(len(pairs))
    for q in configurations:
        always = always[_gaps(mechanism, cover, pairs[always], q) <= 0.0]
    tolerated = np.zeros(len(pairs), dtype=bool)
    for q in () if known_free is None else known_free:
        tolerated |= _gaps(mechanism, cover, pairs, q) <= 0.0
    tolerated[always] = False
    kept = ~tolerated
    kept[always] = False
    return SelfCollisionPairs(pairs[kept], pairs[always], pairs[tolerated], links=links)


def fitted_cover(
    mechanism: Mechanism, cover: SphereCover, pairs: NDArray[np.int64], known_free: Array
) -> SphereCover:
    """The cover with spheres made smaller, by no more than their overshoot, that touch where the mechanism is free.

    They stand no longer for all of the geometry, but can tell how near two links are that are close to each other
    there, such as fingers side by side.

    Args:
        mechanism: whose.
        cover: its outer spheres.
        pairs: (p, 2) of spheres that would have to keep apart.
        known_free: (k, size) at which the mechanism is known to hit nothing.
    """
    assert cover.overshoot is not None
    less, over = np.zeros(len(cover)), cover.overshoot[pairs]
    share = over / np.maximum(over.sum(axis=1, keepdims=True), 1e-12)
    for q in known_free:
        inside = np.maximum(_FREE - _gaps(mechanism, cover, pairs, q), 0.0)
        for side in (0, 1):
            np.maximum.at(less, pairs[:, side], inside * share[:, side])
    less = np.minimum(np.minimum(less, cover.overshoot), 0.9 * cover.radius)
    if not less.any():
        return cover
    return replace(cover, radius=cover.radius - less, overshoot=cover.overshoot - less, kind="given")


def _candidates(
    cover: SphereCover, geoms: NDArray[np.int64], may_collide: NDArray[np.int64]
) -> tuple[NDArray[np.int64], tuple[tuple[int, int], ...]]:
    """Pairs (p, 2) of spheres of geoms that may collide, the one on the lower link first; and the pairs of links."""
    known, index = np.unique(geoms, return_inverse=True)
    place = {int(geom): k for k, geom in enumerate(known) if geom >= 0}
    may = np.zeros((len(known), len(known)), dtype=bool)
    for one, two in may_collide.tolist():
        if one in place and two in place:
            may[place[one], place[two]] = may[place[two], place[one]] = True
    meets = may[index[:, None], index[None, :]] & (cover.link[:, None] < cover.link[None, :])
    found = np.argwhere(meets).astype(np.int64)
    links = np.unique(cover.link[found].reshape(-1, 2), axis=0)
    return found, tuple((int(a), int(b)) for a, b in links.tolist())


def _gaps(mechanism: Mechanism, cover: SphereCover, pairs: NDArray[np.int64], q: Array) -> Array:
    centres = place(mechanism, q).points(cover.link, cover.centre)
    one, two = pairs.T
    gaps: Array = np.linalg.norm(centres[one] - centres[two], axis=1) - cover.radius[one] - cover.radius[two]
    return gaps
