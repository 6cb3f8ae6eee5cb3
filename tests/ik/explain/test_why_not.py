"""Explanations of a "no": each named cause is checked by taking it away, and the closest pose by the judge."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from tests.ik.arms import beads, box, planar
from workcell.errors import InputError
from workcell.geometry.types import SphereCover
from workcell.ik.explain.closest import closest_pose
from workcell.ik.explain.why_not import explain
from workcell.ik.judge.verify import verify
from workcell.ik.problem import IKProblem
from workcell.ik.result import Status
from workcell.ik.solve import solve
from workcell.pose import Pose

ARM = planar()


def at(angles: tuple[float, float]) -> Pose:
    return ARM.fk(np.array(angles))


def on_forearm(angles: tuple[float, float]) -> tuple[float, ...]:
    """Where the middle of the last link is when the tool is at its target."""
    return tuple((at(angles) @ Pose.from_xyz([-0.2, 0.0, 0.0])).position)


def question(target: Pose, *obstacles) -> IKProblem:  # type: ignore[no-untyped-def]
    return IKProblem(ARM, target, tuple(obstacles), beads(ARM))


def test_one_obstacle_in_the_way_is_named_and_its_removal_helps() -> None:
    target = at((0.4, 0.7))
    wall = box("wall", on_forearm((0.4, 0.7)), (0.05, 0.05, 0.05))
    aside = box("aside", (-0.8, -0.8, 0.0), (0.1, 0.1, 0.1))
    problem = question(target, wall, aside)
    result = solve(problem)
    assert result.status is Status.BLOCKED
    why = explain(problem, result)
    assert [str(cause) for cause in why.causes] == ["the obstacle wall"]
    assert why.undecided == 0
    assert why.solution is not None
    assert verify(replace(problem, obstacles=(aside,)), np.array(why.solution)).accepted
    assert "without the obstacle wall" in why.sentence
    assert why.to_json()["without"] == [{"kind": "obstacle", "name": "wall"}]


def test_two_obstacles_that_both_have_to_go_are_both_named() -> None:
    walls = [box(name, on_forearm((0.5, 0.0)), (0.05, 0.05, 0.05)) for name in ("one", "two")]
    problem = replace(
        question(at((0.5, 0.0)), *walls), goal="position"
    )  # stretched: no other way to be there
    why = explain(problem, solve(problem))
    assert {cause.name for cause in why.causes} == {"one", "two"}
    for wall in walls:
        assert not solve(replace(problem, obstacles=(wall,))).solved


def test_a_limit_in_the_way_is_named() -> None:
    tight = replace(ARM, lower=np.array([-1.0, -2.0]), upper=np.array([1.0, 2.0]))
    problem = IKProblem(tight, at((1.5, 0.4)))
    result = solve(problem)
    assert result.status is Status.UNREACHABLE
    why = explain(problem, result)
    assert {cause.kind for cause in why.causes} == {"limits of joint"}
    assert why.causes[0].name == tight.joint_names[0]


def test_what_is_out_of_reach_stays_so_and_the_closest_pose_is_told() -> None:
    problem = IKProblem(ARM, Pose.from_xyz([2.0, 0.0, 0.0]))
    why = explain(problem, solve(problem))
    assert why.causes == ()
    assert "does not help" in why.sentence
    assert why.closest is not None
    assert why.closest.position_error == pytest.approx(2.0 - ARM.reach(), abs=1e-3)


def test_the_closest_pose_is_clear_by_the_judge_and_at_the_wall() -> None:
    target = at((0.0, 0.0))
    wall = box("wall", tuple(target.position), (0.1, 1.0, 1.0))
    problem = question(target, wall)
    found = closest_pose(problem)
    assert found is not None
    assert found.clearance.distance >= 0.0
    free = replace(problem, tolerances=replace(problem.tolerances, position=10.0, rotation=4.0))
    assert verify(free, found.q).accepted
    assert found.position_error < 0.3
    assert "mm and" in found.sentence


def test_only_a_no_can_be_explained() -> None:
    problem = question(at((0.4, 0.7)))
    with pytest.raises(InputError, match="SOLVED"):
        explain(problem, solve(problem))


def test_the_smallest_of_several_sets_is_found() -> None:
    """Two walls in front, and two joints' limits at fault as well: by deletion alone the larger set might be told."""
    tight = replace(ARM, lower=np.array([-1.0, -0.2]), upper=np.array([1.0, 0.2]))
    target = ARM.fk(np.array([1.4, 0.9]))
    walls = [box(name, (-0.9, -0.9, 0.1 * k), (0.05, 0.05, 0.01)) for k, name in enumerate("abc")]
    problem = IKProblem(tight, target, tuple(walls), beads(ARM))
    why = explain(problem, solve(problem))
    assert why.smallest and why.undecided == 0
    for size in range(len(why.causes)):
        for kept in itertools.combinations(why.causes, size):
            fewer = replace(problem, robot=_freed(tight, kept))
            assert not solve(fewer).solved, kept


def _freed(robot, causes):  # type: ignore[no-untyped-def]
    names = {cause.name for cause in causes}
    free = np.array([name in names for name in robot.joint_names])
    lower, upper = np.where(free, -np.pi, robot.lower), np.where(free, np.pi, robot.upper)
    return replace(robot, lower=lower, upper=upper)


def test_two_walls_are_a_smallest_set_and_said_to_be() -> None:
    walls = [box(name, on_forearm((0.5, 0.0)), (0.05, 0.05, 0.05)) for name in ("one", "two")]
    problem = replace(question(at((0.5, 0.0)), *walls), goal="position")
    why = explain(problem, solve(problem))
    assert why.smallest and "(no fewer do)" in why.sentence and why.to_json()["smallest"] is True
    assert "fewer others may do" in replace(why, smallest=False).sentence


def test_a_collision_of_the_robot_with_itself_is_no_obstacle() -> None:
    """A folded arm of three links whose ends meet: nothing else is in the way."""
    robot = planar((0.4, 0.4, 0.4))
    q = np.array([0.0, 2.0944, 2.0944])
    cover = SphereCover(
        np.array([1, 3]), np.array([[0.05, 0.0, 0.0], [0.4, 0.0, 0.0]]), np.full(2, 0.06), "given"
    )
    aside = box("aside", (-2.0, 0.0, 0.0), (0.1, 0.1, 0.1))
    own = np.array([[0, 1]])
    problem = IKProblem(robot, robot.fk(q), (aside,), cover, self_collision=own)
    result = solve(problem)
    assert result.status is Status.BLOCKED and "the robot itself" in result.status.sentence
    why = explain(problem, result)
    assert [cause.kind for cause in why.causes] == ["self-collision"]
    first, second = (robot.link_names[k] for k in (1, 3))
    assert "collision with itself" in why.sentence and first in why.sentence and second in why.sentence
    assert "obstacle" not in why.sentence
