"""Joints that follow others: MuJoCo agrees on where they are, and what can't be honoured is refused."""

import mujoco
import numpy as np
import pytest

from tests.coupled_arms import coupled_arm, planar, residuals
from workcell.errors import InputError, ModelError
from workcell.model.collision_model import CollisionModel
from workcell.model.joined import joined_robot
from workcell.model.loading.load import load_robot
from workcell.model.scene import Scene, robot_scene

CASES = [(seed, bent) for seed in range(12) for bent in (False, True)]
URDF_LINK = """
<link name="l{k}"><inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial>
</link>"""


def load(folder, text, suffix="xml"):
    path = folder / f"arm.{suffix}"
    path.write_text(text)
    return load_robot(path)


@pytest.mark.parametrize(("seed", "bent"), CASES)
def test_kinematics_and_constraints_agree_with_mujoco(tmp_path, seed, bent):
    text, following = coupled_arm(seed, joints=6, followers=1 + seed % 3, bent=bent, every=seed % 2 == 0)
    robot = load(tmp_path, text)
    assert set(robot.joint_names) == {f"j{k}" for k in range(6)} - set(following)
    assert robot.joint_count == 6 and len(robot.link_names) == 7
    scene = robot_scene(tmp_path / "arm.xml")
    actor, model = scene.robot(), scene.model
    assert np.abs(residuals(model, scene.initial_qpos())).max() < 1e-12
    truth, data = CollisionModel(scene), mujoco.MjData(model)
    for q in robot.random_configuration(np.random.default_rng(seed), 20):
        qpos = truth.full_qpos(q)
        assert np.abs(residuals(model, qpos)).max() < 1e-12
        assert np.all((qpos >= model.jnt_range[:, 0] - 1e-9) & (qpos <= model.jnt_range[:, 1] + 1e-9))
        assert np.array_equal(qpos[actor.qpos_addresses], q)
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        pose = robot.fk(q)
        assert np.abs(pose.position - data.site_xpos[0]).max() < 1e-12
        assert np.abs(pose.rotation - data.site_xmat[0].reshape(3, 3)).max() < 1e-12
        free = robot.uncoupled
        assert np.allclose(free.fk_transform(robot.joint_values(q)), robot.fk_transform(q), atol=1e-14)
        assert free.within_limits(robot.joint_values(q))


