"""What the planner sees: the robot's spheres among the free cuboids, those that decided in the links' colours."""

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
from workcell.record.show.outline import CORNER_M, box_edges, creases, dashes, joined
from workcell.record.show.studio import Studio

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from workcell.record.read.review import Review

_VIEW, _TILE, _COLUMNS, _MOMENTS = (800, 600), (640, 480), 2, 4
_UNUSED_RGB = (0.25, 0.65, 0.35)
_BADGE_PX = 18
_MANY = 24
"""Cuboids from which on those that no link is ever in are left out of the picture."""
_BADGE_RGB = (0.2, 0.2, 0.2)
_TITLE_PX, _CAPTION_PX, _MARGIN_PX = 94, 50, 12


def has_planner_view(review: Review) -> bool:
    """Whether spheres or cuboids were recorded."""
    return any(thing.kind in ("spheres", "free_space") for thing in review.stage.things)


def planner_view(review: Review) -> Figure:
    """The robot's spheres, the planned path, the goals' names, and the free cuboids.

    Of a run at four moments, with the cuboids that decided in the colours of the links that were in them, and their
    numbers; of a decomposition, where nobody planned, once.
    """
    planned = bool(review.cuboid_words or review.cuboids)
    moments = key_moments(review, _MOMENTS) if planned else key_moments(review)[:1]
    width, height = _TILE if len(moments) > 1 else _VIEW
    columns = min(_COLUMNS, len(moments))
    rows = -(-len(moments) // columns)
    tall = height + (_CAPTION_PX if planned else _MARGIN_PX)
    sheet = Sheet(columns * (width + _MARGIN_PX) + _MARGIN_PX, _TITLE_PX + rows * tall)
    _title(review, sheet, planned)
    studio = Studio(review.stage, choose_cameras(review.stage, width, height)[0])
    for k, moment in enumerate(moments):
        corner = (_MARGIN_PX + k % columns * (width + _MARGIN_PX), _TITLE_PX + k // columns * tall)
        if planned:
            _used_tile(review, studio, sheet, corner, moment.time)
            words = f"{moment.time:.2f} s  {moment.caption}"
            _caption(review, sheet, (corner[0], corner[1] + height), words, moment.time)
        else:
            sheet.tile(studio.picture(moment.time, ("free_space", "spheres", "obstacle_spheres")), corner)
        for index, (name, pose) in enumerate(review.stage.goals.items()):
            sheet.label(name, studio.place(pose.position), corner, index, (width, height))
    return sheet.figure


def _title(review: Review, sheet: Sheet, planned: bool) -> None:
    """What is drawn, who planned, and the links' colours."""
    sheet.text(12, 24, f"{review.task}: what the planner sees", size=15, weight="bold")
    decided = review.cuboid_words
    if review.cuboids:
        decided = f"boxes in the links' colours: {decided}"
    others = "other free cuboids" if review.cuboids else "free cuboids"
    green = f"thin green: {others}" if planned else "green: cuboids and polytopes proved free"
    parts = ["blue: sphere cover of the robot", decided, green, "blue line: planned path"]
    sheet.text(12, 50, "; ".join(filter(None, parts)), size=11)
    colours = {use.link: use.rgb for use in review.stage.uses if use.distinct}
    sheet.words(12, 74, list(colours.items()), size=11)


def cuboids_at(stage: Stage, time: float) -> dict[int, list[str]]:
    """The cuboids that held links at a time, by number, and these links."""
    names = _names(stage)
    return {number: [names[k] for k in held] for number, held in _held_at(stage, time).items()}


def _held_at(stage: Stage, time: float) -> dict[int, list[int]]:
    """The cuboids that held links at a time, by number, and the links as indices of `stage.uses`."""
    found: dict[int, list[int]] = {}
    for k, use in enumerate(stage.uses):
        row = use.row_at(time)
        for number in use.numbers[row] if row >= 0 else ():
            found.setdefault(number, []).append(k)
    return dict(sorted(found.items()))


def _names(stage: Stage) -> list[str]:
    """Names of the links in the order of `stage.uses`, with their robots' where there are several."""
    several = len({use.robot for use in stage.uses}) > 1
    return [f"{use.robot}/{use.link}" if several else use.link for use in stage.uses]


def _used_tile(
    review: Review, studio: Studio, sheet: Sheet, corner: tuple[float, float], time: float
) -> None:
    """One moment, with the cuboids that decided coloured and numbered."""
    held = _held_at(review.stage, time)
    cuboids = [thing for thing in review.stage.things if thing.kind == "free_space"]
    if len(cuboids) > _MANY:
        ever = {str(number) for use in review.stage.uses for number in use.distinct}
        cuboids = [thing for thing in cuboids if thing.owner in ever]
    lines: list[Line] = []
    badges: list[tuple[int, Array]] = []
    for thing in cuboids:
        number = int(thing.owner) if thing.owner.isdigit() else -1
        edges, low, high = _outline(thing)
        if number not in held:
            lines.append(Line(joined(edges), _UNUSED_RGB, 0.6, 0.12))
            continue
        colours = [review.stage.uses[k].rgb for k in held[number]]
        lines += [Line(mine, rgb, 2.2, 0.45) for mine, rgb in dashes(edges, colours)]
        spot = _spot(studio, low, high)
        while spot is not None and any(np.abs(spot - other).max() < _BADGE_PX for _, other in badges):
            spot = spot + np.array([_BADGE_PX, 0.0])
        badges += [] if spot is None else [(number, spot)]
    sheet.tile(studio.picture(time, ("spheres", "obstacle_spheres"), lines=lines), corner)
    for number, spot in badges:
        sheet.badge(str(number), spot, corner, _BADGE_RGB)


def _caption(review: Review, sheet: Sheet, place: tuple[float, float], moment: str, time: float) -> None:
    """The time, and which cuboid held which link."""
    x, y = place
    sheet.text(x, y + 13, shortened(moment, 80), size=12, weight="bold")
    order = _names(review.stage)
    held = [f"{number}: {_runs(links, order)}" for number, links in cuboids_at(review.stage, time).items()]
    words = "in cuboid " + "; ".join(held) if held else f"no cuboid decided here: {_why_none(review, time)}"
    sheet.text(x, y + 31, shortened(words, 128), size=11)


def _why_none(review: Review, time: float) -> str:
    """Where the robots are instead: on no way, or on one that was answered without cuboids."""
    found = dict.fromkeys(
        "on no way that was asked for" if one.ways[row] is None else f"{one.by[row]} answered {one.ways[row]}"
        for one in review.places
        if (row := one.row_at(time)) >= 0
    )
    return ", ".join(found) or "not told"


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
    """Edges of a cuboid or a polytope as points (k, 3) each, and the corners of the box around."""
    vertices = np.concatenate([mesh.vertices for mesh, _ in thing.parts])
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    if np.all((np.abs(vertices - low) < CORNER_M) | (np.abs(vertices - high) < CORNER_M)):
        return box_edges(low, high), low, high
    return [edge for mesh, _ in thing.parts for edge in creases(mesh)], low, high


def _spot(studio: Studio, low: Array, high: Array) -> Array | None:
    """Where in the picture to write a box's number: at a corner in sight, the upper ones first; else in its middle."""
    corners = [np.where(side, high, low) for side in itertools.product((True, False), repeat=3)]
    for point in [*sorted(corners, key=lambda corner: -corner[2]), (low + high) / 2]:
        x, y = studio.place(point)
        if 24 < x < studio.width - 24 and 24 < y < studio.height - 24:
            return np.array([x, y])
    return None
