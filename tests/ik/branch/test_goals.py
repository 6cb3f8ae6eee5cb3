"""Branch and bound for position or axis alone, sliding joints, spheres that must not touch, threads and turns."""

import dataclasses

import numpy as np
import pytest

from tests.ik.branch.test_solver import BUDGET, arm, elbow_problem, ur_like, wall
from workcell import clock
from workcell.bench.reference.planting import planted_problem, random_chain
from workcell.errors import InputError
from workcell.geometry.types import Piece, SphereCover
from workcell.ik.branch.checker.check import check_branch, seal, statement
from workcell.ik.branch.solver import BranchSearch, solve_branch
from workcell.ik.judge.verify import verify
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.result import Status
from workcell.ik.solve import solve
from workcell.model.serial import serial_robot
from workcell.pose import Pose


def outward(height: float = 0.3) -> Pose:
    """The S-R-S arm's tool pointing up at a place that it can reach from below, but not with this direction."""
    return Pose.from_xyz([0.85, 0.0, height])


@pytest.mark.parametrize("goal", ["position", "axis"])
def test_goals_that_ask_for_less_are_reached_where_the_pose_is_not(goal: str) -> None:
    robot = arm()
    # Tool along x, 5 cm short of full stretch, then rolled or turned: the pose needs the wrist elsewhere.
    q = np.array([0.4, 1.2, 0.3, 0.5, 0.0, 2.2, 0.0])
    limited = dataclasses.replace(
        robot,
        lower=np.where(np.arange(7) == 6, -0.2, robot.lower),
        upper=np.where(np.arange(7) == 6, 0.2, robot.upper),
    )
    straight = dataclasses.replace(
        limited,
        lower=np.where(np.arange(7) == 4, -0.2, limited.lower),
        upper=np.where(np.arange(7) == 4, 0.2, limited.upper),
    )
    roll = Pose(np.zeros(3), np.array([np.cos(0.5), 0.0, 0.0, np.sin(0.5)]))
    tilt = Pose(np.zeros(3), np.array([np.cos(0.7), 0.0, np.sin(0.7), 0.0]))
    target = straight.fk(q) @ (roll if goal == "axis" else tilt)
    problem = IKProblem(straight, target, goal=goal)  # type: ignore[arg-type]
    result = solve(problem, budget=BUDGET)
    assert result.status is Status.SOLVED
    assert verify(problem, result.q).accepted
    away = straight.fk(result.q).position - target.position
    assert np.linalg.norm(away) < 1e-4
    if goal == "axis":
        assert straight.fk(result.q).rotation[:, 2] @ target.rotation[:, 2] > np.cos(1e-3)


@pytest.mark.parametrize("goal", ["position", "axis"])
def test_goals_that_ask_for_less_can_be_impossible(goal: str) -> None:
    far = IKProblem(arm(), Pose.from_xyz([0.95, 0.0, 0.3]), goal=goal)  # type: ignore[arg-type]
    certificate = solve_branch(far, BUDGET).certificate
    assert certificate is not None
    assert certificate.scope == "kinematics"
    assert check_branch(far, certificate) is None
    as_pose = dataclasses.replace(far, goal="pose")
    assert "another problem" in str(check_branch(as_pose, certificate))


def test_axis_is_forbidden_where_the_position_is_not() -> None:
    """At full stretch the tool can only point outwards."""
    up = IKProblem(arm(), outward(), goal="axis")
    certificate = solve_branch(up, BUDGET).certificate
    assert certificate is not None
    assert check_branch(up, certificate) is None
    assert solve_branch(dataclasses.replace(up, goal="position"), BUDGET).q is not None


def test_a_blocked_position_is_proved() -> None:
    cover = SphereCover(np.array([7]), np.array([[0.0, 0.0, 0.1]]), np.array([0.05]))
    ball = Piece("ball", "sphere", Pose.from_xyz([0.4, 0.0, 0.3]), np.array([0.03]))
    problem = IKProblem(arm(), Pose.from_xyz([0.4, 0.0, 0.3]), (ball,), cover, goal="position")
    certificate = solve_branch(problem, BUDGET).certificate
    assert certificate is not None
    assert certificate.scope == "geometry"
    assert check_branch(problem, certificate) is None


def test_other_solvers_refuse_such_goals() -> None:
    problem = IKProblem(arm(), outward(), goal="position")
    with pytest.raises(InputError, match="whole poses"):
        solve(problem, "hjcd")
    with pytest.raises(InputError, match="unknown goal"):
        IKProblem(arm(), outward(), goal="orientation")  # type: ignore[arg-type]


def gantry():
    """Three sliding joints along x, y, z, then a spherical wrist."""
    axes = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 1], [0, 1, 0], [0, 0, 1]]
    joints = [
        {"name": f"j{k}", "xyz": [0, 0, 0], "quat": [1, 0, 0, 0], "axis": axis,
         "lower": -0.5 if k < 3 else -2.0, "upper": 0.5 if k < 3 else 2.0}
        for k, axis in enumerate(axes)
    ]  # fmt: skip
    robot = serial_robot("gantry", joints, Pose.from_xyz([0.0, 0.0, 0.1]))
    return dataclasses.replace(robot, prismatic=np.arange(6) < 3)


@pytest.mark.parametrize(("x", "possible"), [(0.499, True), (0.502, False)])
def test_a_gantry_reaches_as_far_as_it_slides(x: float, possible: bool) -> None:
    robot = gantry()
    target = Pose.from_xyz([x, 0.2, 0.1]) @ robot.fk(np.array([0, 0, 0, 0.3, 0.5, -0.4]))
    offset = robot.fk(np.array([0, 0, 0, 0.3, 0.5, -0.4])).position
    problem = IKProblem(robot, Pose(np.array([x, 0.2, 0.1]) + offset, target.quat_wxyz))
    candidate = solve_branch(problem, BUDGET)
    if possible:
        assert verify(problem, candidate.q).accepted
    else:
        assert candidate.certificate is not None
        assert check_branch(problem, candidate.certificate) is None


