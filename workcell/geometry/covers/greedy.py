"""Smallest sets of balls that hold a union of convex pieces: greedy set cover, lazily corrected by the proof."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from workcell.errors import ModelError
from workcell.geometry.covers.proof import holes
from workcell.geometry.covers.tighten import tighten
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.polytope import polytope_of
from workcell.geometry.separation import bounding_box
from workcell.geometry.types import Piece
from workcell.pose import Array

_SLACK = 0.025
"""Share of the overshoot kept back for gaps between samples."""

_MARGIN = 0.02
"""Share of the overshoot by which the search tries to do better than asked, for what lies between samples."""

_MOST = 150
"""Samples that join the search at once."""

_PATIENCE = 6
"""Moves of the balls in search of a cover with as few of them, before holes get balls of their own."""

_TIGHTNESS = 5e-5
"""Metres: half the edge of the cells that decide how small each ball may be."""

_PAD = 8e-5
"""Metres added to every radius in the end: more than the diameter of the proof's smallest cells, so that it must
succeed."""

_CANDIDATES, _SAMPLES, _WORKING = 3000, 12_000, 1500
"""Largest numbers of possible centres, of samples, and of those samples that the search begins with."""


def cover_union(pieces: Sequence[Piece], overshoot: float) -> tuple[Array, Array]:
    """Centres (m, 3) and radii (m,) of balls that hold all pieces, proved; each sticks out by `overshoot` at most."""
    if len(pieces) == 1 and pieces[0].kind == "sphere":
        return pieces[0].pose.position[None], pieces[0].size[:1] + _PAD
    shape = ObstacleArrays(pieces)
    samples = surface_samples(pieces, shape)
    working = samples[:_WORKING]
    candidates = _candidates(pieces, shape, overshoot)
    aim = (1 - _SLACK) * overshoot - _PAD
    centres = candidates[_greedy(candidates, aim - shape.nearest(candidates)[0], working)]
    for turn in range(200):
        centres, excess, worst = relax(shape, centres, working, aim)
        if excess > 0:
            centres = np.vstack([centres, worst])
            continue
        missed = _missed(shape, centres, samples, aim)
        if len(missed) == 0:
            largest = overshoot - _PAD - shape.nearest(centres)[0]
            missed = holes(pieces, centres, largest)
            if len(missed) == 0:
                centres, radii = tighten(pieces, centres, largest, resolution=_TIGHTNESS)
                return centres, radii + _PAD
            samples = np.vstack([samples, missed])
        working = np.vstack([working, missed])
        if turn >= _PATIENCE:
            centres = np.vstack([centres, missed[0]])
    raise ModelError("no sphere cover was found", where=pieces[0].name, remedy="allow a larger overshoot")


def _missed(shape: ObstacleArrays, centres: Array, samples: Array, overshoot: float) -> Array:
    """Samples outside all balls, and those that lie so near to a hole that the next move could open it; else none."""
    radii = overshoot - shape.nearest(centres)[0]
    gap = (np.sqrt(np.maximum(_squares(centres, samples), 0.0)) - radii[:, None]).min(axis=0)
    if gap.max() <= 0:
        return np.zeros((0, 3))
    order = np.argsort(-gap)[:_MOST]
    chosen: Array = samples[order[gap[order] > -_MARGIN * overshoot]]
    return chosen


def relax(
    shape: ObstacleArrays, centres: Array, samples: Array, overshoot: float, *, rounds: int = 150
) -> tuple[Array, float, Array]:
    """Move the balls until those of radius `overshoot - s` hold all samples, s being a centre's signed distance.

    Subgradient steps on the largest excess `|p - c| + s(c) - overshoot` over the samples p that suit centre c best:
    for fixed samples that is convex in c.

    Returns:
        centres (m, 3); their largest excess in metres (<= 0: all samples are held); the sample (3,) that has it.
    """
    best, best_excess, worst = centres, np.inf, samples[0]
    c = centres.copy()
    for turn in range(rounds):
        depth, slope, _ = shape.nearest(c)
        length = np.sqrt(np.maximum(_squares(c, samples), 0.0))
        excess = length + depth[:, None] - overshoot
        owner = np.argmin(excess, axis=0)
        own = excess[owner, np.arange(len(samples))]
        most = int(np.argmax(own))
        if own[most] < best_excess:
            best, best_excess, worst = c.copy(), float(own[most]), samples[most]
        if best_excess <= -_MARGIN * overshoot or (best_excess <= 0 and turn % 30 == 29):
            break
        mine = np.where(owner == np.arange(len(c))[:, None], excess, -np.inf)
        far = np.argmax(mine, axis=1)
        busy = np.isfinite(mine[np.arange(len(c)), far])
        toward = samples[far] - c
        toward /= np.maximum(np.linalg.norm(toward, axis=1, keepdims=True), 1e-9)
        step = 0.15 * overshoot * 0.98**turn
        c = np.where(busy[:, None], c + step * (toward - slope), c)
    return best, best_excess, worst


def _squares(a: Array, b: Array) -> Array:
    squares: Array = np.sum(a**2, axis=1)[:, None] + np.sum(b**2, axis=1) - 2 * a @ b.T
    return squares


def surface_samples(pieces: Sequence[Piece], shape: ObstacleArrays) -> Array:
    """Points (k, 3) of the union in random order, most on its surface: the nearest points of a grid's nodes."""
    collected = []
    for index, piece in enumerate(pieces):
        points, step = _own_samples(piece)
        others = [other for k, other in enumerate(pieces) if k != index]
        if others:
            points = points[ObstacleArrays(others).floor(points) > -step]
        collected.append(points)
    samples = np.vstack(collected)
    order = np.random.default_rng(0).permutation(len(samples))[:_SAMPLES]
    chosen: Array = samples[order]
    return chosen


