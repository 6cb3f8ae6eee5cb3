"""`Scene.load`: robots and objects attached in place, goals resolved, and every mistake in a task file named."""

import numpy as np
import pytest

from workcell.errors import ModelError, UnknownNameError, WorkcellError
from workcell.model.collision_model import CollisionModel
from workcell.model.labels import geom_name
from workcell.model.scene import Scene
from workcell.pose import Pose

TASK = """
format = "workcell-task/1"
name = "toy"
cell = "shelf"
[[robots]]
name = "sawyer"
model = "sawyer"
mount = "robot_mount"
gripper = "parallel_gripper"
gripper_site = "right_hand"
[[objects]]
name = "mug"
model = "mug"
place = "mug_place"
[[goals]]
name = "grasp"
robot = "sawyer"
relative_to = "mug/grasp"
xyz = [0, 0, -0.1]
[task]
object = "mug"
"""


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("task") / "toy.toml"
    path.write_text(TASK)
    return Scene.load(path)


def test_names_addresses_and_start(scene):
    arm = scene.robot()
    assert arm.robot.dof == 7 and arm.gripper == "sawyer/gripper/gripper"
    assert arm.robot.default_tool == "gripper/tool"
    assert {"shelf", "table"} <= set(scene.obstacles)
    qpos = scene.initial_qpos()
    assert np.array_equal(qpos[arm.qpos_addresses], arm.start)
    assert scene.object("mug").qpos_address is not None
    assert scene.task["object"] == "mug"


def test_goals_are_relative_to_their_site(scene):
    expected = scene.site_pose("mug/grasp") @ Pose.from_xyz([0, 0, -0.1])
    assert np.allclose(scene.goal("grasp").pose.matrix, expected.matrix)


def test_robot_kinematics_are_those_of_the_compiled_scene(scene):
    arm = scene.robot()
    rng = np.random.default_rng(0)
    for q in arm.robot.random_configuration(rng, 10):
        qpos = np.array(scene.initial_qpos())
        qpos[arm.qpos_addresses] = q
        assert np.allclose(
            scene.site_pose("sawyer/gripper/tool", qpos).matrix, arm.robot.fk(q).matrix, atol=1e-12
        )


def test_distance_is_the_smallest_over_all_pairs(scene):
    import mujoco

    collision = CollisionModel(scene)
    ids = {geom_name(scene.model, geom): geom for geom in range(scene.model.ngeom)}
    data = mujoco.MjData(scene.model)
    arm = scene.robot()
    for q in arm.robot.random_configuration(np.random.default_rng(1), 8):
        found = collision.distance(q)
        data.qpos[:] = collision.full_qpos(q)
        mujoco.mj_kinematics(scene.model, data)
        distances = [
            mujoco.mj_geomDistance(scene.model, data, ids[a], ids[b], 10.0, None) for a, b in collision.pairs
        ]
        assert found.distance == pytest.approx(min(distances), abs=1e-9)


def test_a_penetrating_contact_of_the_simulator_is_always_seen(scene):
    """Whatever MuJoCo reports as a contact of the robot, the distances report as negative: same filter rules."""
    import mujoco

    collision = CollisionModel(scene)
    arm, data = scene.robot(), mujoco.MjData(scene.model)
    for q in arm.robot.random_configuration(np.random.default_rng(2), 40):
        data.qpos[:] = collision.full_qpos(q)
        mujoco.mj_forward(scene.model, data)
        touching = [
            c
            for c in data.contact
            if c.dist < -1e-6 and {int(scene.model.geom_bodyid[g]) for g in c.geom} & arm.body_ids
        ]
        assert bool(touching) == (collision.distance(q).distance < -1e-6)


def test_a_carried_object_moves_with_the_hand(scene):
    arm = scene.robot()
    grip = Pose.from_xyz([0.0, 0.0, 0.01])
    collision = CollisionModel(scene, attached=("mug", grip))
    q = arm.start
    qpos = collision.full_qpos(q)
    at = scene.object("mug").qpos_address
    assert np.allclose(qpos[at : at + 3], (arm.robot.fk(q) @ grip).position)
    names = {name for pair in collision.pairs for name in pair}
    assert any(name.startswith("mug/") for name in names)
    assert not any(a.startswith("mug/") and "gripper" in b for a, b in collision.pairs)


def test_allowed_and_ignored_bodies(scene):
    everything = CollisionModel(scene).pairs
    mug = scene.model.body(scene.object("mug").body_id).name
    without = CollisionModel(scene, ignored=[mug]).pairs
    assert len(without) < len(everything)
    assert not any(name.startswith("mug/") for pair in without for name in pair)


