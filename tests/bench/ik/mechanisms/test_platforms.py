"""Poses and postures of the platforms are as published, and the rows of Table V hold what they say."""

from __future__ import annotations

import json

import numpy as np

from workcell.bench.ik.mechanisms.postures import LEG_LENGTHS, POSTURES
from workcell.bench.ik.mechanisms.table5 import (
    LEGS,
    LOWER,
    METHODS,
    UPPER,
    drawn_poses,
    platform_on_legs,
    table5,
)
from workcell.model.mechanism.measuring import measure_of
from workcell.pose import Pose


def test_every_posture_has_dietmaier_s_lengths_and_no_two_are_one() -> None:
    mechanism = platform_on_legs("stewart_dietmaier")
    # where the legs begin and end, by MuJoCo at home
    names = [f"platform{k}" for k in range(1, 7)]
    feet = [mechanism.joints[mechanism.joint(leg)].parent for leg in LEGS]
    base = np.array([mechanism.joints[foot - 1].T_parent_joint.position for foot in feet])
    frames = [mechanism.frame(name) for name in names]
    assert len(POSTURES) == 40
    for position, quat in POSTURES:
        T = Pose(np.array(position), np.array(quat))
        tops = np.array([T.apply(frame.T_link_frame.position) for frame in frames])
        np.testing.assert_allclose(np.linalg.norm(tops - base, axis=1), LEG_LENGTHS, atol=1e-12)
    poses = [Pose(np.array(position), np.array(quat)) for position, quat in POSTURES]
    apart = [a.error_to(b) for k, a in enumerate(poses) for b in poses[:k]]
    assert min(max(pair) for pair in apart) > 1e-2
    assert measure_of(mechanism).frames(names, mechanism.home).keys() == set(names)


def test_poses_are_within_their_ranges_and_repeat() -> None:
    poses = drawn_poses(40, 2)
    places = np.array([pose.position for pose in poses])
    assert (places >= LOWER).all() and (places <= UPPER).all()
    assert all(a.error_to(b) == (0.0, 0.0) for a, b in zip(poses, drawn_poses(40, 2), strict=True))


def test_both_platforms_are_solved_by_every_method_and_the_legs_have_their_lengths() -> None:
    rows = {row["row"]: row for row in table5(2, 0)}
    assert len(rows) == 2 * len(METHODS) and json.dumps(list(rows.values()))
    for name, row in rows.items():
        assert row["n"] == 2 and row["success"] == 1.0, name
        assert row["closure_error_max"] < 1e-6 and row["position_error_max"] < 1e-6
        assert (row["leg_errors_max"] is None) == name.startswith("stewart/")
        if row["leg_errors_max"] is not None:
            assert max(row["leg_errors_max"]) < 1e-6
        if name.endswith(("quaternion", "rotation")):
            assert row["rank_gap_max"] < 1e-5 and row["paper"] == 1.0
