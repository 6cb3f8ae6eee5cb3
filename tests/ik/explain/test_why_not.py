"""Explanations of a "no": each named cause is checked by taking it away, and the closest pose by the judge."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.ik.arms import beads, box, planar
from workcell.errors import InputError
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
