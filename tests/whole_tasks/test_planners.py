"""Every moving task by both convex planners: each configuration of each way is the planner's own."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from workcell.model.loading.assets import find_task
from workcell.record.read.review import Review, review
from workcell.task.job import Job
from workcell.task.run import run_task

WAYS = {
    "shelf_grasp": ["way into the shelf", "way off the board", "way out with the mug"],
    "machine_tending": [
        "way to the blank",
        "way off the rack",
        "way into the chuck",
        "way out of the machine",
    ],
    "bin_picking": ["bar: into the bin", "bar: out of the bin", "bar: to the tray", "bar: onto the tray"],
    "dual_arm_carry": ["left: way to the handle", "lifting the crate", "carrying the crate over the wall"],
    "keep_upright": ["way around the pillar", "way to the cup", "way off"],
    "circle_trace": ["circle"],
    "square_trace": ["square"],
}
"""Ways that each task has, beside others."""


def planned(task: str, planner: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Review:
    """The review of a run that ends when everything is planned, before anything moves."""
    monkeypatch.setattr(Job, "simulation", lambda job: job.fail("PLANNED", "as far as this test looks"))
    path = find_task(task)
    if task == "bin_picking":  # one part is enough
        lines = path.read_text().splitlines()
        text = "\n".join(line for line in lines if "symmetry =" not in line or line.startswith("bar ="))
        shutil.copy(path.with_suffix(".py"), folder / "bin_picking.py")
        path = folder / "bin_picking.toml"
        path.write_text(text)
    result = run_task(path, planner=planner, seed=1, out=folder / "out", say=lambda _: None)
    assert result.status == "PLANNED", result.sentence
    return review(result.recording)


@pytest.mark.parametrize("planner", ["ikspark", "cidgik"])
@pytest.mark.parametrize("task", sorted(WAYS))
def test_every_configuration_of_every_way_is_the_planners(
    task: str, planner: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = planned(task, planner, tmp_path, monkeypatch)
    (check,) = (check for check in seen.checks if check.name == "planner")
    assert check.passed, check.finding
    rows = {row.what: row for row in seen.ways}
    assert set(WAYS[task]) <= set(rows)
    for way in WAYS[task]:
        row = rows[way]
        assert row.steps and row.by and all(name.split("+")[0] == planner for name, _ in row.by)
        assert row.step is not None and row.step.bound and row.step.largest <= row.step.bound
        turn = row.link_rotation
        assert turn is not None and turn.bound == 0.28 and turn.largest <= turn.bound
