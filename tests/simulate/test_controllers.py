"""Both controllers track, keep their limits and stop with a reason; imperfections are seeded and bounded."""

import mujoco
import numpy as np
import pytest

from tests.simulate.test_simulation import quintic, towards_the_pillar
from workcell.errors import InputError, UnknownNameError
from workcell.model.scene import robot_scene
from workcell.simulate.arm_model import ArmModel
from workcell.simulate.controller import CONTROLLERS, PositionServo
from workcell.simulate.execution import StopReason
from workcell.simulate.imperfections import Imperfections, Pulse
from workcell.simulate.simulation import Settings, Simulation

SWING = np.array([0.4, -0.3, 0.3, -0.3, 0.4, 0.3, 0.5])


def swing(scene, **options):
    start = scene.robot().start
    simulation = Simulation(scene, **options)
    simulation.execute(quintic("sawyer", start, start + SWING, 1.0))
    return simulation


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_the_true_model_is_tracked_within_half_a_millimetre(scene, controller):
    result = swing(scene, controller=controller).result()
    assert result.stop is None and result.saturated_steps == 0
    assert result.max_tracking_error_m < 5e-4


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_wrong_link_masses_are_tracked_worse_but_tracked(scene, controller):
    wrong = swing(scene, controller=controller, imperfections=Imperfections(link_error=0.1, seed=1)).result()
    right = swing(scene, controller=controller).result()
    assert wrong.stop is None
    assert right.max_tracking_error_m < wrong.max_tracking_error_m < 0.01


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_a_payload_misjudged_by_a_tenth_is_tracked_within_three_millimetres(scene, controller):
    start = scene.robot().start
    errors = []
    for payload_error in (0.1, -0.1):
        simulation = Simulation(
            scene, controller=controller, imperfections=Imperfections(payload_error=payload_error)
        )
        simulation.data.qpos[scene.object("brick").qpos_address + 2] += 0.3  # it hangs in the air, rigidly
        mujoco.mj_forward(simulation.model, simulation.data)
        assert simulation.attach("brick") and simulation.hold(0.05)
        assert simulation.execute(quintic("sawyer", start, start + 0.2 * SWING, 1.0))
        errors.append(simulation.result().max_tracking_error_m)
    assert 1e-5 < max(errors) < 3e-3


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_guards_stop_the_run_and_say_why(scene, controller):
    simulation = Simulation(scene, controller=controller)
    assert not simulation.execute(towards_the_pillar(scene))
    assert simulation.stop.reason is StopReason.CONTACT and "pillar" in simulation.stop.detail
    start = scene.robot().start
    simulation = Simulation(scene, controller=controller)
    assert not simulation.execute(quintic("sawyer", start, start + np.eye(7)[4] + np.eye(7)[5], 0.12))
    assert simulation.stop.reason is StopReason.TRACKING
    assert np.all(simulation.result().torque <= scene.robot().robot.effort + 1e-9)


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_a_push_is_withstood_and_a_hard_one_stops_the_run(scene, controller):
    def pushed(newtons):
        pulse = Pulse("sawyer/right_l6", (0.0, 0.0, -newtons), start=0.05, duration=0.1)
        simulation = Simulation(scene, controller=controller, imperfections=Imperfections(pulses=(pulse,)))
        simulation.hold(0.8)
        return simulation.result()

    soft, hard = pushed(10.0), pushed(1500.0)
    assert soft.stop is None and 1e-5 < soft.max_tracking_error_m < 0.01
    assert soft.tracking_error_m[-1] < 0.1 * soft.max_tracking_error_m, "it comes back"
    assert np.all(soft.tracking_error_m[:4] < 1e-5), "nothing moves before the push"
    assert hard.stop is not None and hard.stop.reason is StopReason.TRACKING


def test_noise_is_seeded(scene):
    def noisy(seed):
        noise = Imperfections(noise_q=1e-4, noise_qd=1e-3, seed=seed)
        simulation = Simulation(scene, controller="servo", imperfections=noise)
        simulation.hold(0.2)
        return simulation.result().q

    assert np.array_equal(noisy(1), noisy(1))
    assert not np.array_equal(noisy(1), noisy(2))


