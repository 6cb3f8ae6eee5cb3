"""IKSPARK on robots with slides, on joints that follow others, and on goals that are a part of a pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.coupled_arms import coupled_arm, planar
from tests.ik.arms import beads, box, gantry, random_arm
from tests.ik.lifted_arms import arm as vertical
from tests.ik.lifted_arms import seven_axis
from tests.ik.test_coupled import among_spheres, arm
from workcell.errors import InputError
from workcell.geometry.free_space.pool import NOTHING
from workcell.geometry.types import Piece
from workcell.ik.certificate import Certificate
from workcell.ik.check import check_certificate
from workcell.ik.ikspark.solver import solve_ikspark
from workcell.ik.judge.verify import verify
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.result import Status
from workcell.ik.solve import solve
from workcell.model.robot import Robot
from workcell.pose import Pose

X, Y, Z = np.eye(3)


def lift_and_arm() -> Robot:
    """A mobile manipulator's torso and arm (fetch_description/robots/fetch.urdf): a slide, then seven hinges."""
    offsets = [
        [-0.086875, 0, 0.37743],
        [0.119525, 0, 0.34858],
        [0.117, 0, 0.06],
        [0.219, 0, 0],
        [0.133, 0, 0],
        [0.197, 0, 0],
        [0.1245, 0, 0],
        [0.1385, 0, 0],
    ]
    turn = np.pi
    limits = np.array([0.38615, 1.6056, 1.518, turn, 2.251, turn, 2.16, turn])
    lower = -limits
    lower[0], lower[2] = 0.0, -1.221
    robot = vertical([Z, Z, Y, X, Y, X, Y, X], offsets, lower, limits, Pose.from_xyz([0.16645, 0.0, 0.0]))
    return replace(robot, prismatic=np.arange(8) == 0)


def asked(robot: Robot, seed: int, **more) -> IKProblem:
    rng = np.random.default_rng(seed)
    return IKProblem(robot, robot.fk(robot.random_configuration(rng)), **more)


@pytest.mark.parametrize("seed", range(8))
def test_poses_of_an_arm_on_a_lift_are_reached(seed):
    problem = asked(lift_and_arm(), seed)
    result = solve(problem, "ikspark", Budget(20.0))
    assert result.status is Status.SOLVED and result.solver == "ikspark"
    assert verify(problem, result.q).accepted


def test_what_the_lift_alone_would_reach_is_not_reached_without_it():
    robot = lift_and_arm()
    q = np.zeros(8)
    q[0] = 0.38615
    target = robot.fk(q)
    higher = IKProblem(robot, Pose(target.position + 1.2 * Z, target.quat_wxyz))
    result = solve(higher, "ikspark", Budget(20.0))
    assert result.status is Status.UNREACHABLE
    assert result.certificate.kind == "mechanism/1"
    assert check_certificate(higher, result.certificate) is None
    assert check_certificate(replace(higher, target=target), result.certificate) is not None


@pytest.mark.parametrize("goal", ["position", "axis"])
@pytest.mark.parametrize("sliding", [False, True])
def test_parts_of_poses_agree_with_branch_and_bound(goal, sliding):
    told = set()
    for seed in range(4):
        robot = random_arm(np.random.default_rng(seed), n=4, sliding=sliding)
        problem = asked(robot, seed, goal=goal)
        if seed % 2:  # somewhere at random, half of the time out of reach
            moved = problem.target.position + 1.2 * np.random.default_rng(seed).normal(size=3)
            problem = replace(problem, target=Pose(moved, problem.target.quat_wxyz))
        found = solve(problem, "ikspark", Budget(20.0, effort=0.3))
        truth = solve(problem, "branch", Budget(20.0, effort=2.0))
        told.add(found.status)
        assert found.status in (Status.NOT_FOUND, truth.status)
        if not seed % 2:
            assert found.status is Status.SOLVED and verify(problem, found.q).accepted
    assert Status.SOLVED in told


