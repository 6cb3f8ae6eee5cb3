"""What continuous motions reach, against a planar arm whose self-motion is known in closed form."""

from itertools import pairwise

import numpy as np
import pytest

from tests.motion.conftest import make_arm
from workcell.geometry.types import Piece
from workcell.ik.problem import Clearance, IKProblem
from workcell.motion.tool_paths.follow import FollowLimits
from workcell.motion.tool_paths.graph import RouteSearch
from workcell.motion.tool_paths.layers import Sheet
from workcell.motion.tool_paths.poses import FREE, PathTolerance, line
from workcell.motion.tool_paths.result import FollowStatus
from workcell.motion.tool_paths.route import route
from workcell.motion.tool_paths.self_motion import APART
from workcell.motion.tool_paths.starts import all_turns
from workcell.motion.tool_paths.tracker import STILL, LocalTracker
from workcell.pose import Pose

LINK = 0.4
SPIN = PathTolerance(rotation=(0, 0, FREE))
"""Of the planar arm with three joints: one joint to spare."""
BEGIN, END = Pose.from_xyz([0.75, -0.35, 0.0]), Pose.from_xyz([0.75, 0.35, 0.0])
GRID = np.arange(-3.0, 3.0, 0.03)


def closed_form(point):
    """Configurations (2, len(GRID), 3) for each shoulder angle of the grid, elbow to either side; nan where none."""
    x, y = point[0] - LINK * np.cos(GRID), point[1] - LINK * np.sin(GRID)
    with np.errstate(invalid="ignore"):
        bend = np.arccos((x * x + y * y - 2 * LINK**2) / (2 * LINK**2))
    both = []
    for last in (bend, -bend):
        first = np.arctan2(y, x) - np.arctan2(LINK * np.sin(last), LINK + LINK * np.cos(last)) - GRID
        both.append(np.stack([GRID, (first + np.pi) % (2 * np.pi) - np.pi, last], axis=-1))
    return np.array(both)


def oracle(arm, truth, poses, floor, start=None):
    """How many poses a continuous motion gets to, by flooding the closed form; the tool may wait while arms turn."""
    reached = None
    if start is not None:
        reached = np.abs(closed_form(poses[0].position) - start).max(axis=-1) < 0.02
    for count, pose in enumerate(poses):
        q = closed_form(pose.position)
        free = np.isfinite(q).all(axis=-1)
        free[free] = arm.within_limits(q[free])
        free[free] = truth.distances(q[free]) >= floor
        reached = free.copy() if reached is None else reached & free
        if not reached.any():
            return count
        straight = np.abs(q[..., 2]) < 0.25
        while True:
            grown = reached.copy()
            for side in range(2):
                near = np.abs(np.diff(q[side, :, 1])) < 1.0
                grown[side, 1:] |= reached[side, :-1] & near
                grown[side, :-1] |= reached[side, 1:] & near
                grown[side] |= reached[1 - side] & straight[side]
            grown &= free
            if np.array_equal(grown, reached):
                break
            reached = grown
    return len(poses)


def problem_of(planar, cover, truth, poses):
    obstacle = Piece("ball", "sphere", Pose.from_xyz(truth.centre), [truth.radius])
    return IKProblem(planar, poses[0], obstacles=(obstacle,), cover=cover, checker=truth)


def grown(planar, cover, truth, poses, starts, spread, patient=False):
    problem = problem_of(planar, cover, truth, poses)
    tracker = LocalTracker(problem, SPIN, max_step=0.3, aside=STILL)
    sheet = Sheet(tracker, poses, lambda q: truth(q).distance, 0.0, patient)
    sheet.grow(starts, spread=spread)
    for layer in sheet.layers:
        tool = planar.fk_transform(layer.q)[:, :3, 3]
        assert np.abs(tool - layer.pose.position).max() < 1e-6
        assert truth.distances(layer.q).min() >= 0
    return sheet


