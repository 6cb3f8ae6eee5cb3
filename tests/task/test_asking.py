"""What a task plans is recorded: its queries of inverse kinematics, under what they are for, and its worlds."""

from types import SimpleNamespace

import numpy as np
import pytest

from workcell.geometry.types import FreeSpace, SphereCover
from workcell.ik.problem import IKProblem
from workcell.ik.solve import solve
from workcell.model.loading.load import load_robot
from workcell.model.scene import Scene
from workcell.motion.tool_paths.follow import FollowLimits
from workcell.pose import Pose
from workcell.record.read.reader import read
from workcell.record.read.review import review
from workcell.record.write.recording import Recording
from workcell.task.job import Job
from workcell.task.script import TaskFailedError

LIMITS = FollowLimits()


@pytest.fixture(scope="module")
def scene():
    return Scene.load("blocked")


@pytest.fixture(scope="module")
def problem():
    robot = load_robot("ur10")
    return IKProblem(robot, robot.fk(np.array([0.3, -1.1, 1.2, 0.4, 0.9, -0.2])))


@pytest.fixture(scope="module")
def near(scene, problem):
    return world(scene, problem, FreeSpace([[0, 0, 0]], [[1, 1, 1]]))


def world(scene, problem, space):
    """As much of a `PlanningWorld` as planning and recording look at."""
    cover = SphereCover(np.array([0, 1, 2]), np.zeros((3, 3)), np.full(3, 0.05), "outer")
    return SimpleNamespace(
        scene=scene, robot=scene.robot(), cover=cover, free_space=space, problem=lambda _: problem
    )


@pytest.fixture
def job(scene, tmp_path):
    with Recording(tmp_path / "run.rrd", task="work") as recording:
        recording.log_scene(scene)
        yield Job(scene, "auto", "computed_torque", 0, recording, lambda _: None, {}, 0.0)


def recorded(job):
    """What the queries of the finished recording were for, and how many cuboids it holds."""
    file = job.recording.close()
    return [query.what for query in review(file).queries], len(read(file).below("world/free_space"))


def test_queries_are_recorded_under_the_innermost_what(job, problem):
    with job.story.asking("outside"):
        with job.story.asking("inside"):
            solve(problem)
        job.solve(problem, "by the job")
        solve(problem)
    solve(problem)
    assert recorded(job)[0] == ["inside", "by the job", "outside"]


def test_a_query_that_ends_the_task_is_recorded_with_the_one_that_decides_it(job, problem):
    far = IKProblem(problem.robot, Pose.from_xyz([9.0, 0.0, 0.0]))
    with pytest.raises(TaskFailedError, match="UNREACHABLE: far away"):
        job.solve(far, "far away")
    what = recorded(job)[0]
    assert what and set(what) == {"far away"}


def test_worlds_are_recorded_before_what_is_asked_in_them(job, scene, near):
    further = world(scene, None, FreeSpace([[0, 0, 0], [3, 3, 3]], [[1, 1, 1], [4, 4, 4]]))
    for what, worlds in (("there", [near]), ("back", [near]), ("together", [near, further])):
        with job.story.asking(what, *worlds):
            pass
    file = job.recording.close()
    assert len(read(file).below("world/free_space")) == 2
    spheres = [path.rpartition("/")[2] for path in read(file).below("world/robots/ur10/spheres")]
    assert sorted(spheres) == sorted(scene.robot().robot.link_names[:3])


NOTHING = SimpleNamespace(
    path=None,
    proof=None,
    failure=None,
    failures=(),
    tried=(),
    ik=None,
    followed=False,
    detail="none",
    status=SimpleNamespace(value="NOT_FOUND", sentence="None was found."),
)


@pytest.mark.parametrize(
    ("method", "planner", "plan"),
    [
        ("follow", "follow", lambda job, at: job.follow(at, [Pose.identity()], None, LIMITS, "the way")),
        ("trace", "route", lambda job, at: job.trace(at, [Pose.identity()], LIMITS, "the way")),
        ("move", "plan_in_world", lambda job, at: job.move(at, None, None, what="the way")),
        ("reach", "reach", lambda job, at: job.reach(at, None, [], LIMITS, "the way")),
        (
            "carry",
            "carry",
            lambda job, at: job.carry(SimpleNamespace(worlds={"a": at}), [], {}, LIMITS, what="the way"),
        ),
    ],
)
def test_every_way_of_planning_a_path_is_recorded(job, near, problem, monkeypatch, method, planner, plan):
    """The planner asks once and finds nothing: the task ends, and what it asked, and where, is in the recording."""

    def asks_once(*_, **__):
        solve(problem)
        return NOTHING

    monkeypatch.setattr(f"workcell.task.planning.{planner}", asks_once)
    with pytest.raises(TaskFailedError, match="NOT_FOUND: the way"):
        plan(job, near)
    assert recorded(job) == (["the way"], 1), method
