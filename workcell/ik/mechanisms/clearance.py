"""Clearance of a mechanism's spheres, for whoever judges where no compiled model does: exact distances."""

from __future__ import annotations

import numpy as np

from workcell.geometry.types import SphereCover
from workcell.ik.judge.exact import exact_distances, smallest_clearance
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.problem import Clearance
from workcell.pose import Array


class SphereClearance:
    """Smallest distance of a problem's spheres to its obstacles, and of those that must keep apart.

    Args:
        problem: with a cover; without one there is nothing to look at.
    """

    def __init__(self, problem: MechanismProblem) -> None:
        self._problem = problem
        self._foreign = tuple(piece for piece in problem.obstacles if piece.geom < 0)
        cover = problem.cover
        self._moving: SphereCover | None = None  # what stands does not collide with what stands
        if cover is not None:
            rows = cover.link > 0
            self._moving = SphereCover(cover.link[rows], cover.centre[rows], cover.radius[rows], cover.kind)

    def looks(self, *, foreign_only: bool = False) -> bool:
        """Whether there is anything to look at."""
        problem = self._problem
        if problem.cover is None or not len(problem.cover):
            return False
        return bool(self._foreign) or (
            not foreign_only and bool(problem.obstacles or problem.apart is not None)
        )

    def __call__(self, R: Array, p: Array, *, foreign_only: bool = False) -> tuple[Clearance, int]:
        """The clearance with links at (links, 3, 3) and (links, 3), and how many pairs it is of.

        Args:
            R, p: of the links.
            foreign_only: look at no more than the obstacles that come from no compiled model, which that can't see.
        """
        cover, nothing = self._problem.cover, Clearance(float("inf"))
        if cover is None or not len(cover):
            return nothing, 0
        pieces = self._foreign if foreign_only else self._problem.obstacles
        found, count = [nothing], 0
        moving = np.flatnonzero(cover.link > 0)
        if pieces and len(moving):
            own = self._moving
            assert own is not None
            distance, sphere, piece = smallest_clearance(own, R, p, exact_distances(pieces))
            found.append(Clearance(distance, (self._name(int(moving[sphere])), pieces[piece].name)))
            count += len(moving) * len(pieces)
        apart = self._problem.apart
        if apart is not None and len(apart) and not foreign_only:
            centres = np.einsum("mij,mj->mi", R[cover.link], cover.centre) + p[cover.link]
            one, two = apart.T
            gaps = np.linalg.norm(centres[one] - centres[two], axis=1) - cover.radius[one] - cover.radius[two]
            k = int(np.argmin(gaps))
            found.append(Clearance(float(gaps[k]), (self._name(int(one[k])), self._name(int(two[k])))))
            count += len(apart)
        return min(found, key=lambda one: one.distance), count

    def _name(self, sphere: int) -> str:
        cover = self._problem.cover
        assert cover is not None
        carrier = (cover.source[sphere] if cover.source else "") or self._problem.mechanism.link_names[
            int(cover.link[sphere])
        ]
        return f"sphere {sphere} ({carrier})"
