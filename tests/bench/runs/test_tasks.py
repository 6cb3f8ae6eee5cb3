"""The bench of whole tasks: every task has its rows, proofs count where asked for, the first run stands apart."""

import pytest

from workcell.bench.runs import tasks
from workcell.model.loading.assets import find_task

RUN = {
    "robot": "ur10",
    "planner": "ikspark",
    "achieved": True,
    "planning_s": 2.0,
    "simulated_s": 8.0,
    "max_tracking_error_m": 2e-4,
    "min_clearance_m": 3e-3,
    "process_cpu_s": 5.0,
    "recording_mb": 1.0,
}
STOPPED = {
    "achieved": False,
    "planning_s": 1.0,
    "max_tracking_error_m": None,
    "min_clearance_m": None,
    "simulated_s": None,
}


def simulated(monkeypatch, summaries):
    """`run_process` replaced by one that hands out summaries, and notes what it was asked for."""
    asked, left = [], list(summaries)

    def run(entry, seed, caches):
        asked.append((entry.task, seed, caches))
        return left.pop(0)

    monkeypatch.setattr(tasks, "run_process", run)
    return asked


def test_every_task_has_a_row_and_the_traces_one_for_each_arm():
    folder = find_task("blocked").parent
    assert {entry.task for entry in tasks.ENTRIES} == {file.stem for file in folder.glob("*.toml")}
    arms = [entry.robot for entry in tasks.ENTRIES if entry.task == "square_trace"]
    assert arms == ["sawyer", "ur10", "iiwa14"]
    assert [entry.task for entry in tasks.ENTRIES if entry.proof] == ["blocked"]


def test_the_first_run_stands_apart_and_the_others_use_its_caches(monkeypatch):
    runs = [RUN | {"process_s": wall} for wall in (60.0, 9.0, 7.0, 8.0)]
    runs[2] |= {"min_clearance_m": 1e-3, "max_tracking_error_m": 5e-4}
    asked = simulated(monkeypatch, runs)
    row = tasks.task_row(tasks.Entry("machine_tending"), 3, 5)
    assert [seed for _, seed, _ in asked] == [5, 5, 6, 7] and len({caches for *_, caches in asked}) == 1
    assert row["row"] == "ur10/machine_tending/ikspark" and row["n"] == 3 and row["success"] == 1.0
    assert (row["first_process_s"], row["process_s_median"], row["process_s_max"]) == (60.0, 8.0, 9.0)
    assert row["min_clearance_mm"] == pytest.approx(1.0)
    assert row["max_tracking_error_mm"] == pytest.approx(0.5)


def test_a_proof_counts_where_it_is_asked_for_and_nothing_moved_is_no_number(monkeypatch):
    proved = RUN | STOPPED | {"process_s": 3.0, "proof": "no configuration"}
    simulated(monkeypatch, [proved] * 3)
    row = tasks.task_row(tasks.Entry("blocked", proof=True), 2, 0)
    assert row["success"] == 1.0 and row["min_clearance_mm"] is None and row["simulated_s_max"] is None
    assert not tasks.Entry("shelf_grasp").succeeded(proved)
    assert not tasks.Entry("blocked", proof=True).succeeded(RUN | STOPPED)
