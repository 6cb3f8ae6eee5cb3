"""From z-buffers to a picture: light, shadow, outlines, translucent things and lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workcell.pose import Array
from workcell.record.raster import Buffers, Camera, Surface, rasterise

_SKY_TOP, _SKY_BOTTOM = np.array([0.80, 0.85, 0.91]), np.array([0.96, 0.97, 0.98])
_LIGHT = np.array([-0.45, -0.35, 0.82]) / np.linalg.norm([-0.45, -0.35, 0.82])
_OUTLINE = 0.42
_SHADOW_PIXELS = 1024
_SHADOW_BIAS = 0.008


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
        return Light(camera, rasterise(surfaces, camera))

    def with_more(self, surfaces: Sequence[Surface]) -> Light:
        """The same sun with more things in its way."""
        return Light(self.camera, rasterise(surfaces, self.camera, onto=self.buffers))

    def lit(self, points: Array, normals: Array) -> Array:
        """How much of the sun reaches points (..., 3), 0..1, softened over 3x3 cells of the map."""
        h, w = self.buffers.nearness.shape
        place = self.camera.project(points.reshape(-1, 3) + _SHADOW_BIAS * normals.reshape(-1, 3))
        place = np.nan_to_num(place, nan=-10.0, posinf=-10.0, neginf=-10.0)
        total = np.zeros(len(place))
        for dx in (-1.0, 0.0, 1.0):
            for dy in (-1.0, 0.0, 1.0):
                column = np.clip(place[:, 0] + dx, 0, w - 1).astype(np.int64)
                row = np.clip(place[:, 1] + dy, 0, h - 1).astype(np.int64)
                total += self.buffers.nearness[row, column] <= place[:, 2] + _SHADOW_BIAS
        inside = (place[:, 0] >= 0) & (place[:, 0] < w) & (place[:, 1] >= 0) & (place[:, 1] < h)
        shaded: Array = np.where(inside, total / 9.0, 1.0).reshape(points.shape[:-1])
        return shaded


def shade(buffers: Buffers, camera: Camera, light: Light | None = None) -> Array:
    """The picture (h, w, 3) in [0, 1] of opaque buffers."""
    h, _ = buffers.nearness.shape
    seen = buffers.ident >= 0
    picture = np.empty((*buffers.nearness.shape, 3))
    picture[:] = (_SKY_TOP + (_SKY_BOTTOM - _SKY_TOP) * np.linspace(0, 1, h)[:, None])[:, None, :]
    normals, points = buffers.normal[seen], buffers.points(camera)[seen]
    facing = np.clip(normals @ _LIGHT, 0.0, 1.0)
    sun = facing if light is None else facing * light.lit(points, normals)
    to_camera = camera.position - points
    to_camera /= np.linalg.norm(to_camera, axis=1, keepdims=True)
    head = np.clip(np.sum(normals * to_camera, axis=1), 0.0, 1.0)
    sky = 0.5 + 0.5 * normals[:, 2]
    half = to_camera + _LIGHT
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    shine = 0.18 * np.clip(np.sum(normals * half, axis=1), 0.0, 1.0) ** 40 * (sun > 0.3)
    strength = 0.26 + 0.16 * sky + 0.22 * head + 0.48 * sun
    picture[seen] = np.clip(buffers.rgb[seen] * strength[:, None] + shine[:, None], 0.0, 1.0)
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
        crease = np.sum(buffers.normal[a] * buffers.normal[b], axis=-1) < 0.5
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
        rim = (outlines(layer) > 0) & (layer.ident >= 0) & front
        result[rim] = 0.5 * result[rim] + 0.5 * layer.rgb[rim] * 0.6
    return result


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
    nearest = np.full(opaque.nearness.shape, -np.inf)
    np.maximum.at(nearest, (row[inside], column[inside]), near[inside])
    touched = np.isfinite(nearest)
    shown = nearest >= opaque.nearness * (1 - 0.01)
    alpha = np.where(shown, 1.0, line.hidden_alpha)[touched][:, None]
    result = picture.copy()
    result[touched] = (1 - alpha) * result[touched] + alpha * np.array(line.rgb)
    return result


def halve(picture: Array) -> Array:
    """The picture at half its size: each pixel the mean of four, which smooths every edge."""
    h, w = picture.shape[0] // 2 * 2, picture.shape[1] // 2 * 2
    smaller: Array = picture[:h, :w].reshape(h // 2, 2, w // 2, 2, -1).mean(axis=(1, 3))
    return smaller
