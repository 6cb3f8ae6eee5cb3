"""Stops within acceleration and jerk: against integration, and what room a period leaves."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from tests.motion.live.kernels import called

MOST, JERK = 8.0, 80.0
speeds = st.floats(-3.0, 3.0)
accelerations = st.floats(-MOST, MOST)


@given(v=speeds, a=accelerations)
def test_a_stop_ends_at_rest_within_its_limits(v, a):
    whole = called.stop_time(v, a, MOST, JERK)
    times = np.linspace(0.0, whole, 400)
    states = np.array([called.stopping(v, a, MOST, JERK, t) for t in times])
    assert np.abs(states[-1, 1:]) == pytest.approx(0.0, abs=1e-6)
    assert np.abs(states[:, 2]).max() <= MOST + 1e-9
    assert np.abs(np.diff(states[:, 2])).max() <= JERK * (times[1] - times[0]) + 1e-9
    # position and velocity are integrals of what comes after them
    steps = np.diff(times)[:, None]
    middles = 0.5 * (states[1:] + states[:-1])
    assert np.diff(states[:, 0]) == pytest.approx((steps[:, 0] * middles[:, 1]), abs=1e-5)
    assert np.diff(states[:, 1]) == pytest.approx((steps[:, 0] * middles[:, 2]), abs=1e-4)
    assert called.stop_length(v, a, MOST, JERK) == pytest.approx(states[-1, 0], abs=1e-9)
    assert called.farthest(v, a, MOST, JERK) >= states[:, 0].max() - 1e-9
    assert called.farthest(v, a, MOST, JERK) == pytest.approx(max(states[:, 0].max(), 0.0), abs=1e-4)


@given(v=speeds, a=accelerations, share=st.floats(0.0, 1.0))
def test_the_stop_of_a_state_on_a_stop_is_the_rest_of_it(v, a, share):
    whole = called.stop_time(v, a, MOST, JERK)
    x, w, b = called.stopping(v, a, MOST, JERK, share * whole)
    assert x + called.stop_length(w, b, MOST, JERK) == pytest.approx(
        called.stop_length(v, a, MOST, JERK), abs=1e-6
    )
    assert called.stop_time(w, b, MOST, JERK) == pytest.approx((1.0 - share) * whole, abs=1e-5)


@given(v=st.floats(-1.0, 1.0), a=accelerations, room=st.floats(0.0, 1.0))
def test_the_highest_jerk_leaves_a_stop_within_limits_and_no_higher_one_does(v, a, room):
    period, fastest = 0.02, 1.0
    rate = called.highest_jerk(np.array([0.0, v, a]), room, fastest, MOST, JERK, period)
    assume(not np.isnan(rate))

    def keeps(jerk, slack):
        times = np.linspace(0.0, period, 50)
        x = v * times + a * times**2 / 2 + jerk * times**3 / 6
        w, b = v + a * times + jerk * times**2 / 2, a + jerk * times
        peak = w[-1] + b[-1] ** 2 / (2 * JERK) if b[-1] > 0 else w[-1]
        end = x[-1] + called.farthest(w[-1], b[-1], MOST, JERK)
        return (
            end <= room + slack and max(w.max(), peak) <= fastest + slack and np.abs(b).max() <= MOST + slack
        )

    assert abs(rate) <= JERK
    # where it starts beyond its fastest, or turns within the period, more may be refused than these samples see
    assert keeps(rate, 1e-6)
    if rate < JERK - 1e-3:
        assert not keeps(rate + 0.01 * JERK, -1e-9) or a > 0


def test_a_joint_without_any_way_to_stop_has_no_highest_jerk():
    assert np.isnan(called.highest_jerk(np.array([0.0, 1.0, 0.0]), 0.01, 2.0, MOST, JERK, 0.02))
