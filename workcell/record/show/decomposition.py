"""A picture of a decomposition: geometry, spheres and free space, each from two sides. Needs no graphics card."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from workcell.errors import OutputError
from workcell.geometry.decompose import Decomposition
from workcell.geometry.free_space.polytopes import solid_of
from workcell.geometry.polytope import Polytope, polytope_of
from workcell.geometry.types import Piece
from workcell.pose import Array, Pose
from workcell.record.read.stage import Stage, Thing
from workcell.record.render.raster import Camera
from workcell.record.render.shade import Line
from workcell.record.render.tessellate import balls, tessellate
from workcell.record.shapes import (
    OBSTACLE_SPHERE_RGBA,
    ROBOT_SPHERE_RGBA,
    Shape,
    piece_shape,
    polytope_shape,
)
from workcell.record.show.outline import box_edges, joined
from workcell.record.show.studio import Studio

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ROBOT, _OBSTACLE = (0.82, 0.38, 0.04, 1.0), (*OBSTACLE_SPHERE_RGBA[:3], 0.45)
_CUBOID, _POLYTOPE = (0.25, 0.65, 0.35, 0.14), (0.69, 0.16, 0.42, 0.14)
COLOURS = (
    (0.84, 0.15, 0.16),
    (0.58, 0.40, 0.74),
    (0.00, 0.58, 0.62),
    (0.62, 0.52, 0.00),
    (0.80, 0.30, 0.62),
    (0.55, 0.34, 0.29),
    (0.50, 0.50, 0.05),
    (0.20, 0.20, 0.20),
)
"""Of the cuboids, in the order of their numbers."""
_EDGE_RGB = (0.2, 0.2, 0.2)
_DPI, _PANEL_PX = 100, 500
_HEAD_PX, _ABOVE_PX, _BELOW_PX, _LEFT_PX, _RIGHT_PX = 62, 28, 50, 84, 16
"""Pixels left for the headline, for titles above panels, and for their scales below and on the left."""


@dataclass(frozen=True, slots=True)
class _Panel:
    """What one column shows: things of some kinds, and lines."""

    title: str
    kinds: tuple[str, ...]
    lines: tuple[Line, ...]


@dataclass(frozen=True, slots=True)
class _View:
    """A side to look from, `away` from what is seen; two world axes run across and up the picture."""

    title: str
    across: int
    up: int
    away: tuple[float, float, float]

    def camera(self, window: Array, scale: float) -> Camera:
        """A parallel camera over a window (2, 3), `scale` pixels a metre."""
        size, middle = window[1] - window[0], window.mean(axis=0)
        width, height = (round(scale * size[axis]) for axis in (self.across, self.up))
        position = middle + 2.0 * float(np.linalg.norm(size)) * np.array(self.away)
        return Camera(position, middle, width, height, extent=height / scale)


_VIEWS = (
    _View("from the side", 0, 2, (0.0, -1.0, 0.0)),
    _View("from above", 0, 1, (0.0, 0.0, 1.0)),
)


def draw_decomposition(decomposition: Decomposition, path: str | Path) -> None:
    """Write `decomposition_figure` as a PNG.

    Raises:
        OutputError: the file can't be written.
    """
    figure = decomposition_figure(decomposition)
    try:
        figure.savefig(path)
    except OSError as error:
        raise OutputError(f"the picture can't be written: {error.strerror or error}", where=path) from None


def decomposition_figure(decomposition: Decomposition) -> Figure:
    """Six panels: geometry, spheres and free space (columns), each seen from the side and from above (rows)."""
    window = _window(decomposition)
    size = window[1] - window[0]
    scale = _PANEL_PX / float(size.max())
    stage = Stage(_things(decomposition, window), {}, {}, {}, {}, {})
    page = _Page.of([round(scale * size[axis]) for axis in (0, 2, 1)])
    page.figure.suptitle(_headline(decomposition), fontsize=11)
    for row, view in enumerate(_VIEWS):
        studio = Studio(stage, view.camera(window, scale), smooth=False)
        for column, panel in enumerate(_panels(decomposition, view)):
            axes = page.panel(row, column, studio.width, studio.height)
            axes.imshow(
                studio.picture(0.0, panel.kinds, lines=panel.lines),
                extent=(*window[:, view.across], *window[:, view.up]),
            )
            axes.set_title(f"{panel.title}, {view.title}", fontsize=11)
            axes.set_xlabel(f"{'xyz'[view.across]} in metres")
            axes.set_ylabel(f"{'xyz'[view.up]} in metres")
    return page.figure


def _headline(d: Decomposition) -> str:
    metrics = d.metrics
    if d.robot is None:
        outside = 1e3 * metrics["obstacle_overshoot_max_m"]
        return f"{d.scene}: {metrics['obstacle_spheres']} spheres on obstacles (at most {outside:.0f} mm outside)"
    outside = 1e3 * metrics["robot_overshoot_max_m"]
    return (
        f"{d.scene}: {metrics['robot_spheres']} spheres on the arm, {metrics['base_spheres']} on its base, "
        f"{metrics['obstacle_spheres']} on obstacles (at most {outside:.0f} mm outside);\n"
        f"{metrics['cuboids']} cuboids and {metrics['polytopes']} polytopes "
        f"that hold {100 * metrics['covered_fraction']:.1f} % of the free workspace"
    )


@dataclass(frozen=True, slots=True)
class _Page:
    """A page whose panels are as large as their pictures, pixel for pixel."""

    figure: Figure
    width: int
    heights: tuple[int, int]

    @staticmethod
    def of(sizes: Sequence[int]) -> _Page:
        """For pictures `sizes[0]` pixels wide, `sizes[1]` high in the upper row and `sizes[2]` in the lower one."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        width, *heights = sizes
        page = 3 * (_LEFT_PX + width) + _RIGHT_PX, _HEAD_PX + sum(heights) + 2 * (_ABOVE_PX + _BELOW_PX)
        figure = Figure(figsize=(page[0] / _DPI, page[1] / _DPI), dpi=_DPI)
        FigureCanvasAgg(figure)
        return _Page(figure, width, (heights[0], heights[1]))

    def panel(self, row: int, column: int, width: int, height: int) -> Axes:
        """Axes for a picture."""
        page_width, page_height = _DPI * self.figure.get_size_inches()
        left = _LEFT_PX + column * (_LEFT_PX + self.width)
        bottom = _BELOW_PX if row == 1 else self.heights[1] + _ABOVE_PX + 2 * _BELOW_PX
        return self.figure.add_axes(
            (left / page_width, bottom / page_height, width / page_width, height / page_height)
        )


