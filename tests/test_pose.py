"""SE(3): group laws, the shortest rotation vector near half turns, bad input."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from workcell.errors import InputError
from workcell.pose import (
    Pose,
    axis_angle_to_matrix,
    from_xyzw,
    matrix_to_quat,
    quat_to_matrix,
    rotation_vector,
    slerp,
    to_xyzw,
)

quats = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 1e-3)
points = st.tuples(*[st.floats(-5, 5)] * 3)


def pose(position, quat):
    return Pose(np.array(position), np.array(quat) / np.linalg.norm(quat))


@given(points, quats, points, quats, points)
@settings(max_examples=60, deadline=None)
def test_product_inverse_and_action_agree_with_matrices(p, q, r, s, x):
    a, b = pose(p, q), pose(r, s)
    assert np.allclose((a @ b).matrix, a.matrix @ b.matrix, atol=1e-9)
    assert np.allclose((a.inverse() @ a).matrix, np.eye(4), atol=1e-9)
    assert np.allclose(a.apply(x), a.rotation @ np.array(x) + a.position, atol=1e-9)


@given(quats)
@settings(max_examples=60, deadline=None)
def test_quaternions_agree_with_scipy(q):
    q = np.array(q) / np.linalg.norm(q)
    R = quat_to_matrix(q)
    assert np.allclose(R, Rotation.from_quat(to_xyzw(q)).as_matrix(), atol=1e-12)
    back = matrix_to_quat(R)
    assert min(np.abs(back - q).max(), np.abs(back + q).max()) < 1e-9
    assert np.array_equal(from_xyzw(to_xyzw(q)), q)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-5, 1.0, 3.0, np.pi - 1e-5, np.pi - 1e-9, np.pi])
def test_rotation_vector_has_the_angle_and_rebuilds_the_rotation(angle):
    rng = np.random.default_rng(1)
    axes = rng.normal(size=(50, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    R = axis_angle_to_matrix(axes, np.full(50, angle))
    v = rotation_vector(R)
    assert np.allclose(np.linalg.norm(v, axis=1), angle, atol=1e-7)
    norms = np.maximum(np.linalg.norm(v, axis=1), 1e-300)
    rebuilt = axis_angle_to_matrix(v / norms[:, None], norms)
    assert np.allclose(rebuilt, R, atol=1e-7)


def test_slerp_takes_the_shorter_arc():
    a, b = np.array([1.0, 0, 0, 0]), -np.array([np.cos(0.2), np.sin(0.2), 0, 0])
    half = slerp(a, b, 0.5)
    assert np.allclose(np.abs(half), [np.cos(0.1), np.sin(0.1), 0, 0])


def test_error_to_is_symmetric_and_exact():
    a = pose([0, 0, 0], [1, 0, 0, 0])
    b = pose([0.3, 0, 0.4], [np.cos(0.25), 0, np.sin(0.25), 0])
    assert a.error_to(b) == pytest.approx((0.5, 0.5))
    assert b.error_to(a) == pytest.approx((0.5, 0.5))


@pytest.mark.parametrize(
    ("position", "quat", "says"),
    [
        ([0, 0, np.nan], [1, 0, 0, 0], "not finite"),
        ([0, 0], [1, 0, 0, 0], "shape"),
        ([0, 0, 0], [1, 1, 0, 0], "length"),
        ([0, 0, 0], [0, 0, 0, 0], "length"),
        ([0, 0, "a"], [1, 0, 0, 0], "numbers"),
    ],
)
def test_bad_poses_are_named(position, quat, says):
    with pytest.raises(InputError, match=says):
        Pose(position, quat)


def test_a_reflection_is_not_a_rotation():
    with pytest.raises(InputError, match="not a rotation"):
        Pose.from_rotation(np.zeros(3), np.diag([1.0, 1.0, -1.0]))


def test_poses_can_not_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        Pose.identity().position[0] = 1.0