def test_a_redundant_arm_holds_its_tool_along_an_axis():
    problem = asked(seven_axis(), 3, goal="axis")
    result = solve(problem, "ikspark")
    assert result.solved and result.rotation_error < 1e-6
    tilted = problem.robot.fk(result.q).rotation[:, 2] @ problem.target.rotation[:, 2]
    assert tilted > 1.0 - 1e-9


def test_two_joints_that_turn_alike_reach_their_curve_alone(tmp_path):
    robot = arm(tmp_path, planar())
    on = IKProblem(robot, robot.fk([0.5]))
    assert solve(on, "ikspark").status is Status.SOLVED
    off = IKProblem(robot, robot.uncoupled.fk([0.5, 0.9]))
    result = solve(off, "ikspark", Budget(5.0, effort=0.5))
    assert result.status in (Status.UNREACHABLE, Status.NOT_FOUND)
    assert solve(off, "branch").status is Status.UNREACHABLE


def test_bounds_against_a_reference_are_of_the_variables(tmp_path):
    robot = arm(tmp_path, planar(2.0))
    problem = IKProblem(robot, robot.fk([0.3]), q_reference=np.array([0.0]), max_step=0.35)
    assert solve(problem, "ikspark").status is Status.SOLVED
    short = solve(replace(problem, max_step=0.1), "ikspark", Budget(5.0, effort=0.2))
    assert not short.solved
    beyond = replace(problem, q_reference=np.array([robot.upper[0] + 1.0]), max_step=0.5)
    assert "farther outside the joint limits" in solve_ikspark(beyond, Budget(1.0)).rejected[0]


def test_bounds_on_the_turns_of_links_are_kept():
    robot = lift_and_arm()
    q = robot.random_configuration(np.random.default_rng(5))
    near = np.clip(q + 0.05, robot.lower, robot.upper)
    problem = IKProblem(robot, robot.fk(near), q_reference=q, max_link_rotation=0.6, max_step=0.2)
    result = solve(problem, "ikspark", Budget(20.0))
    assert result.solved and np.abs(result.q - q).max() <= 0.2 + 1e-9


@pytest.mark.parametrize("solver", ["ikspark", "ikspark+cuts"])
def test_a_ball_on_two_slides_goes_around_a_box(solver):
    robot, cover = gantry(0.1)
    wall = box("wall", (0.0, 0.0, 0.0), (0.3, 0.3, 0.3))
    free = IKProblem(robot, Pose.from_xyz([0.6, 0.0, 0.0]), (wall,), cover)
    result = solve(free, solver)
    assert result.solved and result.clearance.distance >= 0.0
    blocked = solve(replace(free, target=Pose.from_xyz([0.35, 0.0, 0.0])), solver, Budget(5.0, effort=0.2))
    assert not blocked.solved


def test_answers_among_obstacles_are_in_regions_of_free_space(tmp_path):
    in_regions = 0
    for seed in range(4):
        robot = arm(tmp_path, coupled_arm(40 + seed, joints=7, followers=1)[0])
        _, problem = among_spheres(robot, np.random.default_rng(seed))
        candidate = solve_ikspark(problem, Budget(20.0), seed)
        assert verify(problem, candidate.q).accepted
        if candidate.cuboids is not None:
            in_regions += 1
            space, centres = (
                candidate.free_space,
                problem.cover.centres_world(robot.link_transforms(candidate.q)),
            )
            for sphere, region in enumerate(candidate.cuboids):
                if 0 <= region < len(space):
                    least = space.lower[region] + problem.cover.radius[sphere] - 1e-9
                    most = space.upper[region] - problem.cover.radius[sphere] + 1e-9
                    assert np.all((least <= centres[sphere]) & (centres[sphere] <= most))
    assert in_regions >= 3


def among_boxes(robot: Robot, seed: int, count: int = 6) -> IKProblem:
    """A planted pose of a robot among boxes that its configuration keeps clear of."""
    rng, cover = np.random.default_rng(seed), beads(robot, 0.05)
    q = robot.random_configuration(rng)
    own = cover.centres_world(robot.link_transforms(q))
    pieces: list[Piece] = []
    while len(pieces) < count:
        centre = own[rng.integers(len(own))] + 0.25 * rng.normal(size=3)
        if np.linalg.norm(own - centre, axis=1).min() > 0.05 + 0.08 * np.sqrt(3.0) + 0.01:
            pieces.append(box(f"box {len(pieces)}", tuple(centre), (0.08, 0.08, 0.08)))
    problem = IKProblem(robot, robot.fk(q), tuple(pieces), cover)
    assert verify(problem, q).accepted
    return problem


