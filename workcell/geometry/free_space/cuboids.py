"""Free space as axis-aligned cuboids, each proved free: inflated from seeds.

Algorithm 3 of IKSPARK (see `workcell.ik.ikspark.solver`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workcell.errors import InputError
from workcell.geometry.free_space.blockers import Blockers
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.separation import separations
from workcell.geometry.types import FreeSpace, Piece, SphereCover
from workcell.model.robot import Robot
from workcell.pose import Array

GAP = 1e-5
"""Metres that every cuboid and polytope keeps from every obstacle, so that rounding can't make them overlap."""

FIRST_STEP, STEP_GROWTH = 0.01, 1.35
"""Delta of the first sweep in metres, and its growth a sweep. (The paper leaves Delta open.)

Small first steps keep the growth even in all directions, so that a free ball around a seed ends up inside its cuboid.
"""


def inflate_cuboids(
    seeds: ArrayLike,
    obstacles: Sequence[Piece],
    bounds: ArrayLike,
    *,
    first_step: float = FIRST_STEP,
) -> FreeSpace:
    """Grow a cuboid from every seed until all six faces are stopped (Algorithm 3).

    All cuboids grow in sweeps: each active face moves by the largest step up to Delta that stays in the workspace
    and off every obstacle, and rests for good when that is zero. The paper finds the step by bisection; here it is
    known in closed form (`workcell.geometry.free_space.blockers`). Seeds inside an obstacle or outside the workspace
    are skipped and counted; duplicates and cuboids inside others are dropped.

    Args:
        seeds: (k, 3) metres.
        obstacles: convex pieces in the same frame.
        bounds: (2, 3) lower and upper corner of the workspace.
        first_step: Delta of the first sweep.

    Returns:
        cuboids with the proved margin to the nearest obstacle; none when every seed was skipped.

    Raises:
        InputError: bounds that are not finite, or inverted, or wholly inside one obstacle; seeds that are not finite.
    """
    return CuboidInflation(obstacles, bounds).cuboids(seeds, first_step=first_step)


class CuboidInflation:
    """Obstacles and bounds prepared once, for cuboids that are asked for again and again.

    Args:
        obstacles, bounds: as `inflate_cuboids` takes them, and refuses them.
    """

    def __init__(self, obstacles: Sequence[Piece], bounds: ArrayLike) -> None:
        self._obstacles, self._bounds = obstacles, _checked_bounds(bounds, obstacles)
        self._blockers = Blockers(obstacles)

    def cuboids(
        self, seeds: ArrayLike, *, first_step: float = FIRST_STEP, half: ArrayLike | None = None
    ) -> FreeSpace:
        """Cuboids from seeds (k, 3), or from cubes around them: see `inflate_cuboids`.

        Args:
            seeds: (k, 3) metres.
            first_step: Delta of the first sweep.
            half: (k,) half an edge, metres, of cubes that the cuboids begin as. Those that are not free are skipped.
        """
        points = np.asarray(seeds, dtype=float).reshape(-1, 3)
        if not np.all(np.isfinite(points)):
            raise InputError("seeds must be finite", where="seeds")
        reach = np.full(len(points), GAP) if half is None else np.asarray(half, dtype=float) + GAP
        lower, upper = points - reach[:, None], points + reach[:, None]
        usable = np.all((lower > self._bounds[0]) & (upper < self._bounds[1]), axis=1)
        usable[usable] = _is_free(self._blockers, points[usable])
        if half is not None and usable.any():
            apart = separations(lower[usable], upper[usable], self._obstacles)[0]
            usable[usable] = (apart >= 0.0).all(axis=1)
        lower, upper = _grow(lower[usable], upper[usable], self._blockers, self._bounds, first_step)
        kept = outermost(lower, upper)
        margin = separations(lower[kept], upper[kept], self._obstacles)[0].min(axis=1, initial=np.inf)
        proved = margin >= 0
        return FreeSpace(
            lower[kept][proved],
            upper[kept][proved],
            margin=margin[proved],
            skipped_seeds=int(np.count_nonzero(~usable)),
        )


def biased_seeds(
    robot: Robot,
    cover: SphereCover,
    configurations: ArrayLike,
    *,
    scatter: float = 0.05,
    per_sphere: int = 1,
    seed: int = 0,
) -> Array:
    """Seeds (k, 3) where the robot will be: its spheres' centres at configurations, and points near them.

    Spheres that no joint moves are left out.

    Args:
        robot: the robot.
        cover: its spheres.
        configurations: (c, n) obstacle-free solutions, goals, waypoints of a path.
        scatter: r_s, radius in metres of the ball around each centre that more seeds are drawn from.
        per_sphere: how many of those for each centre.
        seed: of the draw.
    """
    q = np.asarray(configurations, dtype=float).reshape(-1, robot.dof)
    moving = cover.link > 0
    centres = cover.centres_world(robot.link_transforms(q))[:, moving].reshape(-1, 3)
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(per_sphere, *centres.shape))
    direction /= np.maximum(np.linalg.norm(direction, axis=-1, keepdims=True), 1e-12)
    radius = scatter * rng.uniform(size=(per_sphere, len(centres), 1)) ** (1 / 3)
    return np.vstack([centres, (centres + radius * direction).reshape(-1, 3)])


