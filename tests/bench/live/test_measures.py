"""The measures against closed forms, the contacts against MuJoCo, the starts against what they promise."""

import mujoco
import numpy as np
import pytest

from workcell.bench.live.arms import ARM, SETUPS, arms_of, conditioning, rest_rotation, threshold
from workcell.bench.live.cases import case_of
from workcell.bench.live.cells import Obstacle, cell
from workcell.bench.live.contacts import Contacts, OwnContacts
from workcell.bench.live.followers import PointIK, drive
from workcell.bench.live.measures import Paper, Run, differences, measure, summary
from workcell.bench.live.touching import Touching
from workcell.bench.live.traces import PERIOD, Trace
from workcell.pose import Pose

SAWYER = next(setup for setup in SETUPS if setup.robot == "sawyer")
FANUC = SETUPS[0]


def test_differences_are_those_of_a_cubic():
    t = np.arange(12.0)
    q = np.stack([t**3, -2.0 * t**3], axis=1)
    found = differences(q) / np.sqrt(5.0)
    later = t[4:]
    assert found[0, 3:] == pytest.approx(3 * later**2 - 3 * later + 1)
    assert found[1, 3:] == pytest.approx(6 * later - 6)
    assert found[2, 3:] == pytest.approx(6.0)
    # before its first configuration the arm stood there
    assert found[:, 0] == pytest.approx([1.0, 1.0, 1.0])


def test_errors_and_events_are_those_that_were_made():
    arms, frames = arms_of(SAWYER), 6
    robot = arms.robots[0]
    q = np.tile(robot.home, (frames + 1, 1))
    q[4:, 2] += 1.5 * robot.velocity[2] * PERIOD
    poses = [robot.fk(row) for row in q[1:]]
    quats = np.array([pose.quat_wxyz for pose in poses])
    positions = np.array([pose.position + np.array([0.0, 0.003, 0.004]) for pose in poses])
    trace = Trace("made", positions[None], quats[None])
    found = measure(arms, trace, Run(q, np.full(frames, 1e-3)))
    assert found.position == pytest.approx(0.005)
    assert found.rotation == pytest.approx(0.0, abs=1e-7)
    assert found.discontinuity.tolist() == [False, False, False, True, False, False]
    assert not found.collision.any()
    row = summary("made", [found, found], Paper(position=0.004, discontinuities=3))
    assert row["discontinuities"] == 2 and row["worse_than_paper"] == "position_error_m"
    assert row["frame_ms_mean"] == pytest.approx(1.0) and row["frames"] == 12


def test_a_stretched_arm_is_singular_and_a_folded_one_touches_itself():
    arms = arms_of(SAWYER)
    robot = arms.robots[0]
    straight = np.zeros(robot.dof)
    assert conditioning(robot, straight) < threshold(robot) < conditioning(robot, robot.home)
    J = robot.jacobian(robot.home)
    values = np.sqrt(np.linalg.eigvalsh(J @ J.T))
    assert conditioning(robot, robot.home) == pytest.approx(values[0] / values[-1])
    # every arm has a threshold of its own, though all of them are called alike in their scenes
    for setup in (FANUC, SAWYER):
        robot = arms_of(setup).robots[0]
        drawn = robot.random_configuration(np.random.default_rng(3), 4000)
        assert np.mean(conditioning(robot, drawn) < threshold(robot)) == pytest.approx(0.025, abs=0.01)


def test_contacts_are_mujoco_s():
    scene = cell(
        "sawyer",
        {ARM: (0.0, 0.0, 0.0)},
        [
            Obstacle("box", (0.1, 0.1, 0.3), (0.75, 0.1, 0.3)),
            Obstacle("ball", (0.08,), (0.4, 0.5, 0.6), moves=True),
        ],
    )
    contacts, judge, robot = Contacts(scene, (ARM,)), Touching(scene, (ARM,)), scene.robot(ARM)
    model, data = scene.model, mujoco.MjData(scene.model)
    rng, met = np.random.default_rng(1), 0
    for _ in range(60):
        q = robot.robot.random_configuration(rng)
        ball = Pose(rng.uniform(-0.6, 0.6, 3), np.array([1.0, 0.0, 0.0, 0.0]))
        contacts.place({"ball": ball})
        judge.place({"ball": ball})
        data.qpos[:] = scene.initial_qpos()
        robot.place(data.qpos, q)
        scene.object("ball").place(data.qpos, ball)
        mujoco.mj_forward(model, data)
        arm = robot.body_ids
        touching = any(
            one.dist < -1e-6 and {int(model.geom_bodyid[g]) for g in one.geom} & arm for one in data.contact
        )
        met += touching
        assert (contacts.distance(q) < 0.0) == touching == bool(judge.pairs(q))
        to_ball = contacts.distance_to("ball", q)
        assert to_ball >= contacts.distance(q) and (to_ball < 0.0) == any(
            "ball" in " ".join(pair) for pair in judge.pairs(q)
        )
    assert 5 < met < 55


def test_random_starts_are_near_the_path_clear_and_not_singular():
    for setup in (SAWYER, FANUC):
        case = case_of(setup, "circle")
        robot, goal = case.arms.robots[0], case.trace.goals(0)[0]
        starts = case.starts(3, 1)
        assert len(starts) == 3 and case.way.reached
        assert not np.array_equal(starts[0], case.starts(3, 2)[0])
        for q in starts:
            here = robot.fk(q)
            assert 0.0 < np.linalg.norm(here.position - goal.position) < 0.2
            assert conditioning(robot, q) > threshold(robot)
            assert OwnContacts(case.arms).distance(q) > 0.0
            if not setup.in_plane:
                np.testing.assert_allclose(here.rotation, rest_rotation(robot), atol=1e-5)


def test_point_ik_is_on_a_path_that_can_be_followed():
    case = case_of(SAWYER, "circle")
    run = drive(PointIK(case.arms), case.trace, case.starts(1, 0)[0])
    found = measure(case.arms, case.trace, run)
    assert found.position.max() < 1e-5 and found.rotation.max() < 1e-4
    assert not found.discontinuity[1:].any()
    assert run.unanswered == 0 and not found.collision.any()
