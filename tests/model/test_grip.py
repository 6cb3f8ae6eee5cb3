"""Fingers and hands apart from the arm: closed forms on boxes."""

import copy
from dataclasses import replace

import numpy as np
import pytest

from workcell.errors import InputError, ModelError
from workcell.model.collision_model import CollisionModel
from workcell.model.grip import fingers_at, fingers_holding, hand_clearance
from workcell.model.scene import Scene
from workcell.pose import Pose
from workcell.world.hand_cover import cover_with_fingers
from workcell.world.planning_world import PlanningWorld


@pytest.fixture(scope="module")
def scene():
    return Scene.load("bin_picking")


def held(scene, part):
    return scene.site_pose(f"{part}/grasp").inverse() @ scene.object_pose(part)


@pytest.mark.parametrize(("part", "half"), [("block", 0.02), ("bar", 0.015), ("nut", 0.025), ("can", 0.022)])
def test_fingers_stop_at_the_object(scene, part, half):
    """A finger's joint is the distance of its pad from the middle: half of the object's width."""
    fingers = fingers_holding(scene, scene.robot(), part, held(scene, part))
    assert [value for _, value in fingers] == pytest.approx([half, half], abs=1e-4)


def test_fingers_that_meet_nothing_close_completely(scene):
    away = Pose.from_xyz([0, 0, 0.5])
    fingers = fingers_holding(scene, scene.robot(), "block", away)
    assert [value for _, value in fingers] == [0.0, 0.0]


def test_shares_of_the_opening(scene):
    robot = scene.robot()
    assert [value for _, value in fingers_at(scene, robot, 1.0)] == [0.045, 0.045]
    assert [value for _, value in fingers_at(scene, robot, 0.4)] == pytest.approx([0.018, 0.018])
    with pytest.raises(InputError, match="from 0"):
        fingers_at(scene, robot, 1.2)


def test_a_second_arm_is_no_finger(tmp_path):
    (tmp_path / "two.xml").write_text(
        '<mujoco><compiler angle="radian"/><worldbody><body name="trunk"><geom size=".1"/>'
        '<body name="left" pos="0 .2 0"><joint name="left" axis="0 0 1" range="-1 1"/><geom size=".05"/>'
        '<site name="tool" pos=".1 0 0"/></body>'
        '<body name="right" pos="0 -.2 0"><joint name="right" axis="0 0 1" range="-1 2"/><geom size=".05"/></body>'
        '</body></worldbody><actuator><motor joint="left"/><motor joint="right"/></actuator></mujoco>'
    )
    scene = Scene.load(tmp_path / "two.xml")
    robot = scene.robot()
    assert robot.robot.joint_names == ("left",) and robot.fingers == ((1, 0.0),)
    assert fingers_at(scene, robot, 0.0) == fingers_at(scene, robot, 1.0) == robot.fingers


def test_the_hand_alone_has_the_clearance_of_the_whole_robot_there(scene):
    """With the tool where the arm has it, the hand's clearance is that of the hand's pairs on the compiled model."""
    robot = scene.robot()
    whole = CollisionModel(scene)
    apart = hand_clearance(scene, robot, robot.robot.fk(robot.start))
    assert apart >= whole.distance(robot.start).distance - 1e-9
    over = Pose.from_xyz([0.55, -0.30, 0.5]) @ Pose(np.zeros(3), np.array([0.0, 1.0, 0.0, 0.0]))
    above, lower = (hand_clearance(scene, robot, Pose.from_xyz([0, 0, dz]) @ over) for dz in (0.0, -0.1))
    assert above - lower == pytest.approx(0.1, abs=0.02)
    assert hand_clearance(scene, robot, Pose.from_xyz([0, 0, -0.49]) @ over) < 0


def test_the_hand_meets_neither_what_it_can_not_touch_nor_what_it_holds(scene):
    robot, grasp = scene.robot(), Pose.from_xyz([0, 0, -0.02]) @ scene.site_pose("block/grasp")
    model = copy.copy(scene.model)
    ghost = replace(scene, model=model)
    for body in scene.object("block").body_ids:
        first, count = model.body_geomadr[body], model.body_geomnum[body]
        model.geom_contype[first : first + count] = model.geom_conaffinity[first : first + count] = 2
    low = Pose.from_xyz([0, 0.03, 0.01]) @ grasp
    assert hand_clearance(scene, robot, low) < hand_clearance(ghost, robot, low)
    assert hand_clearance(ghost, robot, low) == hand_clearance(scene, robot, low, ["block"])
    world = PlanningWorld.of(scene).holding("block", held(scene, "block"))
    closed = world.robot
    assert world.hand_clearance(low) == hand_clearance(world.scene, closed, low, ["block"])


