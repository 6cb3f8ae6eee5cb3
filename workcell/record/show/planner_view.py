"""What the planner sees: the robot's spheres among the free cuboids, those that links are in drawn strongly."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np

from workcell.pose import Array
from workcell.record.read.stage import Stage, Thing
from workcell.record.render.shade import Line
from workcell.record.show.cameras import choose_cameras
from workcell.record.show.canvas import Sheet, shortened
from workcell.record.show.moments import key_moments
from workcell.record.show.studio import Studio

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from workcell.record.read.review import Review

_VIEW, _TILE, _COLUMNS, _MOMENTS = (800, 600), (640, 480), 2, 4
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
_UNUSED_RGB = (0.25, 0.65, 0.35)
_BADGE_PX = 18
_EDGE_POINTS = 17
_CORNER_M = 1e-6
_MANY = 24
"""Cuboids from which on those that no link is ever in are left out of the picture."""
_TITLE_PX, _CAPTION_PX, _MARGIN_PX = 72, 50, 12


def has_planner_view(review: Review) -> bool:
    """Whether spheres or cuboids were recorded."""
    return any(thing.kind in ("spheres", "free_space") for thing in review.stage.things)


def planner_view(review: Review) -> Figure:
    """The robot's spheres, the planned path, the goals' names, and the free cuboids.

    Where the recording tells which cuboids the links are in, at four moments, with these cuboids coloured and numbered;
    else once, at the start.
    """
    told = any(use.numbers for use in review.stage.uses)
    moments = key_moments(review, _MOMENTS) if told else key_moments(review)[:1]
    width, height = _TILE if len(moments) > 1 else _VIEW
    columns = min(_COLUMNS, len(moments))
    rows = -(-len(moments) // columns)
    tall = height + (_CAPTION_PX if told else _MARGIN_PX)
    sheet = Sheet(columns * (width + _MARGIN_PX) + _MARGIN_PX, _TITLE_PX + rows * tall)
    sheet.text(12, 24, f"{review.task}: what the planner sees", size=15, weight="bold")
    boxes = (
        "coloured boxes: free cuboids that links are in"
        if told
        else "green: cuboids and polytopes proved free"
    )
    others = "; thin green: other cuboids" if told else ""
    sheet.text(12, 50, f"blue: sphere cover of the robot; {boxes}{others}; blue line: planned path", size=11)
    studio = Studio(review.stage, choose_cameras(review.stage, width, height)[0])
    for k, moment in enumerate(moments):
        corner = (_MARGIN_PX + k % columns * (width + _MARGIN_PX), _TITLE_PX + k // columns * tall)
        if told:
            _used_tile(review, studio, sheet, corner, moment.time)
            _caption(
                review,
                sheet,
                (corner[0], corner[1] + height),
                f"{moment.time:.2f} s  {moment.caption}",
                moment.time,
            )
        else:
            sheet.tile(studio.picture(moment.time, ("free_space", "spheres", "obstacle_spheres")), corner)
        for index, (name, pose) in enumerate(review.stage.goals.items()):
            sheet.label(name, studio.place(pose.position), corner, index, (width, height))
    return sheet.figure


def cuboids_at(stage: Stage, time: float) -> dict[int, list[str]]:
    """The cuboids that links are in at a time, by number, and these links."""
    found: dict[int, list[str]] = {}
    for use, name in zip(stage.uses, _names(stage), strict=True):
        row = use.row_at(time)
        for number in use.numbers[row] if row >= 0 else ():
            found.setdefault(number, []).append(name)
    return dict(sorted(found.items()))


def _names(stage: Stage) -> list[str]:
    """Names of the links in the order of `stage.uses`, with their robots' where there are several."""
    several = len({use.robot for use in stage.uses}) > 1
    return [f"{use.robot}/{use.link}" if several else use.link for use in stage.uses]


