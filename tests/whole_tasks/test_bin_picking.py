"""A part of the task in simulation: one part out of the full bin, held by friction; a bin too narrow for a hand."""

import shutil

import pytest

from tests.whole_tasks.planned import check_planned
from workcell.model.loading.assets import find_task
from workcell.record.read.review import review
from workcell.task.run import run_task


def variant(folder, change):
    """The task with some lines changed, in a folder of its own."""
    source = find_task("bin_picking")
    lines = [change(line) for line in source.read_text().splitlines()]
    path = folder / "bin_picking.toml"
    path.write_text("\n".join(line for line in lines if line is not None))
    shutil.copy(source.with_suffix(".py"), path.with_suffix(".py"))
    return path


def only(part):
    def change(line):
        return None if "symmetry =" in line and not line.startswith(f"{part} =") else line

    return change


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bin")
    return run_task(variant(folder, only("bar")), seed=2, out=folder / "out", say=lambda _: None)


def test_the_bar_stands_on_the_tray(outcome):
    assert outcome.achieved, outcome.sentence
    conditions = outcome.summary["conditions"]
    assert conditions["the bar has left the bin"] and conditions["the bar stands on the tray"]


def test_friction_held_it(outcome):
    assert 0.0 < outcome.summary["max_slip_m"] < 2e-3
    assert outcome.summary["max_tracking_error_m"] < 5e-4
    seen = review(outcome.recording)
    check_planned(
        seen, "ikspark", ["bar: into the bin", "bar: to the tray", "bar: onto the tray", "bar: off the tray"]
    )
    assert any("held by the fingers' friction" in event.text for event in seen.events)
    moved = {row.name: row.moved for row in seen.objects}
    assert moved.pop("bar") > 0.2 and len(moved) == 3 and max(moved.values()) < 0.01


def test_a_hand_that_does_not_fit_is_said_before_anything_moves(tmp_path):
    def change(line):
        kept = only("block")(line)
        return "room = 0.05" if kept is not None and kept.startswith("room =") else kept

    result = run_task(variant(tmp_path, change), out=tmp_path / "out", say=lambda _: None)
    assert not result.achieved and result.status == "NOT_FOUND"
    assert "block: the hand does not fit around it at any of its 4 grasps" in result.sentence
