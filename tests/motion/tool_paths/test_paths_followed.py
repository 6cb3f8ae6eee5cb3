"""Tool paths of every kind, tolerances axis by axis, from end to end: the motion is measured against the path."""

from itertools import pairwise

import numpy as np
import pytest

from workcell.errors import InputError
from workcell.ik.problem import IKProblem
from workcell.ik.result import Status
from workcell.motion.tool_paths.poses import FREE, PathTolerance, arc, circle, line, polyline, through
from workcell.motion.tool_paths.result import FollowLimits, FollowStatus
from workcell.motion.tool_paths.route import route
from workcell.pose import Pose

START = np.array([0.2, 0.5, 0.1, 0.9, -0.2, 0.6, 0.3])
LIMITS = FollowLimits(max_step=0.3, deviation_m=1e-3, deviation_rad=np.deg2rad(0.5))
TURN = Pose([0, 0, 0], [np.cos(0.1), 0, np.sin(0.1), 0])


def knots(begin):
    """Four poses around the first, the tool turned a little from one to the next."""
    places = ([0.05, 0.03, 0.02], [0.08, -0.03, 0.04], [0.04, -0.06, 0.0])
    return (begin, *(Pose.from_xyz(place) @ begin @ TURN for place in places))


def spline(begin):
    return through(knots(begin), 0.01)


def round_arc(begin):
    centre = begin.apply([0.0, 0.0, -0.1])
    return arc(begin, centre, [0.0, 1.0, 0.2], -0.5, 0.01, turning=True)


def whole_circle(begin):
    return circle(begin, begin.apply([0.0, 0.03, 0.03]), begin.rotation[:, 0], 0.01)


PATHS = {
    "line": lambda begin: line(begin, Pose.from_xyz([0.1, -0.08, 0.05]) @ begin, 0.01),
    "arc": round_arc,
    "circle": whole_circle,
    "spline": spline,
    "poses": knots,
    "corners": lambda begin: polyline(knots(begin), 0.02),
}
TOLERANCES = {
    "exact": PathTolerance(),
    "spin": PathTolerance(rotation=(FREE, 0, 0)),
    "box": PathTolerance(position=(2e-3, 0, 1e-3), rotation=(0, 0.05, 0.02)),
    "world": PathTolerance(position=(0, 0, 3e-3), rotation=(0, 0, 0.1), frame="world"),
}


@pytest.fixture(scope="module")
def begin(arm7):
    return arm7.fk(START)


def strayed(poses, tolerance, path, samples=4):
    """Metres and radians by which the tool is beyond its tolerance, at the waypoints and between."""
    worst = np.zeros(2)
    for k, (a, b) in enumerate(pairwise(poses)):
        for u in np.linspace(0.0, 1.0, samples, endpoint=False):
            actual = path.robot.fk(path.at(k + u))
            worst = np.maximum(worst, tolerance.excess(a.interpolate(b, u), actual))
    return worst


@pytest.mark.parametrize("tolerance", TOLERANCES)
@pytest.mark.parametrize("kind", PATHS)
def test_the_tool_is_on_its_path_within_the_tolerance(arm7, begin, kind, tolerance):
    poses, allowed = PATHS[kind](begin), TOLERANCES[tolerance]
    result = route(IKProblem(arm7, begin), poses, START, tolerance=allowed, limits=LIMITS, seed=1)
    assert result.status is FollowStatus.FOLLOWED and result.failure is None
    asked = list(poses)
    if len(result.path) == len(poses):
        metres, radians = strayed(asked, allowed, result.path)
        assert metres < 1.1e-3 and radians < 1.1 * np.deg2rad(0.5)
    at_waypoints = iter(zip(result.path.configurations, result.path.tool_poses, strict=True))
    for pose in asked:
        # waypoints may have been added between the given ones: each given one comes in its turn
        q = next(q for q, near in at_waypoints if max(allowed.excess(pose, near)) < 1e-6)
        assert max(allowed.excess(pose, arm7.fk(q))) < 1e-4
    assert result.path.largest_step <= LIMITS.max_step + 1e-12


def test_a_path_that_stands_still_is_followed(arm7, begin):
    """Segments of no length, and one pose object that comes several times."""
    on = Pose.from_xyz([0.02, 0.0, 0.0]) @ begin
    poses = (begin, begin, *line(begin, on, 0.01), on, *line(on, begin, 0.01), begin)
    result = route(IKProblem(arm7, begin), poses, START, limits=LIMITS)
    assert result.followed and len(result.path) == len(poses)
    assert (
        max(arm7.fk(q).error_to(pose)[0] for q, pose in zip(result.path.configurations, poses, strict=True))
        < 1e-4
    )
    assert route(IKProblem(arm7, begin), line(begin, begin), START, limits=LIMITS).followed


def test_where_the_path_leaves_the_workspace_is_named_with_the_proof(arm7, begin):
    """From any start: the first pose beyond the arm's reach, and the motion up to the one before."""
    outwards = begin.position / np.linalg.norm(begin.position)
    poses = line(begin, Pose.from_xyz(0.7 * outwards) @ begin, 0.05)
    result = route(IKProblem(arm7, begin), poses, limits=FollowLimits(max_step=1.0, deviation_m=0.05))
    failure = result.failure
    assert result.status is FollowStatus.UNREACHABLE and 0 < failure.waypoint < len(poses)
    assert failure.ik.status is Status.UNREACHABLE and failure.ik.certificate.statement in failure.words
    assert failure.pose is poses[failure.waypoint]
    assert f"{failure.fraction:.0%} of the way" in failure.words
    assert result.path.tool_poses[-1].error_to(poses[failure.waypoint - 1])[0] < 1e-9


def test_a_path_whose_first_pose_is_out_of_reach(arm7, begin):
    far = Pose.from_xyz([3.0, 0.0, 0.0]) @ begin
    result = route(IKProblem(arm7, begin), line(far, begin, 0.5), limits=LIMITS)
    assert result.status is FollowStatus.UNREACHABLE and result.failure.waypoint == 0 and result.path is None


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda pose: line(pose, Pose([np.nan, 0, 0], [1, 0, 0, 0])), "finite"),
        (lambda pose: line(pose, Pose([0, 0, 0], [1, 1, 0, 0])), "length 1.41"),
        (lambda pose: line(pose, pose, spacing=-0.1), "spacing"),
        (lambda pose: line(pose, pose, spacing=np.nan), "spacing"),
        (lambda pose: polyline([pose]), "two or more poses, not 1"),
        (lambda pose: PathTolerance(rotation=(0, -0.1, 0)), "zero or more"),
    ],
)
def test_what_is_no_path(begin, make, words):
    with pytest.raises(InputError, match=words):
        make(begin)


def test_one_pose_is_no_path(arm7, begin):
    with pytest.raises(InputError, match="two or more poses, not 1"):
        route(IKProblem(arm7, begin), [begin], START)
