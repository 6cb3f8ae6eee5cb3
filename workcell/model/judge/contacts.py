"""MuJoCo's own collision pipeline as a second opinion: what it has in contact is not clear."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from workcell.errors import ModelError
from workcell.model.judge.distances import TOLERANCE, JudgeModel
from workcell.pose import Array

if TYPE_CHECKING:
    import mujoco


def deepest_contact(
    judge: JudgeModel, data: mujoco.MjData, pairs: NDArray[np.int64]
) -> tuple[float, tuple[int, int], Array] | None:
    """The deepest contact that MuJoCo finds between some pairs of geoms, deeper than distances may be off.

    Args:
        judge: the judge's copy, whose margins are zero.
        data: with its geoms placed; contacts are written into it.
        pairs: (p, 2) geoms, the lower first and in order, as `colliding_pairs` makes them.

    Returns:
        the signed distance, the geoms, and the contact's point (2, 3), twice; None: there is no such contact.

    Raises:
        ModelError: MuJoCo itself can't look for contacts in this model.
    """
    import mujoco

    full = data.warning[mujoco.mjtWarning.mjWARN_CONTACTFULL]
    full.number = 1  # the first one would be printed
    try:
        mujoco.mj_collision(judge.model, data)
    except mujoco.FatalError as error:
        raise _incapable(judge, " ".join(str(error).split())) from None
    if full.number > 1:
        raise _incapable(judge, "there are more contacts than it has memory for")
    deep = np.flatnonzero(data.contact.dist < -TOLERANCE)
    if not len(deep) or not len(pairs):
        return None
    geoms = np.sort(data.contact.geom[deep], axis=1).astype(np.int64)
    keys, sought = (each[:, 0] * judge.model.ngeom + each[:, 1] for each in (pairs, geoms))
    known = keys[np.minimum(np.searchsorted(keys, sought), len(keys) - 1)] == sought
    if not known.any():
        return None
    deep, geoms = deep[known], geoms[known]
    k = int(np.argmin(data.contact.dist[deep]))
    point = np.tile(data.contact.pos[deep[k]], (2, 1))
    return float(data.contact.dist[deep[k]]), (int(geoms[k, 0]), int(geoms[k, 1])), point


def _incapable(judge: JudgeModel, why: str) -> ModelError:
    return ModelError(
        f"MuJoCo's own collision detection fails: {why}",
        where=judge.name,
        remedy='more memory, <size memory="..."/>, or fewer bodies that touch, or planes on bodies',
    )
