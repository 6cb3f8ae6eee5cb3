"""Paths to poses: proved, judged by another kernel, the same for a seed; bad starts are named with a way out."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from workcell.errors import InputError
from workcell.geometry.types import Piece, SphereCover
from workcell.ik.judge.verify import verify
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.result import Status
from workcell.motion.body import Upright, pack_body
from workcell.motion.plans import goals
from workcell.motion.plans.compiled import Effort, search
from workcell.motion.plans.to_pose import plan_to_pose
from workcell.motion.proofs.judge import BatchLinks, judge_path
from workcell.motion.timing.phase_plane import rest_to_rest
from workcell.pose import Pose

START = np.array([0.0, -0.6, 0.0, 0.9, 0.0, 0.5, 0.0])


@pytest.fixture(scope="module")
def cover7():
    link = np.repeat(np.arange(1, 8), 2)
    centre = np.tile([[0.03, 0, 0], [0.1, 0, 0]], (7, 1))
    return SphereCover(link, centre, np.full(14, 0.05))


@pytest.fixture(scope="module")
def walled(arm7, cover7):
    """A pillar stands between the start and the goal."""
    goal = START.copy()
    goal[0] = 2.2
    pillar = Piece(
        "pillar", "cylinder", Pose.from_xyz([0.45 * np.cos(1.1), 0.45 * np.sin(1.1), 0.0]), [0.08, 2.0]
    )
    return IKProblem(arm7, arm7.fk(goal), (pillar,), cover7)


def test_a_path_around_a_pillar(walled, arm7):
    plan = plan_to_pose(walled, START, budget=Budget(5.0), seed=1)
    assert plan.solved and plan.proved and plan.margin > 0
    assert len(plan.path) > 2 and plan.stats["iterations"] > 0
    verdict = judge_path(walled, START, plan.path)
    assert verdict.accepted and verdict.bound >= -1e-9 and verdict.clearance.distance >= plan.margin - 1e-9
    again = plan_to_pose(walled, START, budget=Budget(5.0), seed=1)
    assert np.array_equal(again.path, plan.path)


def test_the_judge_refuses_what_is_wrong(walled, arm7):
    path = plan_to_pose(walled, START, seed=1).path
    assert "begins" in judge_path(walled, START + 0.01, path).reason
    assert "its end" in judge_path(walled, START, path[:-1]).reason
    assert "shape" in judge_path(walled, START, path[:, :6]).reason
    assert "not a list" in judge_path(walled, START, [["a"]]).reason
    assert "finite" in judge_path(walled, START, np.full((2, 7), np.nan)).reason
    beyond = path.copy()
    beyond = np.insert(beyond, 1, beyond[0], axis=0)
    beyond[1, 6] = 9.0
    assert "outside" in judge_path(walled, START, beyond).reason
    straight = judge_path(walled, START, path[[0, -1]])
    assert not straight.accepted and "inside pillar" in straight.reason


def test_links_of_the_judge_are_those_of_the_robot(arm7):
    q = np.random.default_rng(0).uniform(-3, 3, (20, 7))
    R, p = BatchLinks(arm7)(q)
    T = arm7.link_transforms(q)
    assert np.allclose(R, T[..., :3, :3], atol=1e-12) and np.allclose(p, T[..., :3, 3], atol=1e-12)


def test_a_goal_out_of_reach_has_a_status(walled):

    far = replace(walled, target=Pose.from_xyz([9.0, 0, 0]))
    plan = plan_to_pose(far, START, budget=Budget(0.5))
    assert plan.status is Status.UNREACHABLE and plan.path is None and plan.ik is not None


def test_bad_starts(walled, arm7):
    inside = START.copy()
    inside[0] = 1.1
    with pytest.raises(
        InputError, match=r"start.*pillar overlap by \d+\.\d+ mm.*free configuration"
    ) as caught:
        plan_to_pose(walled, inside)
    listed = str(caught.value).split("[")[1].split("]")[0]
    free = np.array([float(value) for value in listed.split(",")])
    assert plan_to_pose(walled, free).solved
    with pytest.raises(InputError, match="takes 7 joint values"):
        plan_to_pose(walled, START[:6])
    with pytest.raises(InputError, match="finite"):
        plan_to_pose(walled, np.full(7, np.nan))
    with pytest.raises(InputError, match="outside its joint limits"):
        plan_to_pose(walled, START + 7)
    with pytest.raises(InputError, match="tilted"):
        plan_to_pose(walled, START, upright=Upright(0.1, tool_axis=(0, 1, 0)))


def test_any_of_many_goals_and_the_shortest_of_the_straight_ones(planar, planar_cover):
    body = pack_body(planar, planar_cover, ())
    goals = np.array([[1.0, 0, 0], [0.2, 0.1, 0], [-2.0, 1.0, 1.0]])
    found = search(body, np.zeros(3), goals)
    assert found.goal == 1 and np.array_equal(found.path, [np.zeros(3), goals[1]])


def test_walled_in_goals_are_not_reached_and_the_others_are(planar, planar_cover):
    """Two balls pin the first joint on one side; a goal beyond them is out of reach, another is not."""
    ball = Piece("ball", "sphere", Pose.from_xyz([0.3, 0.0, 0.0]), [0.1])
    body = pack_body(planar, planar_cover, (ball,))
    start, beyond = np.array([1.2, 0.3, 0.0]), np.array([-1.2, 0.0, 0.0])
    assert search(body, start, [beyond], Effort(iterations=2000)).path is None
    near = np.array([2.0, -0.5, 0.4])
    assert search(body, start, [beyond, near], Effort(iterations=2000)).goal == 1


def test_the_tool_stays_upright_on_the_way(arm7, cover7):
    upright = Upright(0.5, tool_axis=(1, 0, 0), direction=(0, 0, 1))
    rng = np.random.default_rng(2)
    q = rng.uniform(-3, 3, (20000, 7))
    axis = arm7.fk_transform(q)[:, :3, 0]
    good = q[axis[:, 2] > np.cos(0.4)][:6]
    body = pack_body(arm7, cover7, (), upright=upright)
    found = search(body, good[0], good[1:], Effort(step=0.5, iterations=20000), seed=0)
    assert found.path is not None
    dense = np.concatenate(
        [a + np.linspace(0, 1, 200)[:, None] * (b - a) for a, b in itertools.pairwise(found.path)]
    )
    tilt = np.arccos(np.clip(arm7.fk_transform(dense)[:, 2, 0], -1, 1))
    assert tilt.max() <= 0.5 + 1e-9


def test_rest_to_rest_is_the_trapezoid():
    v, a = np.array([1.0, 2.0]), np.array([4.0, 4.0])
    corners = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 0.1]])
    assert rest_to_rest(corners, v, a) == pytest.approx((2 / 1 + 1 / 4) + 2 * np.sqrt(0.1 / 4))
    assert rest_to_rest(corners[:1], v, a) == 0.0


def test_a_search_that_makes_no_sense(planar, planar_cover):
    body = pack_body(planar, planar_cover, ())
    with pytest.raises(InputError, match="steps of 0"):
        Effort(step=0.0)
    with pytest.raises(InputError, match="negative"):
        Effort(iterations=-1)
    with pytest.raises(InputError, match="shape"):
        search(body, np.zeros(2), [np.zeros(3)])
    with pytest.raises(InputError, match="not finite"):
        search(body, np.zeros(3), [np.full(3, np.nan)])


def test_no_path_is_solved_whose_end_the_judge_refuses(walled, monkeypatch):
    """Goals that are clear but miss the target, as a faulty solver might hand them over, end no path."""
    honest, asked = goals.collect, []

    def faulty(problem, count, seed, budget):
        asked.append(seed)
        off = 0.01 if len(asked) <= goals.GOALS else 0.0
        found = honest(problem, count, seed, budget)
        return replace(found, configurations=tuple(q + off for q in found.configurations))

    monkeypatch.setattr(goals, "collect", faulty)
    plan = plan_to_pose(walled, START, budget=Budget(5.0), seed=1)
    assert plan.stats["rounds"] > 1
    assert plan.solved and verify(walled, plan.path[-1]).accepted


@pytest.mark.parametrize("effort", [Effort(), Effort(optimise_s=0.2, optimise_iterations=500)])
def test_the_judge_is_asked_about_the_very_end_of_the_path_that_is_returned(walled, monkeypatch, effort):
    judged, reaches = [], goals.Goals.reaches

    def noted(self, q):
        judged.append(np.array(q))
        return reaches(self, q)

    monkeypatch.setattr(goals.Goals, "reaches", noted)
    plan = plan_to_pose(walled, START, budget=Budget(5.0), seed=1, effort=effort)
    assert plan.solved and np.array_equal(judged[-1], plan.path[-1])
