"""A team of arms: one kinematic tree, a closed chain that stays closed, proofs of both arms against each other."""

import mujoco
import numpy as np
import pytest

from workcell.errors import InputError
from workcell.model.joined import columns, joined_robot
from workcell.model.scene import Scene
from workcell.motion.path import Path
from workcell.motion.teams.carrying import carry
from workcell.motion.teams.team import Team, prove_team, prove_team_motion
from workcell.motion.teams.torques import TeamDynamics
from workcell.motion.timing.retime import retime
from workcell.motion.timing.torques import ChainDynamics
from workcell.motion.tool_paths.follow import FollowLimits
from workcell.pose import Pose


@pytest.fixture(scope="module")
def scene():
    return Scene.load("dual_arm_carry")


@pytest.fixture(scope="module")
def team(scene):
    """The crate as if it hung between the hands where they start."""
    begin = scene.object_pose("crate")
    grasps = {
        name: begin.inverse() @ scene.robot(name).robot.fk(scene.robot(name).start) for name in scene.robots
    }
    return Team.of(scene, "crate", grasps).touching(["bench_top"])


def start(scene):
    return np.concatenate([robot.start for robot in scene.robots.values()])


def test_the_joined_robot_has_the_kinematics_of_its_parts(scene):
    robots = list(scene.robots.values())
    joined, parts = joined_robot(robots), columns(robots)
    rng = np.random.default_rng(2)
    for q in joined.random_configuration(rng, 5):
        for robot, part in zip(robots, parts, strict=True):
            for tool in robot.robot.tools:
                whole = joined.fk_transform(q, f"{robot.name}/{tool}")
                assert np.allclose(whole, robot.robot.fk_transform(q[part], tool), atol=1e-12)
    assert joined.dof == 14 and not joined.is_serial
    with pytest.raises(InputError, match="no robot to join"):
        joined_robot([])


def test_a_chain_that_is_closed_is_not_stretched_and_a_broken_one_is(scene, team):
    q = start(scene)
    assert team.stretch(q[None])[0] < 1e-12
    # the left arm turns about its upright base axis, and would take the crate's other handle along
    left, right = (scene.robot(name).robot for name in ("left", "right"))
    arm = right.fk(q[7:]).position - left.T_world_base.position
    expected = 2 * np.sin(0.005) * np.linalg.norm(arm[:2])
    assert team.stretch((q + 0.01 * np.eye(14)[0])[None])[0] == pytest.approx(expected, rel=1e-6)


def test_no_pair_loses_more_distance_than_the_bound_says(scene, team):
    rng = np.random.default_rng(5)
    q = start(scene)
    half = np.full(14, 0.02)
    before, bound = team.clearance(q).distance, team.motion_bound(q, half)
    for _ in range(30):
        assert team.clearance(q + rng.uniform(-half, half)).distance >= before - bound


def test_arms_that_approach_each_other_are_not_proved(scene, team):
    inwards = start(scene)
    inwards[0], inwards[7] = inwards[0] - 1.3, inwards[7] + 1.3
    proof = prove_team(team, Path(team.robot, np.stack([start(scene), inwards])))
    assert not proof.proved and proof.smallest.distance < 0
    assert np.isfinite(proof.failed_at) and proof.reason.startswith("collision between ")


def test_a_short_common_motion_is_proved_timed_and_split(scene, team):
    together = start(scene)
    together[[1, 8]] -= 0.05
    path = Path(team.robot, np.stack([start(scene), together]))
    assert prove_team(team, path, floor=0.002).proved
    trajectory = retime(path, tool_speed=0.25)
    proof = prove_team_motion(team, trajectory, floor=0.001)
    assert proof.proved and proof.margin >= 0.001
    left, right = team.split(trajectory)
    assert (left.robot_name, right.robot_name) == ("left", "right")
    assert np.array_equal(np.hstack([left.q, right.q]), trajectory.q)
    assert np.array_equal(left.time, right.time)


