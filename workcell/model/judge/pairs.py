"""Which pairs of geoms MuJoCo may bring into contact: its own rules, for all pairs of some bodies at once."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import mujoco

_FILTER_PARENT = 1 << 10
"""MuJoCo's `mjDSBL_FILTERPARENT`, written out so that MuJoCo is not imported here."""
_PLANE, _HEIGHTS = 0, 1
"""MuJoCo's `mjGEOM_PLANE` and `mjGEOM_HFIELD`, which it collides with neither kind."""


def colliding_pairs(
    model: mujoco.MjModel, moving: Collection[int], ignored: Collection[int] = ()
) -> NDArray[np.int64]:
    """Pairs of geoms (p, 2), the lower first and in order, that MuJoCo may bring into contact.

    A `<pair>` counts whatever the rules of bit masks and bodies say; planes and height fields collide with neither.

    Args:
        model: compiled model.
        moving: bodies (ids); of each pair one geom belongs to one of them.
        ignored: bodies (ids) whose geoms don't count.
    """
    body_of = np.asarray(model.geom_bodyid)
    present = ~np.isin(body_of, list(ignored))
    mine = present & np.isin(body_of, list(moving))
    excluded = np.array([[int(s) >> 16, int(s) & 0xFFFF] for s in model.exclude_signature], dtype=np.int64)
    found = [np.zeros((0, 2), dtype=np.int64)]
    for geom in np.flatnonzero(mine):
        meets = present & ~_never_collides(model, int(geom)) & ~_excluded(excluded, body_of, int(geom))
        meets[geom] = False
        others = np.flatnonzero(meets)
        found.append(np.sort(np.stack([np.full_like(others, geom), others], axis=1), axis=1))
    explicit = np.sort(np.stack([model.pair_geom1, model.pair_geom2], axis=1).astype(np.int64), axis=1)
    found.append(explicit[present[explicit].all(axis=1) & mine[explicit].any(axis=1)])
    every = np.unique(np.concatenate(found), axis=0)
    pairs: NDArray[np.int64] = every[~np.isin(model.geom_type, (_PLANE, _HEIGHTS))[every].all(axis=1)]
    return pairs


def _excluded(excluded: NDArray[np.int64], body_of: NDArray[np.int32], geom: int) -> NDArray[np.bool_]:
    """(g,) whether an `<exclude>` keeps each geom's body from that of `geom`."""
    own = int(body_of[geom])
    rows = excluded.reshape(-1, 2)
    away = np.concatenate([rows[rows[:, 0] == own, 1], rows[rows[:, 1] == own, 0]])
    return np.isin(body_of, away)


def _never_collides(model: mujoco.MjModel, geom: int) -> NDArray[np.bool_]:
    """(g,) whether MuJoCo keeps each geom from `geom` for good.

    By its bit masks, or because both are of one rigid body; or because neither can move by itself: both stand in the
    world or on bodies that are moved from outside (mocap); or because one's body is the parent of the other's, unless
    that is the world, or the model disables `filterparent`.
    """
    bits, masks = np.asarray(model.geom_contype), np.asarray(model.geom_conaffinity)
    apart: NDArray[np.bool_] = ((bits & masks[geom]) | (bits[geom] & masks)) == 0
    body = np.asarray(model.geom_bodyid)
    weld = np.asarray(model.body_weldid)
    here, there = int(weld[body[geom]]), weld[body]
    apart |= there == here
    apart |= (model.body_treeid[body] < 0) & (model.body_treeid[body[geom]] < 0)
    if not model.opt.disableflags & _FILTER_PARENT:
        parent = weld[np.asarray(model.body_parentid)[weld]]
        related = (parent[body] == here) | (parent[body[geom]] == there)
        apart |= related & (there != 0) & (here != 0)
    return apart
