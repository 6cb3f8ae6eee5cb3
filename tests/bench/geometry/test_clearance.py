"""The bench of the clearance engine: what it compares agrees."""

from __future__ import annotations

from workcell.bench.tables import run_bench


def test_the_engine_agrees_with_mujoco_coal_and_differences():
    rows = run_bench("clearance", n=40, seed=1)["rows"]
    points = [row for row in rows if row["row"].startswith("points/")]
    assert len(points) == 8
    for row in points:
        assert row["mujoco_max_m"] < 1e-9 and row["gradient_max"] < 1e-6
        # coal's own iteration stops a little short on ellipsoids.
        assert row["coal_max_m"] < (1e-6 if "ellipsoid" in row["row"] else 1e-9)
    arm = [row for row in rows if row["row"].startswith("iiwa14/")]
    assert len(arm) == 6 and all(row["gradient_max"] is None or row["gradient_max"] < 1e-6 for row in arm)
