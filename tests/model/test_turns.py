"""Whole turns of joints: the nearest that the limits allow, and the others in order, whatever the ranges are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from workcell.bench.reference.planting import random_chain

TURN = 2 * np.pi
RANGES = [(-2.9, 2.9), (-6.28, 6.28), (1.0, 8.0), (-TURN, TURN), (-20.0, 20.0), (7.0, 9.0), (-30.0, -1.0)]
"""Less than a turn, just less than two, off the centre, many."""


def arm(ranges, sliding=False):
    robot = random_chain(np.random.default_rng(3), len(ranges))
    lower, upper = np.array(ranges).T
    prismatic = np.array([sliding, *[False] * (len(ranges) - 1)])
    return replace(robot, lower=lower, upper=upper, prismatic=prismatic)


ranges = st.lists(st.sampled_from(RANGES), min_size=3, max_size=3)
shares = st.lists(st.floats(0.0, 1.0), min_size=3, max_size=3).map(np.array)
anywhere = st.lists(st.floats(-25.0, 25.0), min_size=3, max_size=3).map(np.array)


@given(ranges=ranges, share=shares, reference=anywhere)
def test_the_nearest_turn_within_the_limits_is_taken(ranges, share, reference):
    robot = arm(ranges)
    q = robot.lower + share * (robot.upper - robot.lower)
    turned = robot.unwrap(q, reference)
    assert np.all(turned >= robot.lower) and np.all(turned <= robot.upper)
    assert np.allclose(robot.link_transforms(turned), robot.link_transforms(q), atol=1e-5)
    for k in range(3):
        allowed = [v for v in q[k] + TURN * np.arange(-12, 13) if robot.lower[k] <= v <= robot.upper[k]]
        assert abs(turned[k] - reference[k]) <= min(abs(v - reference[k]) for v in allowed) + 2e-6


@given(ranges=ranges, share=shares, other=shares)
def test_all_turns_come_in_order_of_their_distance(ranges, share, other):
    robot = arm(ranges)
    q, reference = (robot.lower + s * (robot.upper - robot.lower) for s in (share, other))
    rows = robot.turns(q, reference)
    away = np.linalg.norm(rows - reference, axis=1)
    assert np.all(np.diff(away) >= 0) and np.array_equal(rows[0], robot.unwrap(q, reference))
    assert np.all(robot.within_limits(rows)) and len({row.tobytes() for row in rows}) == len(rows) <= 64
    T = robot.link_transforms(rows)
    assert np.abs(T - T[0]).max() < 1e-5
    assert len(robot.turns(q, reference, 2)) == min(2, len(rows))


def test_an_angle_that_no_turn_brings_into_the_limits_stays_one_and_slides_do_not_turn():
    robot = arm([(-1.0, 1.0), (-6.28, 6.28), (1.0, 8.0)], sliding=True)
    q = np.array([0.9, 2.0, 0.5])
    assert robot.unwrap(q, np.array([-6.0, -4.0, 7.0])) == pytest.approx([0.9, 2.0 - TURN, 0.5 + TURN])
    narrow = arm([(-1.0, 1.0)] * 3)
    assert len(narrow.turns(np.array([2.0, 0.0, 0.0]), np.zeros(3))) == 1
