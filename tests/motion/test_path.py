"""Paths and trajectories: shapes, joining, halfway deviation in closed form."""

import numpy as np
import pytest

from workcell.errors import InputError
from workcell.motion.path import Path, Trajectory, stationary
from workcell.pose import Pose


def test_halfway_deviation_of_one_joint_is_the_sagitta(planar):
    """Turning the outstretched arm by 2a: the arc's middle is R (1 - cos a) off the chord's."""
    a, reach = 0.1, 1.2
    path = Path(planar, np.array([[-a, 0, 0], [a, 0, 0]]))
    metres, radians = path.tool_deviation()
    assert metres[0] == pytest.approx(reach * (1 - np.cos(a)), abs=1e-12)
    assert radians[0] == pytest.approx(0.0, abs=1e-9)


def test_deviation_is_measured_against_the_poses_that_were_asked_for(planar):
    q = np.array([[-0.1, 0, 0], [0.1, 0, 0]])
    asked = tuple(planar.fk(row) @ Pose.from_xyz([0.01, 0, 0]) for row in q)
    with_poses = Path(planar, q, asked).tool_deviation()[0][0]
    assert with_poses == pytest.approx(abs(1.2 * (1 - np.cos(0.1)) - 0.01 * np.cos(0.1)), abs=1e-12)


def test_interpolation_and_steps(planar):
    path = Path(planar, np.array([[0, 0, 0], [0.1, -0.3, 0], [0.2, 0, 0]]))
    assert path.largest_step == pytest.approx(0.3)
    assert np.allclose(path.at([0.5, 2.0, 9.0]), [[0.05, -0.15, 0], [0.2, 0, 0], [0.2, 0, 0]])
    assert np.allclose(path.reversed().configurations, path.configurations[::-1])


def test_joining_paths(planar):
    a = Path(planar, np.array([[0, 0, 0], [0.1, 0, 0.0]]))
    b = Path(planar, np.array([[0.1, 0, 0], [0.2, 0, 0.0]]))
    assert np.allclose((a + b).configurations[:, 0], [0, 0.1, 0.2])
    with pytest.raises(InputError, match="begins"):
        b + a


@pytest.mark.parametrize(
    ("configurations", "message"),
    [
        (np.zeros((1, 3)), "two or more"),
        (np.zeros((2, 4)), "two or more"),
        (np.full((2, 3), np.nan), "finite"),
        (np.array([[0, 0, 0], [0, 4, 0]]), "j1 = 4.0000 outside"),
    ],
)
def test_bad_paths_are_refused(planar, configurations, message):
    with pytest.raises(InputError, match=message):
        Path(planar, configurations)


def test_configurations_are_read_only(planar):
    with pytest.raises(ValueError, match="read-only"):
        Path(planar, np.zeros((2, 3))).configurations[0, 0] = 1.0


def test_trajectories_are_evenly_sampled():
    zero = np.zeros((3, 2))
    with pytest.raises(InputError, match="equal"):
        Trajectory("arm", np.array([0, 0.1, 0.3]), zero, zero, zero)
    still = stationary("arm", [1.0, 2.0], 0.1)
    assert still.duration == pytest.approx(0.1) and still.dt == pytest.approx(0.002)
    assert np.all(still.q == [1.0, 2.0]) and not still.qd.any()


def test_a_path_is_split_where_the_tool_is_nearest(planar):
    """A planar arm that turns about its base: places on its circle lie at known waypoints."""
    angles = np.linspace(0.0, 1.0, 11)
    path = Path(planar, np.stack([angles, np.zeros(11), np.zeros(11)], axis=1))
    reach = planar.fk(path.start).position[0]
    places = [[reach * np.cos(a), reach * np.sin(a), 0.01] for a in (0.31, 0.68)]
    parts = path.split(places)
    assert [len(part) for part in parts] == [4, 5, 4]
    assert np.allclose(parts[0].end, [0.3, 0, 0]) and np.allclose(parts[2].start, [0.7, 0, 0])
    whole = parts[0] + parts[1] + parts[2]
    assert np.array_equal(whole.configurations, path.configurations)
    with pytest.raises(InputError, match="waypoints nearest to the places"):
        path.split(places[::-1])
