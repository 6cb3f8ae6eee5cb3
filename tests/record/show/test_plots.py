"""Plots: every panel has the curves of one metric with the values that were logged, and marks what matters."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D

from tests.record.conftest import record_toy, toy_motion
from workcell.ik.ikspark.rank import RANK_GAP
from workcell.record.read.cuboids import LinkUse
from workcell.record.read.queries import Query, RecordedStage
from workcell.record.read.review import LogLine, Review, review
from workcell.record.show.plots import plot_metrics

RED = to_rgb("#c03030")


@pytest.fixture
def found(tmp_path: Path, toy: mujoco.MjModel) -> Review:
    times, _ = toy_motion(toy)
    joints = np.stack([np.sin(times), np.cos(times)], axis=1)
    return review(
        record_toy(
            tmp_path / "toy.rrd",
            toy,
            **{"joint_positions/arm": joints, "path_deviation_rad": 1e-3 * np.sqrt(times)},
        )
    )


def panels(found: Review) -> dict[str, Axes]:
    return {axes.get_title(loc="left"): axes for axes in plot_metrics(found).axes}


def across_the_height(axes: Axes) -> list[Line2D]:
    return [line for line in axes.lines if np.array_equal(line.get_ydata(), [0, 1])]


def curves(axes: Axes) -> list[np.ndarray]:
    """Points (T, 2) of each curve of a panel."""
    return [np.asarray(line.get_xydata()) for line in axes.lines if len(line.get_xydata()) > 2]


def test_every_metric_has_its_panel_and_its_curve_has_the_logged_values(
    found: Review, toy: mujoco.MjModel
) -> None:
    times, _ = toy_motion(toy)
    expected = {
        "clearance": ("mm", [50 + 40 * np.cos(times)]),
        "tracking error": ("mm", [0.1 * times]),
        "path deviation of the tool's orientation": ("mrad", [np.sqrt(times)]),
        "joint positions of arm": ("rad", [np.sin(times), np.cos(times)]),
    }
    shown = panels(found)
    assert list(shown) == list(expected)
    for title, (unit, values) in expected.items():
        axes = shown[title]
        drawn = curves(axes)
        assert axes.get_ylabel() == unit
        assert len(drawn) == len(values)
        for curve, one in zip(drawn, values, strict=True):
            assert curve == pytest.approx(np.stack([times, one], axis=1), abs=1e-9)
        low, high = axes.get_ylim()
        assert low < np.min(values) and np.max(values) < high
        assert axes.get_xlim()[0] <= 0.0 and axes.get_xlim()[1] >= 2.0
    assert [text.get_text() for text in shown["joint positions of arm"].get_legend().get_texts()] == [
        "0",
        "1",
    ]
    assert list(shown.values())[-1].get_xlabel() == "simulated time in seconds"


def test_extremes_events_and_zero_are_marked(found: Review) -> None:
    shown = panels(found)
    least = 50 + 40 * np.cos(2.0)
    for title, words, place in (
        ("clearance", f"min {least:.3g} mm", (2.0, least)),
        ("tracking error", "max 0.2 mm", (2.0, 0.2)),
    ):
        axes = shown[title]
        (note,) = axes.texts
        assert note.get_text() == words
        assert note.xy == pytest.approx(place)
        dots = [line for line in axes.lines if len(line.get_xydata()) == 1]
        assert [tuple(dot.get_xydata()[0]) for dot in dots] == [pytest.approx(place)]
        assert [to_rgb(dot.get_color()) for dot in dots] == [RED]
    for axes in shown.values():
        assert [line.get_xdata()[0] for line in across_the_height(axes)] == [0.0, 1.0]
    level = [line for line in shown["clearance"].lines if np.array_equal(line.get_xdata(), [0, 1])]
    assert [list(line.get_ydata()) for line in level] == [[0.0, 0.0]]


def test_an_error_among_the_events_is_red(found: Review) -> None:
    bad = replace(found, events=(*found.events, LogLine(1.5, "ERROR", "unintended contact")))
    for axes in panels(bad).values():
        colours = {line.get_xdata()[0]: to_rgb(line.get_color()) for line in across_the_height(axes)}
        assert colours == {0.0: to_rgb("#888888"), 1.0: to_rgb("#888888"), 1.5: RED}


def test_a_bar_for_each_cuboid_that_a_link_is_in_while_it_is_in_it(found: Review) -> None:
    """Lane below lane, in the link's colour, with the cuboid's number; red where a sphere is not all inside."""
    blue = (0.0, 0.0, 1.0)
    use = LinkUse("arm", "hand", blue, np.array([0.0, 0.5, 1.5]), ((2,), (2, 5), ()), np.array([0, 0, 3]))
    found.stage.uses = (use,)
    (axes,) = (axes for title, axes in panels(found).items() if "by number" in title)
    bars = {
        tuple(round(float(edge), 6) for edge in path.get_extents().extents): to_rgb(bar.get_facecolor()[0])
        for bar in axes.collections
        for path in bar.get_paths()
    }
    assert bars == {(0.0, 0.0, 1.5, 0.9): blue, (0.5, 1.0, 1.5, 1.9): blue, (1.5, 2.0, 2.0, 2.3): RED}
    numbers = {(text.get_position()[0], text.get_text().strip()) for text in axes.texts}
    assert numbers == {(0.0, "2"), (0.5, "5")}
    assert [label.get_text() for label in axes.get_yticklabels()] == ["hand"]


def test_rank_residuals_are_drawn_step_by_step_a_line_for_each_restart(found: Review) -> None:
    """Only of the stages that reach one; over the solvers' steps, on a logarithmic scale."""
    nan = float("nan")

    def stage(name: str, residual: float) -> RecordedStage:
        return RecordedStage(name, "ikspark", 1.0, residual, "")

    first = (stage("relaxation", 1e-1), stage("rank reduction", 1e-4), stage("polish", nan))
    second = (stage("relaxation", 1e-2), stage("rank reduction", 1e-8), stage("verify", nan))
    queries = (
        Query(0, "w", "ikspark", "SOLVED", 6.0, 0, first + second, {}),
        Query(1, "w", "hjcd", "SOLVED", 1.0, 6, (stage("sampling", nan),), {}),
        Query(2, "w", "ikspark", "SOLVED", 1.0, 7, (stage("relaxation", 1e-3),), {}),
    )
    axes = plot_metrics(replace(found, queries=queries)).axes[-1]
    lines = [line for line in axes.lines if line.get_marker() == "o"]
    drawn = [[tuple(point) for point in line.get_xydata()] for line in lines]
    assert drawn == [[(0, 1e-1), (1, 1e-4)], [(3, 1e-2), (4, 1e-8)], [(7, 1e-3)]]
    colours = [line.get_color() for line in lines]
    assert colours[0] == colours[1] != colours[2]
    assert axes.get_yscale() == "log" and "solver_step" in axes.get_xlabel()
    assert [line.get_ydata()[0] for line in axes.lines if line.get_marker() != "o"] == [RANK_GAP]
