"""Arms whose joints follow others: what is planted is found, what only free joints reach is not."""

from dataclasses import replace

import numpy as np
import pytest

from tests.coupled_arms import coupled_arm, planar
from workcell.errors import InputError
from workcell.geometry.types import Piece, SphereCover
from workcell.ik.check import check_certificate
from workcell.ik.cidgik.query import solve_query
from workcell.ik.hjcd.batch import solve_batch
from workcell.ik.hjcd.solver import collect_solutions
from workcell.ik.judge.verify import verify
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.registry import SOLVERS
from workcell.ik.result import Status
from workcell.ik.solve import solve
from workcell.ik.trees.query import Goal, Query
from workcell.model.loading.load import load_robot
from workcell.pose import Pose

TAKERS = ["auto", *(name for name, entry in SOLVERS.items() if entry.listed and entry.couples)]
REFUSERS = [name for name, entry in SOLVERS.items() if entry.listed and not entry.couples]


def arm(folder, text):
    path = folder / "arm.xml"
    path.write_text(text)
    return load_robot(path).chain()


def among_spheres(robot, rng, count=4):
    """A planted configuration, its target, a cover of two spheres a link, and balls that leave it clear."""
    links = np.repeat(np.arange(1, robot.joint_count + 1), 2)
    centres = np.tile([[0.0, 0.0, 0.04], [0.01, 0.0, 0.11]], (robot.joint_count, 1))
    cover = SphereCover(links, centres, np.full(len(links), 0.03))
    q = robot.random_configuration(rng)
    own = cover.centres_world(robot.link_transforms(q))
    balls = []
    while len(balls) < count:
        centre = own[rng.integers(len(own))] + rng.normal(size=3) * 0.15
        if np.linalg.norm(own - centre, axis=1).min() > 0.03 + 0.06 + 0.01:
            balls.append(Piece(f"ball {len(balls)}", "sphere", Pose.from_xyz(centre), np.array([0.06])))
    return q, IKProblem(robot, robot.fk(q), tuple(balls), cover)


@pytest.mark.parametrize("bent", [False, True])
@pytest.mark.parametrize("solver", TAKERS)
def test_planted_configurations_are_found(tmp_path, solver, bent):
    for seed in range(6):
        robot = arm(tmp_path, coupled_arm(seed, joints=5 + seed % 4, followers=1 + seed % 2, bent=bent)[0])
        rng = np.random.default_rng(seed)
        for _ in range(2):
            planted = robot.random_configuration(rng)
            result = solve(IKProblem(robot, robot.fk(planted)), solver, Budget(30.0))
            assert result.status is Status.SOLVED
            assert result.q.shape == (robot.dof,) and robot.within_limits(result.q)


@pytest.mark.parametrize("bent", [False, True])
@pytest.mark.parametrize("solver", TAKERS)
def test_planted_configurations_among_obstacles_are_found(tmp_path, solver, bent):
    for seed in range(4):
        robot = arm(tmp_path, coupled_arm(40 + seed, joints=7 + seed % 2, followers=1, bent=bent)[0])
        planted, problem = among_spheres(robot, np.random.default_rng(seed))
        assert verify(problem, planted).accepted
        assert solve(problem, solver, Budget(60.0)).status is Status.SOLVED


def test_solutions_are_collected_and_batches_say_that_they_can_t(tmp_path):
    robot = arm(tmp_path, coupled_arm(41, joints=8, followers=1)[0])
    _, problem = among_spheres(robot, np.random.default_rng(1))
    found = collect_solutions(problem, 5)
    assert len(found) == 5 and all(verify(problem, q).accepted for q in found)
    with pytest.raises(InputError, match="follows another"):
        solve_batch(robot, [problem.target])


@pytest.mark.parametrize("solver", REFUSERS)
def test_solvers_that_know_no_couplings_say_who_does(tmp_path, solver):
    robot = arm(tmp_path, planar())
    with pytest.raises(InputError, match=r"joints that follow others.*auto, hjcd"):
        solve(IKProblem(robot, robot.fk([0.3])), solver)


@pytest.mark.parametrize("bent", [False, True])
@pytest.mark.parametrize("followers", [1, 2])
def test_what_only_joints_of_their_own_would_reach_is_proved_unreachable(tmp_path, bent, followers):
    for seed in range(4):
        robot = arm(tmp_path, coupled_arm(seed, joints=6, followers=followers, bent=bent)[0])
        rng = np.random.default_rng(seed)
        k = int(robot.coupling.followers[0])
        q = robot.joint_values(robot.random_configuration(rng))
        q[k] += 0.05 if robot.prismatic[k] else 0.2
        problem = IKProblem(robot, robot.uncoupled.fk(q))
        result = solve(problem, budget=Budget(60.0))
        assert result.status is Status.UNREACHABLE
        assert check_certificate(problem, result.certificate) is None
        free = replace(problem, robot=robot.uncoupled)
        assert check_certificate(free, result.certificate) is not None


@pytest.mark.parametrize("goal", ["position", "axis"])
def test_positions_and_directions_off_the_coupled_set_are_proved_unreachable(tmp_path, goal):
    robot = arm(tmp_path, planar())
    here = robot.fk([0.5])
    assert solve(IKProblem(robot, here, goal=goal)).status is Status.SOLVED
    # the point that a second joint turned by 0.1 rad more would reach
    away = robot.uncoupled.fk([0.5, 0.6])
    assert solve(IKProblem(robot, away, goal=goal)).status is Status.UNREACHABLE


def test_an_obstacle_at_the_one_configuration_that_is_left_blocks(tmp_path):
    robot = arm(tmp_path, planar())
    cover = SphereCover(
        np.array([1, 1, 2, 2]),
        np.array([[0.1, 0, 0], [0.2, 0, 0], [0.15, 0, 0], [0.28, 0, 0]]),
        np.full(4, 0.03),
    )
    target = robot.fk([0.5])
    ball = Piece(
        "ball", "sphere", Pose.from_xyz([0.2 * np.cos(0.5), 0.2 * np.sin(0.5) + 0.05, 0.1]), np.array([0.04])
    )
    problem = IKProblem(robot, target, (ball,), cover)
    assert not verify(problem, [0.5]).accepted
    result = solve(problem)
    assert result.status is Status.BLOCKED and check_certificate(problem, result.certificate) is None
    clear = replace(problem, obstacles=())
    assert solve(clear).status is Status.SOLVED


def test_max_step_bounds_the_variables(tmp_path):
    robot = arm(tmp_path, planar(2.0))
    problem = IKProblem(robot, robot.fk([0.3]), q_reference=np.array([0.0]), max_step=0.1)
    assert solve(problem).status is Status.UNREACHABLE
    assert solve(replace(problem, max_step=0.35)).status is Status.SOLVED


def test_queries_of_several_goals_say_that_cidgik_knows_no_couplings(tmp_path):
    robot = arm(tmp_path, coupled_arm(1, joints=6, followers=1, slides=False)[0])
    with pytest.raises(InputError, match="follows another, which cidgik does not know"):
        solve_query(Query(robot, (Goal.posed("tool", robot.fk(robot.home)),)))
