"""Limits mean what a model's file says, also where MuJoCo would take a joint for unlimited."""

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from workcell.errors import ModelError
from workcell.model.loading.load import load_robot, load_spec
from workcell.model.loading.warnings import heard_warnings
from workcell.model.scene import Scene, robot_scene

MJCF = """
<mujoco><compiler angle="{angle}" autolimits="{auto}"/>{default}
  <worldbody><body name="a"><joint {name} {joint}/><geom size=".1" mass="1"/><site name="tool" pos="0 0.1 0"/></body>
  </worldbody><actuator>{actuator}</actuator></mujoco>
"""
URDF = """
<robot name="r"><link name="base"/><link name="l1">{mass}</link><link name="l2">{mass}</link>
  <joint name="one" type="{kind}"><parent link="base"/><child link="l1"/><axis xyz="0 0 1"/>{limit}</joint>
  <joint name="two" type="revolute"><parent link="l1"/><child link="l2"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="5" velocity="2"/></joint></robot>
"""
MASS = (
    '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    '<collision><geometry><sphere radius="0.1"/></geometry></collision>'
)


def mjcf(folder, joint, *, angle="radian", auto="true", default="", name='name="j"'):
    path = folder / "arm.xml"
    path.write_text(
        MJCF.format(
            angle=angle,
            auto=auto,
            default=default,
            name=name,
            joint=joint,
            actuator='<motor joint="j"/>' if "j" in name else "",
        )
    )
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("limits")


number = st.one_of(st.just(0.0), st.floats(-3.0, 3.0).map(lambda x: round(x, 3)))


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(["revolute", "prismatic"]), st.none() | number, st.none() | number)
def test_urdf_limits_are_those_of_pinocchio_s_parser(folder, kind, lower, upper):
    given_ = "".join(f' {name}="{x}"' for name, x in (("lower", lower), ("upper", upper)) if x is not None)
    text = URDF.format(kind=kind, mass=MASS, limit=f'<limit{given_} effort="1" velocity="1"/>')
    path = folder / "arm.urdf"
    path.write_text(text)
    oracle = pin.buildModelFromXML(text)
    low, high = oracle.lowerPositionLimit[0], oracle.upperPositionLimit[0]
    if low > high:
        with pytest.raises(ModelError, match="'one'"):
            load_robot(path)
        return
    robot = load_robot(path)
    assert (robot.lower[0], robot.upper[0]) == (low, high)
    scene = robot_scene(path)
    assert low <= scene.initial_qpos()[0] <= high


def test_a_continuous_joint_has_no_limits_and_a_revolute_one_without_limit_is_refused(folder):
    path = folder / "arm.urdf"
    for limit in ("", '<limit lower="-0.1" upper="0.1" effort="1" velocity="1"/>'):
        path.write_text(URDF.format(kind="continuous", mass=MASS, limit=limit))
        assert np.allclose(load_robot(path).joint_limits[0], [-2 * np.pi, 2 * np.pi])
    for kind in ("revolute", "prismatic"):
        path.write_text(URDF.format(kind=kind, mass=MASS, limit=""))
        with pytest.raises(ModelError, match=r"'one'.*has no <limit>"):
            load_robot(path)
    path.write_text(URDF.format(kind="revolute", mass=MASS, limit='<limit lower="nan" upper="1"/>'))
    with pytest.raises(ModelError, match=r"'one'.*lower limit is 'nan'"):
        load_robot(path)


@pytest.mark.parametrize(
    ("joint", "limits"),
    [
        ('range="0 0"', (0.0, 0.0)),
        ('range="0 0" limited="auto"', (0.0, 0.0)),
        ('range=" -0.0   0e3 "', (0.0, 0.0)),
        ('range="0.5 0.5"', (0.5, 0.5)),
        ('range="0.5 0.5" ref="0.2"', (0.5, 0.5)),
        ('type="slide" range="0 0"', (0.0, 0.0)),
        ('limited="false" range="-0.5 1"', (-0.5, 1.0)),
        ('limited="false" range="0.5 0.5"', (0.5, 0.5)),
        ('range="-0.5 1"', (-0.5, 1.0)),
        ("", (-2 * np.pi, 2 * np.pi)),
        ('limited="false"', (-2 * np.pi, 2 * np.pi)),
    ],
)
def test_a_range_in_an_mjcf_file_is_never_ignored(folder, joint, limits):
    path = mjcf(folder, joint)
    robot = load_robot(path)
    assert robot.joint_limits[0] == pytest.approx(limits, abs=1e-12)
    assert limits[0] <= robot_scene(path).initial_qpos()[0] <= limits[1]


