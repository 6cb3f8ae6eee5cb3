"""The bench of planners: whose the configurations of every moving task are, and the time against `auto`."""

from types import SimpleNamespace

import pytest

from workcell.bench.runs import planners
from workcell.bench.runs.planners import Run, row_of_planner
from workcell.model.loading.assets import find_task


def run(solvers, planning_s=2.0, achieved=True, unsolved=0):
    queries = [
        SimpleNamespace(solved=True, solver=name, in_cuboids=name == "cidgik", step=0.05, link_rotation=0.1)
        for name in solvers
    ]
    queries += [SimpleNamespace(solved=False, solver="cidgik", in_cuboids=False)] * unsolved
    summary = {
        "achieved": achieved,
        "planning_s": planning_s,
        "max_tracking_error_m": 2e-4 if achieved else None,
        "min_clearance_m": 1e-3 if achieved else None,
    }
    return Run(summary, tuple(queries))


LIVE = {"follow_target", "teleop"}
"""Whose arms follow what nobody knows ahead: nothing is planned."""


def test_every_task_in_which_arms_move_is_planned():
    folder = find_task("blocked").parent
    others = {file.stem for file in folder.glob("*.toml") if "[mechanism]" in file.read_text()}
    assert set(planners.TASKS) == {file.stem for file in folder.glob("*.toml")} - others - {"blocked"} - LIVE


def test_shares_and_ratios_are_of_the_same_seeds():
    autos = [run(["local"] * 4, 1.0), run(["local"] * 4, 2.0), run(["local"] * 4, 3.0)]
    own = [
        run(["cidgik"] * 4, 2.0),
        run(["cidgik", "cidgik+planes"], 3.0, unsolved=2),
        run(["cidgik", "local"], 9.0),
    ]
    row = row_of_planner("shelf_grasp", "cidgik", own, autos)
    assert row["row"] == "shelf_grasp/cidgik" and row["n"] == 3
    assert row["success"] == pytest.approx(2 / 3) and row["achieved"] == 1.0
    assert row["queries"] == 8 and row["not_solved"] == 2
    assert row["by_planner"] == pytest.approx(7 / 8) and row["in_cuboids"] == pytest.approx(6 / 8)
    assert row["by"] == {"cidgik": 6, "cidgik+planes": 1, "local": 1}
    assert row["planning_to_auto"] == pytest.approx(2.0) and row["planning_s_max"] == 9.0
    assert row_of_planner("shelf_grasp", "auto", autos, autos)["planning_to_auto"] == 1.0


def test_a_run_that_failed_before_it_moved_counts_and_has_no_clearance():
    failed = run([], achieved=False)
    row = row_of_planner("shelf_grasp", "cidgik", [failed], [run(["local"])])
    assert row["success"] == 0.0 and row["by_planner"] == 0.0
    assert row["min_clearance_mm"] is None and row["step_max"] is None
