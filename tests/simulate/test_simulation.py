"""Execution in MuJoCo: tracking, grasping, guards; every stop names its reason."""

from dataclasses import replace

import numpy as np
import pytest

from tests.motion.local_solver import solve_locally
from workcell.errors import InputError, ModelError, UnknownNameError, WorkcellError
from workcell.ik.problem import IKProblem
from workcell.model.scene import robot_scene
from workcell.motion.path import Path, Trajectory, stationary
from workcell.motion.timing.retime import retime
from workcell.motion.tool_paths.follow import follow, line
from workcell.pose import Pose
from workcell.simulate.execution import StopReason
from workcell.simulate.simulation import Settings, Simulation


def quintic(name, start, end, duration, dt=0.002):
    """The fifth-order polynomial that starts and ends at rest with zero acceleration."""
    t = np.arange(round(duration / dt) + 1) * dt
    u = t / duration
    s, sd, sdd = 10 * u**3 - 15 * u**4 + 6 * u**5, 30 * u**2 * (1 - u) ** 2, 60 * u * (1 - u) * (1 - 2 * u)
    delta = np.asarray(end) - start
    q = start + np.outer(s, delta)
    return Trajectory(name, t, q, np.outer(sd, delta) / duration, np.outer(sdd, delta) / duration**2)


@pytest.fixture(scope="module")
def above(scene, robot):
    problem = IKProblem(robot, scene.goal("above").pose, q_reference=scene.robot().start)
    return solve_locally(problem).unwrap()


@pytest.fixture(scope="module")
def picking(scene, robot, above):
    """Down to the brick, grasp, lift; shared by the tests that look at different sides of it."""
    chunks = []
    sim = Simulation(replace_start(scene, above), on_chunk=chunks.append)
    down = follow(
        IKProblem(robot, scene.goal("above").pose),
        line(scene.goal("above").pose, scene.goal("grasp").pose),
        above,
        solver=solve_locally,
    ).path
    assert sim.execute(retime(down, tool_speed=0.25), "down")
    assert sim.grasp("brick")
    supports, held = sim.supports, sim.T_tool_object
    assert sim.execute(retime(down.reversed(), tool_speed=0.25), "up") and sim.hold(0.5)
    return sim, chunks, supports, held


def replace_start(scene, q):
    """The same scene with the robot beginning elsewhere."""
    robots = {name: replace(robot, start=np.array(q)) for name, robot in scene.robots.items()}
    return replace(scene, robots=robots)


def test_a_quintic_is_tracked_within_a_tenth_of_a_millimetre(scene):
    start = scene.robot().start
    sim = Simulation(scene)
    assert sim.execute(quintic("sawyer", start, start + np.array([0.4, -0.3, 0.3, -0.3, 0.4, 0.3, 0.5]), 2.0))
    result = sim.result()
    assert result.max_tracking_error_m < 1e-4 and result.max_tracking_error_rad < 1e-3
    assert result.stop is None and not result.contacts and result.saturated_steps == 0
    assert np.allclose(np.diff(result.time), 0.01)
    assert np.abs(result.q - result.q_reference).max() < 1e-3


def test_logged_tool_positions_are_the_kinematics(scene, robot):
    sim = Simulation(scene)
    sim.hold(0.05)
    result = sim.result()
    assert np.allclose(result.tool_position, robot.fk_transform(result.q)[:, :3, 3], atol=1e-9)


def test_picking_up_keeps_tracking_with_the_payload(picking):
    sim, _, _, _ = picking
    result = sim.result()
    assert sim.stop is None
    assert result.max_tracking_error_m < 1e-3
    assert result.min_clearance >= 0 and not result.contacts
    assert sim.object_pose("brick").position[2] > 0.1


def test_the_weld_holds_the_brick_still_in_the_hand(picking):
    sim, _, _, held = picking
    now = sim.tool_pose().inverse() @ sim.object_pose("brick")
    distance, angle = now.error_to(held)
    assert distance < 2e-5 and angle < 2e-4


def test_what_the_brick_stood_on_is_known_and_left(picking):
    sim, _, supports, _ = picking
    assert [sim.scene.model.geom(g).name for g in supports] == ["plinth"]
    assert sim.supports == frozenset()
    assert any("clear of what it stood on" in event.text for event in sim.result().events)


def test_chunks_add_up_to_the_result(picking):
    sim, chunks, _, _ = picking
    result = sim.result()
    assert sum(len(chunk) for chunk in chunks) == len(result)
    assert np.array_equal(np.concatenate([chunk.qpos for chunk in chunks]), result.qpos)
    assert [e for chunk in chunks for e in chunk.events] == list(result.events)


