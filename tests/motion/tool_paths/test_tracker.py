"""Local tracking: on the path within its tolerance, within limits, clear, and what it does beside the path."""

import numpy as np
import pytest

from tests.motion.local_solver import solve_locally
from workcell.geometry.types import Piece, SphereCover
from workcell.ik.problem import IKProblem
from workcell.ik.result import IKResult, Status
from workcell.motion.quality import limit_distance, manipulability
from workcell.motion.tool_paths.poses import FREE, PathTolerance, arc, line
from workcell.motion.tool_paths.steps import LocalSolver, Tolerant, starting_poses
from workcell.motion.tool_paths.tracker import STILL, Aside, LocalTracker
from workcell.pose import Pose

START = np.array([0.2, 0.5, 0.1, 0.9, -0.2, 0.6, 0.3])
TOLERANCES = [
    PathTolerance(),
    PathTolerance(rotation=(0, 0, FREE)),
    PathTolerance(rotation=(0, FREE, 0), frame="world"),
    PathTolerance(position=(2e-3, 0, 1e-3), rotation=(0, 0.05, 0)),
    PathTolerance(rotation=(FREE, FREE, FREE)),
]


@pytest.fixture(scope="module")
def straight(arm7):
    start = arm7.fk(START)
    return line(start, Pose.from_xyz([0.12, -0.1, 0.05]) @ start, spacing=0.01)


@pytest.mark.parametrize("tolerance", TOLERANCES, ids=range(len(TOLERANCES)))
def test_every_waypoint_is_on_the_path_to_its_tolerance(arm7, straight, tolerance):
    tracker = LocalTracker(IKProblem(arm7, straight[0]), tolerance, max_step=0.1)
    tracked = tracker.track(straight[1:], START)
    assert tracked.complete and len(tracked.configurations) == len(straight) - 1
    for pose, q in zip(straight[1:], tracked.configurations, strict=True):
        metres, radians = tolerance.excess(pose, arm7.fk(q))
        assert metres < 1e-6 and radians < 1e-6
    steps = np.abs(np.diff(np.vstack([START, tracked.configurations]), axis=0))
    assert steps.max() <= 0.1 and np.all(arm7.within_limits(tracked.configurations))


def test_a_turned_start_needs_no_turning_back(arm7, straight):
    """The tool begins turned by nearly half a turn about its free axis: it stays there."""
    back = Pose([0, 0, 0], [np.cos(1.5), 0, 0, -np.sin(1.5)])
    turned = [pose @ back for pose in straight]
    tracker = LocalTracker(IKProblem(arm7, turned[0]), PathTolerance(rotation=(0, 0, FREE)), aside=STILL)
    tracked = tracker.track(turned[1:], START)
    assert tracked.complete
    assert np.abs(np.diff(np.vstack([START, tracked.configurations]), axis=0)).max() < 0.06


def test_a_tolerance_saves_motion(arm7, straight):
    def travel(tolerance):
        tracked = LocalTracker(IKProblem(arm7, straight[0]), tolerance, aside=STILL).track(
            straight[1:], START
        )
        return np.linalg.norm(np.diff(np.vstack([START, tracked.configurations]), axis=0), axis=1).sum()

    exact, spin, free = (travel(TOLERANCES[k]) for k in (0, 1, 4))
    assert free < spin < exact


def test_motions_beside_the_path_serve_their_purpose(arm7, straight):
    stiff = np.array([0.2, 0.5, 1.6, 0.9, -1.5, 0.6, 0.3])
    bent = line(arm7.fk(stiff), Pose.from_xyz([0.05, 0, 0]) @ arm7.fk(stiff), 0.005)
    problem = IKProblem(arm7, bent[0])
    nimble = LocalTracker(problem, aside=Aside(0.0, 0.2, 0.0)).track(bent[1:], stiff).configurations[-1]
    still = LocalTracker(problem, aside=STILL).track(bent[1:], stiff).configurations[-1]
    assert manipulability(arm7, nimble) > manipulability(arm7, still) * (1 + 5e-4)
    near = np.clip(START + np.eye(7)[2] * 2.75, arm7.lower, arm7.upper)
    poses = line(arm7.fk(near), Pose.from_xyz([0.05, 0, 0]) @ arm7.fk(near), 0.005)
    problem = IKProblem(arm7, poses[0])
    kept = LocalTracker(problem, aside=Aside(0.02, 0.0, 0.0)).track(poses[1:], near).configurations[-1]
    left = LocalTracker(problem, aside=STILL).track(poses[1:], near).configurations[-1]
    assert limit_distance(arm7, kept) > limit_distance(arm7, left) + 0.02


@pytest.fixture(scope="module")
def cover(arm7):
    x = np.array([0.05, 0.2, 0.1, 0.2, 0.1])
    return SphereCover(np.array([2, 2, 3, 4, 5]), np.stack([x, 0 * x, 0 * x], axis=1), np.full(5, 0.05))


def gaps(arm, cover, ball, q):
    centres = cover.centres_world(arm.link_transforms(q))
    return np.linalg.norm(centres - ball.pose.position, axis=-1) - cover.radius - ball.size[0]