def test_a_cell_alone_takes_a_robot():
    scene = Scene.load("shelf", robot="ur10")
    assert scene.robot().robot.dof == 6 and not scene.goals
    assert not Scene.load("shelf").robots


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('cell = "shelf"', "", "cell is missing"),
        ('cell = "shelf"', 'cell = "shelv"', "did you mean shelf"),
        ('cell = "shelf"', 'cell = "no/such.xml"', "no such file"),
        ('model = "sawyer"', 'model = "sawyr"', "did you mean sawyer"),
        ('model = "sawyer"', 'model = "sawyr"', "robot 'sawyer' model"),
        ('name = "toy"', 'name = "../elsewhere"', "name is '../elsewhere'"),
        ('name = "sawyer"', 'name = "a/b"', r"robots\[0\].name is 'a/b'"),
        ('name = "mug"', 'name = "sawyer"', "'sawyer' twice"),
        ('place = "mug_place"', 'place = "mug_place"\nvary_yaw = inf', "a finite number"),
        ('place = "mug_place"', 'place = "mug_place"\nvary_xyz = [nan, 0, 0]', "finite numbers"),
        ('gripper_site = "right_hand"', 'gripper_site = "right_hand"\nstart = "up"', '"home", or one number'),
        ('format = "workcell-task/1"', "", "format is missing"),
        ('model = "mug"', 'model = "mugg"', "no object named"),
        ('mount = "robot_mount"', 'mount = "robot_mont"', "did you mean robot_mount"),
        ('gripper_site = "right_hand"', 'gripper_site = "left_hand"', "no site named"),
        ('place = "mug_place"', 'place = "cup_plac"', "did you mean cup_place"),
        ('relative_to = "mug/grasp"', 'relative_to = "mug/grip"', "no site named"),
        ("xyz = [0, 0, -0.1]", "xyz = [0, 0]", "not a pose"),
        ("xyz = [0, 0, -0.1]", "xyz = [0, 0, nan]", "finite numbers"),
        ("xyz = [0, 0, -0.1]", "xyz = [0, 0, 1]\nquat_wxyz = [1, 1, 0, 0]", "length"),
        ("xyz = [0, 0, -0.1]", 'xyz = "here"', "a list of finite numbers"),
        ('robot = "sawyer"', 'robot = "baxter"', "no robot named"),
        ('name = "toy"', 'nam = "toy"', "did you mean name"),
        ('format = "workcell-task/1"', 'format = "x"', "format is"),
        ("[task]", "[task", "not valid TOML"),
        ('gripper_site = "right_hand"', 'gripper_site = "right_hand"\nstart = [1, 2]', "takes 7 joint values"),
        (
            'gripper_site = "right_hand"', 'gripper_site = "right_hand"\nstart = [9, 0, 0, 0, 0, 0, 0]',
            "outside its joint limits",
        ),
    ],
)  # fmt: skip
def test_mistakes_in_a_task_file_are_named(tmp_path, old, new, says):
    assert old in TASK
    path = tmp_path / "bad.toml"
    path.write_text(TASK.replace(old, new, 1))
    with pytest.raises(WorkcellError, match=says) as caught:
        Scene.load(path)
    assert "bad.toml" in str(caught.value)


def test_unknown_goals_objects_and_tasks(scene):
    with pytest.raises(UnknownNameError, match="did you mean grasp"):
        scene.goal("grsp")
    with pytest.raises(UnknownNameError, match="known: mug"):
        scene.object("teapot")
    with pytest.raises(UnknownNameError, match="did you mean shelf"):
        Scene.load("shelff")


MAST = """
<body name="{name}" pos="{x} 0 0"><geom type="box" size=".05 .05 .2"/>
  <body name="{name}_arm" pos="0 0 .3"><joint name="{name}_turn" axis="0 0 1" range="-3 3"/>
    <geom name="{name}_arm" type="capsule" fromto="0 0 0 .4 0 0" size=".03"/><site name="{name}/tool" pos=".43 0 0"/>
  </body>
</body>"""
DOOR = """
<body name="door" pos="0 1.5 0.5"><joint name="hinge" axis="0 0 1" range="0 1"/>
<geom type="box" size=".3 .02 .3"/></body>
"""
OWN = """
<mujoco><compiler angle="radian"/>
  <worldbody>{bodies}<geom name="wall" type="box" pos="-.4 0 .3" size=".05 .5 .5"/></worldbody>
  <actuator>{motors}</actuator>
</mujoco>"""


