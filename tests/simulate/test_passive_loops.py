"""An arm whose rods are closed by the model is driven with what they weigh, and its torques are known before."""

import mujoco
import numpy as np
import pytest

from tests.model.loops.linkages import four_bar, parallel_arm
from workcell.model.scene import Scene
from workcell.motion.path import Path
from workcell.motion.proofs.on_model import prove_path
from workcell.motion.timing.retime import retime
from workcell.motion.timing.torques import ChainDynamics
from workcell.simulate.arm_model import ArmModel
from workcell.simulate.simulation import Simulation
from workcell.world.planning_world import PlanningWorld


def heavy(text):
    return text.replace('mass=".2"', 'mass="1.5"')


def by_multipliers(scene, q, qd, qdd):
    """Torques of a motion by the constrained equations of motion, with derivatives of positions by differences."""
    model, robot, data = scene.model, scene.robot(), mujoco.MjData(scene.model)
    step, passes = 1e-4, []
    for k in (-1, 0, 1):
        qpos = np.array(scene.initial_qpos())
        assert robot.place(qpos, q + k * step * qd + 0.5 * (k * step) ** 2 * qdd) == ""
        passes.append(qpos)
    data.qpos[:], data.qvel[:] = passes[1], (passes[2] - passes[0]) / (2 * step)
    acceleration = (passes[2] - 2 * passes[1] + passes[0]) / step**2
    mujoco.mj_forward(model, data)
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    needed = M @ acceleration + data.qfrc_bias - data.qfrc_passive
    J = np.zeros((data.nefc, model.nv))
    J[:] = data.efc_J.reshape(-1, model.nv) if data.efc_J.size == J.size else 0
    J = J[data.efc_type[: data.nefc] == mujoco.mjtConstraint.mjCNSTR_EQUALITY]
    driven = robot.dof_addresses
    passive = np.setdiff1d(np.arange(model.nv), driven)
    force = np.linalg.lstsq(J[:, passive].T, needed[passive], rcond=1e-9)[0]
    return needed[driven] - J[:, driven].T @ force


@pytest.mark.parametrize("make", [parallel_arm, four_bar])
def test_torques_are_those_of_the_constrained_motion(tmp_path, make):
    rng = np.random.default_rng(2)
    text = heavy(make(rng)).replace("<worldbody>", '<option jacobian="dense"/><worldbody>', 1)
    (tmp_path / "cell.xml").write_text(text)
    scene = Scene.load(tmp_path / "cell.xml")
    robot = scene.robot()
    arm, dynamics = ArmModel(scene.model, robot), ChainDynamics(scene)
    assert "passive loops" in dynamics.lacking
    for _ in range(10):
        q = robot.start + rng.uniform(-0.2, 0.2, robot.robot.dof)
        qd, qdd = rng.uniform(-1, 1, (2, robot.robot.dof))
        expected = by_multipliers(scene, q, qd, qdd)
        scale = 1e-4 * (1 + np.abs(expected).max())
        qvel = np.zeros(scene.model.nv)
        assert arm.inverse(scene.initial_qpos(), qvel, q, qd, qdd) == pytest.approx(expected, abs=scale)
        assert dynamics.at(q[None], qd[None], qdd[None])[0] == pytest.approx(expected, abs=scale)


@pytest.mark.parametrize("controller", ["computed_torque", "servo"])
def test_a_proved_motion_is_executed(tmp_path, controller):
    (tmp_path / "cell.xml").write_text(heavy(parallel_arm(np.random.default_rng(2))))
    scene = Scene.load(tmp_path / "cell.xml")
    world = PlanningWorld.of(scene)
    path = Path(world.robot.robot, np.array([world.robot.start, [0.4, 0.6]]))
    assert prove_path(path, world.clearance, world.cover).proved
    motion = retime(path, velocity=1.0, acceleration=2.0)
    simulation = Simulation(scene, controller=controller)
    assert simulation.execute(motion), simulation.stop
    assert np.abs(simulation.q - [0.4, 0.6]).max() < (1e-3 if controller == "computed_torque" else 1e-2)
