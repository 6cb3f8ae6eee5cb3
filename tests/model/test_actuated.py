"""A chuck that closes before anything is simulated: its jaws stop at the blank, and the planners see them there."""

import mujoco
import numpy as np
import pytest

from workcell.errors import InputError, UnknownNameError
from workcell.model.grip import actuated
from workcell.model.scene import Scene
from workcell.world.planning_world import PlanningWorld

JAWS = ("jaw_1", "jaw_2", "jaw_3")


@pytest.fixture(scope="module")
def scene():
    return Scene.load("machine_tending", seed=1)


@pytest.fixture(scope="module")
def seated(scene):
    return scene.moved({"blank": scene.site_pose("seat")})


def jaws(scene):
    return np.array([scene.initial_qpos()[scene.model.joint(name).qposadr[0]] for name in JAWS])


def gaps(scene):
    """Distances of every jaw to the blank, metres."""
    data = mujoco.MjData(scene.model)
    data.qpos[:] = scene.initial_qpos()
    mujoco.mj_kinematics(scene.model, data)
    blank = scene.object("blank").body_ids
    mine = [g for g in range(scene.model.ngeom) if int(scene.model.geom_bodyid[g]) in blank]
    return [
        min(mujoco.mj_geomDistance(scene.model, data, scene.model.geom(jaw).id, g, 0.1, None) for g in mine)
        for jaw in JAWS
    ]


def test_jaws_stop_at_the_blank_and_close_completely_without_it(scene, seated):
    closed = actuated(seated, "chuck", 1.0)
    assert 0.0 < min(gaps(closed)) < 1e-6 and np.ptp(jaws(closed)) < 1e-12
    assert np.allclose(jaws(actuated(scene, "chuck", 1.0)), 0.008)
    assert np.allclose(jaws(actuated(scene, "chuck", 0.25)), 0.002, atol=1e-8)
    assert np.all(jaws(scene) == 0.0) and np.all(jaws(actuated(closed, "chuck", 0.0)) == 0.0)


def test_planners_see_the_jaws_where_they_are(seated):
    closed = actuated(seated, "chuck", 1.0)
    centres = [
        {
            p.name: p.pose.position
            for p in PlanningWorld.of(s, approached=["blank"]).obstacles
            if p.name in JAWS
        }
        for s in (seated, closed)
    ]
    moved = [np.linalg.norm(centres[1][jaw] - centres[0][jaw]) for jaw in JAWS]
    assert np.allclose(moved, jaws(closed), atol=1e-9)


def test_bad_input_names_what_there_is(scene):
    with pytest.raises(UnknownNameError, match="chuck"):
        actuated(scene, "ur10/gripper", 1.0)
    with pytest.raises(InputError, match="from 0 to 1"):
        actuated(scene, "chuck", 1.5)
