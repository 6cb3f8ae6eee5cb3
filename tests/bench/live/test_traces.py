"""The traces against closed forms: radii, speeds, corners, turns, ends at rest."""

import numpy as np
import pytest

from workcell.bench.live.traces import PERIOD, TASKS, Setup, trace
from workcell.pose import quat_to_matrix, rotation_vector

SETUP = Setup("any", (0.6, 0.1, 0.4), (0.3, 0.0, 0.5), 0.3)
REST = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])


def turned(rotations):
    return np.linalg.norm(rotation_vector(rotations), axis=-1)


def test_a_circle_keeps_its_radius_its_speed_and_the_tool_s_rotation():
    path = trace("circle", SETUP, REST)
    away = path.positions[0] - SETUP.centre
    assert np.linalg.norm(away, axis=1) == pytest.approx(0.3)
    assert away[:, 0] == pytest.approx(0.0)
    steps = np.linalg.norm(np.diff(path.positions[0], axis=0), axis=1)
    assert len(path) == 441  # 8.8 s at 50 Hz, both ends
    assert steps == pytest.approx(2.0 * 0.3 * np.sin(np.pi / 440.0))
    np.testing.assert_allclose(quat_to_matrix(path.quats[0]), np.broadcast_to(REST, (441, 3, 3)), atol=1e-12)
    np.testing.assert_allclose(path.positions[0, 0], path.positions[0, -1], atol=1e-12)


def test_a_square_keeps_its_speed_through_its_corners():
    path = trace("square", SETUP, REST)
    away = path.positions[0] - SETUP.centre
    side = 0.3 * np.sqrt(2.0)
    assert np.max(np.abs(away[:, 1:]), axis=1) == pytest.approx(side / 2.0)
    steps = np.linalg.norm(np.diff(path.positions[0], axis=0), axis=1)
    # each step is as long as the others, but for those that cut one of the four corners
    assert np.sum(np.abs(steps - 4.0 * side / 440.0) > 1e-9) <= 4
    assert np.linalg.norm(away, axis=1).max() <= 0.3 + 1e-12


def test_turns_reach_a_right_angle_on_both_sides_about_each_axis_at_one_place():
    path = trace("rotations", SETUP, REST)
    assert path.positions[0] == pytest.approx(np.broadcast_to(SETUP.turning, path.positions[0].shape))
    turns = quat_to_matrix(path.quats[0]) @ REST.T
    third = len(path) // 3
    for k, axis in enumerate((2, 1, 0)):
        vectors = rotation_vector(turns[k * third : (k + 1) * third])
        others = np.delete(vectors, axis, axis=1)
        assert np.abs(others).max() < 1e-9
        # averaging over 0.4 s takes a little off the ends
        assert np.radians(88.0) < vectors[:, axis].max() <= np.pi / 2.0
        assert -np.pi / 2.0 <= vectors[:, axis].min() < -np.radians(88.0)


@pytest.mark.parametrize("task", ["spoon feeding", "cooking", "rotations"])
def test_key_poses_are_left_and_reached_at_rest(task):
    path = trace(task, SETUP, REST)
    for arm in range(path.arms):
        steps = np.diff(path.positions[arm], axis=0)
        assert np.linalg.norm(steps[[0, -1]], axis=1).max() < 1e-3
        assert np.linalg.norm(np.diff(steps, axis=0), axis=1).max() / PERIOD**2 < 20.0
        rotations = quat_to_matrix(path.quats[arm])
        assert turned(np.swapaxes(rotations[1:], 1, 2) @ rotations[:-1]).max() / PERIOD < 3.0
        assert np.sum(path.quats[arm, 1:] * path.quats[arm, :-1], axis=1).min() > 0.99


def test_two_hands_hold_a_pot_of_one_width_while_it_is_carried():
    path = trace("cooking", SETUP, REST)
    assert path.arms == 2
    between = path.positions[0] - path.positions[1]
    held = slice(int(0.32 * len(path)), int(0.72 * len(path)))
    assert np.linalg.norm(between[held], axis=1) == pytest.approx(2.0 * 0.3 * 0.3, abs=1e-9)
    assert np.abs(between[held][:, [0, 2]]).max() < 1e-9


def test_a_hand_in_the_plane_of_its_arm_points_away_from_the_base():
    setup = Setup("any", (0.6, 0.1, 0.4), (0.3, 0.0, 0.5), 0.3, in_plane=True)
    for task in TASKS:
        path = trace(task, setup, REST)
        for arm in range(path.arms):
            away = path.positions[arm] - setup.base(arm, path.arms)
            left = np.stack([-away[:, 1], away[:, 0]], axis=1)
            pointing = (quat_to_matrix(path.quats[arm]) @ np.linalg.inv(REST))[:, :2, 0]
            assert np.abs(np.sum(left * pointing, axis=1)).max() < 1e-9, task