def test_link_factors_lie_in_their_bounds_and_move_the_believed_torques(scene):
    bodies = scene.robot().body_ids
    factors = Imperfections(link_error=0.1, seed=4).link_factors(bodies)
    assert set(factors) == set(bodies) and all(0.9 <= f <= 1.1 for f in factors.values())
    assert Imperfections(link_error=0.1, seed=4).link_factors(bodies) == factors
    assert Imperfections().link_factors(bodies) == {}
    qpos, still = np.array(scene.initial_qpos()), np.zeros(7)
    q = scene.robot().start
    true = ArmModel(scene.model, scene.robot()).inverse(qpos, np.zeros(scene.model.nv), q, still, still)
    wrong = ArmModel(scene.model, scene.robot(), Imperfections(link_error=0.1, seed=4))
    assert not np.allclose(wrong.inverse(qpos, np.zeros(scene.model.nv), q, still, still), true, atol=0.01)


def test_at_rest_on_its_reference_the_servo_applies_the_feed_forward_alone(scene):
    """Spring and damper are silent there, and the rest holds gravity: what the true model needs, in closed form."""
    qpos = np.array(scene.initial_qpos())
    servo, robot = PositionServo(scene.model, scene.robot(), qpos), scene.robot()
    still, qvel = np.zeros(7), np.zeros(scene.model.nv)
    torque, saturated = servo.torque(qpos, qvel, robot.start, still, still)
    assert not saturated
    assert np.allclose(torque, servo.arm.inverse(qpos, qvel, robot.start, still, still), atol=1e-12)
    ahead = robot.start + 1e-4 * np.eye(7)[2]
    more, _ = servo.torque(qpos, qvel, ahead, still, still)
    gravity = servo.arm.inverse(qpos, qvel, ahead, still, still)
    assert more[2] - gravity[2] == pytest.approx(1e-4 * servo.stiffness[2])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Imperfections(payload_error=-1.0), "payload error"),
        (lambda: Imperfections(link_error=1.0), "link error"),
        (lambda: Imperfections(noise_q=-1.0), "standard deviation"),
        (lambda: Pulse("a", (1.0, np.nan, 0.0), 0.0, 1.0), "force of a pulse"),
        (lambda: Pulse("a", (1.0, 0.0, 0.0), 0.0, 0.0), "above zero"),
    ],
)
def test_imperfections_that_make_no_sense(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_unknown_names(scene):
    with pytest.raises(UnknownNameError, match=r"controller named 'serv'.*did you mean servo"):
        Simulation(scene, controller="serv")
    with pytest.raises(UnknownNameError, match="body named 'sawyer/right_l9'"):
        Simulation(scene, imperfections=Imperfections(pulses=(Pulse("sawyer/right_l9", (1, 0, 0), 0, 1),)))
    with pytest.raises(UnknownNameError, match="actuator named 'chuck'"):
        Simulation(scene, settings=Settings()).actuate("chuck", 1.0)


LIGHT = """
<mujoco model="light">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="upper">
      <joint name="shoulder" axis="0 1 0" range="-2 2"/>
      <geom type="capsule" fromto="0.05 0 0 0.3 0 0" size="0.03" mass="1"/>
      <body name="fore" pos="0.35 0 0">
        <joint name="elbow" axis="0 1 0" range="-2 2"/>
        <geom type="capsule" fromto="0.05 0 0 0.3 0 0" size="0.03" mass="1"/>
        <body name="hand" pos="0.35 0 0">
          <joint name="wrist" axis="0 1 0" range="-2 2"/>
          <geom type="sphere" pos="0.05 0 0" size="0.03" mass="0.3"/>
          <site name="tool" pos="0.1 0 0"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor joint="shoulder" forcerange="-60 60"/><motor joint="elbow" forcerange="-60 60"/>
    <motor joint="wrist" forcerange="-20 20"/>
  </actuator>
</mujoco>
"""


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_light_links_without_armature_are_not_shaken(tmp_path, controller):
    (tmp_path / "light.xml").write_text(LIGHT)
    scene = robot_scene(tmp_path / "light.xml")
    simulation = Simulation(scene, controller=controller)
    start = scene.robot().start
    assert simulation.execute(quintic(scene.robot().name, start, start + 0.5, 1.0))
    result = simulation.result()
    assert result.saturated_steps == 0 and result.max_tracking_error_m < 5e-4
