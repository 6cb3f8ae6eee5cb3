"""Following a tool path: continuity, refinement, and failures that say where and why."""

from itertools import pairwise

import numpy as np
import pytest

from tests.motion.local_solver import solve_locally
from workcell.errors import InputError
from workcell.geometry.types import SphereCover
from workcell.ik.problem import Clearance, IKProblem
from workcell.ik.result import IKResult, Status
from workcell.motion.tool_paths.follow import FollowLimits, FollowStatus, follow, line
from workcell.motion.tool_paths.steps import LocalSolver
from workcell.pose import Pose

START = np.array([0.2, 0.5, 0.1, 0.9, -0.2, 0.6, 0.3])


@pytest.fixture(scope="module")
def straight(arm7):
    start = arm7.fk(START)
    return line(start, Pose.from_xyz([0.12, -0.1, 0.05]) @ start, spacing=0.03)


@pytest.fixture(scope="module")
def followed(arm7, straight):
    return follow(IKProblem(arm7, straight[0]), straight, START, solver=solve_locally)


def test_line_spacing_and_ends():
    a = Pose.identity()
    b = Pose([0.1, 0, 0], [np.cos(0.5), np.sin(0.5), 0, 0])
    poses = line(a, b, spacing=0.03, spacing_rad=0.2)
    steps = [p.error_to(q) for p, q in pairwise(poses)]
    assert poses[0] is a and poses[-1] is b
    assert max(s[0] for s in steps) <= 0.03 + 1e-12 and max(s[1] for s in steps) <= 0.2 + 1e-9
    assert np.ptp([s[1] for s in steps]) < 1e-9
    assert len(line(a, b, spacing=1, spacing_rad=10)) == 2
    with pytest.raises(InputError, match="spacing"):
        line(a, b, spacing=0.0)


def test_the_tool_reaches_every_pose_with_bounded_steps(arm7, straight, followed):
    assert followed.status is FollowStatus.FOLLOWED and followed.failure is None
    path = followed.path
    for q, pose in zip(path.configurations, path.tool_poses, strict=True):
        distance, angle = arm7.fk(q).error_to(pose)
        assert distance < 1e-4 and angle < 1e-3
    assert path.largest_step <= 0.2 and np.array_equal(path.start, START)
    asked = {tuple(pose.position) for pose in straight}
    assert asked <= {tuple(pose.position) for pose in path.tool_poses}


def test_each_step_carries_the_continuity_constraint(arm7, straight):
    seen = []

    def solver(problem):
        seen.append(problem)
        return solve_locally(problem)

    limits = FollowLimits(max_step=0.15, max_link_rotation=0.5)
    result = follow(IKProblem(arm7, straight[0]), straight, START, solver=solver, limits=limits)
    assert np.array_equal(seen[0].q_reference, START)
    for problem in seen:
        assert np.all(problem.max_step == 0.15) and problem.max_link_rotation == 0.5
    assert result.path.largest_step <= 0.15


def test_spacing_is_refined_until_the_tool_stays_on_the_line(arm7):
    start = arm7.fk(START)
    end = Pose.from_xyz([0.12, -0.1, 0.05]) @ start
    limits = FollowLimits(max_step=1.0, deviation_m=2e-4)
    result = follow(IKProblem(arm7, start), (start, end), START, solver=solve_locally, limits=limits)
    assert result.followed and len(result.path) > 3
    metres, radians = result.path.tool_deviation()
    assert metres.max() <= 2e-4 and radians.max() <= limits.deviation_rad
    assert result.metrics.deviation_m == metres.max()


def test_metrics_of_a_path_with_a_truth(arm7, straight):
    cover = SphereCover(np.arange(1, 8), np.zeros((7, 3)), np.full(7, 0.05))
    template = IKProblem(arm7, straight[0], checker=lambda q: Clearance(0.5, ("a", "b")))
    followed = follow(template, straight, START, solver=solve_locally, extent=cover)
    metrics = followed.metrics
    assert metrics.clearance_at_waypoints == Clearance(0.5, ("a", "b"))
    assert 0 < metrics.clearance_between < 0.5 and metrics.evaluations >= 1
    assert metrics.waypoints == len(followed.path)


def test_an_unreachable_pose_is_named(arm7):
    start = arm7.fk(START)
    poses = line(start, Pose.from_xyz([3.0, 0, 0]) @ start, spacing=0.3)

    def solver(problem):
        q = solve_locally(problem, attempts=1).q
        return (
            IKResult(Status.SOLVED, "oracle", q) if q is not None else IKResult(Status.UNREACHABLE, "oracle")
        )

    limits = FollowLimits(max_step=3.0, deviation_m=1.0, deviation_rad=4.0)
    result = follow(IKProblem(arm7, start), poses, START, solver=solver, limits=limits)
    assert result.status is FollowStatus.UNREACHABLE
    failure = result.failure
    assert failure.fraction == pytest.approx((failure.waypoint - 1) / (len(poses) - 1))
    assert np.array_equal(failure.pose.position, poses[failure.waypoint].position)
    assert failure.ik.status is Status.UNREACHABLE
    reached = 0 if result.path is None else len(result.path) - 1
    assert failure.waypoint == reached + 1


