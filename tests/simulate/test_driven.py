"""Objects that are driven along paths, whatever they meet."""

import numpy as np
import pytest

from workcell.errors import InputError, UnknownNameError
from workcell.pose import Pose
from workcell.simulate.simulation import Simulation


def along(first, speed=0.1):
    return lambda t: Pose(first.position + np.array([0.0, speed * t, 0.05]), first.quat_wxyz)


def test_an_object_is_where_its_path_says_and_then_falls(scene):
    simulation = Simulation(scene)
    first = simulation.object_pose("brick")
    simulation.drive("brick", along(first))
    assert simulation.hold(1.0)
    rows = simulation.result()
    at = scene.object("brick").qpos_address
    expected = first.position[1] + 0.1 * rows.time
    assert np.abs(rows.qpos[:, at + 1] - expected).max() < 1e-9
    assert np.ptp(rows.qpos[:, at + 2]) < 1e-9 and rows.clearance.min() > 0
    simulation.drive("brick", None)
    assert simulation.hold(0.3)
    assert simulation.object_pose("brick").position[2] < first.position[2] + 0.04


def test_it_turns_as_its_path_says(scene):
    simulation = Simulation(scene)
    over = simulation.object_pose("brick").position + np.array([0, 0, 0.3])
    simulation.drive("brick", lambda t: Pose(over, [np.cos(0.5 * t), 0, 0, np.sin(0.5 * t)]))
    assert simulation.hold(0.5)
    quat = simulation.qpos[scene.object("brick").qpos_address + 3 :][:4]
    assert quat == pytest.approx([np.cos(0.25), 0, 0, np.sin(0.25)], abs=1e-9)
    dof = scene.object("brick").qpos_address  # of the velocity: the joints before it have one each
    assert simulation.data.qvel[dof + 5] == pytest.approx(1.0, abs=1e-6)


def test_what_cannot_be_driven(scene):
    simulation = Simulation(scene)
    with pytest.raises(UnknownNameError, match="no object named 'brock'"):
        simulation.drive("brock", along(Pose.identity()))
    with pytest.raises(InputError, match="tells ndarray"):
        simulation.drive("brick", lambda t: np.zeros(3))
