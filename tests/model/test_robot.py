"""`Robot`: kinematics against MuJoCo on models with every joint feature, limits, unwrapping, sub-chains."""

import mujoco
import numpy as np
import pytest

from workcell.errors import InputError, ModelError, UnknownNameError
from workcell.model.loading.load import load_robot
from workcell.pose import rotation_vector

ARM = """
<mujoco model="arm">
  <compiler angle="radian"/>
  <custom><numeric name="turn:velocity" data="1.5"/><numeric name="turn:acceleration" data="4"/></custom>
  <worldbody>
    <body name="base" pos="0.1 0.2 0.3" euler="0 0 0.4">
      <geom type="cylinder" size=".05 .05"/>
      <body name="fixed" pos="0 0 .1" euler="0.2 0 0">
        <body name="one" pos="0 0 .02" euler="0.3 0 0.2">
          <joint name="turn" axis="0 0 1" range="-2 1" pos="0.02 0 0.01" ref="0.3"/>
          <geom type="capsule" size=".03" fromto="0 0 0 0 0 .3"/>
          <body name="two" pos="0 0 .35">
            <joint name="bend" axis="0 1 0" range="-2 2"/>
            <joint name="roll" axis="1 0 0" range="-5 5"/>
            <geom type="capsule" size=".03" fromto="0 0 0 .3 0 0"/>
            <body name="three" pos=".35 0 0">
              <joint name="slide" type="slide" axis="1 0 0" range="0 0.2" ref="0.05"/>
              <geom type="box" size=".03 .02 .02"/>
              <body name="tip" pos="0.05 0 0" euler="0.1 0.2 0.3"><site name="tool" pos="0.01 0.02 0"/></body>
            </body>
          </body>
          <site name="shoulder" pos="0 0 0.1"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="turn" joint="turn" forcerange="-20 20"/><motor name="bend" joint="bend"/>
    <motor name="roll" joint="roll"/><motor name="slide" joint="slide"/>
  </actuator>
  <keyframe><key name="home" qpos="0.3 0.2 0.1 0.1"/></keyframe>
</mujoco>
"""


@pytest.fixture
def arm(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(ARM)
    return load_robot(path), mujoco.MjModel.from_xml_path(str(path))


def test_forward_kinematics_agree_with_mujoco(arm):
    robot, model = arm
    data = mujoco.MjData(model)
    for q in robot.random_configuration(np.random.default_rng(0), 50):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        for site in ("tool", "shoulder"):
            pose = robot.fk(q, site)
            assert np.abs(pose.position - data.site(site).xpos).max() < 1e-12
            assert np.abs(pose.rotation - data.site(site).xmat.reshape(3, 3)).max() < 1e-12


def test_jacobian_agrees_with_central_differences(arm):
    robot, _ = arm
    rng, h = np.random.default_rng(1), 1e-6
    for q in robot.random_configuration(rng, 5):
        J = robot.jacobian(q)
        for k, step in enumerate(np.eye(robot.dof) * h):
            a, b = robot.fk(q - step), robot.fk(q + step)
            column = np.concatenate(
                [(b.position - a.position) / (2 * h), rotation_vector(b.rotation @ a.rotation.T) / (2 * h)]
            )
            assert np.abs(J[:, k] - column).max() < 1e-8


def test_a_batch_equals_its_members(arm):
    robot, _ = arm
    q = robot.random_configuration(np.random.default_rng(2), 12).reshape(3, 4, robot.dof)
    assert np.array_equal(robot.fk_transform(q)[1, 2], robot.fk_transform(q[1, 2]))
    assert np.array_equal(robot.jacobian(q)[2, 0], robot.jacobian(q[2, 0]))


def test_limits_and_home_come_from_the_file(arm):
    robot, _ = arm
    assert robot.joint_names == ("turn", "bend", "roll", "slide")
    assert robot.velocity[0] == 1.5 and robot.acceleration[0] == 4.0 and np.isinf(robot.velocity[1])
    assert robot.effort[0] == 20.0
    assert np.allclose(robot.home, [0.3, 0.2, 0.1, 0.1])
    with pytest.raises(InputError, match=r"turn = 1\.5000 outside"):
        robot.check_limits([1.5, 0, 0, 0.1])


def test_unwrap_moves_whole_turns_into_the_limits(arm):
    robot, _ = arm
    q = np.array([-1.0, 0.5, 4.5, 0.1])
    turned = q + np.array([2 * np.pi, -2 * np.pi, 4 * np.pi, 0.0])
    back = robot.unwrap(turned)
    assert np.all(robot.within_limits(back))
    assert np.allclose(robot.fk(back).matrix, robot.fk(q).matrix)
    assert np.allclose(robot.unwrap(turned, reference=q), q)


def test_a_chain_to_an_inner_tool_drops_the_joints_beyond(arm):
    robot, _ = arm
    short = robot.chain("shoulder")
    assert short.joint_names == ("turn",) and short.is_serial
    q = robot.random_configuration(np.random.default_rng(3))
    assert np.allclose(short.fk(q[:1]).matrix, robot.fk(q, "shoulder").matrix)


def test_configurations_by_name(arm):
    robot, _ = arm
    q = robot.configuration({"bend": 1.0})
    assert q[1] == 1.0 and q[0] == robot.home[0]
    with pytest.raises(UnknownNameError, match="did you mean bend"):
        robot.configuration({"bendy": 1.0})
    with pytest.raises(InputError, match="takes 4 joint values"):
        robot.configuration([0.0])
    with pytest.raises(InputError, match="not finite"):
        robot.configuration([0.0, np.nan, 0, 0])


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('<motor name="bend" joint="bend"/>', "", "'bend' lies between"),
        ('<site name="tool" pos="0.01 0.02 0"/>', "", ""),
        ('axis="0 1 0" range="-2 2"', 'type="ball"', "can't (read|compile)|neither hinge nor slide"),
        ("<mujoco", "<mujocoo", "can't read"),
        ('range="0 0.2" ref', "ref", "has no limits"),
    ],
)
def test_what_can_not_be_planned_for_is_named(tmp_path, old, new, says):
    path = tmp_path / "bad.xml"
    path.write_text(ARM.replace(old, new))
    if not says:
        assert load_robot(path).default_tool == "shoulder"
        return
    with pytest.raises(ModelError, match=says):
        load_robot(path)


