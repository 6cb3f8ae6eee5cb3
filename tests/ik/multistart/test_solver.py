"""The sampler: its derivatives, its answers, what it honours, and what it says when it fails."""

import numpy as np
import pytest

from tests.ik.arms import beads, box, planar, random_arm, seven
from workcell.geometry.engine import ClearanceEngine
from workcell.geometry.self_collision import self_collision_pairs
from workcell.geometry.types import Piece, SphereCover
from workcell.ik.judge.verify import verify
from workcell.ik.multistart.pose_errors import pose_errors
from workcell.ik.multistart.solver import solve_multistart
from workcell.ik.problem import Budget, Clearance, IKProblem, Tolerances
from workcell.pose import Pose

BUDGET = Budget(5.0)


def _crowd(rng, count=6):
    pieces = []
    for k in range(count):
        quat = rng.normal(size=4)
        pose = Pose(rng.normal(size=3) * 0.5, quat / np.linalg.norm(quat))
        kind = ("box", "sphere", "capsule", "cylinder", "ellipsoid", "hull")[k % 6]
        size = rng.uniform(0.05, 0.2, size={"sphere": 1, "capsule": 2, "cylinder": 2, "hull": 0}.get(kind, 3))
        vertices = rng.normal(size=(12, 3)) * 0.15 if kind == "hull" else None
        pieces.append(Piece(f"{kind} {k}", kind, pose, size, vertices))
    return (*pieces, Piece("floor", "halfspace", Pose.from_xyz([0, 0, -0.3]), np.zeros(0)))


@pytest.mark.parametrize("sliding", [False, True])
def test_batched_pose_errors_and_jacobians(sliding):
    rng = np.random.default_rng(1)
    robot = random_arm(rng, sliding=sliding)
    q = robot.random_configuration(rng, 4)
    target = robot.fk(robot.random_configuration(rng))
    error, J = pose_errors(robot, q, target)
    for row in range(4):
        reached = robot.fk(q[row])
        assert np.linalg.norm(error[row, :3]) == pytest.approx(
            np.linalg.norm(target.position - reached.position)
        )
        assert np.linalg.norm(error[row, 3:]) == pytest.approx(reached.error_to(target)[1], abs=1e-9)
        assert np.allclose(J[row], robot.jacobian(q[row]), atol=1e-12)


def test_free_poses_are_reached():
    robot, rng = seven(), np.random.default_rng(0)
    for seed in range(10):
        problem = IKProblem(robot, robot.fk(robot.random_configuration(rng)))
        candidate = solve_multistart(problem, BUDGET, seed)
        verdict = verify(problem, candidate.q)
        assert verdict.accepted and verdict.position_error < 1e-5


def test_obstacles_are_avoided_whatever_their_kind():
    robot, rng = seven(), np.random.default_rng(2)
    cover = beads(robot, 0.04)
    solved = 0
    while solved < 5:
        q, pieces = robot.random_configuration(rng), _crowd(rng)
        problem = IKProblem(robot, robot.fk(q), pieces, cover)
        if verify(problem, q).accepted:
            candidate = solve_multistart(problem, BUDGET, 0)
            assert verify(problem, candidate.q).accepted
            solved += 1


def test_sliding_joints_are_solved():
    rng = np.random.default_rng(7)
    robot = random_arm(rng, n=7, sliding=True)
    problem = IKProblem(robot, robot.fk(robot.random_configuration(rng)))
    assert verify(problem, solve_multistart(problem, BUDGET, 0).q).accepted


def test_the_same_seed_gives_the_same_answer():
    robot = seven()
    problem = IKProblem(robot, robot.fk(robot.random_configuration(np.random.default_rng(3))))
    first, again, other = (solve_multistart(problem, BUDGET, seed).q for seed in (4, 4, 5))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_the_reference_comes_first_and_its_step_is_kept():
    robot, rng = seven(), np.random.default_rng(8)
    q = 0.8 * robot.random_configuration(rng)
    goal = robot.fk(q + rng.uniform(-0.05, 0.05, 7))
    problem = IKProblem(robot, goal, q_reference=q, max_step=0.1)
    candidate = solve_multistart(problem, BUDGET, 0)
    assert verify(problem, candidate.q).accepted
    assert np.abs(candidate.q - q).max() <= 0.1 + 1e-12
    far = robot.fk(q + 0.5)
    assert solve_multistart(IKProblem(robot, far, q_reference=q, max_step=0.01), Budget(0.05), 0).q is None


