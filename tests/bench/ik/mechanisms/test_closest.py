"""Table IV's rows hold what they say, and every kind of restart is measured on the same goals."""

from __future__ import annotations

import json

import numpy as np
import pytest

import workcell.bench.ik.mechanisms.table4 as module
from workcell.bench.ik.mechanisms.restarts import restarts
from workcell.ik.ikspark.mechanisms.restart import RESTARTS


def test_the_closest_configuration_is_judged_its_bound_proved_and_the_paper_beside_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    chosen = {key: paper for key, paper in module.PAPER.items() if key == ("quaternion", None)}
    monkeypatch.setattr(module, "PAPER", chosen)
    rows = {row["row"]: row for row in module.table4(1, 1)}
    assert json.dumps(list(rows.values()))
    ours, local = (rows[f"baxter/2 m farther/{name}"] for name in ("quaternion/adaptive", module.MULTISTART))
    assert ours["success"] == ours["proved"] == 1.0 and ours["rank_gap_max"] < 1e-5
    assert 0.0 <= ours["gap_mean"] < 0.5 and ours["rise_mean"] <= ours["rise_rank_one_mean"] + 1e-6
    assert ours["paper"] == 0.970 and local["paper"] is None and local["success"] == 1.0
    # nothing is closer than what is proved
    assert local["cost_mean"] >= ours["cost_mean"] - ours["gap_mean"] - 1e-9


def test_every_published_c_is_measured() -> None:
    assert {(form, c) for form, c in module.PAPER if c is None} == {("quaternion", None), ("rotation", None)}
    assert len(module.PAPER) == 8 and np.all([0.0 < paper.success < 1.0 for paper in module.PAPER.values()])


def test_all_kinds_of_restarts_are_measured_on_what_is_reached() -> None:
    rows = restarts(1, 1)
    assert [row["row"] for row in rows] == [f"baxter/{kind}" for kind in RESTARTS]
    assert all(row["n"] == 1 for row in rows) and rows[0]["success"] == 1.0 and json.dumps(rows)
