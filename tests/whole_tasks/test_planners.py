"""Every moving task by the other convex planner than in its own test: all of its ways are the planner's."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.whole_tasks.planned import check_planned
from workcell.model.loading.assets import find_task
from workcell.record.read.review import review
from workcell.task.job import Job
from workcell.task.run import run_task

WAYS = {
    ("shelf_grasp", "cidgik"): ["way into the shelf", "way off the board", "way out with the mug"],
    ("machine_tending", "cidgik"): ["way to the blank", "way off the rack", "way into the chuck"],
    ("bin_picking", "cidgik"): ["bar: into the bin", "bar: out of the bin", "bar: to the tray"],
    ("dual_arm_carry", "cidgik"): ["left: way to the handle", "carrying the crate over the wall"],
    ("keep_upright", "cidgik"): ["way around the pillar", "way to the cup", "way off"],
    ("circle_trace", "cidgik"): ["circle"],
    ("square_trace", "ikspark"): ["square"],
}


@pytest.mark.parametrize(("task", "planner"), sorted(WAYS))
def test_every_configuration_of_every_way_is_the_planners(
    task: str, planner: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The run ends when everything is planned, before anything moves."""
    monkeypatch.setattr(Job, "simulation", lambda job: job.fail("PLANNED", "as far as this test looks"))
    path = find_task(task)
    if task == "bin_picking":  # one part is enough
        lines = path.read_text().splitlines()
        text = "\n".join(line for line in lines if "symmetry =" not in line or line.startswith("bar ="))
        shutil.copy(path.with_suffix(".py"), tmp_path / "bin_picking.py")
        path = tmp_path / "bin_picking.toml"
        path.write_text(text)
    result = run_task(path, planner=planner, seed=1, out=tmp_path / "out", say=lambda _: None)
    assert result.status == "PLANNED", result.sentence
    check_planned(review(result.recording), planner, WAYS[task, planner])