def test_an_object_that_is_about_to_be_grasped_can_be_left_out(scene):
    """Fingers closed by so much that the pads would be in the block, 4 cm wide: half of it less where they stand."""
    grasp, robot = scene.site_pose("block/grasp"), scene.robot()
    for opening, inside in ((0.3, 0.02 - 0.3 * 0.045), (0.4, 0.02 - 0.4 * 0.045)):
        pressed = replace(robot, fingers=fingers_at(scene, robot, opening))
        assert hand_clearance(scene, pressed, grasp) == pytest.approx(-inside, abs=1e-4)
        assert hand_clearance(scene, pressed, grasp, ["block"]) > 0.004
    assert hand_clearance(scene, robot, grasp) > 0.004


@pytest.mark.parametrize("opening", [0.0, 0.5, 1.0])
def test_the_cover_contains_the_fingers_where_they_stand(scene, opening):
    """Corners of the fingers' boxes, placed by MuJoCo, lie in the cover's spheres."""
    import mujoco

    robot = replace(scene.robot(), fingers=fingers_at(scene, scene.robot(), opening))
    cover = cover_with_fingers(scene, robot, 0.02)
    data, model = mujoco.MjData(scene.model), scene.model
    data.qpos[:] = scene.initial_qpos()
    for address, value in robot.fingers:
        data.qpos[address] = value
    mujoco.mj_kinematics(model, data)
    centres = cover.centres_world(robot.robot.link_transforms(robot.start))
    signs = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T
    checked = 0
    for geom in range(model.ngeom):
        if "finger" in model.geom(geom).name and model.geom_contype[geom]:
            corners = (
                data.geom_xpos[geom] + (signs * model.geom_size[geom]) @ data.geom_xmat[geom].reshape(3, 3).T
            )
            inside = np.linalg.norm(corners[:, None] - centres, axis=2) <= cover.radius + 1e-9
            assert inside.any(axis=1).all()
            checked += 1
    assert checked == 4


def test_seeds_move_objects_within_their_bounds():
    places = [Scene.load("bin_picking", seed=seed).object_pose("block") for seed in range(5)]
    plain = Scene.load("bin_picking").object_pose("block")
    offsets = np.array([pose.position - plain.position for pose in places])
    assert np.all(np.abs(offsets) <= [0.003 + 1e-12, 0.02 + 1e-12, 1e-12])
    assert len({round(float(x), 9) for x in offsets[:, 1]}) == 5
    assert all(pose.error_to(plain)[1] <= 0.12 + 1e-9 for pose in places)
    again = Scene.load("bin_picking", seed=3).object_pose("block")
    assert np.array_equal(again.position, places[3].position)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("vary_xyz = [0.1, 0.1]", "bad vary_xyz"),
        ("vary_xyz = [-0.1, 0.1, 0.0]", "bad vary_xyz"),
        ("vary_yaw = true", "vary_yaw is True"),
        ("vary_yaw = 0.1\nfixed = true", "is fixed and varies"),
    ],
)
def test_variations_that_make_no_sense(tmp_path, line, message):
    text = 'format = "workcell-task/1"\ncell = "bin"\n[[objects]]\nname = "b"\n'
    text += f'model = "block"\nplace = "block_place"\n{line}\n'
    (tmp_path / "t.toml").write_text(text)
    with pytest.raises(ModelError, match=message):
        Scene.load(tmp_path / "t.toml", seed=0)


def test_a_scene_that_begins_elsewhere(scene):
    moved = scene.moved({"block": Pose.from_xyz([0.5, 0.2, 0.1])})
    assert moved.object_pose("block").position == pytest.approx([0.5, 0.2, 0.1])
    assert scene.object_pose("block").position[1] < 0
    q = scene.robot().start + 0.1
    assert np.array_equal(scene.with_start("iiwa14", q).robot().start, q)
    with pytest.raises(InputError, match="start of 'iiwa14'"):
        scene.with_start("iiwa14", np.full(7, 9.0))