def test_no_budget_means_no_work():
    robot = seven()
    candidate = solve_multistart(IKProblem(robot, robot.fk(np.zeros(7))), Budget(0.0), 0)
    assert candidate.q is None and candidate.stats["starts"] == 0


def test_near_misses_name_the_sphere_and_the_obstacle():
    robot = planar()
    cover = SphereCover(np.array([2]), np.array([[0.2, 0, 0]]), np.array([0.05]))
    target = robot.fk(np.array([0.3, 0.8]))
    # both elbow solutions end with the same last link: the ball on it can't be avoided
    at = target.apply([-0.2, 0.0, 0.0])
    ball = Piece("ball", "sphere", Pose.from_xyz(at), np.array([0.04]))
    candidate = solve_multistart(IKProblem(robot, target, (ball,), cover), Budget(0.3), 0)
    assert candidate.q is None
    assert any("sphere 0 (link2) is" in reason and "ball" in reason for reason in candidate.rejected)


def test_where_the_true_shape_is_known_the_overshoot_is_no_obstacle():
    robot = planar()
    target = robot.fk(np.array([0.3, 0.8]))
    fat = SphereCover(np.array([2]), np.array([[0.2, 0, 0]]), np.array([0.05]), "outer", np.array([0.03]))
    at = target.apply([-0.2, 0.07, 0.0])
    ball = Piece("ball", "sphere", Pose.from_xyz(at), np.array([0.04]))

    def thin(q):
        centre = robot.link_transforms(q)[2] @ [0.2, 0, 0, 1]
        return Clearance(float(np.linalg.norm(centre[:3] - at)) - 0.04 - 0.02, ("arm", "ball"))

    problem = IKProblem(robot, target, (ball,), fat, checker=thin)
    assert verify(problem, solve_multistart(problem, BUDGET, 0).q).accepted
    judged_by_spheres = IKProblem(robot, target, (ball,), fat)
    assert solve_multistart(judged_by_spheres, Budget(0.1), 0).q is None


def test_a_joint_without_freedom_stays_where_it_is():
    from dataclasses import replace

    robot = planar((0.4, 0.3, 0.2))
    stiff = replace(robot, lower=np.array([-3.0, 0.5, -3.0]), upper=np.array([3.0, 0.5, 3.0]))
    problem = IKProblem(stiff, stiff.fk(np.array([0.2, 0.5, -1.0])))
    candidate = solve_multistart(problem, BUDGET, 0)
    assert candidate.q[1] == 0.5 and verify(problem, candidate.q).accepted


def test_a_narrow_slot_is_entered():
    robot = seven()
    cover = beads(robot, 0.04)
    q = np.array([0.2, 0.9, 0.1, 0.6, 0.0, 0.4, 0.0])
    target = robot.fk(q)
    x, y, z = target.position
    slot = tuple(
        box(f"board {k}", (x, y, z + side * 0.14), (0.2, 0.2, 0.02)) for k, side in enumerate((-1, 1))
    )
    problem = IKProblem(robot, target, slot, cover)
    assert verify(problem, q).accepted
    assert verify(problem, solve_multistart(problem, BUDGET, 1).q).accepted


def test_the_robot_does_not_hit_itself():
    robot, rng = seven(), np.random.default_rng(3)
    cover = beads(robot, 0.1)
    pairs = self_collision_pairs(robot, cover).pairs
    own = ClearanceEngine(robot, cover, (), pairs)
    configurations = robot.random_configuration(rng, 400)
    gaps = own.clearances(configurations)
    hidden = configurations[(gaps > 0) & (gaps < 0.01)][:4]
    assert len(hidden) == 4
    for q in hidden:
        problem = IKProblem(robot, robot.fk(q), cover=cover, self_collision=pairs)
        candidate = solve_multistart(problem, BUDGET, 0)
        assert verify(problem, candidate.q).accepted and own.clearance(candidate.q) >= 0
    blocked = IKProblem(
        robot, robot.fk(hidden[0]), cover=cover, self_collision=pairs, q_reference=hidden[0], max_step=0.02,
        tolerances=Tolerances(safety_margin=0.05),
    )  # fmt: skip
    missed = solve_multistart(blocked, Budget(0.2), 0)
    assert missed.q is None and any(reason.count("sphere") == 2 for reason in missed.rejected)