def test_a_robot_without_actuators(tmp_path):
    path = tmp_path / "passive.xml"
    head, tail = ARM.split("<actuator>")
    path.write_text(head + tail.split("</actuator>")[1])
    with pytest.raises(ModelError, match="no actuated joint"):
        load_robot(path)


def test_unknown_names_and_tools(arm, tmp_path):
    with pytest.raises(UnknownNameError, match="did you mean sawyer"):
        load_robot("sawyr")
    with pytest.raises(ModelError, match="no such file"):
        load_robot(tmp_path / "nothing.xml")
    with pytest.raises(UnknownNameError, match="known: shoulder, tool"):
        arm[0].tool("gripper")


def test_a_urdf_gets_actuators_and_a_tool(tmp_path):
    (tmp_path / "two.urdf").write_text(
        """<robot name="two"><link name="base"/>
        <link name="a"><inertial><mass value="1"/>
        <inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial>
        <collision><geometry><box size=".1 .1 .1"/></geometry></collision></link>
        <link name="b"><inertial><mass value="1"/>
        <inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="j1" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
        <origin xyz="0 0 .5"/><limit lower="-1" upper="1" effort="5" velocity="1"/></joint>
        <joint name="j2" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="1 0 0"/>
        <origin xyz=".3 0 0"/><limit lower="0" upper=".2" effort="5" velocity="1"/></joint></robot>"""
    )
    robot = load_robot(tmp_path / "two.urdf")
    assert robot.joint_names == ("j1", "j2")
    assert np.allclose(robot.fk([np.pi / 2, 0.1]).position, [0, 0.4, 0.5])


LIFT = """<robot name="lift"><link name="base"/><link name="car"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="rail" type="prismatic">
<parent link="base"/><child link="car"/><axis xyz="0 0 1"/><limit lower="0" upper="1" effort="5" VELOCITY/>
</joint></robot>"""


def test_a_urdf_keeps_its_velocity_limits(tmp_path):
    path = tmp_path / "lift.urdf"
    for text, velocity in (('velocity="0.25"', 0.25), ('velocity="0"', np.inf), ("", np.inf)):
        path.write_text(LIFT.replace("VELOCITY", text))
        assert load_robot(path).velocity.tolist() == [velocity]
    for text in ("-1", "nan", "fast", "inf"):
        path.write_text(LIFT.replace("VELOCITY", f'velocity="{text}"'))
        with pytest.raises(ModelError, match=r"lift\.urdf.*'rail' has the velocity limit"):
            load_robot(path)


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("arm.txt", b"<mujoco/>", "not the name of a model file"),
        ("arm", b"<mujoco/>", "not the name of a model file"),
        ("arm.urdf", bytes(range(256)), "not a text file"),
        ("arm.xml", b"", "can't read this file"),
    ],
)
def test_what_is_no_model_file_is_said_in_one_message(tmp_path, capfd, name, content, says):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ModelError, match=says):
        load_robot(tmp_path / name)
    assert capfd.readouterr() == ("", "")


ROD = """<mujoco><worldbody><body name="rod"><joint name="turn" range="-90 90"/><geom size="0.1"/>
<site name="tool" pos="0 0 1"/>
</body></worldbody><custom><numeric name="turn:velocity" data="2"/></custom>
<actuator><motor joint="turn"/></actuator></mujoco>"""


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('range="-90 90"', 'range="90 -90"', "the range of joint 'turn'"),
        ('range="-90 90"', 'range="nan 90"', "the range of joint 'turn'"),
        ('range="-90 90"', 'type="slide"', "'turn' has no limits"),
        ('data="2"', 'data="-2"', "'turn:velocity' is -2"),
        ('data="2"', 'data="nan"', "'turn:velocity' is nan"),
        ('pos="0 0 1"', 'pos="0 nan 1"', "site 'tool' is not finite"),
    ],
)
def test_numbers_that_mujoco_lets_pass_are_refused(tmp_path, old, new, says):
    (tmp_path / "rod.xml").write_text(ROD)
    assert load_robot(tmp_path / "rod.xml").velocity.tolist() == [2.0]
    (tmp_path / "rod.xml").write_text(ROD.replace(old, new))
    with pytest.raises(ModelError, match=rf"rod\.xml: .*{says}"):
        load_robot(tmp_path / "rod.xml")