def test_the_payload_is_in_the_torque(scene, picking):
    """At rest the shoulder holds the brick: 0.3 kg times its lever about the joint, in closed form."""
    sim, _, _, _ = picking
    from workcell.motion.timing.torques import ChainDynamics

    q = sim.q_reference
    still = stationary("sawyer", q, 0.004)
    empty = ChainDynamics(scene).at(still.q, still.qd, still.qdd)[0]
    loaded = ChainDynamics(scene, attached=("brick", sim.T_tool_object)).at(still.q, still.qd, still.qdd)[0]
    centre = (sim.object_pose("brick")).apply([0, 0, 0.04])
    T = sim.robot.robot.link_transforms(q)
    axis, origin = T[2, :3, :3] @ sim.robot.robot.axis[1], T[2, :3, 3]
    lever = np.cross(axis, centre - origin) @ [0, 0, 0.3 * 9.81]
    assert loaded[1] - empty[1] == pytest.approx(lever, abs=2e-3)
    assert np.allclose(sim.result().torque[-1], np.abs(loaded), atol=0.05)


def test_orders_that_make_no_sense(scene):
    sim, still = Simulation(scene), stationary("sawyer", scene.robot().start, 0.004)
    for order, message in (
        (lambda: sim.execute([]), "no robot"),
        (lambda: sim.execute([still, still]), "one for each robot"),
        (lambda: sim.move_gripper(1.7), "share of 1.7"),
        (lambda: sim.move_gripper(float("nan")), "share of nan"),
        (lambda: sim.release(opening=-0.1), "share of -0.1"),
        (lambda: sim.hold(float("nan")), "duration of nan"),
        (lambda: sim.hold(-1.0), "duration of -1.0"),
        (lambda: sim.grasp("brick", hold="glue"), "no hold named 'glue'"),
    ):
        with pytest.raises(WorkcellError, match=message):
            order()
    assert sim.time == 0.0


def test_an_empty_hand_can_not_release(scene):
    sim = Simulation(scene)
    with pytest.raises(InputError, match="holds nothing"):
        sim.release()


def test_putting_the_brick_back(scene, robot, above):
    """Grasp, lift a little, lower, release, draw back: the brick stands where it stood."""
    sim = Simulation(replace_start(scene, above))
    before = sim.object_pose("brick")
    problem = IKProblem(robot, scene.goal("above").pose)
    grasp = scene.goal("grasp").pose
    down = follow(problem, line(scene.goal("above").pose, grasp), above, solver=solve_locally).path
    raised = Pose.from_xyz([0, 0, 0.03]) @ grasp
    lift = follow(problem, line(grasp, raised), down.end, solver=solve_locally).path
    assert sim.execute(retime(down, tool_speed=0.25))
    # said before the brick is lifted, and still true afterwards
    sim.expect_contact("brick", "plinth")
    assert sim.grasp("brick")
    with pytest.raises(InputError, match="holds the brick"):
        sim.attach("brick")
    assert sim.execute(retime(lift)) and sim.object_pose("brick").position[2] > 0.025
    assert sim.execute(retime(lift.reversed())) and sim.release() and sim.hold(0.2)
    assert sim.execute(retime(down.reversed(), tool_speed=0.25)) and sim.hold(0.2)
    distance, angle = sim.object_pose("brick").error_to(before)
    assert distance < 1e-3 and angle < 0.01 and sim.T_tool_object is None
    assert not sim.result().contacts
    # the hand has left the brick: touching it again, with closed fingers from above, is unintended
    assert sim.move_gripper(0.0) and not sim.execute(retime(down, tool_speed=0.25))
    assert sim.stop.reason is StopReason.CONTACT and "brick" in sim.stop.detail


def test_putting_it_back_is_unintended_unless_said(scene, robot, above, picking):
    with pytest.raises(UnknownNameError, match="no body named 'plint'"):
        Simulation(scene).expect_contact("brick", "plint")
    sim = Simulation(replace_start(scene, above))
    grasp = scene.goal("grasp").pose
    problem = IKProblem(robot, grasp)
    down = follow(problem, line(scene.goal("above").pose, grasp), above, solver=solve_locally).path
    lift = follow(
        problem, line(grasp, Pose.from_xyz([0, 0, 0.03]) @ grasp), down.end, solver=solve_locally
    ).path
    assert sim.execute(retime(down)) and sim.grasp("brick") and sim.execute(retime(lift))
    assert not sim.execute(retime(lift.reversed()))
    assert sim.stop.reason is StopReason.CONTACT and "plinth" in sim.stop.detail


