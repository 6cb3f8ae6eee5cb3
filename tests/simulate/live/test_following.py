"""Tools that follow goals in a simulation: tracked, placed, told, and refused where it makes no sense."""

import numpy as np
import pytest

from tests.simulate.live.stand_in import StandIn
from workcell.errors import InputError, UnknownNameError
from workcell.motion.live.goals import LiveGoal
from workcell.motion.live.step import Guard, GuardKind
from workcell.motion.live.stream import Stamped
from workcell.pose import Pose
from workcell.simulate.execution import StopReason
from workcell.simulate.simulation import Settings, Simulation


@pytest.fixture
def live(robot):
    return StandIn("sawyer", robot)


def moved(pose, *offset):
    return Pose(pose.position + offset, pose.quat_wxyz)


def around(simulation):
    """A goal that goes round a circle of 5 cm from where the tool begins."""
    begin = simulation.tool_pose()
    return lambda t: moved(begin, 0.05 * np.sin(2 * t), 0.05 * (1 - np.cos(2 * t)), 0.0)


def lines(simulation, word):
    return [event for event in simulation.result().events if word in event.text]


@pytest.fixture(scope="module")
def followed(scene, robot):
    simulation, live = Simulation(scene), StandIn("sawyer", robot)
    assert simulation.follow(live, around(simulation), 2.0, "round a circle")
    return simulation, live


def test_the_arm_does_what_the_frames_say(followed):
    simulation, _ = followed
    rows = simulation.result()
    assert rows.max_tracking_error_m < 1e-4 and rows.stop is None and not rows.contacts
    (frames,) = rows.live
    reference = rows.q_reference[:, :7]
    for k in (20, 50, 90):  # rows every 10 ms, frames every 20 ms
        assert np.abs(reference[2 * k] - frames.q[k]).max() < 1e-9
    assert np.abs(np.diff(frames.q, axis=0)).max() > 1e-3


def test_no_limit_of_the_frames_is_exceeded_between_them(followed):
    simulation, live = followed
    rows = simulation.result()
    velocity = np.diff(rows.q_reference, axis=0) / 0.01
    assert np.abs(velocity).max() <= live.limits.velocity.max() + 1e-9
    assert np.abs(np.diff(velocity, axis=0) / 0.01).max() <= live.limits.acceleration.max() + 1e-6


def test_every_frame_is_kept_with_its_goal_and_its_terms(followed):
    simulation, live = followed
    (frames,) = simulation.result().live
    assert len(frames) == len(live.stamps) + 1 > 100
    assert frames.status[0] == "" and set(frames.status[1:]) == {"MOVING", "NO_GOAL"}
    assert frames.counts()["MOVING"] == 100 and frames.jumps == 0
    assert frames.time[:3] == pytest.approx([0.0, 0.02, 0.04])
    assert np.isnan(frames.goal[0]).all() and np.isnan(frames.goal[-1]).all()
    begin = frames.goal[1, 0]
    assert np.linalg.norm(frames.goal[50, 0, :3] - begin[:3]) > 0.01
    assert frames.terms[1] == pytest.approx(np.arange(7.0))
    assert np.nanmax(frames.position_error) < 0.06 and np.isnan(frames.position_error[-1]).all()
    assert frames.facts.names == ("sawyer",) and frames.facts.dofs == (7,)


def test_the_arm_rests_where_the_order_ended_and_can_go_on(scene, robot):
    simulation, live = Simulation(scene), StandIn("sawyer", robot)
    goal = around(simulation)
    assert simulation.follow(live, goal, 0.5) and simulation.hold(0.1)
    assert np.abs(simulation.q_reference - live.q).max() < 1e-9
    assert np.abs(live.qd).max() < 1e-6 and simulation.result().max_tracking_error_m < 1e-4
    assert simulation.follow(live, goal, 0.1)
    assert np.abs(live.resets[1] - live.resets[0]).max() > 1e-3 and len(simulation.result().live) == 2


def test_goals_may_be_bands_mappings_and_said_with_a_stamp(scene, live):
    simulation = Simulation(scene)
    begin = simulation.tool_pose()
    said = [begin, LiveGoal.position_only(begin), {"sawyer": begin}, None, Stamped(begin, 7.0)]
    assert simulation.follow(live, lambda t: said[round(t / 0.02)], 0.1)
    assert live.stamps[:5] == [None, None, None, None, 7.0]
    (frames,) = simulation.result().live
    known = np.isfinite(frames.goal[1:6, 0, 0])
    assert known.tolist() == [True, True, True, False, True]