def _panels(d: Decomposition, view: _View) -> tuple[_Panel, ...]:
    free = d.free_space
    # obstacles are one see-through layer, in which only the nearest shows: outlines show those inside and behind
    outlines = tuple(Line(_outline(piece, view), _EDGE_RGB, 0.5, 0.15) for piece in _bounded(d))
    cuboids = [
        Line(joined(box_edges(low, high)), COLOURS[number % len(COLOURS)], 1.0, 0.45)
        for number, (low, high) in enumerate(zip(free.lower, free.upper, strict=True))
    ]
    polytopes = [Line(joined(_edges(solid_of(p))), _POLYTOPE[:3], 0.5, 0.45) for p in free.polytopes]
    return (
        _Panel("Geometry", ("walls",), outlines),
        _Panel("Spheres", ("spheres", "obstacle_spheres"), ()),
        _Panel("Free space", ("walls", "free_space"), (*outlines, *polytopes, *cuboids)),
    )


def _things(d: Decomposition, window: Array) -> list[Thing]:
    """The robot, and what is laid over it where a panel shows it, one see-through layer a kind and owner."""
    centres, radii = d.robot_spheres()
    cover, fixed = d.obstacle_cover, d.robot_cover.link == 0
    near = np.all((cover.centre > window[0] - 0.2) & (cover.centre < window[1] + 0.2), axis=1)
    cuboids = zip(d.free_space.lower, d.free_space.upper, strict=True)
    spheres = [
        ("spheres", "arm", centres[~fixed], radii[~fixed], ROBOT_SPHERE_RGBA),
        ("spheres", "base", centres[fixed], radii[fixed], ROBOT_SPHERE_RGBA),
        ("obstacle_spheres", "all", cover.centre[near], cover.radius[near], OBSTACLE_SPHERE_RGBA),
    ]
    return [
        *(_solids("robots", piece.name, [piece_shape(piece, np.array(_ROBOT))]) for piece in d.robot_pieces),
        _solids("walls", "all", [piece_shape(piece, np.array(_OBSTACLE)) for piece in _bounded(d)]),
        *(
            Thing(f"{kind}/{owner}", kind, owner, ((balls(c, r), np.array(rgba)),))
            for kind, owner, c, r, rgba in spheres
        ),
        _solids("free_space", "cuboids", [_cuboid(low, high) for low, high in cuboids]),
        _solids(
            "free_space",
            "polytopes",
            [polytope_shape(p, np.array(_POLYTOPE)) for p in d.free_space.polytopes],
        ),
    ]


def _solids(kind: str, owner: str, shapes: Iterable[Shape]) -> Thing:
    return Thing(f"{kind}/{owner}", kind, owner, tuple((tessellate(shape), shape.rgba) for shape in shapes))


def _cuboid(low: Array, high: Array) -> Shape:
    return Shape("", "box", (high - low) / 2, Pose.from_xyz((low + high) / 2), np.array(_CUBOID))


def _bounded(d: Decomposition) -> list[Piece]:
    """The obstacles, half-spaces left out."""
    return [piece for piece in d.obstacles if piece.kind != "halfspace"]


def _outline(piece: Piece, view: _View) -> Array:
    """Corners (k, 3) around a piece as a view sees it, the first again at the end."""
    from scipy.spatial import ConvexHull

    corners = polytope_of(piece).vertices
    around: Array = corners[ConvexHull(corners[:, [view.across, view.up]]).vertices]
    return np.concatenate([around, around[:1]])


def _edges(solid: Polytope) -> list[Array]:
    return list(solid.vertices[solid.edges])


def _window_of_all(d: Decomposition) -> Array:
    """(2, 3) corners of all obstacles; of a metre around the origin where none has an end."""
    corners = [polytope_of(piece).vertices for piece in _bounded(d)] or [np.array([[-1.0] * 3, [1.0] * 3])]
    points = np.concatenate(corners)
    return np.array([points.min(axis=0) - 0.12, points.max(axis=0) + 0.12])


def _window(d: Decomposition) -> Array:
    """(2, 3) corners of what is worth drawing: the robot and the obstacles near it."""
    if d.robot is None:
        return _window_of_all(d)
    centres, radii = d.robot_spheres()
    low, high = (centres - radii[:, None]).min(axis=0), (centres + radii[:, None]).max(axis=0)
    reach = d.robot.reach()
    origin = d.robot.T_world_base.position
    for piece in _bounded(d):
        corners = polytope_of(piece).vertices
        if np.linalg.norm(np.ptp(corners, axis=0)) < 3 * reach:
            low = np.minimum(low, np.maximum(corners.min(axis=0), origin - 1.6 * reach))
            high = np.maximum(high, np.minimum(corners.max(axis=0), origin + 1.6 * reach))
    return np.array([low - 0.12, high + 0.12])
