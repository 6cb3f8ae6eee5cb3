"""Retiming: closed forms, limits on a dense evaluation by finite differences, rest at both ends."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from workcell.errors import InputError
from workcell.motion.path import Path
from workcell.motion.polynomials import PolynomialMotion
from workcell.motion.timing.retime import retime
from workcell.motion.timing.spline import spline_within_limits
from workcell.motion.timing.torque_limits import TooWeakError


def line(robot, delta):
    return Path(robot, np.stack([np.zeros(robot.dof), np.asarray(delta, dtype=float)]))


def derivatives(trajectory):
    """Velocity and acceleration by central differences of the positions alone."""
    q, h = trajectory.q, trajectory.dt
    return (q[2:] - q[:-2]) / (2 * h), (q[2:] - 2 * q[1:-1] + q[:-2]) / h**2


def limit_shares(trajectory, velocity, acceleration):
    """(n,) of velocity and (n,) of acceleration: the largest share of its limit that each joint uses at a sample."""
    return np.abs(trajectory.qd).max(axis=0) / velocity, np.abs(trajectory.qdd).max(axis=0) / acceleration


def assert_smooth_and_within(trajectory, velocity, acceleration):
    assert max(share.max() for share in limit_shares(trajectory, velocity, acceleration)) <= 1.0
    between = PolynomialMotion.of_trajectory(trajectory).divided(4)
    assert np.all(between.largest(1) <= np.asarray(velocity))
    assert np.all(between.largest(2) <= np.asarray(acceleration))
    qd, qdd = derivatives(trajectory)
    assert np.all(np.abs(qd) <= np.asarray(velocity) * (1 + 1e-6) + 1e-9)
    assert np.all(np.abs(qdd) <= np.asarray(acceleration) * (1 + 1e-3) + 1e-6)
    assert np.allclose(trajectory.qd[1:-1], qd, atol=np.max(acceleration) * trajectory.dt)
    assert np.abs(trajectory.qd[[0, -1]]).max() < 1e-9
    assert np.abs(trajectory.qdd[[0, -1]]).max() < 1e-6


@pytest.mark.parametrize("distance", [0.02, 0.5, 2.0])
def test_a_straight_line_takes_the_trapezoid_time_plus_the_smoothing(planar, distance):
    v, a, w = 1.0, 4.0, 0.06
    trajectory = retime(line(planar, [distance, 0, 0]), v, a, smoothing_s=w)
    optimal = distance / v + v / a if distance > v * v / a else 2 * np.sqrt(distance / a)
    assert optimal <= trajectory.duration <= 1.01 * (optimal + w) + 0.004
    assert_smooth_and_within(trajectory, v, a)
    assert np.allclose(trajectory.q[-1], [distance, 0, 0], atol=1e-12)


def test_the_slowest_joint_sets_the_pace(planar):
    v, a = np.array([2.0, 0.5, 2.0]), np.array([8.0, 8.0, 8.0])
    trajectory = retime(line(planar, [1.0, 1.0, 0.3]), v, a)
    used, _ = limit_shares(trajectory, v, a)
    assert used[1] > 0.99 and used[0] == pytest.approx(0.25 * used[1])
    ratio = trajectory.q[:, 2] - 0.3 * trajectory.q[:, 0]
    assert np.abs(ratio).max() < 1e-9  # a straight line stays one


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_limits_hold_on_random_paths(arm7, seed):
    rng = np.random.default_rng(seed)
    path = Path(arm7, rng.uniform(-1, 1, (rng.integers(2, 6), 7)))
    v, a = rng.uniform(0.5, 3, 7), rng.uniform(1, 10, 7)
    trajectory = retime(path, v, a, grid=150)
    assert_smooth_and_within(trajectory, v, a)
    assert np.allclose(trajectory.q[[0, -1]], path.configurations[[0, -1]], atol=1e-9)


def test_the_motion_passes_the_waypoints_and_stays_near_the_straight_lines(planar):
    corners = np.array([[0, 0, 0], [0.6, 0, 0], [0.6, 0.6, 0], [0, 0.6, 0.6]], dtype=float)
    path = Path(planar, corners)
    trajectory = retime(path, 1.0, 5.0)
    straight = path.at(np.linspace(0, 3, 3001))
    off = [np.abs(straight - q).max(axis=1).min() for q in trajectory.q]
    assert max(off) < 4e-3
    for corner in corners:
        assert np.abs(trajectory.q - corner).max(axis=1).min() < 2e-3


def test_a_motion_that_turns_back_on_itself_stops_there(planar):
    path = Path(planar, np.array([[0, 0, 0], [0.5, 0.2, 0], [0, 0, 0]], dtype=float))
    trajectory = retime(path, 1.0, 5.0)
    assert_smooth_and_within(trajectory, np.ones(3), np.full(3, 5.0))
    assert trajectory.q[:, 0].max() == pytest.approx(0.5, abs=2e-3)


def test_a_tool_path_is_splined_without_corners(planar):
    t = np.linspace(0, 1, 21)[:, None]
    q = np.hstack([np.sin(t), np.cos(t) - 1, 0.5 * t])
    poses = tuple(planar.fk(row) for row in q)
    trajectory = retime(Path(planar, q, poses), 1.0, 5.0)
    s = trajectory.q[:, 2] / 0.5
    assert np.abs(trajectory.q[:, 0] - np.sin(s)).max() < 2e-3
    assert_smooth_and_within(trajectory, np.ones(3), np.full(3, 5.0))


def test_joint_limits_hold_between_waypoints_that_touch_them(planar):
    """A plateau at the limit, which a plain spline would overshoot."""
    q = np.array([[0, 0, 0], [3.0, 0, 0], [3.0, 0.4, 0], [3.0, 0.8, 0], [0, 0.8, 0]], dtype=float)
    trajectory = retime(Path(planar, q), 1.0, 5.0)
    assert np.all(planar.within_limits(trajectory.q))
    assert trajectory.q[:, 0].max() > 3.0 - 5e-3
    assert_smooth_and_within(trajectory, np.ones(3), np.full(3, 5.0))
    assert np.array_equal(trajectory.q[0], q[0]) and np.allclose(trajectory.q[-1], q[-1], atol=1e-12)


def test_a_path_that_ends_at_a_limit_along_which_it_runs(planar):
    """The end stays where it is; the corner before it takes many small moves to make room."""
    q = np.array([[3, -2.875, 0], [3, -3, 0.1], [2.998, -3, 0.5]])
    trajectory = retime(Path(planar, q), 1.0, 5.0)
    assert np.all(planar.within_limits(trajectory.q))
    assert np.abs(trajectory.q - q[1]).max(axis=1).min() < 5e-3
    assert np.array_equal(trajectory.q[0], q[0]) and np.allclose(trajectory.q[-1], q[-1], atol=1e-12)


def test_joint_limits_hold_between_corners_at_the_limits(arm7):
    """The spline's own extremes count: looked at in 24 places an interval, this one exceeds a limit by 5e-6 rad."""
    rng = np.random.default_rng(3)
    corners = np.clip(rng.uniform(-3.3, 3.3, (6, 7)), arm7.lower, arm7.upper)
    spline = spline_within_limits(Path(arm7, corners), 0.02)
    q = spline.derivatives(np.linspace(0.0, spline.length, 200_001))[0]
    assert np.all(arm7.within_limits(q))
    low, high = spline.extremes()
    assert np.all(low.min(axis=0) <= q.min(axis=0) + 1e-12)
    assert np.allclose(low.min(axis=0), q.min(axis=0), atol=1e-6)
    assert np.allclose(high.max(axis=0), q.max(axis=0), atol=1e-6)


