"""A z-buffer rasteriser in numpy: pictures without a graphics card or a display.

Triangles are cut into the pixel rows that they cross, rows into pixels, all triangles at once; the nearest surface
at each pixel wins. Along a row the reciprocal depth is linear, for a perspective camera as for a parallel one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workcell.pose import Array
from workcell.record.render.tessellate import Triangles

_ROWS_AT_ONCE = 400_000
_NEAR = 0.02


@dataclass(frozen=True, slots=True)
class Camera:
    """A camera at `position` that looks at `target`, z up in the picture.

    Attributes:
        position, target: (3,) metres, world.
        width, height: pixels.
        fov_deg: vertical field of view of a perspective camera; ignored when `extent` is given.
        extent: for a parallel projection (a light's shadow), metres across the picture's height; else None.
    """

    position: Array
    target: Array
    width: int
    height: int
    fov_deg: float = 40.0
    extent: float | None = None

    @property
    def axes(self) -> Array:
        """Rows: right, up and forward in the world (3, 3)."""
        forward = np.asarray(self.target, dtype=float) - self.position
        forward /= np.linalg.norm(forward)
        up = np.array([0.0, 0.0, 1.0]) if abs(forward[2]) < 0.999 else np.array([0.0, 1.0, 0.0])
        right = np.cross(forward, up)
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(right, forward), forward])

    def view(self, points: Array) -> Array:
        """World points (k, 3) as right, up, depth."""
        return (np.asarray(points, dtype=float) - self.position) @ self.axes.T

    def screen(self, view_points: Array) -> Array:
        """Pixel coordinates x (right), y (down) and reciprocal depth (k, 3) of points in view coordinates."""
        right, up, depth = view_points.T
        if self.extent is None:
            scale = 0.5 * self.height / np.tan(np.radians(self.fov_deg) / 2) / depth
            nearness = 1.0 / depth
        else:
            scale = np.full(len(depth), self.height / self.extent)
            nearness = -depth
        return np.stack([0.5 * self.width + right * scale, 0.5 * self.height - up * scale, nearness], axis=1)

    def project(self, points: Array) -> Array:
        """`screen` of world points (k, 3); nan for those behind the camera."""
        seen = self.view(points)
        if self.extent is None:
            seen[seen[:, 2] < _NEAR] = np.nan
        return self.screen(seen)


@dataclass(frozen=True, slots=True)
class Surface:
    """Triangles in the world with one colour (4,); `ident` tells things apart, for their outlines."""

    triangles: Triangles
    rgba: Array
    ident: int = 0


@dataclass(slots=True)
class Buffers:
    """What each pixel sees.

    Attributes:
        nearness: (h, w) reciprocal depth (parallel: minus depth); -inf where nothing is.
        normal: (h, w, 3) unit, world, single precision.
        rgb: (h, w, 3), single precision.
        ident: (h, w), -1 where nothing is.
    """

    nearness: Array
    normal: NDArray[np.float32]
    rgb: NDArray[np.float32]
    ident: NDArray[np.int64]

    @staticmethod
    def empty(camera: Camera) -> Buffers:
        """Nothing seen yet."""
        shape = (camera.height, camera.width)
        # single precision is plenty for light, and twice as fast
        normal, rgb = np.zeros((*shape, 3), dtype=np.float32), np.zeros((*shape, 3), dtype=np.float32)
        return Buffers(np.full(shape, -np.inf), normal, rgb, np.full(shape, -1))

    def copy(self) -> Buffers:
        """An independent copy."""
        return Buffers(self.nearness.copy(), self.normal.copy(), self.rgb.copy(), self.ident.copy())

    def points(self, camera: Camera) -> Array:
        """World points (k, 3) that the pixels with something in them see, row by row."""
        h, w = self.nearness.shape
        row, column = np.nonzero(self.ident >= 0)
        near = self.nearness[row, column]
        if camera.extent is None:
            depth = 1.0 / near
            scale = depth * (2 * np.tan(np.radians(camera.fov_deg) / 2) / h)
        else:
            depth, scale = -near, np.full(len(near), camera.extent / h)
        view = np.stack([(column + 0.5 - 0.5 * w) * scale, (0.5 * h - row - 0.5) * scale, depth], axis=1)
        points: Array = view @ camera.axes + camera.position
        return points


def unit(vectors: NDArray[Any]) -> NDArray[Any]:
    """Vectors (k, 3) at length 1."""
    length = np.sqrt(np.einsum("pj,pj->p", vectors, vectors))
    scaled: NDArray[Any] = vectors / np.maximum(length, 1e-12)[:, None]
    return scaled


def rasterise(
    surfaces: Sequence[Surface], camera: Camera, onto: Buffers | None = None, *, depth_only: bool = False
) -> Buffers:
    """The buffers of opaque surfaces; `onto` continues a picture (its buffers are not changed).

    With `depth_only` colour, normal and identity are left as they were: enough for shadows and for what hides what.
    """
    buffers = Buffers.empty(camera) if onto is None else onto.copy()
    if not surfaces:
        return buffers
    corners, normals, owner = _front_corners(surfaces, camera)
    if not len(corners):
        return buffers
    screen = camera.screen(corners.reshape(-1, 3)).reshape(-1, 3, 3)
    edges, slope, kept = _edge_functions(screen)
    winner = _nearest(buffers.nearness, screen[kept], edges, slope)
    seen = winner >= 0
    if seen.any() and not depth_only:
        _fill(buffers, seen, winner[seen], edges, screen[kept], normals[kept], owner[kept], surfaces)
    return buffers


def _front_corners(surfaces: Sequence[Surface], camera: Camera) -> tuple[Array, Array, NDArray[np.int64]]:
    """Corners in view coordinates and world normals (t, 3, 3) of triangles before the camera; their surface (t,)."""
    meshes = [surface.triangles for surface in surfaces]
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, first, strict=False)])
    owners = np.repeat(np.arange(len(meshes)), [len(mesh.faces) for mesh in meshes])
    all_corners = camera.view(np.concatenate([mesh.vertices for mesh in meshes]))[faces]
    all_normals = np.concatenate([mesh.normals for mesh in meshes])[faces]
    if camera.extent is not None:
        return all_corners, all_normals, owners
    ahead = all_corners[..., 2] >= _NEAR
    whole, cut = ahead.all(axis=1), ahead.any(axis=1) & ~ahead.all(axis=1)
    parts = [(all_corners[whole], all_normals[whole], owners[whole])]
    for k in np.flatnonzero(cut):
        piece = _clip(all_corners[k], all_normals[k])
        parts.append((*piece, np.full(len(piece[0]), owners[k])))
    return tuple(np.concatenate(columns) for columns in zip(*parts, strict=True))  # type: ignore[return-value]


def _clip(corners: Array, normals: Array) -> tuple[Array, Array]:
    """The one or two triangles left of one that crosses the near plane."""
    kept_points, kept_normals = [], []
    for k in range(3):
        a, b = corners[k], corners[(k + 1) % 3]
        if a[2] >= _NEAR:
            kept_points.append(a)
            kept_normals.append(normals[k])
        if (a[2] >= _NEAR) != (b[2] >= _NEAR):
            share = (_NEAR - a[2]) / (b[2] - a[2])
            kept_points.append(a + share * (b - a))
            kept_normals.append(normals[k] + share * (normals[(k + 1) % 3] - normals[k]))
    fan = [[0, k, k + 1] for k in range(1, len(kept_points) - 1)]
    return np.array(kept_points)[fan], np.array(kept_normals)[fan]


def _edge_functions(screen: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """For front-facing triangles: barycentric coordinates a x + b y + c (t, 3, 3), the same of nearness (t, 3)."""
    x, y = screen[..., 0], screen[..., 1]
    a = np.roll(y, -1, axis=1) - np.roll(y, -2, axis=1)
    b = np.roll(x, -2, axis=1) - np.roll(x, -1, axis=1)
    c = np.roll(x, -1, axis=1) * np.roll(y, -2, axis=1) - np.roll(x, -2, axis=1) * np.roll(y, -1, axis=1)
    area = c.sum(axis=1)
    kept = area < -1e-9  # y points down: counter-clockwise outside is clockwise on the screen
    edges = np.stack([a, b, c], axis=-1)[kept] / area[kept, None, None]
    slope = np.einsum("tk,tkj->tj", screen[kept, :, 2], edges)
    return edges, slope, kept


def _nearest(nearness: Array, screen: Array, edges: Array, slope: Array) -> NDArray[np.int64]:
    """Writes the largest nearness into the buffer; returns the triangle that won each pixel (h, w), or -1."""
    height, width = nearness.shape
    winner = np.full(nearness.size, -1)
    flat = nearness.reshape(-1)
    first = np.clip(np.ceil(screen[..., 1].min(axis=1) - 0.5), 0, height).astype(np.int64)
    last = np.clip(np.floor(screen[..., 1].max(axis=1) - 0.5), -1, height - 1).astype(np.int64)
    rows = np.maximum(last - first + 1, 0)
    ends = np.cumsum(rows)
    for begin, stop in _batches(ends):
        count = rows[begin:stop]
        triangle = np.repeat(np.arange(begin, stop), count)
        row = np.arange(len(triangle)) - np.repeat(np.cumsum(count) - count, count) + first[triangle]
        _fill_rows(flat, winner, width, triangle, row, edges, slope)
    return winner.reshape(height, width)


def _batches(ends: NDArray[np.int64]) -> list[tuple[int, int]]:
    """Ranges of triangles with at most about _ROWS_AT_ONCE rows each."""
    cuts, done, base = [0], 0, 0
    while done < len(ends):
        done = max(int(np.searchsorted(ends, base + _ROWS_AT_ONCE, side="right")), done + 1)
        base = int(ends[done - 1])
        cuts.append(done)
    return list(pairwise(cuts))


def _fill_rows(
    flat: Array,
    winner: NDArray[np.int64],
    width: int,
    triangle: NDArray[np.int64],
    row: NDArray[np.int64],
    edges: Array,
    slope: Array,
) -> None:
    """All pixels whose centres lie inside, row by row: each edge function bounds x from one side."""
    y = row + 0.5
    left, right = np.zeros(len(row)), np.full(len(row), float(width))
    for k in range(3):
        a, rest = edges[triangle, k, 0], edges[triangle, k, 1] * y + edges[triangle, k, 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = -rest / a
        left = np.where(a > 0, np.maximum(left, crossing), left)
        right = np.where(a < 0, np.minimum(right, crossing), right)
        right = np.where((a == 0) & (rest < 0), -1.0, right)
    start = np.ceil(np.clip(left, 0, width) - 0.5).astype(np.int64)
    count = np.maximum(np.ceil(np.clip(right, -1, width) - 0.5).astype(np.int64) - start, 0)
    pixel_row = np.repeat(np.arange(len(row)), count)
    x = np.arange(len(pixel_row)) - np.repeat(np.cumsum(count) - count, count) + start[pixel_row]
    owner = triangle[pixel_row]
    value = slope[owner, 0] * (x + 0.5) + (slope[triangle, 1] * y + slope[triangle, 2])[pixel_row]
    pixel = row[pixel_row] * width + x
    np.maximum.at(flat, pixel, value)
    won = value == flat[pixel]
    winner[pixel[won]] = owner[won]


def _fill(
    buffers: Buffers,
    seen: NDArray[np.bool_],
    winner: NDArray[np.int64],
    edges: Array,
    screen: Array,
    normals: Array,
    owner: NDArray[np.int64],
    surfaces: Sequence[Surface],
) -> None:
    """Colour, normal and identity of the pixels that were won."""
    rows, columns = np.nonzero(seen)
    e = edges[winner]
    weight = e[..., 0] * (columns + 0.5)[:, None] + e[..., 1] * (rows + 0.5)[:, None] + e[..., 2]
    nearness = screen[winner, :, 2]
    if np.all(nearness > 0):  # perspective: attributes are linear in space, not on the screen
        weight = weight * nearness
    normal = unit(np.einsum("pk,pkj->pj", weight, normals[winner]))
    colours = np.array([surface.rgba[:3] for surface in surfaces])
    buffers.normal[seen] = normal
    buffers.rgb[seen] = colours[owner[winner]]
    buffers.ident[seen] = np.array([surface.ident for surface in surfaces])[owner[winner]]