def test_a_branch_change_is_a_step_too_large(planar):
    """The planar arm is asked for the mirrored elbow at the second pose."""
    first, mirrored = np.array([0.3, 0.9, 0.4]), np.array([0.3 + 0.9, -0.9, 0.4 + 0.9])
    start, end = planar.fk(first), planar.fk(mirrored)

    def solver(problem):
        q = first if problem.target.error_to(start)[0] < problem.target.error_to(end)[0] else mirrored
        if problem.max_step is not None and np.any(np.abs(q - problem.q_reference) > problem.max_step):
            return IKResult(Status.NOT_FOUND, "oracle")
        return IKResult(Status.SOLVED, "oracle", q)

    limits = FollowLimits(max_step=0.5, max_halvings=0)
    result = follow(IKProblem(planar, start), (start, end), first, solver=solver, limits=limits)
    assert result.status is FollowStatus.STEP_TOO_LARGE
    assert "1.8 rad away" in result.failure.detail and result.path is None


def test_a_collision_between_clear_waypoints_is_found(planar, planar_cover, ball):
    a, b = np.array([-0.2, 0, 0]), np.array([0.2, 0, 0])
    truth = ball([1.19, 0.0, 0.0], 0.01)
    assert truth(a).distance > 0 and truth(b).distance > 0
    answers = iter([b])

    def solver(problem):
        return IKResult(Status.SOLVED, "oracle", next(answers))

    limits = FollowLimits(max_step=0.5, deviation_m=1.0, max_halvings=0)
    template = IKProblem(planar, planar.fk(a), cover=planar_cover, checker=truth)
    result = follow(template, (planar.fk(a), planar.fk(b)), a, solver=solver, limits=limits)
    assert result.status is FollowStatus.COLLISION
    assert "arm and ball" in result.failure.detail


def test_blocked_and_not_found_are_told_apart(arm7, straight):
    def solver(status):
        def answer(problem):
            free = problem.cover is None and problem.checker is None
            return solve_locally(problem) if free else IKResult(status, "oracle")

        return answer

    truth = lambda q: Clearance(1.0)  # noqa: E731
    template = IKProblem(arm7, straight[0], checker=truth)
    limits = FollowLimits(max_halvings=0)
    for status, expected in (
        (Status.BLOCKED, FollowStatus.BLOCKED),
        (Status.BLOCKED_IN_MODEL, FollowStatus.BLOCKED_IN_MODEL),
        (Status.NOT_FOUND, FollowStatus.NOT_FOUND),
    ):
        result = follow(template, straight, START, solver=solver(status), limits=limits)
        assert result.status is expected and result.failure.waypoint == 1


def test_a_start_away_from_the_path_is_bad_input(arm7, straight):
    with pytest.raises(InputError, match="away from the path's first pose"):
        follow(IKProblem(arm7, straight[0]), straight, START + 0.1, solver=solve_locally)
    with pytest.raises(InputError, match="two or more poses"):
        follow(IKProblem(arm7, straight[0]), straight[:1], START, solver=solve_locally)
    with pytest.raises(InputError, match="max_step"):
        FollowLimits(max_step=-1.0)


def test_following_is_deterministic(arm7, straight, followed):
    again = follow(IKProblem(arm7, straight[0]), straight, START, solver=solve_locally)
    assert np.array_equal(again.path.configurations, followed.path.configurations)


def test_metrics_without_a_truth(followed):
    metrics = followed.metrics
    assert np.isnan(metrics.clearance_between) and metrics.evaluations == 0


def test_a_tool_that_waits_has_a_proposal_for_each_time_that_its_pose_comes(arm7, straight):
    """The same pose three times, while the arm turns along its self-motion as proposed; then on without proposals."""
    waits = straight[0]
    aside = 0.1 * np.linalg.svd(arm7.jacobian(START))[2][-1]
    turned = [solve_locally(IKProblem(arm7, waits, q_reference=START + k * aside)).q for k in (1, 2)]
    proposed = np.stack([START, *turned])
    problem = IKProblem(arm7, waits)
    followed = follow(
        problem, [waits] * 3 + [straight[1]], START, solver=LocalSolver(problem), proposed=proposed
    )
    assert followed.followed and np.abs(np.diff(proposed, axis=0)).max() > 0.02
    assert np.array_equal(followed.path.configurations[:3], proposed)