@pytest.mark.parametrize("seed", [2, 4])
def test_what_is_reached_is_what_the_closed_form_reaches(planar, planar_cover, ball, seed):
    rng = np.random.default_rng(seed)
    poses = line(BEGIN, END, 0.02)
    truth = ball([*rng.uniform([0.1, -0.5], [0.7, 0.5]), 0.0], rng.uniform(0.02, 0.12))
    starts = closed_form(poses[0].position).reshape(-1, 3)
    starts = starts[np.isfinite(starts).all(axis=1)]
    starts = starts[planar.within_limits(starts) & (truth.distances(starts) >= 0)]
    sheet = grown(planar, planar_cover, truth, poses, starts[::7], True)
    assert oracle(planar, truth, poses, 0.02) <= sheet.reached <= oracle(planar, truth, poses, -0.01)


@pytest.mark.parametrize("centre", [[0.35, 0.25], [0.6, 0.3]])
@pytest.mark.parametrize("place", [(1, 80), (1, 100)])
def test_what_is_reached_from_one_start(planar, planar_cover, ball, centre, place):
    poses, truth = line(BEGIN, END, 0.02), ball([*centre, 0.0], 0.06)
    start = closed_form(poses[0].position)[place]
    if not (np.isfinite(start).all() and planar.within_limits(start) and truth.distances(start) > 0.02):
        pytest.skip("no start there")
    sheet = grown(planar, planar_cover, truth, poses, start[None], False, True)
    least, most = (oracle(planar, truth, poses, floor, start) for floor in (0.02, -0.01))
    assert least <= sheet.reached <= most


def test_the_cheapest_motion_is_continuous_and_its_edges_hold(planar, planar_cover, ball):
    truth, poses = ball([0.3, 0.0, 0.0], 0.03), line(BEGIN, END, 0.02)
    start = closed_form(poses[0].position)[0, 60:61]
    sheet = grown(planar, planar_cover, truth, poses, start, True)
    asked = []

    def check(a, b):
        asked.append((a, b))
        return len(asked) % 12 != 0

    motion = sheet.cheapest(check)
    assert sheet.complete and len(motion) == len(sheet.layers)
    assert np.abs(np.diff(motion, axis=0)).max() <= 0.3
    refused = asked[11::12]
    steps = {(a.tobytes(), b.tobytes()) for a, b in pairwise(motion)}
    assert refused and not any((a.tobytes(), b.tobytes()) in steps for a, b in refused)
    elsewhere = sheet.cheapest(lambda a, b: True, begins=lambda q: abs(q[0] - motion[0, 0]) > 0.3)
    assert elsewhere is not None and abs(elsewhere[0, 0] - motion[0, 0]) > 0.3
    prices = np.abs(sheet.layers[0].q - elsewhere[0]).max(axis=1) * 1e6
    assert np.array_equal(sheet.cheapest(lambda a, b: True, prices=prices)[0], elsewhere[0])
    assert sheet.cheapest(lambda a, b: False) is None


def test_the_distance_is_halved_where_a_step_would_be_too_large(planar):
    """Waypoints so far apart that no joint step within the bound leads from one to the next."""
    poses = (BEGIN, END)
    tracker = LocalTracker(IKProblem(planar, BEGIN), SPIN, max_step=0.2, aside=STILL)
    sheet = Sheet(tracker, poses)
    sheet.grow(closed_form(BEGIN.position)[0, 60:61], spread=False)
    assert sheet.complete and len(sheet.layers) > 3
    for before, layer in pairwise(sheet.layers):
        a, b = layer.edges
        assert np.abs(before.q[a] - layer.q[b]).max() <= max(0.2, 1.3 * APART) + 1e-9