def cell_with(folder, bodies, joints):
    motors = "".join(f'<motor joint="{joint}"/>' for joint in joints)
    (folder / "own.xml").write_text(OWN.format(bodies="".join(bodies), motors=motors))
    return folder / "own.xml"


def test_a_cell_s_own_robot_is_the_one_with_a_tool_and_not_a_door_that_comes_first(tmp_path):
    mast = MAST.format(name="mast", x=0)
    scene = Scene.load(cell_with(tmp_path, [DOOR, mast], ["hinge", "mast_turn"]))
    robot = scene.robot()
    assert robot.name == "mast" and robot.robot.joint_names == ("mast_turn",)
    names = [[scene.model.body(body).name for body in link] for link in robot.link_body_ids]
    assert names == [["mast"], ["mast_arm"]]
    assert scene.obstacles == ("world", "door")
    found = CollisionModel(scene).distance([3.0])
    assert found.distance < 0 and set(found.pair) == {"wall", "mast_arm"}


def test_two_robots_in_one_cell_file_are_refused(tmp_path):
    masts = [MAST.format(name=name, x=x) for name, x in (("left", -1), ("right", 1))]
    with pytest.raises(ModelError, match="holds 2 robots: left, right"):
        Scene.load(cell_with(tmp_path, masts, ["left_turn", "right_turn"]))


LEG = """
<body name="leg" pos="0 1 0"><joint name="ball" type="ball"/><geom size=".1"/>
  <body><joint name="slide" type="slide"/><geom size=".1"/><site name="end"/></body>
</body>"""


def test_drives_that_hang_on_ball_joints_are_no_robot_beside_one_or_alone(tmp_path):
    assert not Scene.load(cell_with(tmp_path, [LEG], ["slide"])).robots
    mast = MAST.format(name="mast", x=0)
    assert list(Scene.load(cell_with(tmp_path, [LEG, mast], ["slide", "mast_turn"])).robots) == ["mast"]


THING = '<mujoco><worldbody><body{name}>{joint}<geom size=".05" pos=".1 0 0"/></body></worldbody></mujoco>'
PLACES = """
<mujoco><worldbody><site name="robot_mount"/>
  <site name="quat" pos="1 1 1" quat="0.70710678 0 0 0.70710678"/><site name="euler" pos="1 1 1" euler="0 0 90"/>
  <site name="axes" pos="1 1 1" xyaxes="0 1 0 -1 0 0"/>
  <frame pos="1 0 0" euler="0 0 90"><site name="framed" pos="1 0 1"/></frame>
</worldbody></mujoco>"""


def with_thing(folder, place="quat", fixed="false", joint="", name=' name="thing"'):
    (folder / "places.xml").write_text(PLACES)
    (folder / "thing.xml").write_text(THING.format(joint=joint, name=name))
    (folder / "placed.toml").write_text(
        'format = "workcell-task/1"\nname = "placed"\ncell = "places.xml"\n'
        '[[robots]]\nname = "ur10"\nmodel = "ur10"\nmount = "robot_mount"\n'
        f'[[objects]]\nname = "thing"\nmodel = "thing.xml"\nplace = "{place}"\nfixed = {fixed}\n'
    )
    return Scene.load(folder / "placed.toml")


@pytest.mark.parametrize("fixed", ["false", "true"])
@pytest.mark.parametrize("place", ["quat", "euler", "axes", "framed"])
def test_objects_stand_as_their_site_does_however_its_angles_are_written(tmp_path, place, fixed):
    scene = with_thing(tmp_path, place, fixed)
    quarter = Pose(np.array([1.0, 1.0, 1.0]), np.array([1.0, 0.0, 0.0, 1.0]) * np.sqrt(0.5))
    assert max(scene.object_pose("thing").error_to(quarter)) < 1e-7


def test_the_task_says_whether_an_object_is_free_and_not_its_file(tmp_path):
    free = with_thing(tmp_path, joint="<freejoint/>", name="")
    assert free.object("thing").qpos_address == 6 and free.model.nq == 13
    fixed = with_thing(tmp_path, fixed="true", joint="<freejoint/>")
    assert fixed.object("thing").qpos_address is None and fixed.model.nq == 6
    lid = with_thing(tmp_path, fixed="true", joint='<joint name="lid"/>')
    assert lid.object("thing").qpos_address is None and lid.model.nq == 7
    with pytest.raises(ModelError, match="root body 'thing' has the joint 'lid'"):
        with_thing(tmp_path, joint='<joint name="lid"/>')


def test_what_a_scene_says_of_its_robots_can_not_be_changed(scene):
    arm = scene.robot()
    for values in (arm.start, arm.qpos_addresses, arm.dof_addresses, arm.actuator_ids):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 1
