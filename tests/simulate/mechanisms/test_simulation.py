"""A linkage follows its reference, keeps its loop closed, and stops where something goes wrong."""

import numpy as np
import pytest

from tests.simulate.mechanisms.crank import MOTOR, SERVO, write_task
from workcell.errors import InputError, ModelError
from workcell.model.mechanism.following import close
from workcell.model.scene import Scene
from workcell.motion.mechanisms.path import MechanismPath, resting
from workcell.motion.mechanisms.timing import MotionLimits, time_mechanism
from workcell.simulate.execution import StopReason
from workcell.simulate.mechanisms.simulation import MechanismSimulation
from workcell.simulate.runner import Settings


def turning(scene, to, steps=6):
    """A motion of the crank to an angle, and the way it goes."""
    moving, configurations = scene.mechanism, [scene.mechanism.start]
    for angle in np.linspace(moving.start[0], to, steps + 1)[1:]:
        q = np.array(configurations[-1])
        q[0] = angle
        configurations.append(close(moving.mechanism, q).q)
    path = MechanismPath(moving.mechanism, np.array(configurations))
    limits = MotionLimits(moving.velocity, moving.acceleration, {})
    return time_mechanism(path, limits, float(scene.model.opt.timestep))


@pytest.mark.parametrize("actuator", [MOTOR, SERVO])
def test_a_linkage_is_where_its_reference_is(tmp_path, actuator):
    scene = Scene.load(write_task(tmp_path, actuator=actuator))
    simulation = MechanismSimulation(scene)
    motion = turning(scene, 1.2)
    assert simulation.execute(motion, "turning") and simulation.hold(0.2)
    rows = simulation.result()
    assert rows.stop is None and not rows.contacts
    assert rows.max_tracking_error_m < 1e-3
    assert len(rows.closure_error) == len(rows) and rows.closure_error.max() < 1e-3
    assert simulation.q[0] == pytest.approx(1.2, abs=2e-3)
    # the closed form of a crank of 0.1 m and a rod of 0.3 m
    x = 0.1 * np.cos(1.2) + np.sqrt(0.3**2 - (0.1 * np.sin(1.2)) ** 2)
    assert simulation.frame_pose("block").position[0] == pytest.approx(x, abs=1e-3)
    assert rows.tool_position[-1] == pytest.approx(simulation.frame_pose("block").position, abs=1e-4)
    assert rows.q.shape == (len(rows), 1) and rows.torque.shape == (len(rows), 1)
    assert [event.text for event in rows.events] == [f"turning: {motion.duration:.2f} s"]


def test_the_wall_in_the_way_stops_the_run_and_is_named(tmp_path):
    scene = Scene.load(write_task(tmp_path, wall=0.42, start="start = {motor = 1.0}"))
    simulation = MechanismSimulation(scene)
    assert not simulation.execute(turning(scene, 0.0))
    rows = simulation.result()
    assert rows.stop is not None and rows.stop.reason is StopReason.CONTACT
    assert {frozenset(contact.pair) for contact in rows.contacts} == {frozenset(("slider", "wall"))}
    assert rows.min_clearance_pair in (("slider", "wall"), ("wall", "slider"))
    assert not simulation.hold(0.1)


def test_a_contact_that_is_expected_is_none_to_stop_for(tmp_path):
    scene = Scene.load(write_task(tmp_path, wall=0.42, start="start = {motor = 1.0}"))
    settings = Settings(max_error_m=0.1, max_error_rad=1.0)
    simulation = MechanismSimulation(scene, settings=settings)
    simulation.expect([("slider", "wall")])
    assert simulation.execute(turning(scene, 0.0)) and simulation.hold(0.3)
    assert list(simulation.touched()) == [("slider", "wall")]
    assert simulation.touched()["slider", "wall"] > 0.0


def test_pressing_gives_the_force_that_is_asked_for(tmp_path):
    scene = Scene.load(write_task(tmp_path, wall=0.38, start="start = {motor = 1.0}"))
    simulation = MechanismSimulation(scene)
    simulation.expect([("slider", "wall")])
    face = 0.37 - 0.03
    angle = np.arccos((0.1**2 + face**2 - 0.3**2) / (2 * 0.1 * face))
    assert simulation.execute(turning(scene, float(angle))) and simulation.hold(0.3)
    assert simulation.press({"block": np.array([6.0, 0.0, 0.0])}, 0.4) and simulation.hold(0.6)
    assert simulation.touched()["slider", "wall"] == pytest.approx(6.0, rel=0.1)


def test_a_motor_that_is_too_weak_loses_the_reference(tmp_path):
    weak = '<motor name="drive" joint="motor" ctrlrange="-0.02 0.02" ctrllimited="true"/>'
    scene = Scene.load(write_task(tmp_path, actuator=weak))
    simulation = MechanismSimulation(scene)
    assert not simulation.execute(turning(scene, 1.5))
    rows = simulation.result()
    assert rows.stop is not None and rows.stop.reason is StopReason.TRACKING and rows.saturated_steps > 0


def test_what_does_not_fit_is_refused(tmp_path):
    scene = Scene.load(write_task(tmp_path))
    simulation = MechanismSimulation(scene)
    moving = scene.mechanism
    elsewhere = close(moving.mechanism, moving.start + np.array([0.5, 0.0, 0.0])).q
    with pytest.raises(InputError, match="the motion begins"):
        simulation.execute(resting(moving.mechanism, elsewhere, 0.1, simulation.timestep))
    with pytest.raises(InputError, match="step"):
        simulation.execute(resting(moving.mechanism, moving.start, 0.1, 0.01))
    with pytest.raises(InputError, match="-1"):
        simulation.hold(-1.0)
    undriven = write_task(tmp_path, actuator="")
    with pytest.raises(ModelError, match="no actuator"):
        MechanismSimulation(Scene.load(undriven))
    with pytest.raises(ModelError, match="no mechanism"):
        MechanismSimulation(Scene.load("two_arms"))