def _used_tile(
    review: Review, studio: Studio, sheet: Sheet, corner: tuple[float, float], time: float
) -> None:
    """One moment, with the cuboids in use coloured and numbered."""
    used = cuboids_at(review.stage, time)
    cuboids = [thing for thing in review.stage.things if thing.kind == "free_space"]
    if len(cuboids) > _MANY:
        ever = {str(number) for use in review.stage.uses for number in use.distinct}
        cuboids = [thing for thing in cuboids if thing.owner in ever]
    lines: list[Line] = []
    badges: list[tuple[int, Array]] = []
    for thing in cuboids:
        number = int(thing.owner) if thing.owner.isdigit() else -1
        edges, low, high = _outline(thing)
        if number in used:
            lines += [Line(edge, COLOURS[number % len(COLOURS)], 2.2, 0.45) for edge in edges]
            spot = _spot(studio, low, high)
            while spot is not None and any(np.abs(spot - other).max() < _BADGE_PX for _, other in badges):
                spot = spot + np.array([_BADGE_PX, 0.0])
            badges += [] if spot is None else [(number, spot)]
        else:
            lines += [Line(edge, _UNUSED_RGB, 0.6, 0.12) for edge in edges]
    sheet.tile(studio.picture(time, ("spheres", "obstacle_spheres"), lines=lines), corner)
    for number, spot in badges:
        sheet.badge(str(number), spot, corner, COLOURS[number % len(COLOURS)])


def _caption(review: Review, sheet: Sheet, place: tuple[float, float], moment: str, time: float) -> None:
    """The time, and which link is in which cuboid."""
    x, y = place
    sheet.text(x, y + 13, shortened(moment, 80), size=12, weight="bold")
    order = _names(review.stage)
    places = [f"{number}: {_runs(links, order)}" for number, links in cuboids_at(review.stage, time).items()]
    sheet.text(
        x, y + 31, shortened("in cuboid " + "; ".join(places) if places else "in no cuboid", 128), size=11
    )


def _runs(links: list[str], order: list[str]) -> str:
    """Names of links in few words: of neighbours, the first and the last."""
    runs: list[list[str]] = []
    for link in links:
        neighbour = runs and order.index(link) == order.index(runs[-1][-1]) + 1
        if neighbour and link.rpartition("/")[0] == runs[-1][0].rpartition("/")[0]:
            runs[-1].append(link)
        else:
            runs.append([link])
    return ", ".join(run[0] if len(run) == 1 else f"{run[0]} to {run[-1].rpartition('/')[2]}" for run in runs)


def _outline(thing: Thing) -> tuple[list[Array], Array, Array]:
    """Edges of a cuboid, or all triangles of a polytope, as points (k, 3) each, and the corners of the box around."""
    vertices = np.concatenate([mesh.vertices for mesh, _ in thing.parts])
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    if np.all((np.abs(vertices - low) < _CORNER_M) | (np.abs(vertices - high) < _CORNER_M)):
        return box_edges(low, high), low, high
    faces = [mesh.vertices[list(face)] for mesh, _ in thing.parts for face in mesh.faces]
    return [np.concatenate([face, face[:1]]) for face in faces], low, high


def box_edges(low: Array, high: Array) -> list[Array]:
    """The twelve edges of an axis-aligned box, each as points (k, 3) on it."""
    corners = [np.where(side, high, low) for side in itertools.product((False, True), repeat=3)]
    pairs = itertools.combinations(corners, 2)
    return [np.linspace(a, b, _EDGE_POINTS) for a, b in pairs if np.count_nonzero(a != b) == 1]


def _spot(studio: Studio, low: Array, high: Array) -> Array | None:
    """Where in the picture to write a box's number: at a corner in sight, the upper ones first; else in its middle."""
    corners = [np.where(side, high, low) for side in itertools.product((True, False), repeat=3)]
    for point in [*sorted(corners, key=lambda corner: -corner[2]), (low + high) / 2]:
        x, y = studio.place(point)
        if 24 < x < studio.width - 24 and 24 < y < studio.height - 24:
            return np.array([x, y])
    return None
