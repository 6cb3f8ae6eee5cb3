"""The bench of live guards: movers within their bounds, violations found, cells that repeat themselves."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from workcell.bench.live.arms import arms_of
from workcell.bench.live.contacts import Contacts
from workcell.bench.live.crowds import CLEAR_AT_START, crowd
from workcell.bench.live.guards import CELLS, run_cell, violations
from workcell.bench.live.movers import (
    FASTEST,
    HASTE,
    REACHING,
    REACHING_HASTE,
    SPIN,
    SPIN_HASTE,
    Reacher,
    Wanderer,
)
from workcell.bench.live.traces import PERIOD
from workcell.bench.live.yielding import NEAR, ROOM, Yielding, brake
from workcell.motion.live.limits import LiveLimits

A, J = np.array([5.0, 8.0]), np.array([50.0, 80.0])


@given(
    st.lists(st.floats(-1.5, 1.5), min_size=2, max_size=2),
    st.lists(st.floats(-4.0, 4.0), min_size=2, max_size=2),
)
@settings(max_examples=60, deadline=None)
def test_a_brake_goes_on_smoothly_within_limits_and_ends_at_rest(v, a):
    v, a = np.array(v), np.array(a)
    t = np.array([-3.0, -2.0, -1.0, 0.0])[:, None] * PERIOD
    stop = brake(v * t + 0.5 * a * t**2, A, J)
    assert np.abs(np.diff(stop[-3:], axis=0)).max() < 2e-3
    # the polynomial's own velocity and acceleration are those of the past where it begins
    way = np.concatenate([v * t + 0.5 * a * t**2, stop])
    rates = np.diff(way, 2, axis=0) / PERIOD**2
    assert np.all(np.abs(rates) <= 1.06 * np.maximum(A, np.abs(a)))


def test_a_brake_of_arms_that_rest_is_where_they_are():
    q = np.array([0.3, -0.2])
    np.testing.assert_allclose(brake(np.tile(q, (4, 1)), A, J), np.tile(q, (2, 1)))


def test_each_limit_that_is_broken_is_found_and_no_other():
    arms = arms_of(CELLS[0][0])
    robot, n = arms.robots[0], arms.dof
    limits = LiveLimits.of(robot.velocity, np.full(n, 1e6), np.full(n, 1e9))
    q = np.tile(robot.home, (20, 1))
    q[10:, 1] += 1.01 * robot.velocity[1] * PERIOD
    over, worst = violations(q, arms, limits)
    assert over.tolist() == [0, 1, 0, 0] and worst[0] == pytest.approx(1.01)
    ramp = robot.home + 0.9e-3 * (np.arange(20.0) ** 2)[:, None] * (np.arange(n) == 3)
    tight = LiveLimits.of(np.full(n, 100.0), np.full(n, 1.5e-3 / PERIOD**2), np.full(n, 1e9))
    assert violations(ramp, arms, tight)[0].tolist() == [0, 0, 18, 0]
    q[5, 2] = robot.upper[2] + 1e-3
    assert violations(q, arms, limits)[0][0] == 1


def test_a_wanderer_keeps_its_bounds_and_its_distance_from_arms_that_stand():
    cell = crowd(*CELLS[0], 10, 4)
    start = cell.start()
    contacts = Contacts(cell.scene, cell.arms.names, own=False, limit=NEAR)
    # it always heads for the hand
    hand = cell.arms.robots[0].fk(start).position
    first = next(mover for mover in cell.movers if isinstance(mover, Wanderer))
    mover = Wanderer(first.name, first.pose, hand, FASTEST, np.full(3, 0.5))
    yielding = Yielding(
        contacts, [mover], [[hand]], np.full(7, 8.0), np.full(7, 80.0), np.random.default_rng(0)
    )
    past, nearest = np.tile(start, (4, 1)), np.inf
    assert contacts.distance(start) > CLEAR_AT_START["still"]
    for _ in range(250):
        pose, rates = mover.pose, mover.rates
        assert yielding.advance(past)
        assert np.linalg.norm(mover.rates[:3]) <= FASTEST + 1e-9 and np.linalg.norm(mover.rates[3:]) <= SPIN
        changes = mover.rates - rates
        assert np.linalg.norm(changes[:3]) <= HASTE * PERIOD + 1e-9
        assert np.linalg.norm(changes[3:]) <= SPIN_HASTE * PERIOD + 1e-9
        moved = mover.pose.position - pose.position
        assert moved == pytest.approx(0.5 * PERIOD * (rates + mover.rates)[:3])
        contacts.place(yielding.places())
        nearest = min(nearest, contacts.distance_to(mover.name, start))
    assert ROOM < nearest < 0.2


def test_a_reacher_is_a_chain_whose_twists_are_its_motion():
    q = np.array([0.4, 0.3, -0.8, 0.5])
    base, lengths = np.array([0.5, -0.2, 0.0]), np.array([0.3, 0.25, 0.2])
    reacher = Reacher(("a", "b", "c"), base, lengths, REACHING, q, np.zeros(4), np.zeros(4))
    ends = [base]
    for pose, length in zip(reacher.bodies().values(), lengths, strict=True):
        along = 0.5 * length * pose.rotation[:, 2]
        assert pose.position - along == pytest.approx(ends[-1])
        ends.append(pose.position + along)
    for _ in range(300):
        rates, before, twists = reacher.rates, reacher.bodies(), reacher.twists()
        reacher.go(reacher.liked())
        assert np.linalg.norm(reacher.rates) <= REACHING + 1e-9
        assert np.linalg.norm(reacher.rates - rates) <= REACHING_HASTE * PERIOD + 1e-9
        for name, pose in reacher.bodies().items():
            moved = (pose.position - before[name].position) / PERIOD
            assert moved == pytest.approx(0.5 * (twists[name][0] + reacher.twists()[name][0]), abs=2e-3)
    # it has arrived, upright
    assert ends[-1][2] < reacher.bodies()["c"].position[2] + 0.1
    assert reacher.bodies()["c"].position == pytest.approx(base + np.array([0.0, 0.0, 0.65]), abs=0.02)


def test_a_cell_is_made_again_by_its_seed_and_its_frames_are_counted():
    setup, count = CELLS[3]
    cell, again, other = (crowd(setup, count, 12, seed) for seed in (3, 3, 4))
    assert cell.goals[1][11].position == pytest.approx(again.goals[1][11].position)
    assert [list(one.bodies()) for one in cell.movers] == [list(one.bodies()) for one in again.movers]
    assert not np.array_equal(cell.aims[0][0], other.aims[0][0])
    tally = run_cell(cell, 3)
    row = tally.row("made")
    assert row["n"] == 12 and row["contacts"] == row["unanswered"] == row["position_violations"] == 0
    tally.add(tally)
    assert tally.row("twice")["n"] == 24 and tally.row("twice")["cells"] == 2