def _own_samples(piece: Piece) -> tuple[Array, float]:
    """Points (k, 3) of one piece's surface and inside, and their spacing in metres."""
    lower, upper = bounding_box(piece)
    step = max(0.003, float(np.prod(upper - lower + 0.02) / 30_000) ** (1 / 3))
    nodes = _grid(lower - step, upper + step, step)
    if piece.kind == "hull":
        polytope = polytope_of(piece)
        nodes = nodes[(nodes @ polytope.planes[:, :3].T + polytope.planes[:, 3] < 0).all(axis=1)]
        corners = polytope.vertices[polytope.triangles]
        weight = _TRIANGLE_WEIGHTS[np.newaxis]
        return np.vstack([nodes, (weight @ corners).reshape(-1, 3)]), step
    distance, gradient, _ = ObstacleArrays([piece]).nearest(nodes)
    near = np.abs(distance) < 1.2 * step
    inner = nodes[distance < -2 * step]
    projected = nodes[near] - distance[near, None] * gradient[near]
    return np.vstack([projected, inner[:: max(1, len(inner) // 400)]]), step


_TRIANGLE_WEIGHTS = np.array([[i, j, 6 - i - j] for i in range(7) for j in range(7 - i)]) / 6.0
"""Barycentric coordinates (28, 3) of a triangle's corners, and of points spread over its sides and its inside."""


def _candidates(pieces: Sequence[Piece], shape: ObstacleArrays, overshoot: float) -> Array:
    """Possible centres: a grid over the union, and points of the pieces' own axes."""
    corners = [bounding_box(piece) for piece in pieces]
    lower = np.min([low for low, _ in corners], axis=0)
    upper = np.max([high for _, high in corners], axis=0)
    step = max(0.3 * overshoot, float(np.prod(upper - lower) / (8 * _CANDIDATES)) ** (1 / 3))
    while True:
        nodes = _grid(lower, upper, step)
        nodes = nodes[shape.floor(nodes) < 0.3 * overshoot]
        if len(nodes) <= _CANDIDATES:
            break
        step *= 1.2
    return np.vstack([nodes, *(_own_points(piece) for piece in pieces)])


def _own_points(piece: Piece) -> Array:
    """The piece's centre, and points along its longest axis, in the outer frame."""
    if piece.kind == "hull":
        assert piece.vertices is not None
        return piece.pose.apply(piece.vertices.mean(axis=0)[None])
    half = np.zeros(3)
    if piece.kind in ("capsule", "cylinder"):
        half[2] = piece.size[1]
    elif piece.kind in ("box", "ellipsoid"):
        half[int(np.argmax(piece.size))] = piece.size.max()
    points: Array = piece.pose.apply(np.linspace(-1, 1, 41)[:, None] * half)
    return points


def _grid(lower: Array, upper: Array, step: float) -> Array:
    counts = np.maximum(np.ceil((upper - lower) / step).astype(int), 1)
    axes = [
        low + (np.arange(n) + 0.5) * (high - low) / n
        for low, high, n in zip(lower, upper, counts, strict=True)
    ]
    return np.stack([g.reshape(-1) for g in np.meshgrid(*axes, indexing="ij")], axis=1)


def _greedy(candidates: Array, radii: Array, samples: Array) -> Array:
    """Indices of balls that hold all samples: the one with the most new samples first, then the superfluous dropped."""
    squares = np.sum(candidates**2, axis=1)[:, None] + np.sum(samples**2, axis=1) - 2 * candidates @ samples.T
    holds = (squares <= np.maximum(radii, 0.0)[:, None] ** 2).astype(np.float32)
    left = np.ones(len(samples), dtype=np.float32)
    left[holds.max(axis=0) == 0] = 0.0
    chosen: list[int] = []
    while left.any():
        best = int(np.argmax(holds @ left))
        chosen.append(best)
        left[holds[best] > 0] = 0.0
    count = holds[chosen].sum(axis=0)
    for index in list(chosen):
        if np.all(count - holds[index] >= np.minimum(count, 1)):
            chosen.remove(index)
            count -= holds[index]
    return np.array(chosen)
