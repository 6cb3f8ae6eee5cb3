"""The joint-space branch and bound: what it finds, what it proves, and that it never loses a solution."""

import dataclasses

import numpy as np
import pytest

from workcell.bench.ik.soundness import PARTS, try_boxes
from workcell.bench.reference.planting import random_chain
from workcell.errors import InputError
from workcell.geometry.types import Piece, SphereCover
from workcell.ik.branch.chain import joint_box
from workcell.ik.branch.checker.check import check_branch
from workcell.ik.branch.solver import solve_branch
from workcell.ik.judge.verify import verify
from workcell.ik.problem import Budget, IKProblem, Tolerances
from workcell.model.robot import Robot
from workcell.model.serial import serial_robot
from workcell.pose import Pose

BUDGET = Budget(cpu_s=120.0)  # the first query of a process may have to compile


def arm(lower: float = -3.0, upper: float = 3.0) -> Robot:
    """A 7R arm with a spherical shoulder and wrist (S-R-S)."""
    axes = [[0, 0, 1], [0, 1, 0], [0, 0, 1], [0, 1, 0], [0, 0, 1], [0, 1, 0], [0, 0, 1]]
    steps = [0.3, 0.0, 0.0, 0.4, 0.0, 0.4, 0.0]
    joints = [
        {
            "name": f"j{k}",
            "xyz": [0, 0, steps[k]],
            "quat": [1, 0, 0, 0],
            "axis": axes[k],
            "lower": lower,
            "upper": upper,
        }
        for k in range(7)
    ]
    return serial_robot("srs", joints, Pose.from_xyz([0.0, 0.0, 0.1]))


def ur_like(turns: float = 2 * np.pi) -> Robot:
    """A 6R arm with three parallel axes and limits beyond half a turn."""
    axes = [[0, 0, 1], [0, 1, 0], [0, 1, 0], [0, 1, 0], [0, 0, 1], [0, 1, 0]]
    offsets = [[0, 0, 0.13], [0, 0.22, 0], [0, -0.17, 0.61], [0, 0, 0.57], [0, 0.11, 0], [0, 0, 0.12]]
    joints = [
        {
            "name": f"j{k}",
            "xyz": offsets[k],
            "quat": [1, 0, 0, 0],
            "axis": axes[k],
            "lower": -turns,
            "upper": turns,
        }
        for k in range(6)
    ]
    return serial_robot("ur", joints, Pose.from_xyz([0.0, 0.09, 0.0]))


@pytest.mark.parametrize("part", PARTS)
def test_no_contractor_and_no_collision_test_ever_loses_a_planted_solution(part: str) -> None:
    descent = try_boxes(part, 2500, seed=7, robots=(arm(), ur_like()), each=100)
    assert descent.violations == 0, descent.first
    assert descent.boxes == 2500


@pytest.mark.parametrize("robot", [arm(), ur_like()], ids=["7R", "6R"])
def test_reachable_targets_are_reached(robot: Robot) -> None:
    rng = np.random.default_rng(1)
    for _ in range(5):
        problem = IKProblem(robot, robot.fk(rng.uniform(robot.lower, robot.upper)))
        candidate = solve_branch(problem, BUDGET)
        assert candidate.q is not None
        assert verify(problem, candidate.q).accepted


def test_base_pose_is_taken_into_account() -> None:
    base = Pose(np.array([0.4, -0.2, 1.0]), np.array([0.8, 0.0, 0.6, 0.0]))
    robot = dataclasses.replace(arm(), T_world_base=base)
    q = np.array([0.3, 0.9, -0.4, 1.1, 0.2, -0.7, 0.5])
    far = IKProblem(arm(), robot.fk(q + 0.0) @ Pose.from_xyz([0.0, 0.0, 2.0]))
    assert verify(
        IKProblem(robot, robot.fk(q)), solve_branch(IKProblem(robot, robot.fk(q)), BUDGET).q
    ).accepted
    assert solve_branch(far, BUDGET).certificate is not None


def test_out_of_reach_is_proved_by_kinematics_alone() -> None:
    problem = IKProblem(arm(), Pose.from_xyz([1.4, 0.3, 0.4]))
    certificate = solve_branch(problem, BUDGET).certificate
    assert certificate is not None
    assert certificate.scope == "kinematics"
    assert check_branch(problem, certificate) is None


def test_joint_limits_forbid_what_closed_form_says_they_forbid() -> None:
    """The elbow angle of an S-R-S arm follows from the distance of shoulder and wrist alone (law of cosines)."""
    wide = arm()
    q = np.array([0.3, 0.9, -0.4, 1.1, 0.2, -0.7, 0.5])
    target = wide.fk(q)
    for elbow_limit, possible in ((1.15, True), (1.05, False)):
        upper, lower = np.array(wide.upper), np.array(wide.lower)
        upper[3], lower[3] = elbow_limit, -elbow_limit
        problem = IKProblem(dataclasses.replace(wide, upper=upper, lower=lower), target)
        candidate = solve_branch(problem, BUDGET)
        assert (candidate.q is not None) == possible
        assert (candidate.certificate is not None) != possible


def elbow_problem(pieces: tuple[Piece, ...], **changes: object) -> IKProblem:
    """An S-R-S arm whose elbow is a ball of 5 cm; its circle has radius 0.4 sin(45 deg) around the middle."""
    robot = arm()
    target = Pose(
        np.array([0.4 * np.sqrt(2) + 0.1, 0.0, 0.3]), np.array([np.cos(np.pi / 4), 0, np.sin(np.pi / 4), 0])
    )
    cover = SphereCover(np.array([3]), np.array([[0.0, 0.0, 0.4]]), np.array([0.05]))
    return IKProblem(robot, target, pieces, cover, **changes)  # type: ignore[arg-type]


