"""Whose a body is: by the tree it hangs in, whatever it is called and however the file is cut up."""

import mujoco
import numpy as np
import pytest

from workcell.errors import ModelError
from workcell.model.collision_model import CollisionModel
from workcell.model.loading.actuators import actuator_targets
from workcell.model.loading.load import load_compiled
from workcell.model.loading.subtrees import actuators_of, members
from workcell.model.scene import Scene

ROOTS = """
<mujoco><worldbody><geom type="box" size=".3 .3 .01" pos="0 0 -.05"/>
<body pos="0 .5 0"><geom size=".1"/></body>
<frame pos="0 0 .1"><body><geom size=".05"/><body pos="0 0 .1"><joint name="j1" axis="0 0 1" range="-90 90"/>
<geom type="capsule" fromto="0 0 0 .4 0 0" size=".03"/><frame pos=".4 0 0" euler="0 90 0"><site name="tool"/>
<body><geom type="box" size=".02 .02 .1"/></body></frame></body></body></frame>
<body pos="0 -.5 0"><joint name="door" axis="0 0 1" range="0 90"/><geom type="box" size=".1 .01 .1"/></body>
</worldbody><actuator><motor name="m" joint="j1"/></actuator></mujoco>
"""
CELL = """
<mujoco><worldbody><site name="robot_mount" pos="1 0 .5"/><geom type="plane" size="3 3 .1"/></worldbody></mujoco>
"""
HAND = """
<mujoco><worldbody><body><geom type="box" size=".02 .04 .02"/><site name="tool" pos="0 0 .1"/>
<body pos="0 .02 .05"><joint name="left" type="slide" axis="0 1 0" range="0 .03"/><geom type="box" size=".01 .004 .03"/>
<body><geom size=".005" pos="0 0 .03"/></body></body>
<body pos="0 -.02 .05"><joint name="right" type="slide" axis="0 -1 0" range="0 .03"/>
<geom type="box" size=".01 .004 .03"/></body></body></worldbody>
<tendon><fixed name="both"><joint joint="left" coef=".5"/><joint joint="right" coef=".5"/></fixed></tendon>
<actuator><position name="gripper" tendon="both" ctrlrange="0 .03" kp="100"/></actuator></mujoco>
"""
TASK = """
format = "workcell-task/1"
cell = "cell.xml"
robots = [{name = "arm", model = "arm.xml", gripper = "hand.xml"}]
objects = [{name = "ball", model = "ball.xml", place = "robot_mount"}]
"""


def write(folder, **files: str) -> None:
    for name, text in files.items():
        (folder / f"{name}.xml").write_text(text)


def test_a_file_of_several_roots_is_one_robot_and_its_floor_is_the_worlds(tmp_path) -> None:
    write(tmp_path, arm=ROOTS, cell=CELL)
    scene = Scene.load(tmp_path / "cell.xml", robot=str(tmp_path / "arm.xml"))
    robot, model = scene.robot(), scene.model
    assert robot.body_ids == frozenset(range(1, model.nbody)) and robot.robot.joint_names == ("j1",)
    assert [len(bodies) for bodies in robot.link_body_ids] == [3, 2]
    assert scene.obstacles == ("world",)
    slab = next(g for g in range(model.ngeom) if model.geom(g).name == "arm/world/geom 1 (box)")
    assert int(model.geom_bodyid[slab]) == 0
    assert any(slab in pair for pair in CollisionModel(scene).pair_geoms.tolist())
    pose = scene.site_pose("arm/tool")
    assert np.allclose(robot.robot.fk(robot.start).matrix, pose.matrix, atol=1e-12)
    alone = load_compiled(tmp_path / "arm.xml")[1]
    assert np.allclose(alone.fk(robot.start).position + np.array([1, 0, 0.5]), pose.position, atol=1e-12)


def test_a_nameless_hand_closes_and_what_it_holds_is_held_by_its_body(tmp_path) -> None:
    ball = '<mujoco><worldbody><body><geom size=".01"/></body></worldbody></mujoco>'
    write(tmp_path, arm=ROOTS, cell=CELL, hand=HAND, ball=ball)
    (tmp_path / "task.toml").write_text(TASK)
    scene = Scene.load(tmp_path / "task.toml")
    robot, model = scene.robot(), scene.model
    assert robot.gripper == "arm/gripper/gripper" and robot.robot.default_tool == "gripper/tool"
    assert len(robot.link_body_ids[1]) == 6 and len(robot.fingers) == 3
    weld = model.equality("grasp:arm:ball").id
    assert int(model.eq_obj1id[weld]) == int(model.site_bodyid[model.site("arm/gripper/tool").id])
    assert int(model.eq_obj2id[weld]) == scene.object("ball").body_id


def test_actuators_belong_to_what_they_act_on(tmp_path) -> None:
    model = mujoco.MjModel.from_xml_string(
        HAND.replace("<actuator>", '<actuator><general name="push" site="tool" gear="0 0 1 0 0 0"/>')
    )
    assert [set(actuator_targets(model, k)) for k in range(model.nu)] == [{1}, {2, 4}]
    assert actuators_of(model, {1}) == (0,) and actuators_of(model, {1, 2}) == (0,)
    assert actuators_of(model, {1, 2, 3, 4}) == (0, 1)


def test_trees_within_trees_have_one_owner_each() -> None:
    leaf = "<body><geom size='.1'/></body>"
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody><body><body>{leaf}</body>{leaf}</body>{leaf}</worldbody></mujoco>"
    )
    found = members(model, {("robot", "a"): [1], ("object", "b"): [2]})
    assert found["robot", "a"].own == {1, 4} and found["robot", "a"].guests == {2, 3}
    assert found["object", "b"].own == {2, 3} and not found["object", "b"].guests


def test_geometry_beside_the_body_of_an_object_that_moves_is_refused(tmp_path) -> None:
    ball = '<mujoco><worldbody><geom name="stray" size=".1"/><body><geom size=".01"/></body></worldbody></mujoco>'
    write(tmp_path, arm=ROOTS, cell=CELL, hand=HAND, ball=ball)
    (tmp_path / "task.toml").write_text(TASK)
    with pytest.raises(ModelError, match="'stray' of an object that moves lies beside"):
        Scene.load(tmp_path / "task.toml")


def test_bodies_that_the_file_would_fuse_stay(tmp_path) -> None:
    write(
        tmp_path, arm=ROOTS.replace("<worldbody>", '<compiler fusestatic="true"/><worldbody>', 1), cell=CELL
    )
    assert load_compiled(tmp_path / "arm.xml")[0].nbody == 6
