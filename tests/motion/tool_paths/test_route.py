"""The global choice: which start leads all the way, and failures that name the place and the reason."""

import numpy as np
import pytest

from tests.motion.conftest import make_arm
from workcell.errors import InputError
from workcell.ik.problem import Clearance, IKProblem
from workcell.motion.tool_paths.graph import RouteSearch, layers_of
from workcell.motion.tool_paths.poses import FREE, PathTolerance, arc, line
from workcell.motion.tool_paths.result import FollowLimits, FollowStatus
from workcell.motion.tool_paths.route import route
from workcell.motion.tool_paths.tracker import STILL, LocalTracker
from workcell.pose import Pose

LIMITS = FollowLimits(max_step=0.3, deviation_m=1e-3)


@pytest.fixture(scope="module")
def elbow():
    """Two links and a wrist in a plane; the elbow bends either way, the shoulder turns by less than to either side."""
    return make_arm([[0, 0, 1]] * 3, [0.4, 0.4, 0.1], limit=2.4)


def flat(arm, q):
    return arm.fk(np.array(q))


def closed_form(arm, pose):
    """Both configurations (2, 3) of the planar arm, elbow up and down."""
    heading = np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0])
    x, y = pose.position[:2] - 0.1 * np.array([np.cos(heading), np.sin(heading)])
    inner = np.arccos((x * x + y * y - 0.32) / 0.32)
    both = []
    for bend in (inner, -inner):
        first = np.arctan2(y, x) - np.arctan2(0.4 * np.sin(bend), 0.4 + 0.4 * np.cos(bend))
        both.append([first, bend, heading - first - bend])
    return np.array(both)


@pytest.fixture(scope="module")
def turning(elbow):
    """The wrist turns on the spot until only one of the two elbows has room for it."""
    start = flat(elbow, [0.4, -1.2, 0.2])
    wrist = elbow.link_transforms(np.array([0.4, -1.2, 0.2]))[3, :3, 3]
    return arc(start, wrist, [0, 0, 1], -1.8, 0.02, turning=True)


def test_the_start_is_chosen_that_leads_to_the_end(elbow, turning):
    both = closed_form(elbow, turning[0])
    search = RouteSearch(LocalTracker(IKProblem(elbow, turning[0]), aside=STILL), turning)
    ways = np.array([closed_form(elbow, pose) for pose in turning])
    inside = [bool(np.all(elbow.within_limits(ways[:, k]))) for k in range(2)]
    assert sorted(inside) == [False, True]
    routes = search.run(both)
    assert [r.start for r in routes.complete] == [inside.index(True)]
    assert np.allclose(routes.complete[0].configurations, ways[:, inside.index(True)], atol=1e-4)
    dead = routes.dead_ends[0]
    beyond = np.flatnonzero(~elbow.within_limits(ways[:, inside.index(False)]))[0]
    assert dead.start == inside.index(False) and dead.waypoint == beyond and "joint limit" in dead.why


def test_a_route_is_followed_and_proved(arm7):
    q = np.array([0.2, 0.5, 0.1, 0.9, -0.2, 0.6, 0.3])
    start = arm7.fk(q)
    poses = line(start, Pose.from_xyz([0.1, -0.1, 0.05]) @ start, 0.02)
    result = route(IKProblem(arm7, start), poses, limits=LIMITS, seed=1)
    assert result.status is FollowStatus.FOLLOWED and result.metrics.largest_step <= 0.3
    for pose, q in zip(result.path.tool_poses, result.path.configurations, strict=True):
        assert arm7.fk(q).error_to(pose)[0] < 1e-4
    again = route(IKProblem(arm7, start), poses, limits=LIMITS, seed=1)
    assert np.array_equal(again.path.configurations, result.path.configurations)
    metrics = result.metrics
    assert metrics.manipulability > 0 and metrics.limit_distance > 0


def test_a_free_axis_is_left_free_from_the_start(arm7):
    q = np.array([0.2, 0.5, 0.1, 0.9, -0.2, 0.6, 0.3])
    start, spin = arm7.fk(q), PathTolerance(rotation=(FREE, 0, 0))
    poses = line(start, Pose.from_xyz([0.05, 0, 0]) @ start, 0.01)
    result = route(IKProblem(arm7, start), poses, q, tolerance=spin, limits=LIMITS)
    assert result.followed and np.array_equal(result.path.start, q)
    for pose, q in zip(poses, result.path.configurations, strict=False):
        assert max(spin.excess(pose, arm7.fk(q))) < 1e-5


def test_a_path_that_leaves_the_workspace_is_named_where_it_does(arm7):
    q = np.array([0.2, 0.3, 0.1, 0.4, -0.2, 0.3, 0.3])
    start = arm7.fk(q)
    outwards = start.position / np.linalg.norm(start.position)
    poses = line(start, Pose.from_xyz(0.6 * outwards) @ start, 0.03)
    result = route(IKProblem(arm7, start), poses, q, limits=FollowLimits(max_step=0.5, deviation_m=0.01))
    assert result.status is FollowStatus.UNREACHABLE and result.path is None
    failure = result.failure
    assert failure.ik.certificate is not None
    assert 0 < failure.waypoint < len(poses) and failure.pose is poses[failure.waypoint]
    assert f"at pose {failure.waypoint} (" in failure.words and "certified" in failure.words


