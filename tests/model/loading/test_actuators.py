"""Effort limits are what MuJoCo really applies."""

import mujoco
import numpy as np
import pytest

from workcell.model.loading.actuators import actuated_joints
from workcell.model.loading.compiled import robot_from_model

MODEL = """
<mujoco><compiler autolimits="true"/>
  <worldbody><body name="a"><joint name="j" range="-1 1" {joint}/><geom size=".1"/><site name="tool"/>
  </body></worldbody>
  <actuator>{actuator}</actuator>
</mujoco>
"""


@pytest.mark.parametrize(
    ("joint", "actuator"),
    [
        ("", '<motor joint="j" gear="100" forcerange="-2 2"/>'),
        ("", '<motor joint="j" gear="-50" ctrlrange="-1 1"/>'),
        ("", '<motor joint="j" gear="100" ctrlrange="-3 3" forcerange="-2 2"/>'),
        ("", '<general joint="j" gainprm="10" ctrlrange="-3 3"/>'),
        ('actuatorfrcrange="-7 7"', '<motor joint="j" gear="100" ctrlrange="-1 1"/>'),
    ],
)
def test_an_overdriven_motor_applies_the_effort_limit(joint, actuator):
    model = mujoco.MjModel.from_xml_string(MODEL.format(joint=joint, actuator=actuator))
    data = mujoco.MjData(model)
    data.ctrl[:] = 1e6
    mujoco.mj_forward(model, data)
    assert robot_from_model(model).effort[0] == pytest.approx(abs(data.qfrc_actuator[0]))


def test_the_weaker_side_counts_and_a_servo_s_range_is_no_torque():
    one_sided = MODEL.format(joint="", actuator='<motor joint="j" ctrlrange="-50 30"/>')
    assert robot_from_model(mujoco.MjModel.from_xml_string(one_sided)).effort[0] == 30.0
    servo = MODEL.format(joint="", actuator='<position joint="j" kp="100" ctrlrange="-3 3"/>')
    assert np.isinf(robot_from_model(mujoco.MjModel.from_xml_string(servo)).effort[0])


def test_joints_that_motors_and_tendons_drive_are_known_by_id():
    text = """<mujoco><worldbody>
        <body><joint name="a"/><geom size=".1"/><body pos="1 0 0"><joint name="b"/><geom size=".1"/>
        <body pos="1 0 0"><joint name="c" type="slide"/><geom size=".1"/>
        <body pos="1 0 0"><joint name="d"/><geom size=".1"/></body></body></body></body></worldbody>
        <tendon><fixed name="t"><joint joint="b" coef="1"/><joint joint="c" coef="1"/></fixed></tendon>
        <actuator><motor joint="a"/><motor tendon="t"/></actuator></mujoco>"""
    model = mujoco.MjModel.from_xml_string(text)
    assert actuated_joints(model) == {model.joint(name).id for name in "abc"}