def test_why_a_stream_has_no_goal_is_told(scene, live):
    simulation = Simulation(scene)
    assert simulation.follow(live, lambda t: Stamped(None, None, "the pose is not finite"), 0.1)
    assert any("NO_GOAL (the pose is not finite)" in event.text for event in lines(simulation, "NO_GOAL"))


def test_what_moves_is_placed_at_every_tick_with_its_velocity(scene, robot):
    simulation, live = Simulation(scene), StandIn("sawyer", robot, moving=("brick", "pillar"))
    first = simulation.object_pose("brick")
    simulation.drive("brick", lambda t: moved(first, 0.0, 0.1 * t, 0.2))
    assert simulation.follow(live, around(simulation), 0.4)
    pose, velocity, turning = live.placed["brick"][10]
    assert pose.position == pytest.approx(moved(first, 0.0, 0.02, 0.2).position)
    assert velocity == pytest.approx([0.0, 0.1, 0.0]) and turning == pytest.approx([0, 0, 0], abs=1e-9)
    still, velocity, _ = live.placed["pillar"][10]
    assert velocity is None and still.position == pytest.approx([0, 0, 0])


def test_statuses_and_guards_are_told_when_they_change_and_not_when_they_flicker(scene, robot):
    guard = Guard(GuardKind.OBSTACLE, "hand and pillar", 0.012)
    script = {k: {"guards": (guard,)} for k in (5, 7, 9)}
    script |= {k: {"status": "ON_GOAL"} for k in (12, 14, 16)}
    script |= {k: {"status": "HELD"} for k in range(20, 40)}
    simulation = Simulation(scene)
    assert simulation.follow(StandIn("sawyer", robot, script=script), around(simulation), 1.2)
    on, off = lines(simulation, "guard on"), lines(simulation, "guard off")
    assert len(on) == len(off) == 1 and "hand and pillar (0.012)" in on[0].text
    assert on[0].time == pytest.approx(0.1) and 0.6 < off[0].time < 0.8
    assert not lines(simulation, "ON_GOAL:")
    (held,) = lines(simulation, "HELD")
    assert held.level == "WARN" and held.time == pytest.approx(0.61, abs=0.011)


def test_a_jump_is_an_error(scene, robot):
    start = scene.robot().start
    simulation = Simulation(scene, settings=Settings(max_error_m=1.0, max_error_rad=3.0))
    live = StandIn("sawyer", robot, script={3: {"q": start + np.eye(7)[2] * 0.03}})
    simulation.follow(live, lambda t: None, 0.2)
    (said,) = lines(simulation, "jump")
    assert said.level == "ERROR" and "right_j2" in said.text
    assert simulation.result().live[0].jumps == 1


def test_an_unintended_contact_ends_the_order(scene, robot):
    simulation, live = Simulation(scene), StandIn("sawyer", robot)
    hand = simulation.tool_pose()
    simulation.drive("brick", lambda t: moved(Pose.from_xyz(hand.position), 0, 0, 0.4 * t - 0.4))
    assert not simulation.follow(live, lambda t: hand, 1.5)
    assert simulation.stop.reason is StopReason.CONTACT and "brick" in simulation.stop.detail
    assert not simulation.follow(live, lambda t: hand, 0.1)


def test_each_tick_can_end_the_order(scene, live):
    simulation, ticks = Simulation(scene), []
    assert simulation.follow(live, around(simulation), 5.0, each=lambda: ticks.append(1) or len(ticks) < 10)
    assert len(ticks) == 10 and simulation.time < 2.0


@pytest.mark.parametrize("period", [0.003, 0.0005])
def test_a_period_must_be_whole_steps(scene, robot, period):
    with pytest.raises(InputError, match="no whole number of the simulation's steps"):
        Simulation(scene).follow(StandIn("sawyer", robot, period=period), lambda t: None, 0.1)


def test_bad_orders(scene, robot, live):
    simulation = Simulation(scene)
    with pytest.raises(InputError, match="a duration of -1"):
        simulation.follow(live, lambda t: None, -1.0)
    with pytest.raises(UnknownNameError, match="no robot named 'ur10'"):
        simulation.follow(StandIn("ur10", robot), lambda t: None, 0.1)
    with pytest.raises(UnknownNameError, match="no body named 'ghost'"):
        simulation.follow(StandIn("sawyer", robot, moving=("ghost",)), lambda t: None, 0.1)
    with pytest.raises(UnknownNameError, match="no robot named 'left'"):
        simulation.follow(live, lambda t: {"left": simulation.tool_pose()}, 0.1)
