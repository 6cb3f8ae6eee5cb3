"""CIDGIK finds configurations by convex iteration alone, keeps limits and obstacles, returns no mirror image."""

from __future__ import annotations

import functools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.ik import reaching
from tests.ik.arms import beads, hugged, planar
from tests.ik.lifted_arms import X, Z, arm, parallel_elbow, seven_axis, skew_arm
from workcell.bench.ik.cidgik_scaling import crowded_problems, long_arm
from workcell.bench.reference.cidgik_problems import (
    bench_arm,
    environment,
    joint_points,
    off_centre,
    random_problems,
)
from workcell.errors import InputError
from workcell.geometry.types import Piece, SphereCover
from workcell.ik.cidgik.model import relaxation_at
from workcell.ik.cidgik.rank import converge
from workcell.ik.cidgik.recover import joint_angles, nearest_turn
from workcell.ik.cidgik.solver import solve_cidgik
from workcell.ik.judge.verify import verify
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.result import Status
from workcell.ik.solve import solve
from workcell.model.robot import Robot
from workcell.pose import Pose

BUDGET = Budget(10.0)


assert_reached = functools.partial(reaching.assert_reached, solve_cidgik)


ARMS = [
    bench_arm("ur10"),
    bench_arm("kuka"),
    off_centre(bench_arm("lwa4d")),
    seven_axis(),
    parallel_elbow(),
    *(skew_arm(n + 20, n) for n in (4, 5, 6, 7)),
    replace(seven_axis(1.2), T_world_base=Pose(np.array([0.3, -0.2, 0.5]), np.array([0.5, 0.5, 0.5, -0.5]))),
]


@pytest.mark.parametrize("robot", ARMS, ids=lambda robot: f"{robot.name}{robot.dof}")
def test_reachable_poses_are_reached(robot: Robot) -> None:
    rng = np.random.default_rng(1)
    for seed in range(2):
        assert_reached(IKProblem(robot, robot.fk(robot.random_configuration(rng))), seed)


@pytest.mark.parametrize("joints", [1, 2, 3])
def test_short_arms(joints: int) -> None:
    """Goal and base may fix every vector: then there is nothing to minimise."""
    robot = skew_arm(joints, joints)
    pose = robot.fk(robot.random_configuration(np.random.default_rng(0)))
    assert_reached(IKProblem(robot, pose))
    away = Pose(pose.position + np.array([0.05, 0.02, 0.3]), pose.quat_wxyz)
    assert solve(IKProblem(robot, away), "cidgik", Budget(1.0)).status is Status.UNREACHABLE


def test_same_seed_same_answer() -> None:
    problem = IKProblem(ARMS[2], ARMS[2].fk(np.linspace(-1.0, 1.0, 7)))
    assert np.array_equal(assert_reached(problem, 5), assert_reached(problem, 5))


def test_local_search_is_another_solver() -> None:
    robot = skew_arm(3, 6)
    assert_reached(IKProblem(robot, robot.fk(np.full(6, 0.4))), local=True)


@pytest.mark.parametrize("seed", range(3))
def test_low_rank_points_are_never_mirror_images(seed: int) -> None:
    """Neither of a pose that is reachable, nor of one that only the mirrored arm reaches."""
    rng = np.random.default_rng(seed)
    robot, mirrored = skew_arm(seed + 40, 5), _mirror_image(skew_arm(seed + 40, 5))
    poses = [robot.fk(rng.uniform(-0.5, 0.5, 5)), mirrored.fk(rng.uniform(-0.5, 0.5, 5))]
    found = 0
    for pose in poses:
        instance, _ = relaxation_at(IKProblem(robot, pose))
        for _ in range(8):
            last = list(converge(instance, instance.random_objective(rng)))[-1]
            if not last.low_rank:
                continue
            found += 1
            directions = instance.directions(last.Z)
            skeleton = instance.structure.skeleton
            for link in skeleton.framed:
                assert np.linalg.det(directions[link].T @ skeleton.basis[link].T) > 0.99
            q = joint_angles(skeleton, directions)
            metres, radians = robot.fk(q).error_to(pose)
            assert metres < 1e-2 and radians < 1e-2
        instance.release()
    assert found > 0


def _mirror_image(robot: Robot) -> Robot:
    """The arm reflected in the plane x = 0: another arm, with the same distances between its axes' points."""
    M = np.diag([-1.0, 1.0, 1.0])
    tool = robot.tool()
    pose = Pose.from_matrix(
        np.block([[M @ tool.T_link_tool.rotation @ M, M @ tool.T_link_tool.position[:, None]], [0, 0, 0, 1]])
    )
    return replace(
        robot,
        joint_xyz=robot.joint_xyz @ M,
        joint_rotation=M @ robot.joint_rotation @ M,
        axis=-robot.axis @ M,
        tools={tool.name: replace(tool, T_link_tool=pose)},
    )


@pytest.mark.parametrize("name", ["octahedron", "cube", "icosahedron"])
def test_spheres_are_kept_out_of(name: str) -> None:
    for robot in (bench_arm("ur10"), off_centre(bench_arm("kuka"))):
        for seed, problem in enumerate(random_problems(robot, joint_points(robot), *environment(name), 2, 3)):
            assert_reached(problem, seed)


def test_a_thousand_spheres_of_which_many_stand_around_the_arm() -> None:
    robot = bench_arm("kuka")
    (problem,) = crowded_problems(robot, beads(robot, 0.01), 1000, 1, 0)
    candidate = solve_cidgik(problem, BUDGET)
    assert candidate.q is not None and verify(problem, candidate.q).accepted
    assert 0 < candidate.stats["rows"] < 1000


