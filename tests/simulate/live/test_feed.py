"""Between frames: the very step where its jerk is constant, and no jump of anything from frame to frame."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from workcell.simulate.live.feed import Feed

STEPS, DT = 10, 0.002
PERIOD = STEPS * DT
JERKS = st.lists(st.floats(-80.0, 80.0), min_size=2, max_size=12)


def carried(state, jerk, t):
    q, v, a = state
    return np.array([q + t * (v + t * (a / 2 + t * jerk / 6)), v + t * (a + t * jerk / 2), a + t * jerk])


@given(JERKS)
def test_a_step_of_constant_jerk_is_carried_out_as_it_is(jerks):
    state, feed = np.zeros(3), Feed(np.zeros(1), STEPS, DT)
    for jerk in jerks:
        end = carried(state, jerk, PERIOD)
        q, qd, qdd = feed.to(end[:1], end[1:2], end[2:])
        expected = [carried(state, jerk, k * DT)[0] for k in range(STEPS)]
        assert q[:, 0] == pytest.approx(expected, abs=1e-12)
        assert q.shape == qd.shape == qdd.shape == (STEPS, 1)
        state = end


@given(JERKS)
def test_velocities_and_accelerations_are_differences_from_frame_to_frame(jerks):
    state, feed, rows = np.zeros(3), Feed(np.zeros(1), STEPS, DT), []
    for jerk in jerks:
        state = carried(state, jerk, PERIOD)
        rows.append(np.hstack(feed.to(state[:1], state[1:2], state[2:])))
    q, qd, qdd = np.vstack(rows).T
    assert qd[1:] == pytest.approx(np.diff(q) / DT, abs=1e-9)
    assert qdd[:-1] == pytest.approx(np.diff(qd) / DT, abs=1e-6)
    assert np.abs(qdd).max() <= 80.0 * PERIOD * len(jerks) + 1e-6


def test_it_rests_when_the_joints_do():
    feed = Feed(np.zeros(1), STEPS, DT)
    assert feed.rests
    feed.to(np.array([0.001]), np.array([0.0]), np.array([0.0]))
    assert not feed.rests
    feed.to(np.array([0.001]), np.array([0.01]), np.array([0.0]))
    assert not feed.rests
    feed.to(np.array([0.001]), np.array([0.0]), np.array([0.0]))
    assert feed.rests
