"""RelaxedIK's tables: what their rows hold, for one arm at one task, and what keeps an arm from a path."""

from dataclasses import replace

import pytest

from workcell.bench.live import relaxed
from workcell.bench.live.arms import SETUPS
from workcell.bench.live.cases import case_of, run_case, table
from workcell.bench.live.paper import GROOVE_A, TRAC_IK
from workcell.bench.live.relaxed import live, point_ik
from workcell.bench.live.starts import Way
from workcell.bench.live.traces import Trace
from workcell.bench.tables import list_benches
from workcell.motion.live.optimisers import installed
from workcell.motion.live.weights import WEIGHTS_B

BY_NAME = {setup.robot: setup for setup in SETUPS}


def test_rows_are_of_all_cases_of_those_that_can_be_followed_and_of_each():
    case = case_of(BY_NAME["hubo_arm"], "circle")
    makers, papers = {"A": live(), "point-ik": point_ik()}, {"A": GROOVE_A, "point-ik": TRAC_IK}
    rows = {row["row"]: row for row in table(makers, papers, 1, 0, [case])}
    assert list(rows) == [
        *("all/A", "reached/A", "all/point-ik", "reached/point-ik"),
        *("hubo_arm/circle/A", "hubo_arm/circle/point-ik"),
    ]
    ours, point = rows["reached/A"], rows["hubo_arm/circle/point-ik"]
    assert ours["frames"] == point["frames"] == 441
    assert ours["paper_position_error_m"] == 0.0047 and point["paper_discontinuities"] == 2260
    assert ours["unanswered"] == ours["singularities"] == ours["self_collisions"] == 0
    assert ours["joint_acceleration"] < point["joint_acceleration"]
    assert point["reached"] and point["in_the_way"] == "" and point["position_error_m"] < 1e-6


@pytest.mark.parametrize(
    ("way", "said"),
    [
        (Way(None, 0.02, 0.5, 2.0, 0.01, 0.25), "25 % of its poses are out of reach"),
        (Way(None, 0.02, 0.5, 2.0, 0.01), "no way without a gap of 20.0 mm was found"),
        (Way(None, 0.0, 1.5, 2.0, 0.01), "1.5 times as fast as the joints"),
        (Way(None, 0.0, 0.5, 0.9, 0.01), "through a singularity"),
        (Way(None, 0.0, 0.5, 2.0, -0.01), "through itself"),
    ],
)
def test_what_keeps_an_arm_from_a_path_is_said(way, said):
    assert not way.reached and way.obstacle == said


def test_each_method_of_tables_2_to_4_has_the_published_row_of_its_own(monkeypatch):
    asked = {}
    monkeypatch.setattr(
        relaxed, "table", lambda makers, papers, n, seed: asked.update(makers=makers, papers=papers)
    )

    def settings(name):
        return asked["makers"][name].keywords["settings"]

    relaxed.table2(1, 0, None)
    assert set(asked["makers"]) - set(asked["papers"]) == {"compiled"}
    assert settings("cobyla") == {"solver": "cobyla"}
    assert asked["papers"]["slsqp"] is GROOVE_A
    relaxed.table3(1, 0, None)
    assert set(asked["makers"]) == set(asked["papers"]) and len(asked["makers"]) == 6
    assert settings("mma/differences") == {"solver": "mma", "gradient": "differences"}
    assert asked["papers"]["mma/differences"].seconds == 0.0290
    assert asked["papers"]["mma/analytic"].seconds == 0.0089
    relaxed.table4(1, 0, None)
    assert settings("quadratic/B") == {"loss": "quadratic", "weights": WEIGHTS_B}
    assert asked["papers"]["quadratic/A"].discontinuities == 79


@pytest.mark.skipif(not installed(), reason="needs workcell[live]")
@pytest.mark.parametrize("name", ["slsqp", "bobyqa"])
def test_the_paper_s_optimisers_follow_too_within_all_limits(name):
    case = case_of(BY_NAME["hubo_arm"], "spoon feeding")
    begin = Trace(case.trace.task, case.trace.positions[:, :80], case.trace.quats[:, :80])
    (run,) = run_case(replace(case, trace=begin), live(solver=name), 1, 0)
    assert run.unanswered == 0 and not (run.discontinuity | run.collision | run.singular).any()
    assert run.position[-1] < run.position[0]


def test_the_benches_are_named():
    names = {bench.name for bench in list_benches()}
    assert {f"relaxedik-table{k}" for k in (1, 2, 3, 4)} | {"live-guards", "live-peers", "live-time"} <= names
