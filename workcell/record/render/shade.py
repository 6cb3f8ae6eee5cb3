"""From z-buffers to a picture: light, shadow, outlines, translucent things and lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workcell.pose import Array
from workcell.record.render.raster import Buffers, Camera, Surface, rasterise, unit

_SKY_TOP, _SKY_BOTTOM = np.array([0.80, 0.85, 0.91]), np.array([0.96, 0.97, 0.98])
_LIGHT = np.array([-0.45, -0.35, 0.82]) / np.linalg.norm([-0.45, -0.35, 0.82])
_OUTLINE = 0.42
_SHADOW_PIXELS = 1024
_SHADOW_BIAS = 0.008
_ON_SURFACE = 0.01
"""Share of its depth by which a line may lie behind a surface and still be on it."""


@dataclass(frozen=True, slots=True)
class Line:
    """A line through world points (k, 3); where something hides it, it shines through at `hidden_alpha`."""

    points: Array
    rgb: tuple[float, float, float]
    radius_px: float = 2.0
    hidden_alpha: float = 0.3


@dataclass(frozen=True, slots=True)
class Light:
    """The sun's shadow map: a parallel camera and what it sees."""

    camera: Camera
    buffers: Buffers

    @staticmethod
    def over(centre: Array, radius: float, surfaces: Sequence[Surface]) -> Light:
        """Shadows of surfaces within a ball."""
        camera = Camera(
            centre + 2 * radius * _LIGHT, centre, _SHADOW_PIXELS, _SHADOW_PIXELS, extent=2 * radius
        )
        return Light(camera, rasterise(surfaces, camera, depth_only=True))

    def with_more(self, surfaces: Sequence[Surface]) -> Light:
        """The same sun with more things in its way."""
        return Light(self.camera, rasterise(surfaces, self.camera, onto=self.buffers, depth_only=True))

    def lit(self, points: Array, normals: Array) -> Array:
        """How much of the sun reaches points (k, 3), 0..1, softened over 2x2 cells of the map."""
        h, w = self.buffers.nearness.shape
        place = self.camera.project(points + _SHADOW_BIAS * normals)
        x, y, depth = place.T
        total = np.zeros(len(place))
        for dx, dy in ((-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5)):
            column = np.clip(x + dx, 0, w - 1).astype(np.int64)
            row = np.clip(y + dy, 0, h - 1).astype(np.int64)
            total += self.buffers.nearness[row, column] <= depth + _SHADOW_BIAS
        outside = (x < 0) | (x >= w) | (y < 0) | (y >= h)
        return np.where(outside, 1.0, total / 4.0)


def shade(buffers: Buffers, camera: Camera, light: Light | None = None) -> Array:
    """The picture (h, w, 3) in [0, 1] of opaque buffers."""
    h, _ = buffers.nearness.shape
    seen = buffers.ident >= 0
    picture = np.empty((*buffers.nearness.shape, 3), dtype=np.float32)
    picture[:] = (_SKY_TOP + (_SKY_BOTTOM - _SKY_TOP) * np.linspace(0, 1, h)[:, None])[:, None, :]
    normals, points = buffers.normal[seen], buffers.points(camera).astype(np.float32)
    sun = np.clip(normals @ _LIGHT.astype(np.float32), 0.0, 1.0)
    if light is not None:
        facing = sun > 0.0
        sun[facing] *= light.lit(points[facing], normals[facing])
    to_camera = unit(camera.position.astype(np.float32) - points)
    head = np.clip(np.einsum("pj,pj->p", normals, to_camera), 0.0, 1.0)
    gloss = np.clip(np.einsum("pj,pj->p", normals, unit(to_camera + _LIGHT.astype(np.float32))), 0.0, 1.0)
    for _ in range(5):
        gloss *= gloss  # to the 32nd power
    strength = 0.40 + 0.08 * normals[:, 2] + 0.24 * head + 0.42 * sun
    picture[seen] = np.clip(
        buffers.rgb[seen] * strength[:, None] + (0.2 * gloss * (sun > 0.3))[:, None], 0.0, 1.0
    )
    picture *= 1.0 - _OUTLINE * outlines(buffers)[..., None]
    return picture


