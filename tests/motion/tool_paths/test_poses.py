"""Tool paths against closed forms, and tolerances axis by axis."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from workcell.errors import InputError
from workcell.motion.tool_paths.poses import (
    FREE,
    PathTolerance,
    arc,
    check_tool_path,
    circle,
    distance_to_path,
    polyline,
    through,
    turned,
)
from workcell.pose import Pose, axis_angle_to_matrix

START = Pose([0.4, 0.1, 0.3], [0.5, 0.5, 0.5, 0.5])


def positions(poses):
    return np.stack([pose.position for pose in poses])


def test_a_circle_is_round_closed_and_evenly_spaced():
    centre, axis = np.array([0.4, 0.0, 0.3]), np.array([0.0, 0.6, 0.8])
    start = Pose(centre + 0.1 * np.array([1.0, 0.0, 0.0]), START.quat_wxyz)
    poses = circle(start, centre, axis, 0.01)
    points = positions(poses) - centre
    assert poses[-1] is start
    assert np.allclose(np.linalg.norm(points, axis=1), 0.1) and np.allclose(points @ axis, 0)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert np.ptp(steps) < 1e-12 and steps.max() <= 0.01
    assert np.all(np.cross(points[:-1], points[1:]) @ axis > 0)
    assert all(pose.error_to(start)[1] < 1e-6 for pose in poses)


def test_an_arc_may_turn_the_tool_and_go_clockwise():
    poses = arc(START, [0.3, 0.1, 0.0], [0, 0, 2.0], -np.pi / 2, 0.02, turning=True)
    quarter = axis_angle_to_matrix(np.array([0.0, 0, 1]), np.array(-np.pi / 2))
    assert np.allclose(poses[-1].position, [0.3, 0.0, 0.3])
    assert np.allclose(poses[-1].rotation, quarter @ START.rotation)
    assert max(a.error_to(b)[1] for a, b in pairwise(poses)) <= 0.1 + 1e-9


def test_a_spline_passes_its_knots_smoothly():
    angles = np.linspace(0, np.pi, 5)
    knots = [Pose([0.2 * np.cos(t), 0.2 * np.sin(t), 0.1], [1, 0, 0, 0]) for t in angles]
    poses = through(knots, 0.01)
    points = positions(poses)
    for knot in knots:
        assert np.linalg.norm(points - knot.position, axis=1).min() < 1e-12
    steps = np.diff(points, axis=0)
    assert np.linalg.norm(steps, axis=1).max() <= 0.0102
    unit = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    assert np.all(np.einsum("ij,ij->i", unit[:-1], unit[1:]) > np.cos(0.15))


def test_a_polyline_has_each_corner_once():
    corners = [Pose.from_xyz(p) for p in ([0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0])]
    poses = polyline(corners, 0.02)
    assert len(poses) == 11 and sum(pose is corners[1] for pose in poses) == 1
    off = distance_to_path([[0.05, 0.03, 0.0], [0.1, 0.05, 0.02], [0.2, 0.1, 0.0]], corners)
    assert np.allclose(off, [0.03, 0.02, 0.1])


def random_pose(seed):
    rng = np.random.default_rng(seed)
    quat = rng.normal(size=4)
    return Pose(rng.normal(size=3), quat / np.linalg.norm(quat))


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from(["tool", "world"]))
def test_the_nearest_allowed_pose_is_in_the_box_and_allowed_itself(seed, frame):
    rng = np.random.default_rng(seed)
    bounds = rng.choice([0.0, 0.01, 0.3, FREE], size=6)
    tolerance = PathTolerance(bounds[:3], bounds[3:], frame)
    pose, actual = random_pose(seed), random_pose(seed + 1)
    nearest = tolerance.nearest(pose, actual)
    x = tolerance.coordinates(pose, nearest)
    assert np.all(np.abs(x) <= tolerance.box + 1e-7)
    assert max(tolerance.excess(pose, nearest)) < 1e-6
    y = tolerance.coordinates(pose, actual)
    again = tolerance.coordinates(pose, tolerance.moved(pose, y))
    assert np.allclose(np.abs(again - y).max(), 0, atol=1e-6) or np.linalg.norm(y[3:]) > np.pi - 1e-3


def test_free_turns_about_the_tool_axis_and_about_the_vertical_differ():
    tilted = Pose([0, 0, 0], [np.cos(0.3), np.sin(0.3), 0, 0])
    about_tool = tilted @ Pose([0, 0, 0], [np.cos(0.7), 0, 0, np.sin(0.7)])
    about_world = Pose([0, 0, 0], [np.cos(0.7), 0, 0, np.sin(0.7)]) @ tilted
    spin, yaw = (PathTolerance(rotation=(0, 0, FREE), frame=frame) for frame in ("tool", "world"))
    assert max(spin.excess(tilted, about_tool)) < 1e-9 and spin.excess(tilted, about_world)[1] > 0.1
    assert max(yaw.excess(tilted, about_world)) < 1e-9 and yaw.excess(tilted, about_tool)[1] > 0.1


def test_a_pose_turned_about_its_axis_comes_in_equal_parts_the_nearest_first():
    pose = Pose([0.1, 0.2, 0.3], [np.cos(0.4), np.sin(0.4), 0, 0])
    near = pose @ Pose([0, 0, 0], [np.cos(1.2), 0, 0, np.sin(1.2)])  # by 2.4 rad
    turns = turned(pose, 4, near)
    angles = [pose.error_to(turn)[1] for turn in turns]
    assert np.allclose(angles, [np.pi, np.pi / 2, np.pi / 2, 0], atol=1e-9)
    assert np.allclose([turn.position for turn in turns], pose.position)
    assert all(np.allclose(turn.rotation[:, 2], pose.rotation[:, 2]) for turn in turns)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: PathTolerance(position=(1e-3, 0)), "three bounds"),
        (lambda: PathTolerance(rotation=(0, 0, np.nan)), "three bounds"),
        (lambda: PathTolerance(position=(-1, 0, 0)), "zero or more"),
        (lambda: PathTolerance(frame="base"), "unknown frame"),
        (lambda: arc(START, [0, 0, 0], [0, 0, 0], 1.0), "no arc"),
        (lambda: arc(START, [0, 0, 0], [0, 0, 1], np.nan), "no arc"),
        (lambda: arc(START, [0, np.nan, 0], [0, 0, 1], 1.0), "finite numbers"),
        (lambda: arc(START, START.position, [0, 0, 1], 1.0), "its own axis"),
        (lambda: circle(START, [0, 0, 0], [0, 0, 1], 0.0), "spacing"),
        (lambda: turned(START, 0, START), "0 parts"),
        (lambda: through([START]), "two or more poses"),
        (lambda: through([START, START]), "at one place"),
        (lambda: check_tool_path([]), "two or more poses, not 0"),
        (lambda: check_tool_path([START, np.eye(4)]), r"tool_poses\[1\]"),
    ],
)
def test_bad_input_says_what_is_valid(make, words):
    with pytest.raises(InputError, match=words):
        make()