def test_the_tool_keeps_its_speed_limit(planar):
    trajectory = retime(line(planar, [0.5, 0.5, 0.5]), 2.0, 8.0, tool_speed=0.2)
    positions = planar.fk_transform(trajectory.q)[:, :3, 3]
    speed = np.linalg.norm(np.diff(positions, axis=0), axis=1) / trajectory.dt
    assert speed.max() <= 0.2 * (1 + 1e-6)
    assert speed.max() > 0.19


def test_repeated_waypoints_do_no_harm(planar):
    q = np.array([[0, 0, 0], [0, 0, 0], [0.3, 0, 0], [0.3, 0, 0]], dtype=float)
    assert retime(Path(planar, q), 1.0, 5.0).duration == pytest.approx(
        retime(Path(planar, q[1:3]), 1.0, 5.0).duration
    )


@pytest.mark.parametrize(
    ("velocity", "acceleration", "message"),
    [
        (0.0, 1.0, "velocity limit of j0 is 0.0"),
        (1.0, -1.0, "acceleration"),
        (1.0, np.inf, "inf"),
        (np.nan, 1.0, "nan"),
        ([1.0, 2.0], 1.0, "shape"),
    ],
)
def test_limits_that_make_no_sense(planar, velocity, acceleration, message):
    with pytest.raises(InputError, match=message):
        retime(line(planar, [1, 0, 0]), velocity, acceleration)