def test_an_arm_on_a_lift_finds_its_way_among_boxes_in_regions_or_by_planes():
    for seed in range(5):
        problem = among_boxes(lift_and_arm(), seed)
        result = solve(problem, "ikspark", Budget(20.0))
        assert result.solved and result.solver == "ikspark" and result.cuboids is not None
        # who gives no free space gets planes
        without = replace(problem, grow=lambda points, radii=None: NOTHING)
        for result in (solve(problem, "ikspark+cuts", Budget(20.0)), solve(without, "ikspark", Budget(20.0))):
            assert result.solved and result.cuboids is None


def test_regions_that_are_none_leave_the_rest_of_the_work_to_planes(tmp_path):
    robot = arm(tmp_path, coupled_arm(40, joints=7, followers=1, bent=True)[0])
    _, problem = among_spheres(robot, np.random.default_rng(0))
    without = replace(problem, grow=lambda points, radii=None: NOTHING)
    found = solve_ikspark(without, Budget(30.0))
    assert found.by == "ikspark+cuts" and found.cuboids is None
    assert verify(problem, found.q).accepted


def test_a_relaxation_that_is_empty_by_too_little_is_no_failure_of_the_solver(tmp_path):
    """Off the curve of two joints that turn alike, on its convex hull's outside, by less than tolerances need."""
    robot = arm(tmp_path, planar())
    at = robot.fk([0.5])
    away = Pose(at.position * 1.0003, at.quat_wxyz)
    result = solve(IKProblem(robot, away, goal="position"), "ikspark", Budget(5.0, effort=0.2))
    assert result.status in (Status.NOT_FOUND, Status.UNREACHABLE)


def forged(certificate: Certificate) -> dict[str, Certificate]:
    data = dict(certificate.data)
    return {
        "another question": replace(certificate, problem_hash="0" * 64),
        "a larger margin": replace(certificate, margin=2.0 * certificate.margin),
        "other words": replace(certificate, statement="No configuration is there."),
        "another scope": replace(certificate, scope="model"),
        "no limits": replace(certificate, data={**data, "limits": 0.0 * data["limits"]}),
        "no positions": replace(certificate, data={**data, "positions": 0.0 * data["positions"]}),
        "narrower tolerances": replace(certificate, data={**data, "tolerances": 0.5 * data["tolerances"]}),
        "an array less": replace(certificate, data={k: v for k, v in data.items() if k != "axes"}),
    }


@pytest.mark.parametrize("goal", ["pose", "position", "axis"])
def test_certificates_are_checked_again_and_forged_ones_refused(goal, tmp_path):
    robot = arm(tmp_path, coupled_arm(3, joints=6, followers=1)[0])
    here = robot.fk(robot.home)
    problem = IKProblem(robot, Pose(here.position + 3.0 * X, here.quat_wxyz), goal=goal)
    certificate = solve_ikspark(problem, Budget(10.0)).certificate
    assert certificate is not None and check_certificate(problem, certificate) is None
    again = Certificate.from_json(certificate.to_json())
    assert check_certificate(problem, again) is None
    # the claim forgets what follows what
    for name, one in forged(certificate).items():
        if name == "no limits" and not np.any(certificate.data["limits"]):
            continue
        assert check_certificate(problem, one) is not None, name
    for other in (replace(problem, target=here), replace(problem, max_step=0.1, q_reference=robot.home)):
        assert check_certificate(other, certificate) is not None


def test_local_descent_is_of_the_serial_formulation():
    with pytest.raises(InputError, match="is prismatic"):
        solve_ikspark(asked(lift_and_arm(), 1), Budget(1.0), local=True)
    with pytest.raises(InputError, match="takes whole poses"):
        solve(asked(seven_axis(), 1, goal="position"), "ikspark+lm")
