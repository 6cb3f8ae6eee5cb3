"""A picture of a decomposition: geometry, spheres and free space, each from two sides. Needs no graphics card."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from workcell.errors import OutputError
from workcell.geometry.decompose import Decomposition
from workcell.geometry.free_space.polytopes import solid_of
from workcell.geometry.polytope import polytope_of
from workcell.geometry.types import Piece
from workcell.pose import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_VIEWS = (("from the side", 0, 2, 1.0), ("from above", 0, 1, 1.0))
"""Title, horizontal and vertical world axis, and the sign of the missing axis that points at the viewer."""

_ROBOT, _OBSTACLE, _POLYTOPE = "#d1600a", "#5b6b7a", "#b02a6b"


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
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(16.5, 10.5), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(_VIEWS), 3)
    window = _window(decomposition)
    for row, (side, across, up, sign) in enumerate(_VIEWS):
        for column, panel in enumerate((_draw_geometry, _draw_spheres, _draw_cuboids)):
            title = panel(axes[row, column], decomposition, across, up, sign)
            _frame(axes[row, column], f"{title}, {side}", window, across, up)
    metrics = decomposition.metrics
    figure.suptitle(
        f"{decomposition.scene}: {metrics['robot_spheres']} spheres on the arm, {metrics['base_spheres']} on its base, "
        f"{metrics['obstacle_spheres']} on obstacles "
        f"(at most {1e3 * metrics['robot_overshoot_max_m']:.0f} mm outside); "
        f"{metrics['cuboids']} cuboids and {metrics['polytopes']} polytopes "
        f"that hold {100 * metrics['covered_fraction']:.1f} % of the free workspace",
        fontsize=14,
    )
    return figure


def _draw_geometry(axes: Axes, d: Decomposition, across: int, up: int, sign: float) -> str:
    _draw_outlines(axes, d.obstacles, across, up, sign, face=_OBSTACLE, alpha=0.45)
    _draw_outlines(axes, d.robot_pieces, across, up, sign, face=_ROBOT, alpha=0.55)
    return "Geometry"


def _draw_spheres(axes: Axes, d: Decomposition, across: int, up: int, sign: float) -> str:
    near = _visible(d.obstacle_cover.centre, d)
    _draw_balls(
        axes, d.obstacle_cover.centre[near], d.obstacle_cover.radius[near], across, up, _OBSTACLE, 0.06
    )
    centres, radii = d.robot_spheres()
    for part, alpha in ((d.robot_cover.link == 0, 0.03), (d.robot_cover.link > 0, 0.3)):
        _draw_balls(axes, centres[part], radii[part], across, up, _ROBOT, alpha)
    _draw_outlines(axes, d.robot_pieces, across, up, sign, face="none", alpha=0.9)
    return "Spheres"


def _draw_cuboids(axes: Axes, d: Decomposition, across: int, up: int, sign: float) -> str:
    from matplotlib.patches import Polygon, Rectangle
    from scipy.spatial import ConvexHull

    _draw_outlines(axes, d.obstacles, across, up, sign, face=_OBSTACLE, alpha=0.35)
    for number, (low, high) in enumerate(zip(d.free_space.lower, d.free_space.upper, strict=True)):
        size = high - low
        colour = _shade(number, len(d.free_space))
        axes.add_patch(
            Rectangle(
                (low[across], low[up]), size[across], size[up], facecolor=colour, edgecolor=colour, alpha=0.16
            )
        )
        axes.add_patch(
            Rectangle(
                (low[across], low[up]), size[across], size[up], fill=False, edgecolor=colour, linewidth=1.8
            )
        )
    for polytope in d.free_space.polytopes:
        flat = solid_of(polytope).vertices[:, [across, up]]
        outline = flat[ConvexHull(flat).vertices]
        axes.add_patch(Polygon(outline, facecolor=_POLYTOPE, edgecolor=_POLYTOPE, alpha=0.16))
        axes.add_patch(Polygon(outline, fill=False, edgecolor=_POLYTOPE, linewidth=1.8))
    _draw_outlines(axes, d.robot_pieces, across, up, sign, face=_ROBOT, alpha=0.5)
    return "Free space"


def _draw_outlines(
    axes: Axes, pieces: Sequence[Piece], across: int, up: int, sign: float, *, face: str, alpha: float
) -> None:
    """Silhouettes of pieces, the farther ones first; half-spaces are left out."""
    from matplotlib.collections import PolyCollection
    from scipy.spatial import ConvexHull

    depth_axis = 3 - across - up
    drawn = []
    for piece in pieces:
        if piece.kind == "halfspace":
            continue
        corners = polytope_of(piece).vertices
        flat = corners[:, [across, up]]
        drawn.append((sign * corners[:, depth_axis].max(), flat[ConvexHull(flat).vertices]))
    drawn.sort(key=lambda item: item[0])
    edge = "#333333" if face != "none" else _ROBOT
    axes.add_collection(
        PolyCollection(
            [shape for _, shape in drawn], facecolor=face, edgecolor=edge, linewidth=0.5, alpha=alpha
        )
    )


def _draw_balls(
    axes: Axes, centres: Array, radii: Array, across: int, up: int, colour: str, alpha: float
) -> None:
    from matplotlib.collections import EllipseCollection

    axes.add_collection(
        EllipseCollection(
            2 * radii,
            2 * radii,
            np.zeros(len(radii)),
            units="xy",
            offsets=centres[:, [across, up]],
            offset_transform=axes.transData,
            facecolor=colour,
            edgecolor=colour,
            linewidth=0.4,
            alpha=alpha,
        )
    )


def _frame(axes: Axes, title: str, window: Array, across: int, up: int) -> None:
    axes.set_xlim(window[0, across], window[1, across])
    axes.set_ylim(window[0, up], window[1, up])
    axes.set_aspect("equal")
    axes.set_title(title)
    axes.set_xlabel(f"{'xyz'[across]} in metres")
    axes.set_ylabel(f"{'xyz'[up]} in metres")


def _window(d: Decomposition) -> Array:
    """(2, 3) corners of what is worth drawing: the robot and the obstacles near it."""
    centres, radii = d.robot_spheres()
    low, high = (centres - radii[:, None]).min(axis=0), (centres + radii[:, None]).max(axis=0)
    reach = d.robot.reach()
    origin = d.robot.T_world_base.position
    for piece in d.obstacles:
        if piece.kind == "halfspace":
            continue
        corners = polytope_of(piece).vertices
        if np.linalg.norm(np.ptp(corners, axis=0)) < 3 * reach:
            low = np.minimum(low, np.maximum(corners.min(axis=0), origin - 1.6 * reach))
            high = np.maximum(high, np.minimum(corners.max(axis=0), origin + 1.6 * reach))
    return np.array([low - 0.12, high + 0.12])


def _visible(centres: Array, d: Decomposition) -> Any:
    window = _window(d)
    return np.all((centres > window[0] - 0.2) & (centres < window[1] + 0.2), axis=1)


def _shade(number: int, count: int) -> tuple[float, float, float, float]:
    from matplotlib import colormaps

    shade: tuple[float, float, float, float] = colormaps["viridis"](0.1 + 0.8 * number / max(count - 1, 1))
    return shade