def test_the_margin_leaves_room_for_the_error_of_distances(scene, team):
    path = Path(team.robot, np.stack([start(scene)] * 2))
    margin = prove_team(team, path).margin
    assert 0 < margin == pytest.approx(team.clearance(start(scene)).distance - 1e-6, abs=1e-9)


@pytest.mark.parametrize("planner", ["auto", "ikspark"])
def test_where_one_arm_halves_a_step_the_object_stops_for_both(scene, team, planner):
    """Every step of each arm keeps the bound on its links, and the chain stays closed at every waypoint."""
    begin = scene.object_pose("crate")
    poses = [begin, Pose.from_xyz([0.0, 0.0, 0.04]) @ begin, Pose.from_xyz([0.0, 0.0, 0.06]) @ begin]
    starts = {name: robot.start for name, robot in scene.robots.items()}
    limits = FollowLimits(max_step=0.2, max_link_rotation=0.1)
    done = carry(team, poses, starts, limits=limits, solver=planner)
    assert done.path is not None, done.failure
    assert len(done.path) > len(poses) and done.path.largest_link_rotation <= 0.1
    # IKSPARK answers for both arms at once
    each = 1 if planner == "ikspark" else 2
    assert done.answered.count == each * (len(done.path) - 1)
    assert done.answered.by_planner(planner) == done.answered.count
    assert team.stretch(done.path.configurations).max() < 1e-4


def test_one_arm_is_no_team(scene):
    with pytest.raises(InputError, match="two arms or more"):
        Team.of(scene, "crate", {"left": scene.object_pose("crate")})


def test_a_team_is_timed_within_the_torques_that_each_arm_has(scene, team):
    """Efforts just above what holding still takes: without them the motion would need more, with them no arm does."""
    q = start(scene)
    path = Path(team.robot, np.stack([q, q + 0.15, q + np.linspace(0.3, 0.0, 14)]))
    dynamics = TeamDynamics.of(team)
    still = dynamics.at(path.at(np.linspace(0, 2, 9)), np.zeros((9, 14)), np.zeros((9, 14)))
    effort = 1.15 * np.abs(still).max(axis=0) + 4.0
    free, kept = retime(path), retime(path, dynamics=dynamics, effort=effort)

    def share(motion):
        return (np.abs(dynamics.at(motion.q, motion.qd, motion.qdd)) / effort).max()

    assert share(free) > 1.2 and 0.9 < share(kept) <= 1.0 + 1e-6 and kept.duration > free.duration


def test_the_shares_of_a_team_are_all_of_its_load(scene, team):
    """Held still, arms' torques differ from those of empty hands by what the crate weighs, shared equally."""
    q = start(scene)
    zero = np.zeros((1, 14))
    shared = TeamDynamics.of(team).at(q[None], zero, zero)[0]
    mass = sum(scene.model.body_mass[b] for b in scene.object("crate").body_ids)
    for robot, part in zip(scene.robots.values(), columns(list(scene.robots.values())), strict=True):
        zeros = np.zeros((1, 7))
        empty = ChainDynamics(team.scene, robot.name).at(q[None, part], zeros, zeros)[0]
        # the crate's centre in the tool's frame, and the half of its weight that pulls there
        held = team.grasps[robot.name].inverse()
        centre = held.apply(crate_centre(scene))
        arm = robot.robot.fk(q[part]).apply(centre) - robot.robot.fk(q[part]).position
        jacobian = robot.robot.jacobian(q[part])
        pull = np.array([0.0, 0.0, -0.5 * mass * 9.81])
        torque = jacobian[:3].T @ pull + jacobian[3:].T @ np.cross(arm, pull)
        assert np.allclose(shared[part] - empty, -torque, atol=1e-6)


def crate_centre(scene):
    """Centre of mass in the crate's frame."""
    bodies = sorted(scene.object("crate").body_ids)
    data = mujoco.MjData(scene.model)
    data.qpos[:] = scene.initial_qpos()
    mujoco.mj_kinematics(scene.model, data)
    mujoco.mj_comPos(scene.model, data)
    masses = scene.model.body_mass[bodies]
    return scene.object_pose("crate").inverse().apply(masses @ data.xipos[bodies] / masses.sum())