@pytest.mark.parametrize("name", ["dt", "smoothing_s", "support", "grid"])
@pytest.mark.parametrize("value", [0, -1, float("nan")])
def test_steps_and_widths_that_make_no_sense(planar, name, value):
    with pytest.raises(InputError, match=name):
        retime(line(planar, [1, 0, 0]), 1.0, 1.0, **{name: value})


def test_a_path_that_stands_still(planar):
    with pytest.raises(InputError, match="does not move"):
        retime(Path(planar, np.zeros((3, 3))), 1.0, 1.0)


def test_unknown_acceleration_must_be_given(planar):
    with pytest.raises(InputError, match="pass acceleration="):
        retime(line(planar, [1, 0, 0]))


@pytest.fixture(scope="module")
def sawyer_dynamics():
    from workcell.model.scene import robot_scene
    from workcell.motion.timing.torques import ChainDynamics

    scene = robot_scene("sawyer")
    return scene.robot().robot, ChainDynamics(scene)


def test_torque_limits_hold_between_samples_and_are_used(sawyer_dynamics):
    robot, dynamics = sawyer_dynamics
    steps = np.random.default_rng(0).normal(size=(2, robot.dof)) * 0.5
    corners = np.clip(
        robot.home + np.vstack([np.zeros(robot.dof), np.cumsum(steps, axis=0)]), robot.lower, robot.upper
    )
    path, effort = Path(robot, corners), 0.3 * robot.effort
    free, limited = (retime(path, dynamics=d, effort=effort, grid=150) for d in (None, dynamics))
    motion = PolynomialMotion.of_trajectory(limited)
    t = np.linspace(0, limited.duration, 4 * len(limited))
    share = np.abs(dynamics.at(motion.at(t), motion.at(t, 1), motion.at(t, 2))) / effort
    assert share.max() <= 1.0 + 1e-3
    assert limited.duration >= free.duration
    assert np.all(np.abs(limited.qd) <= robot.velocity) and np.all(np.abs(limited.qdd) <= robot.acceleration)


def test_an_arm_that_is_too_weak_to_hold_itself_is_named(sawyer_dynamics):
    robot, dynamics = sawyer_dynamics
    stretched = np.array(robot.home)
    stretched[1] = 0.0  # the upper arm level: gravity asks most of the shoulder
    path = Path(robot, np.stack([stretched, stretched + 0.1]))
    with pytest.raises(TooWeakError, match=r"needs \d+\.\d N m to hold still"):
        retime(path, dynamics=dynamics, effort=0.5)
    with pytest.raises(InputError, match="effort limit"):
        retime(path, dynamics=dynamics, effort=0.0)


NOISE = [0.0, 1e-12, 1e-9, 1e-7, 1e-6, 1e-5, 1e-4, 5e-4, 9e-4]


@pytest.mark.parametrize("place", [0, 1, 2])
def test_a_twin_of_a_waypoint_costs_no_time(arm7, place):
    """In whatever direction it lies, at an end or in between: there is no way between two such points."""
    rng = np.random.default_rng(place)
    corners = np.cumsum(rng.normal(size=(3, 7)) * 0.3, axis=0)
    limits = (np.full(7, 1.5), np.full(7, 4.0))
    plain = retime(Path(arm7, corners), *limits)
    for distance in NOISE:
        for _ in range(2):
            direction = rng.normal(size=7)
            twin = corners[place] + distance * direction / np.linalg.norm(direction)
            timed = retime(Path(arm7, np.insert(corners, place + (place < 2), twin, axis=0)), *limits)
            assert timed.duration == pytest.approx(plain.duration, rel=0.02), distance
            assert_smooth_and_within(timed, *limits)
    assert np.abs(timed.q[-1] - corners[-1]).max() < 1e-12 and np.abs(timed.q[0] - corners[0]).max() < 1e-12


def test_waypoints_close_together_are_passed_within_a_thousandth_of_a_radian(arm7):
    """A path of very small steps is no heap of twins: it goes where it went, to a fraction of them."""
    u = np.linspace(0.0, 1.0, 1500)[:, None]
    points = 0.3 * np.concatenate([np.sin(2 * u), np.cos(2 * u), u, u**2, -u, 0.5 * u, u**3], axis=1)
    motion = retime(Path(arm7, points), np.full(7, 1.5), np.full(7, 4.0))
    away = np.linalg.norm(motion.q[::25, None] - points[None], axis=2).min(axis=1)
    assert away.max() < 1e-3 and np.abs(motion.q[-1] - points[-1]).max() < 1e-12


def test_a_motion_smaller_than_what_counts_as_a_twin_is_made(planar):
    short = line(planar, np.full(planar.dof, 2e-4))
    assert np.abs(retime(short, 1.0, 1.0).q[-1] - 2e-4).max() < 1e-12
