"""Whose steps a way is made of: those of the planner that is named, within its bounds."""

from dataclasses import replace

import numpy as np
import pytest

from tests.coupled_arms import coupled_arm
from tests.ik.arms import beads
from tests.ik.ikspark.test_by_mechanism import lift_and_arm
from tests.ik.test_coupled import arm
from workcell.errors import InputError, UnknownNameError
from workcell.geometry.types import FreeSpace, Piece, SphereCover
from workcell.ik.observing import observed
from workcell.ik.problem import Clearance, IKProblem
from workcell.ik.registry import is_planned_by
from workcell.ik.result import IKResult, Status
from workcell.ik.solve import solve
from workcell.model.scene import Scene
from workcell.motion.path import Path
from workcell.motion.tool_paths.follow import FollowLimits, FollowStatus, follow, line, steps_of
from workcell.motion.tool_paths.poses import FREE, PathTolerance
from workcell.motion.tool_paths.reach import reach
from workcell.motion.tool_paths.result import Answered
from workcell.motion.tool_paths.route import route
from workcell.motion.tool_paths.steps import LocalSolver, Tolerant
from workcell.pose import Pose
from workcell.world.planning_world import PlanningWorld

LIMITS = FollowLimits(max_step=0.2, max_link_rotation=0.28, clearance=0.002)
ABOUT = PathTolerance(rotation=(0.0, 0.0, FREE))


@pytest.fixture(scope="module")
def world():
    return PlanningWorld.of(Scene.load("circle_trace", robot="iiwa14"))


@pytest.fixture(scope="module")
def here(world):
    return world.robot.robot.fk(world.robot.start)


def sideways(here, turned=0.4):
    """A line of 6 cm on which the tool turns about its own axis."""
    about = Pose(np.zeros(3), [np.cos(0.5 * turned), 0, 0, np.sin(0.5 * turned)])
    return line(here, Pose.from_xyz([0.0, 0.06, 0.0]) @ here @ about)


@pytest.mark.parametrize("planner", ["ikspark", "cidgik"])
@pytest.mark.parametrize("tolerance", [PathTolerance(), ABOUT])
def test_every_step_is_the_convex_planners_and_carries_its_bounds(world, here, planner, tolerance):
    poses, seen = sideways(here), []
    problem = world.problem(poses[0])
    steps = steps_of(planner, problem, tolerance=tolerance, limits=LIMITS)
    with observed(lambda asked, result: seen.append((asked, result))):
        result = follow(problem, poses, world.robot.start, tolerance=tolerance, limits=LIMITS, solver=steps)
    assert result.followed and result.answered.count == len(result.path) - 1
    assert result.answered.by_planner(planner) == result.answered.count
    assert all(is_planned_by(planner, found.solver) for _, found in seen)
    before = result.path.configurations
    for k, (asked, found) in enumerate(seen):
        assert np.array_equal(asked.q_reference, before[k]) and np.array_equal(found.q, before[k + 1])
        assert np.all(asked.max_step == 0.2) and asked.max_link_rotation == 0.28


def test_local_steps_are_autos_and_keep_the_bound_on_links_by_shorter_steps(world, here):
    """The tool turns by 0.1 rad from pose to pose, 0.141 in Frobenius norm: half of that has to do."""
    poses = sideways(here)
    problem = world.problem(poses[0])
    wide, narrow = LIMITS, replace(LIMITS, max_link_rotation=0.1)
    found = {}
    for limits in (wide, narrow):
        steps = steps_of("auto", problem, limits=limits)
        assert isinstance(steps, LocalSolver)
        found[limits] = follow(problem, poses, world.robot.start, limits=limits, solver=steps)
        assert found[limits].followed
        assert found[limits].metrics.largest_link_rotation <= limits.max_link_rotation + 1e-9
    assert found[wide].answered.by == {"local": len(poses) - 1}
    assert found[wide].metrics.largest_link_rotation == pytest.approx(2**1.5 * np.sin(0.05), rel=0.2)
    assert len(found[narrow].path) > len(found[wide].path)


def test_the_turn_of_a_link_in_frobenius_norm(planar):
    """All three links turn with the first joint; the norm of a turn by phi is 2 sqrt(2) sin(phi / 2)."""
    path = Path(planar, np.array([[0.0, 0.2, 0.1], [0.3, 0.2, 0.1], [0.3, 0.2, -0.3]]))
    assert path.largest_link_rotation == pytest.approx(2**1.5 * np.sin(0.2))


