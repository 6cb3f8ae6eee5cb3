"""Plots of a recording's metrics over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from workcell.record.metrics import Series

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from workcell.record.review import Review

_MILLIMETRES = ("clearance", "tracking_error")
_COLOURS = ("#1f6fb4", "#d9541e", "#3a9a4b", "#8a5bb0", "#a67c1a", "#c2417a", "#4a4a4a")


def plot_metrics(review: Review) -> Figure:
    """One panel for each metric, clearance and tracking error first, joint positions last; events as thin lines."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    ordered = sorted(review.series.values(), key=_rank)
    figure = Figure(figsize=(10, 2.4 * max(len(ordered), 1) + 0.6), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(f"{review.task}: {review.verdict}", fontsize=13, fontweight="bold")
    panels = figure.subplots(max(len(ordered), 1), 1, sharex=True, squeeze=False)[:, 0]
    for panel, series in zip(panels, ordered, strict=False):
        _draw(panel, series, review)
    panels[-1].set_xlabel("simulated time in seconds")
    if not ordered:
        panels[0].text(0.5, 0.5, "no metrics in this recording", ha="center", transform=panels[0].transAxes)
    return figure


def _rank(series: Series) -> tuple[int, str]:
    first = {"clearance": 0, "tracking_error": 1}
    return (first.get(series.name, 3 if series.name.startswith("joint_positions") else 2), series.name)


def _draw(panel: Any, series: Series, review: Review) -> None:
    scale, unit = _unit(series.name)
    for k, column in enumerate(series.columns):
        label = column if len(series.columns) > 1 else None
        panel.plot(
            series.times, scale * series.values[:, k], lw=1.4, color=_COLOURS[k % len(_COLOURS)], label=label
        )
    panel.set_title(series.name.replace("_", " "), loc="left", fontsize=10)
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


def _unit(name: str) -> tuple[float, str]:
    if name in _MILLIMETRES:
        return 1e3, "mm"
    if name.endswith("_rad") or name.startswith("joint_positions"):
        return 1.0, "rad"
    return 1.0, ""


def _mark(panel: Any, series: Series, scale: float, k: int, word: str) -> None:
    value = scale * float(series.values[k, 0])
    panel.plot(series.times[k], value, "o", ms=5, color="#c03030")
    panel.annotate(
        f"{word} {value:.2f} mm",
        (series.times[k], value),
        textcoords="offset points",
        xytext=(6, 6),
        fontsize=8,
    )
