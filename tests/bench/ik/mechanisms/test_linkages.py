"""Random linkages are what they are said to be, all of them are solved, and none is solved out of its reach."""

from __future__ import annotations

import json

import mujoco
import numpy as np
import pytest

from workcell.bench.ik.mechanisms.linkages import KINDS, SLOPES, linkage
from workcell.bench.ik.mechanisms.loops import CYCLE, METHODS, linkages, loops
from workcell.ik.mechanisms.judge import judge_mechanism


@pytest.mark.parametrize("kind", KINDS)
def test_the_planted_configuration_answers_the_question_within_reach_alone(kind: str) -> None:
    for seed in range(15):
        one = linkage(kind, seed)
        verdict = judge_mechanism(one.within_reach, one.planted)
        assert verdict.accepted, verdict.reasons
        assert not judge_mechanism(one.out_of_reach, one.planted).accepted
        # by MuJoCo itself: the loops are closed
        compiled = one.mechanism.compiled
        assert compiled is not None
        model, data = compiled.model, mujoco.MjData(compiled.model)
        data.qpos[:] = compiled.qpos(one.planted)
        mujoco.mj_forward(model, data)
        tied = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        assert tied.sum() >= 3 and np.abs(data.efc_pos[tied]).max() < 1e-12


def test_fingers_follow_each_other_by_all_slopes_and_some_cranks_turn_all_round() -> None:
    grippers = [linkage("gripper", seed).mechanism.followers[0].coefficients[1] for seed in range(40)]
    assert set(grippers) == set(SLOPES)
    limited = [linkage("four-bar", seed).mechanism.joints[0].limited for seed in range(10)]
    assert True in limited and False in limited
    one, two = linkage("spatial", 3), linkage("spatial", 3)
    assert np.array_equal(one.planted, two.planted)
    assert "ball" in [joint.kind for joint in one.mechanism.joints]


def test_every_kind_is_drawn_and_all_are_solved_and_none_out_of_reach() -> None:
    assert {one.kind for one in linkages(len(CYCLE), 0)} == set(KINDS)
    rows = {row["row"]: row for row in loops(2 * len(CYCLE), 0)}
    assert len(rows) == len(KINDS) * (len(METHODS) + 1) and json.dumps(list(rows.values()))
    for kind in KINDS:
        for method in METHODS:
            row = rows[f"{kind}/{method}"]
            assert row["success"] == row["asked"] and row["not_solved"] == []
            assert row["closure_error_max"] < 1e-6 and row["position_error_max"] < 1e-6
        away = rows[f"{kind}/out of reach"]
        assert away["success"] == 0.0 and away["wrong"] == 0 and away["errors"] == 0
        assert away["proved"] == 1.0
