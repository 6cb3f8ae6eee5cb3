"""Which ties say nothing that others don't say already."""

from __future__ import annotations

import numpy as np

from workcell.model.mechanism.mechanism import Mechanism
from workcell.model.mechanism.placing import missed, place
from workcell.pose import Array

_RANK = 1e-8
"""What a row adds to those before it counts from here on, metres or radians for each of the tangent."""


def redundant_ties(mechanism: Mechanism, q: Array) -> tuple[str, ...]:
    """Names of ties that forbid no motion which joints that are held, and the ties before them, allow.

    Leaving them out changes nothing near a configuration at which all ties hold. Where the mechanism is stretched, too
    many may be named: ask at a configuration in general position.

    Args:
        mechanism: whose.
        q: (size,) at which its ties hold.
    """
    _, rows = missed(place(mechanism, q))
    known = _basis(
        np.zeros((0, mechanism.dof)),
        np.array(
            [
                np.eye(mechanism.dof)[rate.start]
                for joint, rate in zip(mechanism.joints, mechanism.rate_slices, strict=True)
                if joint.lower == joint.upper and joint.kind in ("hinge", "slide")
            ]
        ).reshape(-1, mechanism.dof),
    )
    found, first = [], 0
    for name, count in _sizes(mechanism):
        more = _basis(known, rows[first : first + count])
        if len(more) == len(known):
            found.append(name)
        known, first = more, first + count
    return tuple(found)


def _sizes(mechanism: Mechanism) -> list[tuple[str, int]]:
    """Every tie's name, and how many rows it is."""
    closures = [(closure.name, 6 if closure.kind == "weld" else 3) for closure in mechanism.closures]
    followers = [(follower.name, 1) for follower in mechanism.followers]
    return closures + followers + [(one.name, 1) for one in mechanism.sums if one.lower == one.upper]


def _basis(known: Array, rows: Array) -> Array:
    """An orthonormal basis (k, dof) of known directions (j, dof), orthonormal, and of rows (r, dof)."""
    rest = rows - (rows @ known.T) @ known
    rest = rest - (rest @ known.T) @ known  # twice is enough
    _, size, directions = np.linalg.svd(rest, full_matrices=False)
    basis: Array = np.vstack([known, directions[size > _RANK]])
    return basis
