"""Eq. 75 of IKSPARK over CIDGIK's vectors: how far a link may turn from where it was, as rows on Z.

With R and R' a link's rotation before and after, |R' - R| <= b (Frobenius) says `tr R^T R' >= 3 - b^2 / 2`: the sum of
products of the link's three directions before with those after, linear in Z. Where the link is known by its whole
frame, this row is all of Eq. 75. Where it is known by fewer directions, each of them has a row that follows: a turn by
phi has |R' - R|^2 = 8 sin^2(phi / 2) and moves no unit vector v by more than 2 sin(phi / 2), so that
`R v . R' v >= 1 - b^2 / 4`.
"""

from __future__ import annotations

import numpy as np

from workcell.ik.cidgik.instance import Instance
from workcell.ik.cidgik.rows import products
from workcell.pose import Array

_ANY_TURN = 2.0 * np.sqrt(2.0)
"""The largest |R' - R| of two rotations: half a turn apart."""
_FIXED = 1e-12
"""Coefficients below it are none."""


def turning_rows(instance: Instance, before: Array, bound: float) -> Array:
    """(k, f + 1) rows over (y, 1), nonnegative where no link has turned by more than `bound`.

    Args:
        instance: the relaxation.
        before: (links + 1, 3, 3) rotations of all links, seen from the base.
        bound: b, the largest Frobenius norm of a rotation's change.
    """
    reduction = instance.structure.reduction
    links = [link for link in reduction.links if link not in reduction.skeleton.known]
    if bound >= _ANY_TURN or not links:
        return np.zeros((0, instance.D.shape[1] + 1))
    d, packed, least = reduction.skeleton.dimension, [], []
    gone = [entry.index for entry in instance.structure.dropped]
    for link in links:
        vectors = reduction.directions[link]
        # a vector that was left out has no place in Z
        whole = ~np.any(vectors.alpha[:, gone], axis=1)
        was = np.zeros((int(whole.sum()), instance.structure.order))
        was[:, -d:] = (before[link] @ reduction.skeleton.basis[link])[:, whole].T @ reduction.skeleton.plane.T
        each = products(instance.vector(vectors)[whole], was)
        if len(each) == 3:
            packed.append(each.sum(axis=0, keepdims=True))
            least.append(np.array([3.0 - 0.5 * bound**2]))
        else:
            packed.append(each)
            least.append(np.full(len(each), 1.0 - 0.25 * bound**2))
    rows = instance.reduced(np.concatenate(packed), -np.concatenate(least))
    # what base or goal fix is no constraint, unless it is broken
    moving = np.any(np.abs(rows[:, :-1]) > _FIXED, axis=1) | (rows[:, -1] < 0.0)
    kept: Array = rows[moving]
    return kept
