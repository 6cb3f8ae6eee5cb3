"""Arms whose joints follow others: torques, tracking, and the constraint kept all along."""

import copy

import mujoco
import numpy as np
import pytest

from tests.coupled_arms import coupled_arm, planar, residuals
from workcell.errors import ModelError
from workcell.ik.solve import solve
from workcell.model.scene import robot_scene
from workcell.motion.path import Path
from workcell.motion.plans.in_scene import plan_in_world
from workcell.motion.timing.retime import retime
from workcell.motion.timing.torques import ChainDynamics
from workcell.simulate.simulation import Simulation
from workcell.world.planning_world import PlanningWorld

LIFT = """
<robot name="lift"><link name="l0"><collision><origin xyz="0 0 0.05"/><geometry><box size="0.1 0.1 0.1"/></geometry>
</collision>{mass}</link>{links}{joints}</robot>
"""
MASS = (
    '<inertial><mass value="1"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>'
)
JOINT = (
    '<joint name="{name}" type="{kind}"><parent link="l{k}"/><child link="l{next}"/><origin xyz="0 0 0.1"/>'
    '<axis xyz="{axis}"/><limit lower="{low}" upper="{high}" effort="200" velocity="1"/>{mimic}</joint>'
)


def lift():
    """A URDF: a turning base, a lift of two stages that move as one, a slide that reaches out."""
    rows = [
        ("pan", "revolute", "0 0 1", -3, 3, ""),
        ("stage", "prismatic", "0 0 1", 0, 0.3, ""),
        ("second", "prismatic", "0 0 1", 0, 0.3, '<mimic joint="stage"/>'),
        ("reach", "prismatic", "1 0 0", 0.1, 0.4, ""),
    ]
    joints = [
        JOINT.format(name=name, kind=kind, k=k, next=k + 1, axis=axis, low=low, high=high, mimic=mimic)
        for k, (name, kind, axis, low, high, mimic) in enumerate(rows)
    ]
    links = "".join(f'<link name="l{k}">{MASS}</link>' for k in range(1, 5))
    return LIFT.format(mass=MASS, links=links, joints="".join(joints))


def scene_of(folder, text, suffix="xml"):
    path = folder / f"arm.{suffix}"
    path.write_text(text)
    return robot_scene(path)


ARMS = [
    (planar(), "xml"),
    (planar(-1.5, 0.2, (-1.0, 1.0), (-2.0, 2.0)), "xml"),
    (coupled_arm(3, joints=7, followers=2, slides=False)[0], "xml"),
    (coupled_arm(6, joints=6, followers=1, bent=True)[0], "xml"),
    (lift(), "urdf"),
]


@pytest.mark.parametrize("case", range(len(ARMS)))
def test_torques_are_those_of_mujoco_s_inverse_dynamics(tmp_path, case):
    scene = scene_of(tmp_path, *ARMS[case])
    actor, dynamics = scene.robot(), ChainDynamics(scene)
    model = copy.copy(scene.model)
    bits = mujoco.mjtDisableBit
    model.opt.disableflags |= bits.mjDSBL_CONTACT | bits.mjDSBL_EQUALITY | bits.mjDSBL_LIMIT
    rng, data = np.random.default_rng(case), mujoco.MjData(model)
    for q in actor.robot.random_configuration(rng, 10):
        qd, qdd = rng.normal(size=(2, len(q)))
        values, speeds, pushes = actor.robot.joint_motion(q, qd, qdd)
        data.qpos[:] = scene.initial_qpos()
        data.qpos[actor.joint_qpos_addresses] = values
        data.qvel[actor.joint_dof_addresses], data.qacc[actor.joint_dof_addresses] = speeds, pushes
        mujoco.mj_inverse(model, data)
        # by virtual work, along each variable in turn
        for k in range(len(q)):
            step = 1e-6 * np.eye(len(q))[k]
            along = (actor.robot.joint_values(q + step) - actor.robot.joint_values(q - step)) / 2e-6
            wanted = along @ data.qfrc_inverse[actor.joint_dof_addresses]
            assert dynamics.at(q[None], qd[None], qdd[None])[0, k] == pytest.approx(
                wanted, abs=1e-6, rel=1e-6
            )


@pytest.mark.parametrize("case", range(len(ARMS)))
def test_from_the_pose_to_the_run(tmp_path, case):
    scene = scene_of(tmp_path, *ARMS[case])
    world, actor = PlanningWorld.of(scene), scene.robot()
    drawn = actor.robot.random_configuration(np.random.default_rng(case), 50)
    planted = next(q for q in drawn if world.clearance(q).distance > 0.01)
    answer = solve(world.problem(actor.robot.fk(planted)))
    assert answer.solved and np.abs(residuals(scene.model, world.collision.full_qpos(answer.q))).max() < 1e-9
    found = plan_in_world(world, actor.start, answer.q)
    assert found.path is not None and found.proof.proved
    velocity = np.minimum(actor.robot.velocity, 1.5)
    trajectory = retime(found.path, velocity, 3.0, dynamics=ChainDynamics(scene))
    simulation = Simulation(scene)
    assert simulation.execute(trajectory)
    run = simulation.result()
    assert run.max_tracking_error_m < 5e-4 and not run.contacts
    assert max(np.abs(residuals(scene.model, qpos)).max() for qpos in run.qpos) < 1e-4
    assert run.q.shape[1] == actor.robot.dof


def test_a_servo_drives_them_too(tmp_path):
    scene = scene_of(tmp_path, lift(), "urdf")
    actor = scene.robot()
    path = Path(actor.robot, np.stack([actor.start, [0.5, 0.15, 0.3]]))
    simulation = Simulation(scene, controller="servo")
    assert simulation.execute(retime(path, acceleration=2.0))
    assert simulation.result().max_tracking_error_m < 5e-4


def test_the_speed_of_who_follows_is_kept(tmp_path):
    text = planar(2.0).replace(
        "<worldbody>", '<custom><numeric name="j2:velocity" data="1"/></custom><worldbody>'
    )
    scene = scene_of(tmp_path, text)
    actor = scene.robot()
    trajectory = retime(Path(actor.robot, np.array([[0.0], [0.7]])), acceleration=5.0)
    speeds = actor.robot.joint_motion(trajectory.q, trajectory.qd, trajectory.qdd)[1]
    assert 0.95 < np.abs(speeds[:, 1]).max() <= 1.0 + 1e-9


def test_hardness_that_a_file_gives_stays_and_other_drives_of_who_follows_are_refused(tmp_path):
    assert scene_of(tmp_path, planar()).model.eq_solref[0].tolist() == [0.005, 1.0]
    given = planar().replace("<joint joint1", '<joint solref="0.05 1" joint1')
    assert scene_of(tmp_path, given).model.eq_solref[0].tolist() == [0.05, 1.0]
    servo = planar().replace("</actuator>", '<position name="m2" joint="j2" kp="10"/></actuator>')
    with pytest.raises(ModelError, match="'arm/m2' can't be driven"):
        Simulation(scene_of(tmp_path, servo))
