"""CIDGIK asked directly: the paper's toy in closed form, trees, planar arms, planes, containment, bad input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.ik.arms import planar
from workcell.bench.reference.cidgik_problems import bench_arm
from workcell.errors import InputError, UnknownNameError
from workcell.geometry.types import SphereCover
from workcell.ik.cidgik.query import Answer, check_query, solve_query
from workcell.ik.problem import Budget
from workcell.ik.result import Status
from workcell.ik.trees.judge import judge_query
from workcell.ik.trees.query import Balls, Goal, Plane, Points, Query, Workspace
from workcell.model.robot import Robot, Tool
from workcell.pose import Pose

BUDGET = Budget(5.0)


def assert_solved(query: Query, seed: int = 0) -> np.ndarray:
    answer = solve_query(query, BUDGET, seed)
    assert answer.status is Status.SOLVED, answer.rejected
    assert answer.q is not None and answer.verdict is not None
    assert answer.verdict.accepted and judge_query(query, answer.q).accepted
    assert answer.stats["rank_gap"] < 1e-5 and answer.stats["moved"] <= 1e-2
    return answer.q


def torso() -> Robot:
    """One joint that carries two arms of four joints."""
    n, parents = 9, [0, 1, 2, 3, 4, 1, 6, 7, 8]
    axes = np.array([[0, 0, 1]] + [[0, 1, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0]] * 2, dtype=float)
    left = [[0, 0.2, 0.2], [0, 0.05, 0], [0.1, 0.2, 0], [0, 0.25, 0]]
    xyz = np.array([[0, 0, 0.3], *left, *([x, -y, z] for x, y, z in left)])
    limit, free = np.full(n, 2.5), np.full(n, np.inf)
    return Robot(
        name="torso",
        joint_names=tuple(f"j{k}" for k in range(n)),
        link_names=tuple(f"l{k}" for k in range(n + 1)),
        parents=np.array(parents),
        joint_xyz=xyz,
        joint_rotation=np.tile(np.eye(3), (n, 1, 1)),
        axis=axes,
        prismatic=np.zeros(n, dtype=bool),
        lower=-limit,
        upper=limit,
        velocity=free,
        acceleration=free,
        effort=free,
        tools={
            "left": Tool("left", 5, Pose.from_xyz([0, 0.1, 0])),
            "right": Tool("right", 9, Pose.from_xyz([0, -0.1, 0])),
        },
        default_tool="left",
    )


TWO_LINKS = planar((1.0, 1.0), 3.2)
CORNER = Goal.at("tool", [1.0, 1.0, 0.0])


def test_the_papers_toy_goes_round_the_disc() -> None:
    """Unit links, goal (1, 1): the elbow is at (1, 0) or (0, 1), and a disc is at the former."""
    disc = Workspace(Points.joints(TWO_LINKS), Balls([[1.0, 0.0, 0.0]], [0.5]))
    for seed in range(3):
        q = assert_solved(Query(TWO_LINKS, (CORNER,), disc, dimension=2), seed)
        assert np.allclose(TWO_LINKS.link_transforms(q)[2, :3, 3], [0.0, 1.0, 0.0], atol=1e-6)


@pytest.mark.parametrize(("radius", "status"), [(1.05, Status.BLOCKED), (0.95, Status.NOT_FOUND)])
def test_the_toy_with_both_elbows_in_discs(radius: float, status: Status) -> None:
    """Distances to base and goal give x + y = 1 at the elbow; each disc 2 - 2 x >= r^2: empty exactly for r > 1."""
    elbow = Points(np.array([2]), np.zeros((1, 3)), np.zeros(1))
    discs = Workspace(elbow, Balls([[1.0, 0, 0], [0, 1.0, 0]], [radius, radius]))
    query = Query(TWO_LINKS, (CORNER,), discs, dimension=2)
    answer = solve_query(query, Budget(0.3))
    assert answer.status is status
    if answer.proof is not None:
        assert check_query(query, answer.proof) is None
        smaller = replace(discs, obstacles=Balls(discs.obstacles.centre, [0.95, 0.95]))
        refusal = check_query(replace(query, workspace=smaller), answer.proof)
        assert "do not prove the claim" in str(refusal)


def test_a_planar_arm_reaches_poses_within_its_limits() -> None:
    robot = planar((0.5, 0.4, 0.3, 0.2), 1.4)
    rng = np.random.default_rng(0)
    for seed in range(3):
        pose = robot.fk(robot.random_configuration(rng))
        assert_solved(Query(robot, (Goal.posed("tool", pose),), dimension=2), seed)


def test_a_planar_goal_out_of_reach_is_certified() -> None:
    query = Query(TWO_LINKS, (Goal.at("tool", [1.5, 1.5, 0.0]),), dimension=2)
    answer = solve_query(query, BUDGET)
    assert answer.status is Status.UNREACHABLE and answer.proof is not None
    assert check_query(query, answer.proof) is None
    nearer = replace(query, goals=(Goal.at("tool", [1.4, 1.4, 0.0]),))
    assert "do not prove the claim" in str(check_query(nearer, answer.proof))


def test_a_tree_reaches_several_goals_at_once() -> None:
    robot, rng = torso(), np.random.default_rng(1)
    for seed in range(2):
        q = robot.random_configuration(rng)
        left, right = robot.fk(q, "left"), robot.fk(q, "right")
        assert_solved(Query(robot, (Goal.at("left", left.position), Goal.at("right", right.position))), seed)
        along = Goal.pointing("right", right.position, right.rotation[:, 1], (0.0, 1.0, 0.0))
        assert_solved(Query(robot, (Goal.posed("left", left), along)), seed)


def test_two_goals_that_exclude_each_other_are_certified() -> None:
    goals = (Goal.at("left", [0.0, 0.7, 0.5]), Goal.at("right", [0.0, 0.9, 0.5]))
    query = Query(torso(), goals)
    answer = solve_query(query, Budget(3.0))
    assert answer.status is Status.UNREACHABLE and answer.proof is not None
    assert check_query(query, answer.proof) is None


def test_planes_hold_points_on_one_side_or_in_them() -> None:
    robot = bench_arm("ur10")
    elbow = Points(np.array([3]), np.zeros((1, 3)), np.array([0.05]))
    stands = robot.fk(np.array([0.3, -1.2, 0.9, 0.4, 1.0, 0.2]))
    height = float(robot.link_transforms(np.array([0.3, -1.2, 0.9, 0.4, 1.0, 0.2]))[3, 2, 3])
    goal = Goal.at("tool", stands.position)
    for seed in range(2):
        above = Plane(np.array([0.0, 0.0, 2.0]), 2 * (height - 0.06))
        q = assert_solved(Query(robot, (goal,), Workspace(elbow, planes=(above,))), seed)
        assert robot.link_transforms(q)[3, 2, 3] >= height - 0.01
        level = Plane(np.array([0.0, 0.0, 1.0]), height, equal=True)
        q = assert_solved(Query(robot, (goal,), Workspace(elbow, planes=(level,))), seed)
        assert robot.link_transforms(q)[3, 2, 3] == pytest.approx(height, abs=1e-5)


def test_points_stay_inside_a_sphere() -> None:
    robot = bench_arm("ur10")
    goal = Goal.at("tool", [0.5, 0.3, 0.4])
    joints = Points.joints(robot)
    ball = Balls([[0.3, 0.2, 0.4]], [0.6])
    q = assert_solved(Query(robot, (goal,), Workspace(joints, inside=ball)))
    away = np.linalg.norm(robot.link_transforms(q)[1:, :3, 3] - ball.centre, axis=1)
    assert away.max() <= 0.6 + 1e-9


def test_points_of_one_arm_keep_apart() -> None:
    robot = planar((0.5, 0.5, 0.5, 0.5), 3.2)
    points = Points(np.array([1, 4]), np.array([[0.3, 0, 0], [0.3, 0, 0]]), np.array([0.1, 0.1]))
    goal = Goal.at("tool", [0.3, 0.25, 0.0])
    free = Query(robot, (goal,), dimension=2)
    apart = replace(free, workspace=Workspace(points, apart=((0, 1),)))
    for seed in range(3):
        q = assert_solved(apart, seed)
        T = robot.link_transforms(q)
        one, other = (T[k] @ [0.3, 0.0, 0.0, 1.0] for k in (1, 4))
        assert np.linalg.norm(one - other) >= 0.2


def test_sphere_covers_are_taken_as_they_are() -> None:
    cover = SphereCover(np.array([0, 0]), np.eye(3)[:2], np.array([0.1, 0.2]))
    assert np.array_equal(Balls.of_cover(cover).radius, cover.radius)
    moving = SphereCover(np.array([1, 2]), np.eye(3)[:2], np.array([0.1, 0.2]))
    assert np.array_equal(Points.of_cover(moving).link, [1, 2])
    with pytest.raises(InputError, match="link 0"):
        Balls.of_cover(moving)


class TestBadInput:
    def ask(self, workspace: Workspace, robot: Robot | None = None) -> Answer:
        robot = robot or bench_arm("ur10")
        return solve_query(Query(robot, (Goal.posed("tool", robot.fk(np.ones(6))),), workspace), Budget(0.1))

    def test_an_obstacle_around_an_anchor(self) -> None:
        robot = bench_arm("ur10")
        wrist = robot.link_transforms(np.ones(6))[6, :3, 3]
        for centre in ([0.0, 0.0, 0.0], wrist):
            with pytest.raises(InputError, match=r"sphere 0: the obstacle contains an anchor"):
                self.ask(Workspace(Points.joints(robot), Balls([centre], [0.1])))

    @pytest.mark.parametrize("radius", [0.0, -0.1, np.nan])
    def test_spheres_of_no_size(self, radius: float) -> None:
        with pytest.raises(InputError, match=r"sphere 1: the radius is"):
            Balls(np.zeros((2, 3)), [0.1, radius])

    def test_points_that_coincide(self) -> None:
        twice = Points(np.array([3, 3]), np.zeros((2, 3)), np.full(2, 0.01))
        with pytest.raises(InputError, match="points 0 and 1 coincide"):
            self.ask(Workspace(twice, apart=((0, 1),)))

    def test_a_point_of_no_link(self) -> None:
        with pytest.raises(InputError, match="does not have"):
            self.ask(Workspace(Points(np.array([9]), np.zeros((1, 3)), np.zeros(1))))
        with pytest.raises(InputError, match="there is no point 3"):
            Workspace(Points.joints(planar()), apart=((0, 3),))

    def test_goals_that_make_no_sense(self) -> None:
        robot = bench_arm("ur10")
        with pytest.raises(UnknownNameError, match="no tool named 'hand'"):
            Query(robot, (Goal.at("hand", [0, 0, 1]),))
        with pytest.raises(InputError, match="at least one goal"):
            Query(robot, ())
        with pytest.raises(InputError, match="same tool"):
            Query(robot, (CORNER, CORNER))
        with pytest.raises(InputError, match="length zero"):
            Goal.pointing("tool", [0, 0, 1], [0, 0, 0])

    def test_a_goal_off_the_plane_of_a_planar_arm(self) -> None:
        with pytest.raises(InputError, match="100 mm off the plane"):
            solve_query(Query(TWO_LINKS, (Goal.at("tool", [1.0, 1.0, 0.1]),), dimension=2), BUDGET)

    def test_dimensions_that_do_not_fit(self) -> None:
        robot = bench_arm("ur10")
        with pytest.raises(InputError, match="parallel axes"):
            solve_query(Query(robot, (CORNER,), dimension=2), BUDGET)
        with pytest.raises(InputError, match="dimension is 4"):
            Query(robot, (CORNER,), dimension=4)