def wall(name: str, y: float, half: float) -> Piece:
    return Piece(name, "box", Pose.from_xyz([0.28, y, 0.3]), np.array([0.2, half, 0.5]))


def test_elbow_circle_between_walls() -> None:
    """The elbow can be anywhere on a circle in the plane x = 0.28; walls block parts of it."""
    halves = (
        Piece(
            "left",
            "halfspace",
            Pose(np.array([0, -0.06, 0]), np.array([np.sqrt(0.5), np.sqrt(0.5), 0, 0])),
            np.zeros(0),
        ),
    )
    assert solve_branch(elbow_problem(halves), BUDGET).q is not None
    blocking = elbow_problem((wall("left", -0.3, 0.3), wall("right", 0.3, 0.3)))
    certificate = solve_branch(blocking, BUDGET).certificate
    assert certificate is not None
    assert certificate.scope == "geometry"
    assert check_branch(blocking, certificate) is None
    gap = elbow_problem((wall("left", -0.4, 0.3), wall("right", 0.4, 0.3)))
    q = solve_branch(gap, BUDGET).q
    assert q is not None
    assert verify(gap, q).accepted


@pytest.mark.parametrize("kind", ["sphere", "capsule", "cylinder", "hull", "halfspace", "box"])
def test_every_kind_of_obstacle_blocks(kind: str) -> None:
    """One convex piece that holds the whole circle of the elbow."""
    sizes = {"sphere": [0.4], "capsule": [0.35, 0.2], "cylinder": [0.5, 0.5], "box": [0.4, 0.4, 0.4]}
    corners = np.array(np.meshgrid([-0.4, 0.4], [-0.4, 0.4], [-0.4, 0.4])).reshape(3, -1).T
    height = 0.8 if kind == "halfspace" else 0.3
    piece = Piece(
        kind, kind, Pose.from_xyz([0.28, 0.0, height]), np.array(sizes.get(kind, [])),
        corners if kind == "hull" else None,
    )  # fmt: skip
    problem = elbow_problem((piece,))
    certificate = solve_branch(problem, BUDGET).certificate
    assert certificate is not None
    assert check_branch(problem, certificate) is None


def test_wanted_clearance_and_scope() -> None:
    walls = (wall("left", -0.4, 0.3), wall("right", 0.4, 0.3))
    tight = elbow_problem(walls, tolerances=Tolerances(safety_margin=0.06))
    certificate = solve_branch(tight, BUDGET).certificate
    assert certificate is not None
    assert certificate.data["clearance"][0] >= 0.06
    assert check_branch(tight, certificate) is None
    modelled = dataclasses.replace(tight, cover=dataclasses.replace(tight.cover, kind="outer"))
    assert solve_branch(modelled, BUDGET).certificate.scope == "model"


def test_same_query_same_answer() -> None:
    problem = elbow_problem((wall("left", -0.4, 0.3), wall("right", 0.4, 0.3)))
    first, second = (solve_branch(problem, BUDGET).q for _ in range(2))
    assert first is not None
    assert np.array_equal(first, second)


def test_no_budget_no_answer() -> None:
    robot = random_chain(np.random.default_rng(3), 7)
    candidate = solve_branch(IKProblem(robot, Pose.from_xyz([0.05, 0.05, 0.05])), Budget(0.0))
    assert candidate.stats["nodes"] <= 500


def test_joint_box_has_one_turn_and_keeps_the_step() -> None:
    robot = ur_like()
    lower, upper = joint_box(IKProblem(robot, Pose.identity()))
    assert np.all(upper - lower >= 2 * np.pi)
    assert np.all(upper - lower < 2 * np.pi + 1e-6)
    near = IKProblem(robot, Pose.identity(), q_reference=np.full(6, 5.0), max_step=0.1)
    lower, upper = joint_box(near)
    assert np.allclose([lower, upper], [np.full(6, 4.9), np.full(6, 5.1)], atol=1e-5)


def test_step_bound_is_kept_and_proved() -> None:
    robot = ur_like()
    q = np.array([4.0, 0.5, 1.0, -4.5, 1.2, 0.3])
    inside = IKProblem(robot, robot.fk(q), q_reference=q + 0.05, max_step=0.1)
    found = solve_branch(inside, BUDGET).q
    assert found is not None
    assert verify(inside, found).accepted
    outside = IKProblem(robot, robot.fk(q), q_reference=q + 0.3, max_step=0.1)
    certificate = solve_branch(outside, BUDGET).certificate
    assert certificate is not None
    assert check_branch(outside, certificate) is None


def test_what_it_does_not_take_is_refused_by_name() -> None:
    robot = arm()
    egg = Piece("egg", "ellipsoid", Pose.identity(), np.array([0.1, 0.2, 0.3]))
    with pytest.raises(InputError, match=r"egg.*ellipsoid"):
        solve_branch(elbow_problem((egg,)), BUDGET)
    bounded = IKProblem(robot, Pose.identity(), q_reference=np.zeros(7), max_link_rotation=0.5)
    with pytest.raises(InputError, match="max_link_rotation"):
        solve_branch(bounded, BUDGET)