def random_seeds(bounds: ArrayLike, count: int, *, seed: int = 0) -> Array:
    """Seeds (count, 3) drawn evenly from the workspace: unbiased."""
    low, high = np.asarray(bounds, dtype=float)
    return np.random.default_rng(seed).uniform(low, high, size=(count, 3))


def outermost(lower: Array, upper: Array, tolerance: float = 1e-6) -> Array:
    """Indices of the cuboids that lie in no other one; of equal ones the first, largest volume first."""
    order = np.argsort(-np.prod(upper - lower, axis=1), kind="stable")
    low, high = lower[order], upper[order]
    inside = np.all(
        (low[:, None, :] >= low[None, :, :] - tolerance) & (high[:, None, :] <= high[None, :, :] + tolerance),
        axis=2,
    )
    earlier = np.tril(inside, k=-1)
    kept: Array = order[~earlier.any(axis=1)]
    return kept


def holds_spheres(free_space: FreeSpace, centres: ArrayLike, radii: ArrayLike) -> NDArray[np.bool_]:
    """Whether each sphere, centres (..., m, 3) and radii (m,), lies inside cuboid k: bool (..., m, k)."""
    centre = np.asarray(centres, dtype=float)[..., None, :]
    radius = np.asarray(radii, dtype=float)[:, None, None]
    inside: NDArray[np.bool_] = np.all(
        (centre - radius >= free_space.lower) & (centre + radius <= free_space.upper), axis=-1
    )
    return inside


def select_cuboids(
    free_space: FreeSpace, centres: Array, radii: Array, *, most: int, needed: Sequence[int] = ()
) -> FreeSpace:
    """The `needed` cuboids, and up to `most` others that together hold the most of the spheres; greedy.

    Args:
        free_space: k cuboids, largest first.
        centres, radii: (c, m, 3) and (m,) metres.
        most: how many besides the needed ones.
        needed: indices of cuboids to keep in any case.
    """
    held = holds_spheres(free_space, centres, radii).reshape(-1, len(free_space))
    left = np.ones(len(held), dtype=bool)
    chosen = list(needed)
    left &= ~held[:, chosen].any(axis=1)
    while len(chosen) < min(most + len(needed), len(free_space)):
        gain = held[left].sum(axis=0)
        if gain.max(initial=0) == 0:
            break
        chosen.append(int(np.argmax(gain)))
        left &= ~held[:, chosen[-1]]
    margin = None if free_space.margin is None else free_space.margin[chosen]
    return FreeSpace(
        free_space.lower[chosen],
        free_space.upper[chosen],
        margin=margin,
        skipped_seeds=free_space.skipped_seeds,
    )


def _checked_bounds(bounds: ArrayLike, obstacles: Sequence[Piece]) -> Array:
    box = np.asarray(bounds, dtype=float)
    if box.shape != (2, 3) or not np.all(np.isfinite(box)) or np.any(box[0] >= box[1]):
        raise InputError(
            f"the workspace's bounds must be a lower and an upper corner, not {box.tolist()}",
            where="bounds",
            remedy="a finite (2, 3) array with lower < upper",
        )
    corners = np.array([[box[i, 0], box[j, 1], box[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    if len(obstacles):
        swallowed = (ObstacleArrays(obstacles).distances(corners) <= 0).all(axis=0)
        if swallowed.any():
            raise InputError(
                f"the whole workspace lies inside the obstacle {obstacles[int(np.argmax(swallowed))].name!r}",
                where="bounds",
                remedy="move the obstacle, or enlarge the bounds",
            )
    return box


def _is_free(blockers: Blockers, points: Array) -> NDArray[np.bool_]:
    """Whether points (s, 3), with the gap around them, are off every obstacle."""
    free = ~blockers.contains(points)
    for axis in range(3):
        for sign in (-1, 1):
            beside = points.copy()
            beside[:, axis] += 3 * sign * GAP
            free &= ~blockers.contains(beside)
    return free


def _grow(lower: Array, upper: Array, blockers: Blockers, bounds: Array, step: float) -> tuple[Array, Array]:
    """The sweeps of Algorithm 3 over all cuboids (s, 3) at once, from corners on; GAP stays free around each."""
    active = np.ones((len(lower), 3, 2), dtype=bool)
    while active.any():
        for axis in range(3):
            for side, sign, corner in ((0, -1, lower), (1, 1, upper)):
                rows = np.flatnonzero(active[:, axis, side])
                if len(rows) == 0:
                    continue
                wanted = corner[rows, axis] + sign * step
                wanted = np.clip(wanted, bounds[0, axis], bounds[1, axis])
                reached = blockers.limits(lower[rows], upper[rows], axis, sign, wanted)
                active[rows, axis, side] = np.abs(reached - corner[rows, axis]) > 1e-12
                corner[rows, axis] = reached
        step *= STEP_GROWTH
    return lower + GAP, upper - GAP
