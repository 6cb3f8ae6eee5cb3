"""Plots of a recording's metrics over time."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from workcell.ik.ikspark.rank import RANK_GAP
from workcell.record.read.metrics import Series, unit_of
from workcell.record.write.cuboid_use import IN_USE, OUTSIDE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from workcell.record.read.review import Review

_COLOURS = ("#1f6fb4", "#d9541e", "#3a9a4b", "#8a5bb0", "#a67c1a", "#c2417a", "#4a4a4a")
_HIGHEST = 8.0
_SMALLEST = 1e-12
_WIDE_ENOUGH = 0.015


def plot_metrics(review: Review) -> Figure:
    """Panels over simulated time, with events as thin lines.

    Clearance, tracking error, which cuboids decided, other metrics, joint positions. Last, over the
    solvers' steps, the rank residuals of their iterations.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    timed = _timed_panels(review)
    solved = any(not np.isnan(stage.residual) for query in review.queries for stage in query.stages)
    draw = [*timed]
    if solved:
        draw.append((partial(_draw_residuals, review=review), 2.6))
    heights = [height for _, height in draw] or [2.4]
    figure = Figure(figsize=(10, sum(heights) + 0.6), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(f"{review.task}: {review.verdict}", fontsize=13, fontweight="bold")
    grid = {"height_ratios": heights}
    panels = figure.subplots(len(heights), 1, squeeze=False, gridspec_kw=grid)[:, 0]
    for k, (panel, (paint, _)) in enumerate(zip(panels, draw, strict=False)):
        paint(panel)
        if 0 < k < len(timed):
            panel.sharex(panels[0])
    for panel in panels[: len(timed) - 1]:
        panel.tick_params(labelbottom=False)
    if timed:
        panels[len(timed) - 1].set_xlabel("simulated time in seconds")
    else:
        panels[0].text(0.5, 0.5, "no metrics in this recording", ha="center", transform=panels[0].transAxes)
    return figure


def _timed_panels(review: Review) -> list[tuple[Callable[[Any], None], float]]:
    """What to draw over simulated time, and how high (inches)."""
    told = bool(review.stage.uses)
    series = [one for one in review.series.values() if not (told and one.name.startswith((IN_USE, OUTSIDE)))]
    panels: list[tuple[tuple[float, str], Callable[[Any], None], float]] = [
        (_rank(one), partial(_draw, series=one, review=review), 2.4) for one in series
    ]
    if told and review.duration > 0:
        lanes = sum(1 + len(use.distinct) for use in review.stage.uses)
        height = min(0.8 + 0.13 * lanes, _HIGHEST)
        panels.append(((1.5, ""), partial(_draw_cuboids, review=review), height))
    return [(paint, height) for _, paint, height in sorted(panels, key=lambda panel: panel[0])]


def _rank(series: Series) -> tuple[float, str]:
    first = {"clearance": 0.0, "tracking_error": 1.0}
    return (first.get(series.name, 3.0 if series.name.startswith("joint_positions") else 2.0), series.name)


def _title(name: str) -> str:
    """`joint_positions/sawyer` is `joint positions of sawyer`; radians are in the unit."""
    words, _, robot = name.removesuffix("_rad").partition("/")
    turned = " of the tool's orientation" if name.endswith("_rad") else ""
    return words.replace("_", " ") + turned + (f" of {robot}" if robot else "")


def _draw_cuboids(panel: Any, *, review: Review) -> None:
    """A bar for each cuboid that held a link, with its number, while it did; red below: a sphere is not all inside."""
    uses, end, lane = review.stage.uses, review.duration, 0
    several = len({use.robot for use in uses}) > 1
    ticks = {}
    for use in uses:
        top = lane
        for number in use.distinct:
            spans = use.spans(number, end)
            panel.broken_barh([(a, b - a) for a, b in spans], (lane, 0.9), color=use.rgb, alpha=0.55)
            for a, b in spans:
                if b - a > _WIDE_ENOUGH * end:
                    panel.text(a, lane + 0.47, f" {number}", fontsize=6.5, va="center", clip_on=True)
            lane += 1
        panel.broken_barh([(a, b - a) for a, b in use.spans(None, end)], (lane, 0.3), color="#c03030")
        lane += 1
        ticks[(top + lane - 1) / 2] = f"{use.robot}/{use.link}" if several else use.link
    panel.set_yticks(list(ticks), list(ticks.values()), fontsize=8)
    panel.set_ylim(lane, -0.5)
    panel.set_title(
        f"{review.cuboid_words}, by number (red: a sphere is not wholly inside)",
        loc="left",
        fontsize=10,
    )
    panel.margins(x=0.01)
    for line in review.events:
        panel.axvline(line.time, color="#888888", lw=0.7, ls=":")


def _draw_residuals(panel: Any, *, review: Review) -> None:
    """Rank residuals down to where a point counts as a configuration; a line a restart, a colour a query."""
    colour = 0
    for query in review.queries:
        lines: list[list[tuple[int, float]]] = []
        for k, stage in enumerate(query.stages, start=query.first_step):
            if stage.name not in ("relaxation", "rank reduction") or np.isnan(stage.residual):
                continue
            if stage.name == "relaxation" or not lines:
                lines.append([])
            lines[-1].append((k, max(stage.residual, _SMALLEST)))
        for line in lines:
            panel.plot(*zip(*line, strict=True), "o-", ms=3, lw=1.2, color=_COLOURS[colour % len(_COLOURS)])
        colour += bool(lines)
    panel.set_yscale("log")
    panel.axhline(RANK_GAP, color="#c03030", lw=1.0)
    panel.annotate(
        "counts as a configuration",
        (1.0, RANK_GAP),
        xycoords=("axes fraction", "data"),
        xytext=(-4, -9),
        textcoords="offset points",
        ha="right",
        fontsize=8,
        color="#c03030",
    )
    panel.set_title(
        "rank residual of the solvers' iterations (a colour a query, a line a restart)",
        loc="left",
        fontsize=10,
    )
    panel.set_xlabel("step of the solvers (timeline solver_step)")
    panel.xaxis.get_major_locator().set_params(integer=True)
    panel.grid(alpha=0.25)
    panel.margins(x=0.03, y=0.14)


def _draw(panel: Any, *, series: Series, review: Review) -> None:
    scale, unit = unit_of(series.name)
    for k, column in enumerate(series.columns):
        label = column if len(series.columns) > 1 else None
        mark = "o" if len(series.times) == 1 else ""
        colour = _COLOURS[k % len(_COLOURS)]
        panel.plot(
            series.times, scale * series.values[:, k], lw=1.4, marker=mark, ms=5, color=colour, label=label
        )
    panel.set_title(_title(series.name), loc="left", fontsize=10)
    panel.set_ylabel(unit)
    panel.grid(alpha=0.25)
    panel.margins(x=0.01, y=0.14)
    for line in review.events:
        panel.axvline(line.time, color="#c03030" if line.level == "ERROR" else "#888888", lw=0.7, ls=":")
    if series.name == "clearance":
        panel.axhline(0.0, color="#c03030", lw=1.0)
        _mark(panel, series, scale, int(np.nanargmin(series.values[:, 0])), "min")
    if series.name == "tracking_error":
        _mark(panel, series, scale, int(np.nanargmax(series.values[:, 0])), "max")
    if len(series.columns) > 1:
        panel.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8, frameon=False)


def _mark(panel: Any, series: Series, scale: float, k: int, word: str) -> None:
    value = scale * float(series.values[k, 0])
    panel.plot(series.times[k], value, "o", ms=5, color="#c03030")
    panel.annotate(
        f"{word} {value:.3g} mm",
        (series.times[k], value),
        textcoords="offset points",
        xytext=(6, 6),
        fontsize=8,
    )
