"""Where bodies and sites of a compiled model stand, against what MuJoCo computes while it steps."""

import mujoco
import numpy as np
import pytest

from workcell.errors import UnknownNameError
from workcell.model.scene import Scene
from workcell.model.scene_parts import SceneObject, body_pose, data_at, place_holding, site_pose
from workcell.pose import Pose


@pytest.fixture(scope="module")
def scene():
    return Scene.load("shelf_grasp")


def test_bodies_sites_and_geoms_stand_where_the_positions_have_them(scene):
    model, arm = scene.model, scene.robot()
    for q in arm.robot.random_configuration(np.random.default_rng(0), 3):
        stepped = mujoco.MjData(model)
        stepped.qpos[:] = scene.initial_qpos()
        stepped.qpos[arm.qpos_addresses] = q
        mujoco.mj_forward(model, stepped)
        data = data_at(model, stepped.qpos)
        for part in ("qpos", "xpos", "xquat", "geom_xpos", "geom_xmat", "site_xpos", "xipos"):
            assert np.array_equal(getattr(data, part), getattr(stepped, part))
        hand = arm.link_body_ids[-1][0]
        assert (
            max(body_pose(model, hand, stepped.qpos).error_to(Pose(stepped.xpos[hand], stepped.xquat[hand])))
            == 0
        )
        tool = site_pose(model, "sawyer/gripper/tool", stepped.qpos, "here")
        assert max(tool.error_to(arm.robot.fk(q))) < 1e-9


def test_each_call_has_data_of_its_own(scene):
    one, qpos = data_at(scene.model, scene.initial_qpos()), np.array(scene.initial_qpos())
    before = one.xpos.copy()
    qpos[scene.robot().qpos_addresses] += 0.1
    other = data_at(scene.model, qpos)
    assert np.array_equal(one.xpos, before) and not np.array_equal(other.xpos, before)


def test_what_the_hand_holds_goes_where_the_tool_goes(scene):
    arm, mug, grip = (
        scene.robot(),
        scene.object("mug"),
        Pose([0.01, 0.02, 0.03], [0.9, 0.0, np.sqrt(0.19), 0.0]),
    )
    q, qpos = arm.robot.random_configuration(np.random.default_rng(1)), np.array(scene.initial_qpos())
    place_holding(qpos, arm, q, mug, grip)
    assert np.array_equal(qpos[arm.qpos_addresses], q)
    tool = site_pose(scene.model, "sawyer/gripper/tool", qpos, "here")
    assert max(scene.object_pose("mug", qpos).error_to(tool @ grip)) < 1e-9
    others = np.delete(
        qpos - scene.initial_qpos(), [*arm.qpos_addresses, *range(mug.qpos_address, mug.qpos_address + 7)]
    )
    assert not others.any()


def test_a_fixed_object_stays_where_it_is(scene):
    qpos = np.array(scene.initial_qpos())
    SceneObject("shelf", 1, frozenset({1}), None).place(qpos, Pose.from_xyz([1.0, 2.0, 3.0]))
    assert np.array_equal(qpos, scene.initial_qpos())


def test_a_site_that_is_not_there_is_named(scene):
    with pytest.raises(UnknownNameError, match=r"here.*handle"):
        site_pose(scene.model, "handle", scene.initial_qpos(), "here")