def test_a_route_is_found_that_tracking_alone_misses(planar, planar_cover, ball):
    """From this start the elbow would be caught by the ball, unless the arm turns aside before."""
    poses, truth = line(BEGIN, END, 0.02), ball([0.35, 0.25, 0.0], 0.05)
    start = closed_form(poses[0].position)[1, 80]
    problem = problem_of(planar, planar_cover, truth, poses)
    graph = RouteSearch(LocalTracker(problem, SPIN, max_step=0.3), poses, lambda q: truth(q).distance)
    assert not graph.run([start]).complete
    limits = FollowLimits(max_step=0.3, deviation_m=5e-3, deviation_rad=4.0)
    result = route(problem, poses, start, tolerance=SPIN, limits=limits)
    assert result.followed and np.array_equal(result.path.start, start)
    assert truth.distances(result.path.at(np.linspace(0, len(result.path) - 1, 2000))).min() >= 0


def test_the_tool_waits_while_the_arm_turns_where_it_has_to(planar, planar_cover, ball):
    """The ball is so near that there is no time to turn aside on the way."""
    poses, truth = line(BEGIN, END, 0.02), ball([0.6, 0.3, 0.0], 0.05)
    start = closed_form(poses[0].position)[1, 100]
    assert not grown(planar, planar_cover, truth, poses, start[None], False).complete
    limits = FollowLimits(max_step=0.3, deviation_m=5e-3, deviation_rad=4.0)
    problem = problem_of(planar, planar_cover, truth, poses)
    result = route(problem, poses, start, tolerance=SPIN, limits=limits)
    assert result.followed and np.array_equal(result.path.start, start)
    tools = np.stack([pose.position for pose in result.path.tool_poses])
    still = np.linalg.norm(np.diff(tools, axis=0), axis=1) < 1e-6
    moved = np.abs(np.diff(result.path.configurations, axis=0)).max(axis=1)
    assert still.any() and moved[still].min() > 0.01 and np.all(np.diff(tools[:, 1]) > -1e-6)


def test_where_nothing_leads_on_the_failure_says_what_was_looked_through(planar, planar_cover, ball):
    rng = np.random.default_rng(4)
    poses = line(BEGIN, END, 0.02)
    truth = ball([*rng.uniform([0.1, -0.5], [0.7, 0.5]), 0.0], rng.uniform(0.02, 0.12))
    start = closed_form(poses[0].position)[0, 60]
    limits = FollowLimits(max_step=0.3, deviation_m=5e-3, deviation_rad=4.0)
    result = route(
        problem_of(planar, planar_cover, truth, poses), poses, start, tolerance=SPIN, limits=limits
    )
    assert result.status is FollowStatus.NO_CONTINUOUS_MOTION
    row = result.failure.waypoint
    assert oracle(planar, truth, poses, 0.02, start) <= row <= oracle(planar, truth, poses, -0.01, start)
    assert result.failure.fraction == pytest.approx((row - 1) / (len(poses) - 1))
    assert "configurations at" in result.failure.words and f"pose {row} " in result.failure.words
    assert len(result.path) > 1 and np.array_equal(result.path.start, start)
    assert np.linalg.norm(result.path.tool_poses[-1].position - poses[row - 1].position) < 1e-6


def test_whole_turns_within_the_limits():
    arm = make_arm([[0, 0, 1]] * 3, [0.4, 0.4, 0.1], limit=2 * np.pi)
    found = all_turns(arm, [np.array([1.0, -1.0, 0.0])])
    assert len(found) == 2 * 2 * 3
    tools = np.stack([arm.fk_transform(q) for q in found])
    assert np.abs(tools - tools[0]).max() < 1e-12
    assert len({q.tobytes() for q in found}) == 12 and np.all(arm.within_limits(np.stack(found)))


def test_nothing_is_asked_of_a_truth_that_there_is_not(planar):
    poses = line(BEGIN, END, 0.1)
    tracker = LocalTracker(IKProblem(planar, BEGIN, checker=lambda q: Clearance(1.0)), SPIN, max_step=1.0)
    sheet = Sheet(tracker, poses)
    sheet.grow(closed_form(BEGIN.position)[0, 60:61], spread=True)
    assert sheet.complete and sheet.nodes > len(poses)