def test_boxes_and_points_off_the_links_are_avoided() -> None:
    robot = seven_axis()
    cover = beads(robot, 0.05)
    off_axis = SphereCover(
        np.append(cover.link, [3, 5]),
        np.vstack([cover.centre, [[0.06, 0.05, 0.1], [-0.05, 0.06, 0.1]]]),
        np.full(len(cover) + 2, 0.05),
    )
    problem = hugged(robot, off_axis, np.random.default_rng(4), 4)
    assert len(relaxation_at(problem)[0].structure.skeleton.framed - {0, 7}) >= 2
    assert_reached(problem)


@pytest.mark.parametrize("goal", ["position", "axis"])
def test_parts_of_a_pose(goal: Any) -> None:
    robot = seven_axis()
    q = np.array([0.3, 0.6, -0.2, 1.0, 0.4, 0.8, 0.5])
    result = solve(IKProblem(robot, robot.fk(q), goal=goal), "cidgik")
    assert result.status is Status.SOLVED
    far = Pose(np.array([3.0, 0.0, 0.0]), robot.fk(q).quat_wxyz)
    assert solve(IKProblem(robot, far, goal=goal), "cidgik").status is Status.UNREACHABLE


def test_spheres_of_the_arm_itself_are_kept_apart() -> None:
    """The forearm's end comes as near the upper arm's as the goal asks, but for the spheres between them."""
    robot = long_arm(6, np.pi)
    cover = SphereCover(np.array([3, 6]), np.array([[0.0, 0, 0], [0.0, 0, -0.05]]), np.array([0.1, 0.1]))
    pairs, rng, folded = np.array([[0, 1]]), np.random.default_rng(2), 0
    for seed in range(12):
        q = robot.random_configuration(rng)
        problem = IKProblem(robot, robot.fk(q), cover=cover, self_collision=pairs, goal="position")
        if not verify(problem, q).accepted:
            continue
        free = solve_cidgik(replace(problem, cover=None, self_collision=None), BUDGET, seed).q
        folded += free is not None and not verify(problem, free).accepted
        found = solve_cidgik(problem, BUDGET, seed).q
        assert found is not None and verify(problem, found).accepted
    assert folded > 0


def test_steps_stay_near_the_reference() -> None:
    robot = seven_axis()
    q = np.array([0.3, 0.6, -0.2, 1.0, 0.4, 0.8, 0.0])
    moved = robot.fk(q + 0.04)
    found = assert_reached(IKProblem(robot, moved, q_reference=q, max_step=0.1))
    assert np.abs(found - q).max() <= 0.1 + 1e-9


@pytest.mark.parametrize("limit", [np.pi, 2.0])
def test_long_chains_in_blocks(limit: float) -> None:
    robot = long_arm(34, limit)
    q = np.random.default_rng(0).uniform(-1.5, 1.5, 34)
    assert_reached(IKProblem(robot, robot.fk(q)), 1)


def test_a_reference_outside_the_limits_is_a_result() -> None:
    robot = bench_arm("ur10")
    q = np.full(6, 5.0)
    candidate = solve_cidgik(IKProblem(robot, robot.fk(q), q_reference=q, max_step=0.1), BUDGET)
    assert candidate.q is None and "max_step" in candidate.rejected[0]


def test_no_budget_no_answer() -> None:
    robot = bench_arm("ur10")
    assert solve(IKProblem(robot, robot.fk(np.ones(6))), "cidgik", Budget(0.0)).status is Status.NOT_FOUND


def test_angles_go_to_the_nearest_turn() -> None:
    middle = np.array([0.0, 3.0, -6.0, 0.0])
    q = nearest_turn(np.array([3.5, -3.0, 0.5, 2.0000015]), middle)
    assert np.allclose(q, [3.5 - 2 * np.pi, -3.0 + 2 * np.pi, 0.5 - 2 * np.pi, 2.0000015])


class TestBadInput:
    def test_a_prismatic_joint_names_what_to_use(self) -> None:
        robot = skew_arm(0, 4)
        sliding = replace(robot, prismatic=np.array([False, True, False, False]))
        with pytest.raises(InputError, match=r"'j1' is prismatic.*multistart"):
            solve_cidgik(IKProblem(sliding, robot.fk(np.zeros(4))), BUDGET)

    def test_axes_that_are_all_parallel(self) -> None:
        robot = planar()
        with pytest.raises(InputError, match=r"all joint axes are parallel.*dimension=2"):
            solve_cidgik(IKProblem(robot, robot.fk(np.zeros(2))), BUDGET)

    def test_two_joints_about_one_axis(self) -> None:
        robot = arm([Z, X, X, Z], [[0, 0, 0.1], [0, 0, 0.2], [0.1, 0, 0], [0, 0.1, 0]], [-2] * 4, [2] * 4)
        with pytest.raises(InputError, match="turn about one axis: their points coincide"):
            solve_cidgik(IKProblem(robot, robot.fk(np.zeros(4))), BUDGET)

    def test_an_obstacle_around_the_base(self) -> None:
        robot = bench_arm("ur10")
        ball = Piece("boulder", "sphere", Pose.from_xyz([0.0, 0.0, 0.1]), np.array([0.3]))
        problem = IKProblem(robot, robot.fk(np.ones(6)), (ball,), joint_points(robot))
        with pytest.raises(InputError, match=r"boulder.*contains the base"):
            solve_cidgik(problem, BUDGET)