def test_random_arms_with_sliding_joints_reach_what_they_can() -> None:
    rng = np.random.default_rng(5)
    for _ in range(6):
        problem, _ = planted_problem(random_chain(rng, 7, sliding=0.3), rng, edge=0.0)
        candidate = solve_branch(problem, BUDGET)
        assert candidate.certificate is None and candidate.q is not None
        assert verify(problem, candidate.q).accepted


def rail():
    """The S-R-S arm on a rail of one metre along x: eight joints."""
    robot = arm()
    axes = np.vstack([[1.0, 0.0, 0.0], robot.axis])
    joints = [
        {"name": f"j{k}", "xyz": xyz, "quat": [1, 0, 0, 0], "axis": axis,
         "lower": -0.5 if k == 0 else -3.0, "upper": 0.5 if k == 0 else 3.0}
        for k, (axis, xyz) in enumerate(zip(axes, np.vstack([np.zeros(3), robot.joint_xyz]), strict=True))
    ]  # fmt: skip
    return dataclasses.replace(
        serial_robot("rail", joints, robot.tool().T_link_tool), prismatic=np.arange(8) == 0
    )


@pytest.mark.parametrize(("x", "possible"), [(1.35, True), (1.45, False)])
def test_eight_joints_on_a_rail(x: float, possible: bool) -> None:
    """The tool, pointing outwards, reaches 0.9 m beyond the end of the rail at the shoulder's height."""
    outwards = np.array([np.cos(np.pi / 4), 0.0, np.sin(np.pi / 4), 0.0])
    cover = SphereCover(np.array([4]), np.array([[0.0, 0.0, 0.4]]), np.array([0.05]))
    problem = IKProblem(rail(), Pose(np.array([x, 0.0, 0.3]), outwards), (wall("side", 0.4, 0.3),), cover)
    candidate = solve_branch(problem, BUDGET)
    if possible:
        assert verify(problem, candidate.q).accepted
    else:
        assert candidate.certificate is not None
        assert check_branch(problem, candidate.certificate) is None


def folded(pairs: np.ndarray | None) -> IKProblem:
    """The wrist so near the shoulder that upper arm and forearm, spheres of 12 cm, overlap."""
    cover = SphereCover(
        np.array([3, 4]), np.array([[0.0, 0.0, 0.2], [0.0, 0.0, 0.2]]), np.array([0.12, 0.12])
    )
    return IKProblem(arm(), Pose.from_xyz([0.4, 0.0, 0.4]), (), cover, self_collision=pairs)


def test_spheres_that_must_not_touch_block() -> None:
    assert solve_branch(folded(None), BUDGET).q is not None
    problem = folded(np.array([[1, 0]]))
    certificate = solve_branch(problem, BUDGET).certificate
    assert certificate is not None
    assert certificate.scope == "geometry"
    assert np.any(certificate.data["tree"] == -3)
    assert check_branch(problem, certificate) is None
    numbers = {**certificate.data, "blocked": np.zeros_like(certificate.data["blocked"])}
    numbers["seal"] = seal(numbers)
    forged = dataclasses.replace(certificate, data=numbers, statement=statement(numbers))
    assert "may touch" in str(check_branch(problem, forged))


def test_what_touches_is_no_solution() -> None:
    q = solve_branch(folded(None), BUDGET).q
    verdict = verify(folded(np.array([[0, 1]])), q)
    assert not verdict.accepted
    assert "inside" in verdict.reasons[0]
    for wrong in (np.array([[0, 0]]), np.array([[0, 2]]), np.array([0, 1]), np.array([[0.0, 1.0]])):
        with pytest.raises(InputError, match="self_collision"):
            folded(wrong)


def test_two_threads_decide_the_same() -> None:
    blocked = elbow_problem((wall("left", -0.3, 0.3), wall("right", 0.3, 0.3)))
    free = IKProblem(ur_like(), ur_like().fk(np.array([0.3, -1.0, 1.2, 0.4, 0.9, 0.1])))
    for threads in (1, 2):
        budget = Budget(120.0, threads=threads)
        refused, found = solve_branch(blocked, budget), solve_branch(free, budget)
        assert refused.q is None and refused.certificate is not None
        assert check_branch(blocked, refused.certificate) is None
        assert found.q is not None and verify(free, found.q).accepted
    with pytest.raises(InputError, match="threads"):
        Budget(1.0, threads=0)


def test_a_search_goes_on_where_it_stopped() -> None:
    problem = elbow_problem((wall("left", -0.3, 0.3), wall("right", 0.3, 0.3)))
    whole = solve_branch(problem, BUDGET)
    search = BranchSearch(problem)
    candidate = search.run(0.0, BUDGET)
    assert candidate.certificate is None
    assert candidate.stats["boxes_left"] == 1.0
    candidate = search.run(clock.cpu_seconds() + 120.0, BUDGET)
    assert candidate.certificate is not None
    assert candidate.stats["nodes"] == whole.stats["nodes"]
    assert np.array_equal(candidate.certificate.data["tree"], whole.certificate.data["tree"])


def test_what_was_nearly_a_solution_is_told() -> None:
    """Both walls leave a gap a little too narrow for the elbow: the best clearance found is negative."""
    narrow = elbow_problem((wall("left", -0.349, 0.3), wall("right", 0.349, 0.3)))
    stats = solve_branch(narrow, BUDGET).stats
    assert -0.01 < stats["best_excess_clearance_m"] < 0.0