@pytest.mark.parametrize("planner", ["auto", "ikspark", "cidgik"])
def test_a_path_ends_in_the_goal_configuration_that_is_known(world, here, planner):
    inward = line(Pose.from_xyz([0.0, 0.1, 0.05]) @ here, Pose.from_xyz([0.0, 0.1, 0.01]) @ here)
    goal = solve(world.problem(inward[-1], q_reference=world.robot.start), planner).unwrap()
    found = reach(world, world.robot.start, [inward], limits=LIMITS, goal=goal, solver=planner)
    assert np.array_equal(found.path.end, goal) and np.array_equal(found.path.start, world.robot.start)
    how = "by way of the goal" if planner == "auto" else "from the goal configuration back to the start"
    assert found.how.startswith(how) and not found.failures
    steps = len(inward) if planner == "auto" else len(found.path)
    assert found.followed.answered.count == steps - 1
    assert found.answered.by_planner(planner) == found.answered.count
    with pytest.raises(InputError, match="away from the path's first pose"):
        reach(world, world.robot.start, [inward], limits=LIMITS, goal=world.robot.start, solver=planner)


def test_a_goal_configuration_without_a_way_is_left_for_one_that_has_one(world, here):
    """The first goal configuration stands at a joint limit, against which the way leads."""
    robot = world.robot.robot
    inward = line(Pose.from_xyz([0.0, 0.1, 0.05]) @ here, Pose.from_xyz([0.0, 0.1, 0.01]) @ here)
    goal = solve(world.problem(inward[-1], q_reference=world.robot.start), "ikspark").unwrap()
    out = follow(
        world.problem(inward[-1]), inward[::-1], goal, solver=steps_of("ikspark", world.problem(here))
    )
    joint = int(np.argmax(np.abs(out.path.end - goal)))
    middle = 0.5 * (goal[joint] + out.path.end[joint])
    side = "upper" if out.path.end[joint] > goal[joint] else "lower"
    limits = np.array(getattr(robot, side))
    limits[joint] = middle
    bent = replace(robot, **{side: limits})
    start = np.clip(world.robot.start, bent.lower, bent.upper)
    narrow = replace(world, robot=replace(world.robot, robot=bent, start=start))
    found = reach(
        narrow, start, [inward], limits=replace(LIMITS, max_halvings=1), goal=goal, solver="ikspark"
    )
    assert found.failures and found.failures[0].startswith("the goal configuration: ")
    assert found.path is not None and not np.allclose(found.path.end, goal)


def test_steps_share_the_free_space_that_one_of_them_has_grown(arm7):
    q = np.array([0.2, 0.5, 0.1, 0.9, -0.2, 0.6, 0.3])
    given, grown = (
        FreeSpace([[0, 0, 0]], [[1, 1, 1]]),
        FreeSpace([[0, 0, 0], [1, 0, 0]], [[1, 1, 1], [2, 1, 1]]),
    )
    seen = []

    def answer(problem):
        seen.append(problem.free_space)
        return IKResult(
            Status.SOLVED, "oracle", solve(replace(problem, cover=None), "auto").q, free_space=grown
        )

    start = arm7.fk(q)
    poses = line(start, Pose.from_xyz([0.0, 0.0, 0.04]) @ start)
    shared = IKProblem(arm7, start, free_space=given, grow=lambda points: grown)
    assert follow(shared, poses, q, solver=answer).followed
    assert seen == [given, grown]
    seen.clear()
    assert follow(replace(shared, grow=None), poses, q, solver=answer).followed
    assert seen == [given, given]