@pytest.mark.parametrize("joint", ['limited="true" range="0 0"', 'limited="true"', 'range="1 0"'])
def test_what_has_no_meaning_is_refused_with_the_joint_s_name(folder, joint):
    with pytest.raises(ModelError, match="'j'"):
        load_robot(mjcf(folder, joint))


def test_a_range_of_a_class_locks_too_and_degrees_are_degrees(folder):
    default = '<default><joint range="0 0"/></default>'
    assert load_robot(mjcf(folder, "", default=default)).joint_limits[0].tolist() == [0.0, 0.0]
    assert load_robot(mjcf(folder, 'range="0 1"', default=default)).joint_limits[0].tolist() == [0.0, 1.0]
    robot = load_robot(mjcf(folder, 'range="30 30" ref="10"', angle="degree"))
    assert robot.joint_limits[0] == pytest.approx([np.pi / 6] * 2)
    robot = load_robot(mjcf(folder, 'range="-30 60" limited="false"', angle="degree"))
    assert robot.joint_limits[0] == pytest.approx([-np.pi / 6, np.pi / 3])


def test_a_range_is_seen_through_includes(folder):
    (folder / "sub").mkdir(exist_ok=True)
    (folder / "sub" / "body.xml").write_text(
        '<mujocoinclude><body name="a"><joint name="j" range="0 0"/><geom size=".1"/><site name="tool"/></body>'
        "</mujocoinclude>"
    )
    path = folder / "top.xml"
    path.write_text(
        '<mujoco><worldbody><include file="sub/body.xml"/></worldbody>'
        '<actuator><motor joint="j"/></actuator></mujoco>'
    )
    assert load_robot(path).joint_limits[0].tolist() == [0.0, 0.0]


def test_the_compiled_model_keeps_a_locked_joint_where_it_is_locked(folder):
    path = mjcf(folder, 'range="0.5 0.5" ref="0.2" axis="1 0 0"')
    scene = robot_scene(path)
    data = mujoco.MjData(scene.model)
    data.qpos[:] = scene.initial_qpos()
    assert data.qpos[0] == 0.5
    for _ in range(500):
        mujoco.mj_step(scene.model, data)
    assert abs(data.qpos[0] - 0.5) < 1e-2
    # a joint without a name or an actuator as well
    spec = load_spec(mjcf(folder, 'range="0.5 0.5"', name=""))
    model = spec.compile()
    assert model.neq == 1 and model.eq_data[0, 0] == 0.5


def test_a_lock_outside_the_range_is_refused(folder):
    path = mjcf(folder, 'range="-0.1 0.1"')
    path.write_text(
        path.read_text().replace(
            "<actuator>", '<equality><joint joint1="j" polycoef="0.4 0 0 0 0"/></equality><actuator>'
        )
    )
    with pytest.raises(ModelError, match=r"'j' at 0\.4, outside its range"):
        load_robot(path)
    path.write_text(path.read_text().replace("0.4 0", "0.05 0"))
    assert load_robot(path).joint_limits[0].tolist() == [0.05, 0.05]
    path.write_text(path.read_text().replace("<joint joint1", '<joint active="false" joint1'))
    assert load_robot(path).joint_limits[0].tolist() == [-0.1, 0.1]


def test_warnings_are_kept_and_those_that_change_the_meaning_are_errors(folder):
    path = folder / "arm.urdf"
    limit = '<limit lower="-1" upper="1"/><mimic joint="nobody"/>'
    path.write_text(URDF.format(kind="revolute", mass=MASS, limit=limit))
    with pytest.raises(ModelError, match=r"arm\.urdf: MuJoCo warns: <mimic> on joint 'one' ignored"):
        load_robot(path)
    cell, arm = folder / "cell.xml", folder / "other.xml"
    cell.write_text(
        '<mujoco><option timestep="0.001"/><worldbody><site name="robot_mount"/></worldbody></mujoco>'
    )
    arm.write_text(
        '<mujoco><option timestep="0.004"/><worldbody><body name="a"><joint name="j" range="-1 1"/><geom size=".1"/>'
        '<site name="tool"/></body></worldbody><actuator><motor joint="j"/></actuator></mujoco>'
    )
    scene = Scene.load(cell, robot=str(arm))
    assert len(scene.warnings) == 1 and "timestep" in scene.warnings[0]
    assert robot_scene(mjcf(folder, 'range="-1 1"')).warnings == ()
    with heard_warnings() as heard:
        Scene.load(cell, robot=str(arm))
    assert heard == []  # the scene has heard its own
