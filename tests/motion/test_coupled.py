"""Arms whose joints follow others: lines and curves are proved for what really moves, and planned."""

import numpy as np
import pytest

from tests.coupled_arms import coupled_arm
from tests.ik.test_coupled import among_spheres, arm
from workcell.errors import InputError
from workcell.ik.result import Status
from workcell.model.scene import robot_scene
from workcell.motion.plans.to_pose import plan_to_pose
from workcell.motion.polynomials import PolynomialMotion
from workcell.motion.proofs.judge import judge_path
from workcell.motion.proofs.on_model import link_motion
from workcell.motion.proofs.on_spheres import CoverProver
from workcell.motion.tool_paths.follow import follow, line, step_solver
from workcell.motion.tool_paths.route import route
from workcell.pose import Pose
from workcell.world.planning_world import PlanningWorld


def smallest(robot, cover, balls, q):
    """(k,) clearances at configurations (k, n)."""
    centres = cover.centres_world(robot.link_transforms(q))
    gaps = [
        np.linalg.norm(centres - ball.pose.position, axis=-1) - cover.radius - ball.size[0] for ball in balls
    ]
    return np.min(gaps, axis=(0, 2))


@pytest.mark.parametrize("bent", [False, True])
def test_lines_and_curves_are_proved_for_what_really_moves(tmp_path, bent):
    proved, failed = 0, 0
    for seed in range(8):
        robot = arm(tmp_path, coupled_arm(seed, joints=6, followers=1 + seed % 2, bent=bent)[0])
        rng = np.random.default_rng(seed)
        planted, problem = among_spheres(robot, rng, count=6)
        prover = CoverProver(robot, problem.cover, problem.obstacles)
        for _ in range(12):
            other = planted + 0.6 * rng.uniform(-1, 1, robot.dof) * (robot.upper - robot.lower)
            ends = np.stack([planted, np.clip(other, robot.lower, robot.upper)])
            t = np.linspace(0, 1, 2000)[:, None]
            truth = smallest(robot, problem.cover, problem.obstacles, ends[0] + t * (ends[1] - ends[0])).min()
            found = prover.path(ends)
            assert found.proved == (truth > 0) or abs(truth) < 2e-4
            if found.proved:
                assert found.margin <= truth + 1e-9
            verdict = judge_path(problem, ends[0], ends)
            assert not (verdict.bound > -1e-3 and truth < -1.1e-4)
            coefficients = np.zeros((1, robot.dof, 4))
            coefficients[0, :, 0], coefficients[0, :, 2:] = (
                ends[0],
                ((ends[1] - ends[0])[:, None] * [3.0, -2.0]),
            )
            curve = prover.motion(PolynomialMotion(coefficients, np.array([1.0])))
            assert curve.proved == found.proved or abs(truth) < 2e-4
            proved, failed = proved + found.proved, failed + (not found.proved)
    assert proved > 10 and failed > 10


@pytest.mark.parametrize("bent", [False, True])
def test_links_move_no_farther_than_their_bound(tmp_path, bent):
    for seed in range(4):
        robot = arm(tmp_path, coupled_arm(seed, joints=6, followers=2, bent=bent)[0])
        rng = np.random.default_rng(seed)
        _, problem = among_spheres(robot, rng)
        q, half = robot.random_configuration(rng), rng.uniform(0, 0.2, robot.dof)
        bound = link_motion(robot, q, half, problem.cover)
        here = problem.cover.centres_world(robot.link_transforms(q))
        for _ in range(200):
            there = problem.cover.centres_world(
                robot.link_transforms(q + half * rng.uniform(-1, 1, robot.dof))
            )
            moved = np.linalg.norm(there - here, axis=1)
            assert np.all(moved <= bound[0, problem.cover.link] + 1e-12)


def test_plans_to_poses_are_found_and_judged(tmp_path):
    for seed in (40, 41, 43):
        robot = arm(tmp_path, coupled_arm(seed, joints=7, followers=1)[0])
        rng = np.random.default_rng(seed)
        _, problem = among_spheres(robot, rng, count=5)
        drawn = robot.random_configuration(rng, 200)
        start = drawn[np.argmax(smallest(robot, problem.cover, problem.obstacles, drawn) > 0.01)]
        plan = plan_to_pose(problem, start)
        assert plan.status is Status.SOLVED and plan.proved
        assert judge_path(problem, start, plan.path).accepted


def test_a_tool_path_is_followed(tmp_path):
    text = coupled_arm(3, joints=8, followers=1, slides=False)[0]
    (tmp_path / "arm.xml").write_text(text)
    world = PlanningWorld.of(robot_scene(tmp_path / "arm.xml"))
    robot, rng = world.robot.robot, np.random.default_rng(3)
    q = next(q for q in 0.5 * robot.random_configuration(rng, 100) if world.clearance(q).distance > 0.02)
    first = robot.fk(q)
    last = Pose(first.position + np.array([0.05, 0.05, -0.04]), first.quat_wxyz)
    for found in (
        follow(world.problem(first), line(first, last), q, solver=step_solver("auto")),
        follow(world.problem(first), line(first, last), q, solver=step_solver("ikspark")),
        route(world.problem(first), line(first, last), q),
    ):
        assert found.path is not None and found.path.configurations.shape[1] == robot.dof
        assert found.path.end.shape == (robot.dof,)
        away, turned = robot.fk(found.path.end).error_to(last)
        assert away < 2e-4 and turned < 2e-3
    with pytest.raises(InputError, match="joints that follow others"):
        follow(world.problem(first), line(first, last), q, solver=step_solver("cidgik"))