def test_spheres_outside_the_free_space_are_named_with_the_remedy(planar):
    """The hand's sphere is in a cuboid where the step begins, and in none where the path goes."""
    cover = SphereCover(np.array([3]), np.array([[0.4, 0.0, 0.0]]), np.array([0.05]), source=("hand",))
    q = np.array([0.3, 0.9, 0.4])
    start = planar.fk(q)
    far = Pose.from_xyz([0.0, -0.3, 0.0]) @ start
    at = start.position
    space = FreeSpace([at - 0.1], [at + 0.1])
    block = Piece("block", "box", Pose.from_xyz(far.position), np.array([0.1, 0.1, 0.1]))
    problem = IKProblem(
        planar, start, obstacles=(block,), cover=cover, free_space=space, checker=lambda _: Clearance(1.0)
    )
    limits = FollowLimits(max_halvings=0)
    nowhere = follow(problem, [start, far], q, limits=limits, solver=lambda asked: refuse(asked, q))
    assert nowhere.status is FollowStatus.NOT_FOUND
    assert "(hand) lies in no cuboid of the free space at this pose" in nowhere.failure.words
    assert "finer sphere cover" in nowhere.failure.words
    buried = replace(problem, free_space=FreeSpace([far.position - 0.1], [far.position + 0.1]))
    nowhere = follow(buried, [start, far], q, limits=limits, solver=lambda asked: refuse(asked, q))
    assert "no cuboid of the free space where the step begins" in nowhere.failure.words


def refuse(problem, q):
    """Every pose has a configuration without obstacles, and none among them."""
    if problem.cover is None:
        return IKResult(Status.SOLVED, "oracle", q)
    return IKResult(Status.NOT_FOUND, "oracle")


def test_solvers_that_cannot_plan_are_named_with_the_remedy(world, here):
    problem = world.problem(here)
    with pytest.raises(InputError, match=r"branch answers single poses .*ikspark, cidgik or auto"):
        steps_of("branch", problem)
    with pytest.raises(UnknownNameError, match="no planner named 'rrt'"):
        steps_of("rrt", problem)
    with pytest.raises(InputError, match="multistart answers single poses"):
        route(problem, sideways(here), solver="multistart")
    assert isinstance(steps_of("cidgik", problem), Tolerant)


def test_who_answered_in_words():
    mixed = Answered({"ikspark": 12}, 11) + Answered({"local": 1, "ikspark": 1})
    assert mixed.words == "13 by ikspark, 1 local step (11 in cuboids)" and mixed.count == 14
    assert mixed.by_planner("ikspark") == 13 and mixed.by_planner("auto") == 14
    assert Answered({"local": 47}).words == "47 local steps" and Answered().words == ""


@pytest.mark.parametrize("kind", ["lift", "coupled", "bent"])
def test_slides_and_joints_that_follow_others_are_planned_by_ikspark_alone(tmp_path, kind):
    if kind == "lift":
        robot, q = lift_and_arm(), np.array([0.2, 0.3, 0.4, 0.2, 1.0, 0.1, 0.5, 0.2])
    else:
        robot = arm(tmp_path, coupled_arm(9, joints=8, followers=1, bent=kind == "bent")[0])
        half = 0.5 * robot.random_configuration(np.random.default_rng(1))
        q = np.clip(half, robot.lower, robot.upper)
    here = robot.fk(q)
    poses = line(here, Pose.from_xyz([0.0, 0.04, 0.03]) @ here)
    cover = beads(robot.uncoupled, 0.03)
    own = cover.centres_world(robot.link_transforms(q))
    places = own[-1] + 0.25 * np.concatenate([np.eye(3), -np.eye(3)])
    clearest = max(places, key=lambda place: float(np.linalg.norm(own - place, axis=1).min()))
    ball = Piece("ball", "sphere", Pose.from_xyz(clearest), np.array([0.1]))
    problem = IKProblem(robot, poses[0], (ball,), cover)
    limits = FollowLimits(max_step=0.2, max_link_rotation=0.4)
    found = follow(problem, poses, q, limits=limits, solver=steps_of("ikspark", problem, limits=limits))
    assert found.followed and found.answered.by_planner("ikspark") == len(found.path) - 1
    assert found.metrics.largest_link_rotation <= 0.4 + 1e-9
    assert np.abs(np.diff(found.path.configurations, axis=0)).max() <= 0.2 + 1e-9
    for target, there in zip(poses[1:], found.path.configurations[-len(poses) + 1 :], strict=True):
        away, turned = robot.fk(there).error_to(target)
        assert away < 2e-4 and turned < 2e-3
    with pytest.raises(InputError, match=r"auto, .*ikspark"):
        follow(problem, poses, q, limits=limits, solver=steps_of("cidgik", problem, limits=limits))
