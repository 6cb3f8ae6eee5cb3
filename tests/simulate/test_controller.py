"""The payload as part of the hand: combined inertia against MuJoCo's own, and discrete references."""

import numpy as np
import pytest

from workcell.errors import InputError
from workcell.motion.path import Trajectory
from workcell.simulate.arm_model import combined_inertia
from workcell.simulate.controller import ComputedTorque, Gains, discrete_reference


def test_two_point_masses_on_a_rod():
    mass, centre, inertia = combined_inertia(
        np.array([1.0, 3.0]), np.array([[0, 0, 0], [0.4, 0, 0]]), np.zeros((2, 3, 3))
    )
    assert mass == 4.0 and np.allclose(centre, [0.3, 0, 0])
    reduced = 1.0 * 3.0 / 4.0 * 0.4**2
    assert np.allclose(inertia, np.diag([0, reduced, reduced]))


def test_carrying_a_body_equals_a_model_with_the_body_fixed_to_the_hand(scene):
    """The brick, welded in the model instead of carried, needs the same torques."""
    import mujoco

    robot = scene.robot()
    rng = np.random.default_rng(3)
    data = mujoco.MjData(scene.model)
    data.qpos[:] = scene.initial_qpos()
    mujoco.mj_forward(scene.model, data)
    hand = scene.model.body("sawyer/gripper/gripper").id
    brick = scene.object("brick")
    address = brick.qpos_address
    data.qpos[address : address + 3] = data.xpos[hand] + [0.05, 0.02, 0.1]
    data.qpos[address + 3 : address + 7] = [0.5, 0.5, -0.5, 0.5]
    mujoco.mj_forward(scene.model, data)
    control = ComputedTorque(scene.model, robot)
    empty = ComputedTorque(scene.model, robot)
    control.arm.carry(hand, brick.body_ids, data)

    for _ in range(5):
        q, qd, qdd = robot.robot.home + 0.3 * rng.normal(size=7), rng.normal(size=7), rng.normal(size=7)
        qpos, qvel = np.array(scene.initial_qpos()), np.zeros(scene.model.nv)
        qpos[robot.qpos_addresses], qvel[robot.dof_addresses] = q, qd
        loaded, _ = control.torque(qpos, qvel, q, qd, qdd)
        bare, _ = empty.torque(qpos, qvel, q, qd, qdd)
        assert np.allclose(loaded - bare, _payload_torque(scene, hand, data, q, qd, qdd), atol=1e-6)
    control.arm.drop(hand)
    assert np.allclose(control.torque(qpos, qvel, q, qd, qdd)[0], bare, atol=1e-12)


def _payload_torque(scene, hand, grasped, q, qd, qdd):
    """Newton and Euler for the brick alone, by finite differences of its motion, mapped by the Jacobian."""
    robot = scene.robot()
    body = scene.object("brick").body_id
    chain = robot.robot
    link = chain.tool().link
    T0 = chain.link_transforms(grasped.qpos[robot.qpos_addresses])[link]
    local = np.linalg.inv(T0) @ np.append(grasped.xipos[body], 1.0)
    frame = T0[:3, :3].T @ grasped.ximat[body].reshape(3, 3)
    h = 1e-5

    def state(t):
        T = chain.link_transforms(q + t * qd + 0.5 * t * t * qdd)[link]
        return (T @ local)[:3], T[:3, :3] @ frame

    before, now, after = state(-h), state(0.0), state(h)
    acceleration = (before[0] - 2 * now[0] + after[0]) / h**2
    inertia = now[1] @ np.diag(scene.model.body_inertia[body]) @ now[1].T
    J = chain.point_jacobian(chain.link_transforms(q), link, now[0])
    omega = J[3:] @ qd

    def spin(t):
        qt, qdt = q + t * qd + 0.5 * t * t * qdd, qd + t * qdd
        T = chain.link_transforms(qt)
        return chain.point_jacobian(T, link, (T[link] @ local)[:3])[3:] @ qdt

    alpha = (spin(h) - spin(-h)) / (2 * h)
    mass = scene.model.body_mass[body]
    force = mass * (acceleration - scene.model.opt.gravity)
    moment = inertia @ alpha + np.cross(omega, inertia @ omega)
    return J[:3].T @ force + J[3:].T @ moment


def test_discrete_references_reproduce_the_positions():
    t = np.linspace(0, 1, 501)
    q = np.stack([np.sin(t) ** 2, t**3], axis=1)
    trajectory = Trajectory("x", t, q, np.zeros_like(q), np.zeros_like(q))
    _, qd, qdd = discrete_reference(trajectory)
    position, velocity = q[1].copy(), qd[1].copy()
    for k in range(1, 500):
        velocity = velocity + trajectory.dt * qdd[k]
        position = position + trajectory.dt * velocity
        assert np.allclose(position, q[k + 1], atol=1e-12)


def test_gains_must_be_positive():
    with pytest.raises(InputError, match="gains"):
        Gains(kp=-1.0)
