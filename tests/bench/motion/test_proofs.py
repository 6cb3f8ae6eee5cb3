"""The bench of continuous proofs: none is wrong, every graze is found, on lines and on smooth motions."""

import numpy as np
import pytest

from workcell.bench.motion.proofs import proof_rows, through


def test_no_proof_is_wrong_and_every_graze_is_found():
    rows = proof_rows(12, 0, None)
    assert [row["row"] for row in rows] == ["sawyer/random-paths/proof", "sawyer/random-motions/proof"]
    for row in rows:
        assert row["wrong"] == row["refused_though_clear"] == 0
        assert row["grazes_found"] == row["grazes_planted"] == row["proved"] > 3


def test_a_motion_goes_through_its_corners_smoothly_and_rests_at_both_ends():
    corners = np.array([[0.0, 1.0], [0.5, 0.0], [-0.5, 0.5], [0.2, 0.4]])
    motion = through(corners)
    assert motion.at(np.arange(4.0)) == pytest.approx(corners)
    assert motion.at(np.array([0.0, 3.0]), 1) == pytest.approx(np.zeros((2, 2)))
    inner = np.array([1.0, 2.0])
    assert motion.at(inner - 1e-9, 1) == pytest.approx(motion.at(inner, 1), abs=1e-6)
