"""Both kinds of restart are measured on the same poses and first ascents."""

from __future__ import annotations

from workcell.bench.ik.restarts import bench_restarts


def test_rows_of_both_kinds_begin_alike() -> None:
    objective, line = bench_restarts(12, 0, "ur10")
    assert objective["row"] == "ur10/free/objective" and line["row"] == "ur10/free/line"
    assert objective["first_ascent"] == line["first_ascent"] < 1.0
    assert min(objective["success"], line["success"]) > 0.8
    assert objective["programs_mean"] != line["programs_mean"]
