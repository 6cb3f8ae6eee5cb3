"""The sampling solver among obstacles: what it proposes passes the judge, what it can't solve it explains."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.ik.arms import beads, box, hugged, random_arm, seven
from workcell.errors import InputError
from workcell.geometry.types import Piece, SphereCover
from workcell.ik.hjcd.refine import refine
from workcell.ik.hjcd.solver import solve_hjcd
from workcell.ik.judge.exact import ExactDistances, ExactKinematics, smallest_clearance
from workcell.ik.judge.verify import verify
from workcell.ik.problem import Budget, Clearance, IKProblem, Tolerances
from workcell.ik.shared.packing import narrowed_arm, pack_world
from workcell.ik.solve import solve
from workcell.model.robot import Tool
from workcell.pose import Pose

BUDGET = Budget(10.0)


def accepted(problem, candidate) -> bool:
    return candidate.q is not None and verify(problem, candidate.q).accepted


@pytest.mark.parametrize("seed", range(12))
def test_thin_solution_sets_of_seven_joints(seed):
    robot = seven()
    problem = hugged(robot, beads(robot), np.random.default_rng(seed))
    assert accepted(problem, solve_hjcd(problem, BUDGET, seed))


@pytest.mark.parametrize("dof", [6, 8, 10])
def test_thin_solution_sets_of_other_chains(dof):
    rng = np.random.default_rng(dof)
    for seed in range(4):
        robot = random_arm(rng, dof, sliding=seed == 3)
        problem = hugged(robot, beads(robot, 0.04), rng, 20)
        assert accepted(problem, solve_hjcd(problem, BUDGET, seed))


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.0, 0.02))
def test_what_is_proposed_passes_the_judge(seed, margin):
    rng = np.random.default_rng(seed)
    robot = seven()
    pieces = tuple(
        box(f"box {k}", tuple(rng.uniform(-0.8, 0.8, 3)), tuple(rng.uniform(0.02, 0.2, 3))) for k in range(12)
    )
    target = robot.fk(robot.random_configuration(rng))
    problem = IKProblem(robot, target, pieces, beads(robot), tolerances=Tolerances(safety_margin=margin))
    candidate = solve_hjcd(problem, Budget(0.1), seed)
    assert (candidate.q is None and candidate.rejected) or accepted(problem, candidate)


def test_every_kind_of_obstacle():
    robot = seven()
    q = np.array([0.4, 0.7, 0.3, -1.1, 0.2, 0.8, 0.1])
    elbow = robot.link_transforms(q)[4, :3, 3]
    rng = np.random.default_rng(0)
    pose = Pose.from_xyz(elbow + np.array([0.0, 0.05, 0.0]))
    floor = Piece("floor", "halfspace", Pose.from_xyz([0, 0, -0.1]), np.zeros(0))
    for kind, size in (
        ("sphere", [0.06]),
        ("capsule", [0.04, 0.1]),
        ("cylinder", [0.05, 0.1]),
        ("ellipsoid", [0.1, 0.05, 0.07]),
        ("box", [0.05, 0.05, 0.1]),
    ):
        problem = IKProblem(
            robot, robot.fk(q), (Piece(kind, kind, pose, np.array(size)), floor), beads(robot)
        )
        assert accepted(problem, solve_hjcd(problem, BUDGET, 1)), kind
    hull = Piece("rock", "hull", pose, np.zeros(0), 0.06 * rng.normal(size=(14, 3)))
    problem = IKProblem(robot, robot.fk(q), (hull, floor), beads(robot))
    assert accepted(problem, solve_hjcd(problem, BUDGET, 1))


def test_free_problems_and_the_reference():
    robot = seven()
    q = np.array([0.4, 0.7, 0.3, -1.1, 0.2, 0.8, 0.1])
    problem = IKProblem(robot, robot.fk(q), q_reference=q + 0.02)
    candidate = solve_hjcd(problem, BUDGET, 0)
    assert accepted(problem, candidate)
    assert np.abs(candidate.q - q).max() < 0.1


def test_bounds_against_the_reference_are_kept():
    robot = seven()
    q = np.array([0.4, 0.7, 0.3, -1.1, 0.2, 0.8, 0.1])
    obstacle = box("far", (5.0, 0.0, 0.0), (0.1, 0.1, 0.1))
    near = IKProblem(robot, robot.fk(q), (obstacle,), beads(robot), q_reference=q + 0.05, max_step=0.2)
    assert accepted(near, solve_hjcd(near, BUDGET, 0))
    turning = IKProblem(robot, robot.fk(q), q_reference=q + 0.03, max_link_rotation=0.6)
    assert accepted(turning, solve_hjcd(turning, BUDGET, 0))
    stuck = replace(turning, max_link_rotation=1e-6)
    refused = solve_hjcd(stuck, Budget(0.05), 0)
    assert refused.q is None
    assert "turns too far" in refused.rejected[0]


def test_same_seed_same_answer():
    robot = seven()
    problem = hugged(robot, beads(robot), np.random.default_rng(5))
    answers = [solve_hjcd(problem, BUDGET, seed) for seed in (3, 3)]
    assert np.array_equal(answers[0].q, answers[1].q)
    assert dict(answers[0].stats) == dict(answers[1].stats)


def test_no_budget_no_work():
    robot = seven()
    assert solve_hjcd(IKProblem(robot, Pose.identity()), Budget(0.0)).q is None


def test_an_unreachable_target_says_how_far_the_arm_got():
    robot = seven()
    obstacle = (box("far", (5.0, 0.0, 0.0), (0.1, 0.1, 0.1)),)
    for problem in (
        IKProblem(robot, Pose.from_xyz([3.0, 0, 0])),
        IKProblem(robot, Pose.from_xyz([3.0, 0, 0]), obstacle, beads(robot)),
    ):
        candidate = solve_hjcd(problem, Budget(0.02), 0)
        assert candidate.q is None
        assert "restarts reached the pose" in candidate.rejected[0]


def test_a_blocked_target_names_sphere_obstacle_and_depth():
    robot = seven()
    target = robot.fk(np.array([0.4, 0.7, 0.3, -1.1, 0.2, 0.8, 0.1]))
    wall = box("wall", tuple(target.position), (0.2, 0.2, 0.2))
    candidate = solve_hjcd(IKProblem(robot, target, (wall,), beads(robot)), Budget(20.0), 0)
    assert candidate.q is None
    assert candidate.stats["exhausted"] == 1.0
    assert candidate.rejected
    assert all("sphere" in line and "mm inside wall" in line for line in candidate.rejected)


def test_the_problems_own_checker_has_the_last_word():
    robot = seven()
    problem = hugged(robot, beads(robot, 0.03), np.random.default_rng(1), 10)
    asked = []

    def checker(q):
        asked.append(q)
        return Clearance(-0.01 if q[0] < 0 else 0.01, ("hand", "lamp"))

    own = replace(problem, checker=checker)
    candidate = solve_hjcd(own, BUDGET, 0)
    assert candidate.stats["checks"] == len(asked) > 0
    assert candidate.q is not None and candidate.q[0] >= 0
    never = replace(problem, checker=lambda q: Clearance(-0.004, ("hand", "lamp")))
    refused = solve_hjcd(never, Budget(2.0), 0)
    assert refused.q is None
    assert refused.stats["checks"] <= 300
    assert "hand is 4 mm inside lamp" in refused.rejected[0]


def test_an_outer_cover_is_forgiven_its_overshoot_where_another_judges():
    robot = seven()
    q = np.array([0.4, 0.7, 0.3, -1.1, 0.2, 0.8, 0.1])
    thin = beads(robot, 0.03)
    fat = SphereCover(thin.link, thin.centre, thin.radius + 0.05, "outer", np.full(len(thin), 0.05))
    # a dot two centimetres ahead of the last sphere, which the target fixes
    rotation, position = ExactKinematics(robot).links(q)
    last = rotation[7] @ thin.centre[-1] + position[7]
    tight = (box("dot", tuple(last + 0.06 * rotation[7] @ np.array([0.0, 0.0, 1.0])), (0.005,) * 3),)
    truth = ExactDistances(tight)
    kinematics = ExactKinematics(robot)

    def checker(configuration):
        return Clearance(smallest_clearance(thin, *kinematics.links(configuration), truth)[0])

    assert checker(q).distance > 0
    problem = IKProblem(robot, robot.fk(q), tight, fat, checker=checker)
    assert accepted(problem, solve_hjcd(problem, BUDGET, 0))
    assert solve_hjcd(replace(problem, checker=None), Budget(0.3), 0).q is None


@pytest.mark.parametrize("dof", [7, 9])
def test_refinement_from_a_near_miss(dof):
    rng = np.random.default_rng(dof)
    solved = 0
    for _ in range(10):
        robot = random_arm(rng, dof)
        problem = hugged(robot, beads(robot, 0.04), rng, 12)
        q = solve_hjcd(problem, BUDGET, 0).q
        assert q is not None
        arm, world, target = narrowed_arm(problem), pack_world(problem), problem.target
        pose, found = np.concatenate([target.position, target.quat_wxyz]), np.empty(dof)
        near = np.clip(q + rng.normal(scale=0.03, size=(3, dof)), arm.bounds[0], arm.bounds[1])
        if refine(arm, world, pose, near, 1e-8, found):
            assert verify(problem, found).accepted
            solved += 1
    assert solved >= 8


def test_a_tool_that_does_not_sit_at_the_end():
    robot = seven()
    early = replace(robot, tools={"tool": Tool("tool", 5, Pose.identity())})
    with pytest.raises(InputError, match="link 5 of 7"):
        solve_hjcd(IKProblem(early, Pose.identity()), BUDGET)


def test_importing_the_solver_does_not_import_numba():
    code = "import sys, workcell.ik.hjcd.solver, workcell.ik.hjcd.refine; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_budget_of_restarts():
    robot = seven()
    target = robot.fk(np.array([0.4, 0.7, 0.3, -1.1, 0.2, 0.8, 0.1]))
    wall = box("wall", tuple(target.position), (0.2, 0.2, 0.2))
    blocked = IKProblem(robot, target, (wall,), beads(robot))
    far = IKProblem(robot, Pose.from_xyz([3.0, 0, 0]))
    for most in (1, 16, 37):
        for problem in (blocked, far):
            candidate = solve_hjcd(problem, Budget(60.0, iterations=most), 0)
            assert candidate.q is None
            assert candidate.stats["restarts"] == most
    with pytest.raises(InputError, match="iterations"):
        Budget(iterations=0)


def test_a_budget_of_restarts_for_the_portfolio():
    robot = seven()
    problem = hugged(robot, beads(robot), np.random.default_rng(5))
    results = [solve(problem, budget=Budget(60.0, iterations=500), seed=3) for _ in range(2)]
    assert results[0].solver == "hjcd"
    assert np.array_equal(results[0].q, results[1].q)