def test_an_empty_grasp_stops_the_run(scene):
    sim = Simulation(scene, settings=Settings(close_s=0.1, settle_s=0.1))
    assert not sim.grasp("brick")
    assert sim.stop.reason is StopReason.NO_GRASP and "0 of 2 fingers" in sim.stop.detail
    assert sim.T_tool_object is None
    assert not sim.hold(0.1), "a stopped simulation does nothing"


def towards_the_pillar(scene):
    """A trajectory that swings the arm into the pillar."""
    start = scene.robot().start
    path = Path(scene.robot().robot, np.stack([start, start - 1.2 * np.eye(7)[0]]))
    return retime(path, tool_speed=0.4)


def test_an_unintended_contact_stops_the_run_and_is_named(scene):
    sim = Simulation(scene)
    assert not sim.execute(towards_the_pillar(scene))
    result = sim.result()
    assert result.stop.reason is StopReason.CONTACT
    assert "pillar" in result.contacts[0].pair and result.contacts[0].depth > 0
    assert result.contacts[0].time == pytest.approx(result.stop.time, abs=0.0025)
    assert any("pillar" in pair for pair in result.clearance_pair[-3:])
    assert result.clearance[-1] < 0.01


def test_contacts_can_be_logged_without_stopping(scene):
    settings = Settings(stop_on_contact=False, max_error_m=1.0, max_error_rad=3.0)
    sim = Simulation(scene, settings=settings)
    sim.execute(towards_the_pillar(scene))
    result = sim.result()
    assert result.stop is None and result.contacts and result.min_clearance < 0


def test_a_motion_beyond_the_effort_limits_stops_by_tracking(scene):
    start = scene.robot().start
    sim = Simulation(scene)
    assert not sim.execute(quintic("sawyer", start, start + np.array([0, 0, 0, 0, 0.8, 0.8, 0]), 0.12))
    result = sim.result()
    assert result.stop.reason is StopReason.TRACKING and "mm" in result.stop.detail
    assert result.saturated_steps > 0
    assert any(event.level == "WARN" and "effort" in event.text for event in result.events)


def test_instability_is_reported_without_a_log_file(scene, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    sim = Simulation(scene)
    sim.data.qvel[:] = 1e200
    assert not sim.hold(0.1)
    assert sim.stop.reason is StopReason.UNSTABLE
    assert not list(tmp_path.iterdir())
    assert np.all(np.isfinite(sim.result().qpos))


def test_two_runs_are_identical(scene):
    runs = []
    for _ in range(2):
        sim = Simulation(scene)
        start = scene.robot().start
        sim.execute(quintic("sawyer", start, start + 0.1, 0.3))
        runs.append(sim.result())
    assert np.array_equal(runs[0].qpos, runs[1].qpos)
    assert np.array_equal(runs[0].clearance, runs[1].clearance)


def test_the_scene_is_left_as_it_was(scene, picking):
    weld = scene.model.equality("grasp:sawyer:brick").id
    assert not np.array_equal(scene.model.eq_data[weld], picking[0].model.eq_data[weld])
    fresh = Simulation(scene)
    assert fresh.T_tool_object is None
    assert np.array_equal(fresh.qpos, scene.initial_qpos())


def test_a_scene_begins_with_the_gripper_open(scene):
    fingers = [value for _, value in scene.robot().fingers]
    assert fingers == [0.045, 0.045]
    assert [scene.initial_qpos()[address] for address, _ in scene.robot().fingers] == fingers


@pytest.mark.parametrize(
    ("trajectory", "message"),
    [
        (lambda q: stationary("sawyer", q, 0.1, 0.004), "retime with dt=0.002"),
        (lambda q: stationary("sawyer", q + 0.1, 0.1), "away from the robot"),
        (lambda q: stationary("sawyer", q[:3], 0.1), "moves 3 joints"),
    ],
)
def test_trajectories_that_do_not_fit(scene, trajectory, message):
    with pytest.raises(InputError, match=message):
        Simulation(scene).execute(trajectory(scene.robot().start))


def test_a_robot_without_a_gripper_can_not_grasp(tmp_path):
    sim = Simulation(robot_scene("sawyer"))
    with pytest.raises(ModelError, match="no gripper"):
        sim.move_gripper(0.0)
