"""Arms are driven by whatever a torque can be asked of; of the rest it is said why not."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from tests.simulate.test_simulation import quintic
from workcell.errors import ModelError
from workcell.model.loading.actuators import servo_range
from workcell.model.scene import Scene
from workcell.simulate.controller import CONTROLLERS
from workcell.simulate.simulation import Simulation

LINKS = """<body name="base"><geom type="cylinder" size=".06 .05" pos="0 0 .05" contype="0" conaffinity="0"/>
 <body name="a" pos="0 0 .15"><joint name="j1" axis="0 0 1" range="-3 3"/><geom type="sphere" size=".03" mass="2"/>
 <body name="b" pos="0 0 .05"><joint name="j2" axis="0 1 0" range="-2 2"/>
  <geom type="capsule" fromto="0 0 .08 0 0 .3" size=".03" mass="3"/>
 <body name="c" pos="0 0 .35"><joint name="j3" axis="0 1 0" range="-2.4 2.4"/>
  <geom type="capsule" fromto=".06 0 0 .3 0 0" size=".025" mass="2"/><site name="tool" pos=".35 0 0"/>
 </body></body></body></body>"""
SWING = np.array([0.5, 0.4, -0.6])

DRIVEN = {
    "motor": '<motor joint="{j}" gear="3"/>',
    "position": '<position joint="{j}" kp="400" kv="40" forcerange="-80 80" ctrlrange="-3 3"/>',
    "position with gear": '<position joint="{j}" kp="300" kv="5" gear="-2" forcerange="-80 80"/>',
    "velocity": '<velocity joint="{j}" kv="30" forcerange="-80 80"/>',
    "general": '<general joint="{j}" gainprm="50" biastype="affine" biasprm="1 -20 -3" forcerange="-80 80"/>',
}
UNDRIVEN = {
    '<position joint="{j}" kp="400" timeconst="0.1"/>': "a state of its own",
    '<intvelocity joint="{j}" kp="400" actrange="-1 1"/>': "a state of its own",
    '<general joint="{j}" gaintype="affine" gainprm="5 1 0"/>': "gain is not fixed",
    '<general joint="{j}" gainprm="0" biastype="affine" biasprm="0 -1 0"/>': "gain is zero",
}


def arm(folder, actuator, integrator="Euler"):
    drives = "".join(actuator.format(j=joint) for joint in ("j1", "j2", "j3"))
    file = folder / "arm.xml"
    file.write_text(
        f'<mujoco><compiler angle="radian"/><option integrator="{integrator}"/><worldbody>{LINKS}</worldbody>'
        f"<actuator>{drives}</actuator></mujoco>"
    )
    return Scene.load(file)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
@pytest.mark.parametrize("kind", DRIVEN)
def test_what_takes_a_torque_is_driven_as_a_motor_is(tmp_path, kind, integrator):
    scene = arm(tmp_path, DRIVEN[kind], integrator)
    simulation = Simulation(scene)
    start = scene.robot().start
    (name,) = scene.robots
    simulation.execute(quintic(name, start, start + SWING, 1.0))
    result = simulation.result()
    assert result.stop is None and result.max_tracking_error_m < 5e-4


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_by_either_controller(tmp_path, controller):
    scene = arm(tmp_path, DRIVEN["position"])
    simulation = Simulation(scene, controller=controller)
    start = scene.robot().start
    simulation.execute(quintic(next(iter(scene.robots)), start, start + SWING, 1.0))
    assert simulation.result().stop is None and simulation.result().max_tracking_error_m < 1e-3


@pytest.mark.parametrize("actuator", UNDRIVEN)
def test_what_takes_none_is_refused_with_the_reason(tmp_path, actuator):
    with pytest.raises(ModelError, match=UNDRIVEN[actuator]):
        Simulation(arm(tmp_path, actuator))


@pytest.mark.parametrize(
    "servo",
    [
        '<position joint="{j}" kp="400" kv="40" ctrlrange="-1.5 1.2"/>',
        '<position joint="{j}" kp="300" gear="-2" ctrlrange="-2 3"/>',
        '<general joint="{j}" gainprm="50" biastype="affine" biasprm="1 -20 -3" ctrlrange="-.3 .5"/>',
    ],
)
def test_a_scene_to_be_executed_keeps_within_what_its_servos_can_hold(tmp_path, servo):
    scene = arm(tmp_path, servo)
    narrow = scene.drivable().robot()
    assert np.all(narrow.robot.lower >= scene.robot().robot.lower)
    assert np.any(narrow.robot.lower > scene.robot().robot.lower)
    data = mujoco.MjData(scene.model)
    for k, address in enumerate(narrow.qpos_addresses):
        for end in servo_range(scene.model, int(narrow.actuator_ids[k])):
            forces = []
            for value in scene.model.actuator_ctrlrange[k]:
                data.qpos[address], data.ctrl[k] = end, value
                mujoco.mj_forward(scene.model, data)
                forces.append(abs(data.actuator_force[k]))
            assert min(forces) == pytest.approx(0.0, abs=1e-9)


def test_a_start_beyond_a_servos_range_stays_a_start(tmp_path):
    scene = arm(tmp_path, '<position joint="{j}" kp="400" ctrlrange="0.2 1"/>')
    kept = scene.drivable().robot()
    assert np.array_equal(kept.start, np.zeros(3)) and np.array_equal(kept.robot.lower, np.zeros(3))
    assert np.array_equal(kept.robot.upper, np.ones(3))


def test_motors_and_servos_without_a_range_narrow_nothing(tmp_path):
    for kind in ("motor", "position with gear", "velocity"):
        scene = arm(tmp_path, DRIVEN[kind])
        assert scene.drivable().robot() is scene.robot()
