"""Benches of the sampling solver: the worst of several seeds, processes, and the discrepancy of two samples."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.ik.arms import seven
from workcell.bench.ik.hjcd_mmd import mmd_squared, reference
from workcell.bench.ik.sets import worst_row
from workcell.bench.tables import run_bench
from workcell.errors import InputError


def test_the_worst_of_several_rows():
    row = {"row": "a", "n": 2, "success": 1.0, "success_paper_tolerance": 1.0, "decided": 1.0, "errors": 0}
    row |= {"cpu_ms_mean": 2.0, "cpu_ms_median": 1.0, "cpu_ms_p95": 3.0, "cpu_ms_max": 4.0, "paper": None}
    other = {**row, "success": 0.5, "cpu_ms_mean": 1.0, "cpu_ms_max": 9.0}
    worst = worst_row([row, other])
    assert (worst["success"], worst["decided"], worst["cpu_ms_mean"], worst["cpu_ms_max"]) == (
        0.5,
        1.0,
        2.0,
        9.0,
    )
    assert worst["seeds"] == 2
    assert worst_row([row]) == row


@pytest.fixture
def folder(tmp_path):
    """A set of two targets, one of them out of reach, and an empty one."""
    robot = {
        "name": "two",
        "joints": [
            {
                "name": "a",
                "xyz": [0, 0, 0.1],
                "quat": [1, 0, 0, 0],
                "axis": [0, 0, 1],
                "lower": -2,
                "upper": 2,
            },
            {
                "name": "b",
                "xyz": [0.3, 0, 0],
                "quat": [1, 0, 0, 0],
                "axis": [0, 0, 1],
                "lower": -2,
                "upper": 2,
            },
        ],
        "tool": {"xyz": [0.2, 0, 0], "quat": [1, 0, 0, 0]},
        "spheres": [[2, 0.1, 0, 0, 0.05]],
    }
    target = {"xyz": [0.5, 0, 0.1], "quat": [1, 0, 0, 0]}
    far = {"xyz": [5.0, 0, 0.1], "quat": [1, 0, 0, 0]}
    problems = [
        {"id": "near", "target": target, "obstacles": {}},
        {"id": "far", "target": far, "obstacles": {}},
    ]
    for name, chosen in (("two", problems), ("empty", [])):
        document = {"format": "workcell-ikset/1", "set": name, "robot": robot, "problems": chosen}
        (tmp_path / f"two_{name}.json").write_text(json.dumps(document))
    return tmp_path


def test_several_seeds_of_the_bench_of_files(folder):
    document = run_bench("sets", n=1, sets=folder, seeds=2)
    assert [row["row"] for row in document["rows"]] == ["two/two/auto", "two/two/multistart"]
    assert [row.get("seeds") for row in document["rows"]] == [2, None]
    assert all(row["success"] == 1.0 for row in document["rows"])


def test_benches_that_run_once_say_so(folder):
    with pytest.raises(InputError, match="runs once"):
        run_bench("hjcd-dof", n=1, seeds=5)
    with pytest.raises(InputError, match="at least 1"):
        run_bench("sets", n=1, sets=folder, seeds=0)


def test_the_discrepancy_of_equal_and_of_distant_samples():
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=(200, 3)), rng.normal(size=(200, 3))
    assert mmd_squared(x, x, 1.0) == pytest.approx(0.0, abs=1e-12)
    assert mmd_squared(x, y, 1.0) < 0.02
    # samples far apart have nothing in common: both means within themselves remain
    apart = mmd_squared(np.zeros((5, 3)), np.full((7, 3), 100.0), 1.0)
    assert apart == pytest.approx(2.0)


def test_reference_solutions_solve_the_target():
    robot = seven()
    target = robot.fk(np.full(7, 0.4))
    found = reference(robot, target, 20, seed=1)
    assert found.shape == (20, 7)
    assert all(max(robot.fk(q).error_to(target)) < 1e-5 for q in found)
    assert np.array_equal(found, reference(robot, target, 20, seed=1))


@pytest.mark.parametrize(("bench", "restarting"), [("hjcd-dof", 4), ("hjcd-batch", 2)])
def test_the_papers_phases_and_our_restarts_are_rows_of_their_own(bench, restarting):
    rows = run_bench(bench, n=2)["rows"]
    ours = [row for row in rows if row["row"].endswith("/restart until solved")]
    papers = [row for row in rows if row["row"].endswith("/two phases (paper)")]
    assert len(ours) == restarting and len(ours) + len(papers) == len(rows)
    assert all(row["paper_ms"] is None for row in ours)
    assert all(row["paper_ms"] > 0 and row["n"] == 2 for row in papers)
    assert all(row["success"] == 1.0 for row in ours)
