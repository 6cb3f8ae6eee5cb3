"""What `ikspark` refuses of a free space that it is given: one made for another scene, or for another cover."""

from __future__ import annotations

import numpy as np

from workcell.errors import InputError
from workcell.geometry.separation import separations, support
from workcell.geometry.types import FreePolytope, FreeSpace, Piece
from workcell.identity_cache import ByIdentity
from workcell.ik.ikspark.obstacles.pairs import checked_table
from workcell.ik.problem import IKProblem

OVERLAP = 1e-3
"""Metres by which a region may overlap an obstacle: a curved one counts as the polytope around it."""
_REMEDY = "make it for these obstacles (workcell.geometry.free_space), or leave it out: ikspark makes its own"
_checked = ByIdentity()


def check_free_space(problem: IKProblem) -> None:
    """Refuse a free space whose table is of another cover, or one of whose regions overlaps an obstacle.

    Raises:
        InputError: as said, with the region and the obstacle.
    """
    given = problem.free_space
    if given is None or problem.cover is None:
        return
    if given.admissible is not None:
        checked_table(problem, given)
    if problem.grow is not None:
        return  # whoever lets it grow among these obstacles proves it
    refusal = _checked.get((given, problem.obstacles), lambda: _overlap(given, problem.obstacles))
    if refusal:
        raise InputError(refusal, where="free_space", remedy=_REMEDY)


def _overlap(given: FreeSpace, obstacles: tuple[Piece, ...]) -> str:
    """Which region overlaps which obstacle, in words; empty: none does."""
    if not obstacles:
        return ""
    apart = separations(given.lower, given.upper, obstacles)[0]
    if apart.size and apart.min() < -OVERLAP:
        k, other = divmod(int(apart.argmin()), len(obstacles))
        return f"cuboid {k} overlaps the obstacle {obstacles[other].name!r} by {-1e3 * apart.min():.3g} mm"
    for k, polytope in enumerate(given.polytopes):
        for piece in obstacles:
            if _behind(polytope, piece) < -OVERLAP:
                return f"no plane of polytope {k} parts it from the obstacle {piece.name!r}"
    return ""


def _behind(polytope: FreePolytope, piece: Piece) -> float:
    """Metres that a piece lies behind one of a polytope's planes, the best one."""
    return float(np.max(-support(piece, -polytope.A) - polytope.b))