def outlines(buffers: Buffers) -> Array:
    """(h, w) 0 or 1: pixels where one thing ends and another begins, or where a surface folds sharply."""
    edge = np.zeros(buffers.ident.shape, dtype=bool)
    for axis in (0, 1):
        here, there = (slice(None, -1), slice(1, None))
        a = (here, slice(None)) if axis == 0 else (slice(None), here)
        b = (there, slice(None)) if axis == 0 else (slice(None), there)
        other = buffers.ident[a] != buffers.ident[b]
        crease = np.einsum("hwj,hwj->hw", buffers.normal[a], buffers.normal[b]) < 0.5
        near_a, near_b = buffers.nearness[a], buffers.nearness[b]
        with np.errstate(invalid="ignore"):
            jump = np.abs(near_a - near_b) > 0.06 * np.maximum(np.abs(near_a), np.abs(near_b))
        changes = other | ((crease | jump) & (buffers.ident[a] >= 0) & (buffers.ident[b] >= 0))
        edge[a] |= changes
    return edge.astype(float)


def blend(picture: Array, opaque: Buffers, camera: Camera, surfaces: Sequence[Surface]) -> Array:
    """Lays translucent surfaces over a picture, each kind (`ident`) once, where nothing opaque hides it."""
    result = picture.copy()
    for ident in sorted({surface.ident for surface in surfaces}):
        group = [surface for surface in surfaces if surface.ident == ident]
        layer = rasterise(group, camera)
        front = (layer.ident >= 0) & (layer.nearness > opaque.nearness)
        if not front.any():
            continue
        alpha = float(group[0].rgba[3])
        towards = np.clip(np.abs(layer.normal[front] @ camera.axes[2]), 0.0, 1.0)
        colour = layer.rgb[front] * (0.65 + 0.35 * towards[:, None])
        share = np.clip(alpha + 0.35 * (1.0 - towards), 0.0, 1.0)[:, None]
        result[front] = (1 - share) * result[front] + share * colour
        rim = _rim(layer.ident >= 0) & front
        result[rim] = 0.5 * result[rim] + 0.5 * layer.rgb[rim] * 0.6
    return result


def _rim(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Pixels of a mask that have a neighbour outside it."""
    inner = mask.copy()
    inner[1:] &= mask[:-1]
    inner[:-1] &= mask[1:]
    inner[:, 1:] &= mask[:, :-1]
    inner[:, :-1] &= mask[:, 1:]
    return mask & ~inner


def draw_line(picture: Array, opaque: Buffers, camera: Camera, line: Line) -> Array:
    """Draws a line of even thickness on the screen over a picture."""
    ends = camera.project(line.points)
    length = np.linalg.norm(np.diff(ends[:, :2], axis=0), axis=1)
    if not len(length) or not np.any(np.isfinite(length)):
        return picture
    steps = np.clip(np.nan_to_num(length * 2), 1, 4000).astype(np.int64)
    segment = np.repeat(np.arange(len(steps)), steps)
    share = (np.arange(len(segment)) - np.repeat(np.cumsum(steps) - steps, steps)) / steps[segment]
    dots = ends[segment] + share[:, None] * (ends[segment + 1] - ends[segment])
    dots = dots[np.isfinite(dots).all(axis=1)]
    reach = int(np.ceil(line.radius_px))
    dy, dx = (grid.ravel() for grid in np.mgrid[-reach : reach + 1, -reach : reach + 1])
    disc = dx**2 + dy**2 <= line.radius_px**2
    column = (dots[:, 0, None] + dx[disc]).astype(np.int64)
    row = (dots[:, 1, None] + dy[disc]).astype(np.int64)
    near = np.broadcast_to(dots[:, 2, None], row.shape)
    inside = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    pixels, where = np.unique(row[inside] * camera.width + column[inside], return_inverse=True)
    nearest = np.full(len(pixels), -np.inf)
    np.maximum.at(nearest, where, near[inside])
    touched = np.unravel_index(pixels, opaque.nearness.shape)
    hides = opaque.nearness[touched]
    shown = nearest >= hides * (1 - _ON_SURFACE * np.sign(hides))
    alpha = np.where(shown, 1.0, line.hidden_alpha)[:, None]
    result = picture.copy()
    result[touched] = (1 - alpha) * result[touched] + alpha * np.array(line.rgb)
    return result


def halve(picture: Array) -> Array:
    """The picture at half its size: each pixel the mean of four, which smooths every edge."""
    h, w = picture.shape[0] // 2 * 2, picture.shape[1] // 2 * 2
    smaller: Array = picture[:h, :w].reshape(h // 2, 2, w // 2, 2, -1).mean(axis=(1, 3))
    return smaller