def test_no_continuous_motion_is_told_from_no_configuration(elbow):
    """One end of the path has room for one elbow alone, the other end for the other, the middle for both."""
    middle = np.array([0.6, -1.2, 0.6])
    wrist = elbow.link_transforms(middle)[3, :3, 3]
    here = flat(elbow, middle)
    begin = arc(here, wrist, [0, 0, 1], 2.0, 0.08, turning=True, spacing_rad=0.4)
    poses = (*begin[:0:-1], *arc(here, wrist, [0, 0, 1], -2.0, 0.08, turning=True, spacing_rad=0.4))
    inside = np.array([elbow.within_limits(closed_form(elbow, pose)) for pose in poses])
    assert np.all(inside.any(axis=1)) and not np.any(inside.all(axis=0))
    starts = closed_form(elbow, poses[0])[inside[0]]
    limits = FollowLimits(max_step=0.5, deviation_m=0.05, deviation_rad=0.1)
    result = route(IKProblem(elbow, poses[0]), poses, starts[0], limits=limits)
    assert result.status is FollowStatus.NO_CONTINUOUS_MOTION
    first = int(np.flatnonzero(~inside[:, int(np.flatnonzero(inside[0])[0])])[0])
    assert result.failure.waypoint == first and "joint limit" in result.failure.detail
    assert "No continuous motion was found among" in result.failure.detail
    assert f"pose {first} " in result.tried[0]
    assert result.path.tool_poses[-1] is poses[first - 1] and result.failure.fraction < 1


def test_what_the_truth_forbids_is_no_route(elbow, turning):
    """By the problem's own truth the elbow may not bend downwards; both elbows reach all of these poses."""
    poses = turning[:4]
    assert np.all(elbow.within_limits(np.array([closed_form(elbow, pose) for pose in poses])))

    def truth(q):
        return Clearance(float(q[1]), ("forearm", "elbow down"))

    tracker = LocalTracker(IKProblem(elbow, poses[0], checker=truth), aside=STILL)
    search = RouteSearch(tracker, poses, clear=lambda q: truth(q).distance)
    routes = search.run(closed_form(elbow, poses[0]))
    assert [found.start for found in routes.complete] == [0] and "clearance" in routes.dead_ends[0].why


def test_of_two_routes_the_one_that_begins_nearer_is_taken(elbow):
    poses = arc(flat(elbow, [0.6, -1.2, 0.6]), [0, 0, 0], [0, 0, 1], 0.3, 0.05, turning=True)
    for q in closed_form(elbow, poses[0]):
        result = route(IKProblem(elbow, poses[0]), poses, q_near=q, limits=LIMITS)
        assert result.followed and np.allclose(result.path.start, q, atol=1e-3)


def test_layers_begin_and_end_with_the_path():
    for count in (2, 3, 7, 50, 1000):
        rows = layers_of(count)
        assert rows[0] == 0 and rows[-1] == count - 1 and 2 <= len(rows) <= 25 and np.all(np.diff(rows) > 0)


def test_bad_input(arm7):
    start = arm7.fk(np.zeros(7))
    template = IKProblem(arm7, start)
    with pytest.raises(InputError, match="two or more poses, not 0"):
        route(template, [])
    with pytest.raises(InputError, match=r"tool_poses\[1\]"):
        route(template, [start, None])
    with pytest.raises(InputError, match="not finite"):
        route(template, [start, start], np.full(7, np.nan))
    with pytest.raises(InputError, match="7 joint values"):
        route(template, [start, start], np.zeros(6))
    with pytest.raises(InputError, match="away from the path's first pose"):
        route(template, line(start, Pose.from_xyz([0.1, 0, 0]) @ start), np.full(7, 0.5))
    with pytest.raises(InputError, match="clearance"):
        FollowLimits(clearance=np.nan)


def test_only_starts_that_may_be_one_are_taken(elbow):
    """A line that both elbows can follow: the one that may not begin is passed over; where none may, that is said."""
    start = flat(elbow, [0.3, -1.2, 0.2])
    poses = line(start, Pose.from_xyz([0.05, 0.0, 0.0]) @ start, 0.02)

    def bent(q):
        return bool(q[1] > 0)

    for solver in ("auto", "ikspark"):
        result = route(IKProblem(elbow, start), poses, begins=bent, limits=LIMITS, solver=solver)
        assert result.followed and result.path is not None and bent(result.path.start)
        refused = route(IKProblem(elbow, start), poses, begins=lambda q: False, limits=LIMITS, solver=solver)
        assert refused.status is FollowStatus.NOT_FOUND and refused.failure is not None
        assert "no way was found from where the robot stands" in refused.failure.words
        assert refused.tried and all("no way to it" in words for words in refused.tried)