@pytest.mark.parametrize(("seed", "bent"), CASES[::3])
def test_the_jacobian_is_that_of_finite_differences(tmp_path, seed, bent):
    robot = load(tmp_path, coupled_arm(seed, bent=bent)[0])
    step = 1e-6
    for q in 0.9 * robot.random_configuration(np.random.default_rng(seed), 5):
        J = robot.jacobian(q)
        assert J.shape == (6, robot.dof)
        for k in range(robot.dof):
            ahead, behind = (robot.fk(q + s * step * np.eye(robot.dof)[k]) for s in (1, -1))
            linear = (ahead.position - behind.position) / (2 * step)
            turn = ahead.rotation @ behind.rotation.T
            angular = np.array(
                [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
            ) / (4 * step)
            assert np.allclose(J[:3, k], linear, atol=1e-7) and np.allclose(J[3:, k], angular, atol=1e-7)
    many = robot.random_configuration(np.random.default_rng(1), 4)
    assert np.allclose(robot.jacobian(many)[2], robot.jacobian(many[2]))


@pytest.mark.parametrize(
    ("multiple", "offset", "leader", "follower", "limits"),
    [
        (1.0, 0.0, (-1.5, 1.5), (-1.0, 2.0), (-1.0, 1.5)),
        (-2.0, 0.0, (-1.5, 1.5), (-1.0, 2.0), (-1.0, 0.5)),
        (1.0, 0.3, (-1.5, 1.5), (-1.0, 0.5), (-1.3, 0.2)),
        (0.0, 0.4, (-1.5, 1.5), (-1.0, 0.5), (-1.5, 1.5)),
    ],
)
def test_limits_of_who_follows_tighten_those_of_who_leads(
    tmp_path, multiple, offset, leader, follower, limits
):
    robot = load(tmp_path, planar(multiple, offset, leader, follower))
    assert robot.joint_limits[0] == pytest.approx(limits)


def test_limits_that_leave_nothing_or_two_ranges_are_refused(tmp_path):
    with pytest.raises(ModelError, match=r"'j2' follows 'j1', .* at no value"):
        load(tmp_path, planar(1.0, 0.0, (-1.5, -1.2), (1.0, 1.4)))
    with pytest.raises(ModelError, match="in 2 ranges apart"):
        load(tmp_path, planar(0.0, 0.0, (-1.5, 1.5), (0.5, 3.0)).replace("0.0 0.0 0 0 0", "0 0 1 0 0"))


def test_velocity_and_effort_of_who_follows_count(tmp_path):
    limits = ("j2:velocity", 3), ("j1:velocity", 9), ("j2:acceleration", 8)
    custom = "".join(f'<numeric name="{name}" data="{value}"/>' for name, value in limits)
    text = planar(2.0).replace("<worldbody>", f"<custom>{custom}</custom><worldbody>")
    text = text.replace('name="j2" axis', 'name="j2" actuatorfrcrange="-5 5" axis')
    robot = load(tmp_path, text)
    assert robot.velocity[0] == 1.5 and robot.acceleration[0] == 4.0 and robot.effort[0] == 10.0


def test_who_is_driven_is_the_variable(tmp_path):
    robot = load(tmp_path, planar(-0.5, 0.1).replace('joint="j1"/></actuator>', 'joint="j2"/></actuator>'))
    assert robot.joint_names == ("j2",)
    q = np.array([0.3])
    assert robot.joint_values(q) == pytest.approx([(0.3 - 0.1) / -0.5, 0.3])
    assert robot.joint_limits[0] == pytest.approx([0.1 - 0.75, 0.1 + 0.75])
    scene = robot_scene(tmp_path / "arm.xml")
    assert np.abs(residuals(scene.model, CollisionModel(scene).full_qpos(q))).max() < 1e-12
    bent = (
        planar(1.0)
        .replace('joint="j1"/></actuator>', 'joint="j2"/></actuator>')
        .replace("1.0 0 0 0", "1.0 0.2 0 0")
    )
    with pytest.raises(ModelError, match=r"'j1' is not actuated.*'j2'"):
        load(tmp_path, bent)


@pytest.mark.parametrize(
    ("equality", "word"),
    [
        (
            '<joint joint1="j2" joint2="j1"/><joint joint1="j2" joint2="j1" polycoef="0 2 0 0 0"/>',
            "'j2' follows several",
        ),
        ('<joint joint1="j2" joint2="j1"/><joint joint1="j1" joint2="j2"/>', "circle"),
        ('<joint joint1="j2" joint2="side"/>', "'j2' follows 'side'"),
        ('<joint joint1="side" joint2="j2"/>', "'side' follows 'j2'"),
        ('<joint joint1="j2" polycoef="0.1"/><joint joint1="j2" polycoef="0.2"/>', "'j2' at 0.1 and 0.2"),
    ],
)
def test_what_can_t_be_honoured_is_refused_by_name(tmp_path, equality, word):
    side = '<body name="side"><joint name="side" axis="1 0 0" range="-1 1"/><geom size=".01"/></body><site name="tool"'
    text = planar().replace('<site name="tool"', side)
    text = text.replace('<motor name="m1"', '<motor name="m2" joint="j2"/><motor name="m1"')
    begin, end = text.index("<equality>") + 10, text.index("</equality>")
    with pytest.raises(ModelError, match=word):
        load(tmp_path, text[:begin] + equality + text[end:])


def test_inactive_couplings_and_couplings_of_others_don_t_count(tmp_path):
    text = planar().replace('<joint joint1="j2"', '<joint active="false" joint1="j2"')
    with pytest.raises(ModelError, match=r"'j2' lies between .* is not actuated"):
        load(tmp_path, text)
    driven = text.replace('<motor name="m1"', '<motor name="m2" joint="j2"/><motor name="m1"')
    assert load(tmp_path, driven).coupling is None


def test_a_joint_that_is_held_needs_no_actuator(tmp_path):
    text = planar().replace('joint2="j1" polycoef="0.0 1.0', 'polycoef="0.4 0')
    robot = load(tmp_path, text)
    assert robot.coupling is None and robot.joint_names == ("j1",)
    scene = robot_scene(tmp_path / "arm.xml")
    qpos = CollisionModel(scene).full_qpos([0.2])
    data = mujoco.MjData(scene.model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(scene.model, data)
    assert qpos.tolist() == [0.2, 0.4]
    assert np.allclose(robot.fk([0.2]).position, data.site_xpos[0], atol=1e-12)
    both = planar().replace("</equality>", '<joint joint1="j2" polycoef="0.4"/></equality>')
    robot = load(tmp_path, both)
    assert robot.joint_names == ("j1",) and robot.joint_limits[0] == pytest.approx([0.4, 0.4])


def test_mimic_of_a_urdf(tmp_path):
    joint = (
        '<joint name="{n}" type="{t}"><parent link="l{p}"/><child link="l{c}"/><origin xyz="0 0 0.1"/>'
        '<axis xyz="{a}"/><limit lower="{lo}" upper="{hi}" effort="{e}" velocity="2"/>{m}</joint>'
    )
    text = '<robot name="lift">' + "".join(URDF_LINK.format(k=k) for k in range(5))
    text += joint.format(n="pan", t="revolute", p=0, c=1, a="0 0 1", lo=-3, hi=3, e=10, m="")
    text += joint.format(
        n="two",
        t="prismatic",
        p=1,
        c=2,
        a="0 0 1",
        lo=0,
        hi=0.5,
        e=40,
        m='<mimic joint="one" multiplier="0.5" offset="0.05"/>',
    )
    text += joint.format(n="one", t="prismatic", p=2, c=3, a="0 0 1", lo=0, hi=0.6, e=100, m="")
    text += joint.format(
        n="three", t="prismatic", p=3, c=4, a="0 0 1", lo=0, hi=0.2, e=70, m='<mimic joint="two"/>'
    )
    robot = load(tmp_path, text + "</robot>", "urdf")
    assert robot.joint_names == ("pan", "one")
    assert robot.joint_limits[1] == pytest.approx([0.0, 0.3]) and robot.effort[1] == 20.0
    assert robot.joint_values([0.1, 0.2]) == pytest.approx([0.1, 0.15, 0.2, 0.15])
    assert robot.fk([0.0, 0.2]).position[2] == pytest.approx(0.4 + 0.5)
    scene = robot_scene(tmp_path / "arm.urdf")
    assert np.abs(residuals(scene.model, scene.initial_qpos())).max() < 1e-12


def test_chains_to_other_tools_keep_the_coupling_or_say_what_is_missing(tmp_path):
    text, following = coupled_arm(3, joints=5, followers=1)
    k = int(following[0][1:])
    text = text.replace(f'<geom name="g{k}"', f'<site name="here"/><geom name="g{k}"')
    robot = load(tmp_path, text)
    leader = next(j for j in range(5) if f'joint2="j{j}"' in text)
    if leader > k:
        with pytest.raises(InputError, match=f"'j{k}' follows 'j{leader}'"):
            robot.chain("here")
    else:
        part = robot.chain("here")
        q = part.random_configuration(np.random.default_rng(0))
        whole = np.concatenate([q, np.zeros(robot.dof - part.dof)])
        assert np.allclose(part.fk_transform(q), robot.fk_transform(whole, "here"), atol=1e-12)


def test_fingers_that_follow_each_other_stand_together(tmp_path):
    joint = '<joint name="f{k}" type="slide" axis="0 1 0" range="-0.04 0.04"/>'
    finger = f'<body name="f{{k}}">{joint}<geom size=".005"/></body>'
    text = planar().replace(
        '<site name="tool"', finger.format(k=1) + finger.format(k=2) + '<site name="tool"'
    )
    text = text.replace("</equality>", '<joint joint1="f2" joint2="f1" polycoef="0.01 -1 0 0 0"/></equality>')
    load(tmp_path, text)
    scene = robot_scene(tmp_path / "arm.xml")
    assert np.abs(residuals(scene.model, scene.initial_qpos())).max() < 1e-12
    assert sorted(value for _, value in scene.robot().fingers) == [0.0, 0.01]


CELL = """
<mujoco><worldbody><site name="a"/><site name="b" pos="1.5 0 0" euler="0 0 90"/>
  <body name="door" pos="0 2 0"><joint name="door" axis="0 0 1" range="0 1"/><geom size=".1 .1 .1" type="box"/></body>
  {robot}</worldbody>{rest}</mujoco>
"""
TASK = """
format = "workcell-task/1"
name = "two"
cell = "cell.xml"
[[robots]]
name = "left"
model = "arm.xml"
mount = "a"
[[robots]]
name = "right"
model = "other.xml"
mount = "b"
"""


def test_robots_side_by_side_keep_their_couplings(tmp_path):
    (tmp_path / "cell.xml").write_text(CELL.format(robot="", rest=""))
    (tmp_path / "two.toml").write_text(TASK)
    (tmp_path / "arm.xml").write_text(planar(0.5, 0.1))
    (tmp_path / "other.xml").write_text(coupled_arm(2, joints=5, followers=2, bent=True)[0])
    scene = Scene.load(tmp_path / "two.toml")
    left, right = scene.robot("left").robot, scene.robot("right").robot
    joined = joined_robot([scene.robot("left"), scene.robot("right")])
    assert joined.dof == left.dof + right.dof and joined.joint_count == 2 + 5
    assert np.abs(residuals(scene.model, scene.initial_qpos())).max() < 1e-12
    for q in joined.random_configuration(np.random.default_rng(0), 10):
        for name, robot, part in (("left", left, q[: left.dof]), ("right", right, q[left.dof :])):
            assert np.allclose(joined.fk_transform(q, f"{name}/tool"), robot.fk_transform(part), atol=1e-12)
        J = joined.jacobian(q, "right/tool")
        assert np.allclose(J[:, : left.dof], 0) and np.allclose(
            J[:, left.dof :], right.jacobian(q[left.dof :])
        )


def test_a_coupling_to_the_cell_s_own_joint_is_refused_by_name(tmp_path):
    arm = planar()
    robot = arm[arm.index('<body name="base">') : arm.index("</worldbody>")]
    rest = (
        '<equality><joint joint1="j2" joint2="j1"/><joint joint1="door" joint2="j1"/></equality>'
        '<actuator><motor joint="j1"/></actuator>'
    )
    (tmp_path / "cell.xml").write_text(CELL.format(robot=robot, rest=rest))
    with pytest.raises(ModelError, match="'door' follows 'j1'"):
        Scene.load(tmp_path / "cell.xml")
    kept = rest.replace('<joint joint1="door" joint2="j1"/>', "")
    (tmp_path / "cell.xml").write_text(CELL.format(robot=robot, rest=kept))
    assert Scene.load(tmp_path / "cell.xml").robot().robot.joint_names == ("j1",)
