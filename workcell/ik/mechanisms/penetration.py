"""How far a mechanism's spheres are too near to obstacles and to each other: rows for whoever steps downhill."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.types import SphereCover
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.residuals import Rows
from workcell.model.mechanism.placing import Placed
from workcell.pose import Array

HINGE_MARGIN = 2e-4
"""Metres beyond the wanted clearance at which rows begin, so that an answer is not left on the edge."""


class Penetration:
    """Rows of spheres that are nearer than wanted.

    Of each moving one to its nearest obstacle, and of pairs that must keep apart.

    Args:
        problem: with a cover; without one there are no rows.
        weight: of a metre, beside a metre of the other rows.
        forgiven: share of each sphere's overshoot that it is made smaller by, from 0 to 1.
    """

    def __init__(self, problem: MechanismProblem, *, weight: float = 1.0, forgiven: float = 0.0) -> None:
        self._weight = weight
        self._wanted = problem.tolerances.safety_margin + HINGE_MARGIN
        cover = problem.cover
        if cover is None:
            cover = SphereCover(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros(0))
        assert cover.overshoot is not None
        self._link, self._centre = np.array(cover.link), np.array(cover.centre)
        self._radius = cover.radius - forgiven * cover.overshoot
        seen = problem.obstacles if len(cover) else ()
        self._obstacles = ObstacleArrays(seen) if seen else None
        self._moving = np.flatnonzero(self._link > 0)
        pairs = problem.apart if problem.apart is not None and len(cover) else np.zeros((0, 2))
        self._by_links(np.array(pairs, dtype=np.int64).reshape(-1, 2))

    def _by_links(self, pairs: NDArray[np.int64]) -> None:
        """The pairs, link by link, and a ball around each link's spheres: most links are far from each other."""
        links = np.sort(self._link[pairs], axis=1)
        order = np.lexsort((links[:, 1], links[:, 0]))
        self._pairs, links = pairs[order], links[order]
        first = np.flatnonzero(np.any(np.diff(links, axis=0, prepend=-1), axis=1))
        self._link_pairs = links[first]
        self._group = np.repeat(np.arange(len(first)), np.diff(np.append(first, len(links))))
        count = int(self._link.max(initial=0)) + 1
        self._ball, self._extent = np.zeros((count, 3)), np.zeros(count)
        for link in np.unique(self._link).tolist():
            mine = self._link == link
            self._ball[link] = self._centre[mine].mean(axis=0)
            away = np.linalg.norm(self._centre[mine] - self._ball[link], axis=1)
            self._extent[link] = float((away + self._radius[mine]).max())

    def _near_pairs(self, placed: Placed) -> NDArray[np.int64]:
        """Pairs (p, 2) of spheres of links that are not too far from each other."""
        middles = placed.points(np.arange(len(self._ball)), self._ball)
        one, two = self._link_pairs.T
        apart = middles[one] - middles[two]
        reach = self._extent[one] + self._extent[two] + self._wanted
        near = (apart * apart).sum(axis=1) < reach * reach
        found: NDArray[np.int64] = self._pairs[near[self._group]]
        return found

    @property
    def nothing(self) -> bool:
        """Whether there is nothing to look at."""
        return self._obstacles is None and not len(self._pairs)

    def __call__(self, rows: Rows) -> tuple[Array, Array]:
        """What is too near (r,), metres times the weight, and its derivatives (r, dof)."""
        placed, dof = rows.placed, rows.placed.mechanism.dof
        values, slopes = [np.zeros(0)], [np.zeros((0, dof))]
        if self.nothing:
            return values[0], slopes[0]
        centres = placed.points(self._link, self._centre)
        if self._obstacles is not None:
            distance, gradient, _ = self._obstacles.nearest(centres[self._moving])
            short = self._wanted + self._radius[self._moving] - distance
            near = np.flatnonzero(short > 0.0)
            if len(near):
                spheres = self._moving[near]
                linear = placed.jacobians(self._link[spheres], centres[spheres])[0]
                values.append(short[near])
                slopes.append(-(gradient[near, None] @ linear)[:, 0])
        if len(self._pairs):
            one, two = self._near_pairs(placed).T
            apart = centres[one] - centres[two]
            length = np.sqrt((apart * apart).sum(axis=1))
            short = self._wanted + self._radius[one] + self._radius[two] - length
            near = np.flatnonzero(short > 0.0)
            if len(near):
                ends = [
                    placed.jacobians(self._link[side[near]], centres[side[near]])[0] for side in (one, two)
                ]
                way = apart[near] / np.maximum(length[near], 1e-12)[:, None]
                values.append(short[near])
                slopes.append(-(way[:, None] @ (ends[0] - ends[1]))[:, 0])
        return self._weight * np.concatenate(values), self._weight * np.concatenate(slopes)