def test_the_elbow_keeps_clear_of_a_ball_that_it_would_hit(arm7, straight, cover):
    free = LocalTracker(IKProblem(arm7, straight[0]), aside=STILL).track(straight[1:], START).configurations
    elbow = cover.centres_world(arm7.link_transforms(free[-1]))[3]
    gone = elbow - cover.centres_world(arm7.link_transforms(START))[3]
    ball = Piece("ball", "sphere", Pose.from_xyz(elbow + 0.06 * gone / np.linalg.norm(gone)), [0.03])
    assert gaps(arm7, cover, ball, free).min() < 0 < gaps(arm7, cover, ball, START).min()
    problem = IKProblem(arm7, straight[0], obstacles=(ball,), cover=cover)
    for aside in (STILL, Aside()):
        tracked = LocalTracker(problem, clearance=0.003, aside=aside).track_anyhow(straight[1:], START)
        assert tracked.complete
        assert gaps(arm7, cover, ball, tracked.configurations).min() >= 0.003


def test_own_spheres_are_kept_apart(arm7, straight):
    def apart(q):
        one, two = np.moveaxis(cover.centres_world(arm7.link_transforms(q)), -2, 0)
        return np.linalg.norm(one - two, axis=-1)

    cover = SphereCover(np.array([2, 5]), np.array([[0.1, 0.1, 0.0], [0.0, 0.1, 0.0]]), np.full(2, 0.05))
    free = LocalTracker(IKProblem(arm7, straight[0]), aside=STILL).track(straight[1:], START).configurations
    way, begin = ((straight[1:], START), (straight[-2::-1], free[-1]))[int(apart(START) < apart(free[-1]))]
    radius = 0.25 * float(apart(begin) + min(apart(START), apart(free[-1])))
    grown = SphereCover(cover.link, cover.centre, np.full(2, radius))
    problem = IKProblem(arm7, way[0], cover=grown, self_collision=np.array([[0, 1]]))
    tracked = LocalTracker(problem, aside=STILL).track_anyhow(way, begin)
    ignorant = LocalTracker(IKProblem(arm7, way[0]), aside=STILL).track(way, begin)
    assert tracked.complete and apart(tracked.configurations).min() >= 2 * radius
    assert apart(ignorant.configurations).min() < 2 * radius < apart(begin)


def test_the_reason_names_the_limit(planar):
    q = np.array([0.3, 0.9, 2.8])
    wrist = planar.link_transforms(q)[3, :3, 3]
    poses = arc(planar.fk(q), wrist, [0, 0, 1], 0.5, 0.01, turning=True)  # by the last joint alone
    start = poses[0]
    tracker = LocalTracker(IKProblem(planar, start), aside=STILL)
    tracked = tracker.track(poses[1:], q)
    assert not tracked.complete and tracked.error > 1e-4
    k = len(tracked.configurations)
    why = tracker.why(poses[k + 1], tracked, tracked.configurations[-1] if k else q)
    assert "j2 at the joint limit" in why and "mm from its pose" in why


def test_a_solver_asks_the_rescue_only_where_steps_fail(arm7, straight):
    asked = []

    def rescue(problem):
        asked.append(problem)
        return solve_locally(problem)

    solver = LocalSolver(IKProblem(arm7, straight[0]), rescue=rescue)
    near = IKProblem(arm7, straight[1], q_reference=START, max_step=0.1)
    assert solver(near).solved and not asked and solver.local == 1
    assert solver(IKProblem(arm7, straight[1])).solved and len(asked) == 1 and solver.rescued == 1


def test_a_proposed_configuration_is_taken_where_the_judge_accepts_it(arm7, straight):
    solver = LocalSolver(IKProblem(arm7, straight[0]), rescue=None)
    near = IKProblem(arm7, straight[1], q_reference=START, max_step=0.1)
    own = solver(near).q
    proposed = own + 1e-6
    assert np.array_equal(solver(near, proposed).q, proposed)
    assert np.array_equal(solver(near, START).q, own)  # it has the tool elsewhere


def test_of_the_poses_of_a_tolerance_the_proposed_one_is_asked_for_first(arm7, straight):
    spin, asked = PathTolerance(rotation=(0, 0, FREE)), []

    def solver(problem):
        asked.append(problem.target)
        return solve_locally(problem)

    problem = IKProblem(arm7, straight[0], q_reference=START)
    turned = solve_locally(IKProblem(arm7, straight[0] @ Pose([0, 0, 0], [0.9, 0, 0, np.sqrt(0.19)]))).q
    result = Tolerant(solver, spin)(problem, turned)
    assert result.solved and len(asked) == 1 and max(asked[0].error_to(arm7.fk(turned))) < 1e-3


def test_poses_of_a_tolerance_are_asked_for_until_one_can_be_reached(arm7, straight):
    spin = PathTolerance(rotation=(0, 0, FREE))
    asked, quarter = [], straight[0] @ Pose([0, 0, 0], [np.cos(0.5), 0, 0, np.sin(0.5)])
    assert (
        len(starting_poses(straight[0], spin)) == 4 and len(starting_poses(straight[0], PathTolerance())) == 1
    )

    def solver(problem):
        asked.append(problem.target)
        seen = problem.target.error_to(quarter)[1] < 0.8
        return solve_locally(problem, attempts=0) if seen else IKResult(Status.UNREACHABLE, "oracle")

    problem = IKProblem(arm7, straight[0], q_reference=START)
    assert Tolerant(solver, PathTolerance())(problem).status is Status.UNREACHABLE
    never = Tolerant(lambda _: IKResult(Status.UNREACHABLE, "oracle"), spin)(problem)
    assert never.status is Status.NOT_FOUND
    asked = []
    result = Tolerant(solver, spin)(problem)
    assert len(asked) > 1 and result.solved and max(spin.excess(straight[0], arm7.fk(result.q))) < 2e-3
