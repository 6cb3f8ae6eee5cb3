"""Baxter's closed chain is as stated: grasp, goals, which of them are reached; rows of Tables II and III."""

from __future__ import annotations

import json

import numpy as np

from workcell.bench.ik.mechanisms.baxter import (
    BAR,
    FARTHER,
    LOWER,
    SEPARATION,
    SIDES,
    UPPER,
    bar_pose,
    carrying_baxter,
    goal_poses,
    problems_of,
    reachable,
)
from workcell.bench.ik.mechanisms.table2 import FORMS, PAPER, table2
from workcell.bench.ik.mechanisms.table3 import METHODS, table3
from workcell.ik.mechanisms.judge import judge_mechanism
from workcell.ik.problem import Budget
from workcell.ik.solve_mechanism import solve_mechanism
from workcell.model.mechanism.measuring import measure_of


def test_fifteen_links_move_and_the_hands_of_an_answer_are_parallel_at_their_distance() -> None:
    mechanism = carrying_baxter()
    assert len(mechanism.joints) == 15 and [c.kind for c in mechanism.closures] == ["weld", "weld"]
    pose = goal_poses(2, 0)[1]
    (problem,) = problems_of([pose])
    q = solve_mechanism(problem, budget=Budget(20.0)).unwrap()
    assert judge_mechanism(problem, q).accepted
    # by MuJoCo: where the hands are
    places = measure_of(mechanism).frames([f"{side}/endpoint" for side in SIDES], q)
    (R, p), (S, o) = (_ordered(places[f"{side}/endpoint"]) for side in SIDES)
    np.testing.assert_allclose(R, S, atol=1e-6)
    np.testing.assert_allclose(p - o, SEPARATION * pose.rotation[:, 2], atol=1e-6)
    np.testing.assert_allclose(R[:, 2], -pose.rotation[:, 1], atol=1e-6)
    assert max(bar_pose(mechanism, q).error_to(pose)) < 1e-6 and BAR in mechanism.frames


def _ordered(place: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    one, two = place
    return (one, two) if np.shape(one) == (3, 3) else (two, one)


def test_goals_are_within_their_ranges_repeat_and_move_away() -> None:
    poses, again, away = goal_poses(50, 3), goal_poses(50, 3), goal_poses(50, 3, farther=FARTHER)
    places = np.array([pose.position for pose in poses])
    assert (places >= LOWER).all() and (places <= UPPER).all()
    for one, two, three in zip(poses, again, away, strict=True):
        assert one.error_to(two) == (0.0, 0.0)
        np.testing.assert_allclose(three.position - one.position, [FARTHER, 0.0, 0.0], atol=1e-15)
        # R_z(a) R_y(b) R_x(g) with b up to pi and g below zero
        assert -1.0 <= one.rotation[2, 0] <= 0.0 and np.isclose(np.linalg.det(one.rotation), 1.0)


def test_what_both_arms_reach_is_decided_and_what_is_2_m_away_is_not_reached() -> None:
    found = reachable(goal_poses(4, 0), 0)
    assert None not in found and True in found
    assert reachable(goal_poses(2, 0, farther=FARTHER), 0) == [False, False]


def test_table_2_has_the_paper_s_numbers_beside_ours() -> None:
    rows = {row["row"]: row for row in table2(1, 1)}
    assert len(rows) == 3 * len(FORMS) and json.dumps(list(rows.values()))
    for form in FORMS:
        plain, ours = rows[f"baxter/{form}/every link a block"], rows[f"baxter/{form}/as it is solved"]
        # the same program as the paper's, but for one equality and for cones instead of half-spaces
        assert abs(plain["equalities"] - PAPER[form].equalities) <= 1 and plain["blocks"] == 15
        assert ours["variables"] < plain["variables"] and ours["equalities"] < plain["equalities"]
        assert len(ours["parts"]) == 2 and sum(ours["parts"]) <= ours["variables"]
        example = rows[f"baxter/{form}/answers before the polish"]
        assert example["n"] == 1 and example["rank_gap"] < 1e-5 and example["off_rotations"] < 1e-5
        assert example["err_R"] < 1e-9 and example["err_T"] < 1e-9 and example["loop_residual"] < 1e-3


def test_table_3_solves_what_both_arms_reach_and_proves_what_is_far_away() -> None:
    rows = {row["row"]: row for row in table3(1, 1)}
    assert rows.keys() == {*(f"baxter/{name}" for name, _, _ in METHODS), "baxter/2 m farther"}
    for name, _, _ in METHODS:
        row = rows[f"baxter/{name}"]
        assert row["contradictions"] == 0 and row["errors"] == 0
        assert row["reachable"] + row["out_of_reach"] == 1.0
        assert row["success"] == 0.0 or row["closure_error_max"] < 1e-6 > row["position_error_max"]
    assert rows["baxter/quaternion"]["success_reachable"] == 1.0
    assert rows["baxter/quaternion"]["rank_gap_max"] < 1e-5
    away = rows["baxter/2 m farther"]
    assert away["proved"] == 1.0 and away["checked"] == 1 and away["margin_min"] > 0.1
