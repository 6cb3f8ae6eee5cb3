"""Names change no answer: worlds of models with names dropped at random solve, plan and explain alike."""

import re

import numpy as np
import pytest

from workcell.errors import UnknownNameError
from workcell.geometry.types import obstacle_name
from workcell.ik.explain.why_not import explain
from workcell.ik.problem import Budget
from workcell.ik.result import Status
from workcell.ik.solve import solve
from workcell.model.scene import Scene
from workcell.motion.plans.in_scene import plan_in_world
from workcell.pose import Pose
from workcell.world.planning_world import PlanningWorld

ARM = """
<mujoco><compiler angle="radian"/><worldbody><body name="base"><geom name="foot" type="cylinder" size=".06 .05"/>
<body name="a" pos="0 0 .15"><joint name="j1" axis="0 0 1" range="-3 3"/>
<geom name="hub" type="cylinder" size=".04 .02"/>
<body name="b" pos="0 0 .05"><joint name="j2" axis="0 1 0" range="-2 2"/>
<geom name="upper" type="capsule" fromto="0 0 .08 0 0 .3" size=".03"/>
<body name="c" pos="0 0 .35"><joint name="j3" axis="0 1 0" range="-2.4 2.4"/>
<geom name="fore" type="capsule" fromto=".06 0 0 .3 0 0" size=".025"/><site name="tool" pos=".35 0 0"/>
<body name="bracket" pos=".3 0 0"><geom name="blade" type="box" size=".03 .15 .01"/></body></body></body></body></body>
</worldbody><contact><exclude body1="base" body2="a"/></contact>
<actuator><motor name="m1" joint="j1"/><motor name="m2" joint="j2"/><motor name="m3" joint="j3"/></actuator></mujoco>
"""
CELL = """
<mujoco><worldbody><site name="robot_mount"/>
<body name="block" pos=".45 0 .5"><geom name="block" type="box" size=".1 .1 .1"/></body>
<geom name="wall" type="box" pos="0 .6 .5" size=".5 .02 .5"/>
<body name="wall" pos="0 -.6 .5"><geom name="left" type="box" size=".5 .02 .5"/></body></worldbody></mujoco>
"""
STARTS = ([-1.2, -0.5, 0.3], [1.2, 0.3, 0.4])


def without_names(rng: np.random.Generator, text: str, share: float) -> str:
    """Some names of bodies, geoms and actuators gone; base and a keep theirs, which the contact exclusion uses."""

    def dropped(match: re.Match[str]) -> str:
        keep = match.group(2) in ("base", "a") or rng.random() > share
        return match.group(0) if keep else f"<{match.group(1)}"

    return re.sub(r'<(body|geom|motor) name="([^"]*)"', dropped, text)


def world_of(folder, arm: str, cell: str) -> PlanningWorld:  # type: ignore[no-untyped-def]
    (folder / "arm.xml").write_text(arm)
    (folder / "cell.xml").write_text(cell)
    return PlanningWorld.of(Scene.load(folder / "cell.xml", robot=str(folder / "arm.xml")))


@pytest.mark.parametrize("share", [0.5, 1.0])
def test_answers_and_plans_are_the_same_without_names(tmp_path, share: float) -> None:  # type: ignore[no-untyped-def]
    rng = np.random.default_rng(0)
    named = world_of(tmp_path, ARM, CELL)
    nameless = world_of(tmp_path, without_names(rng, ARM, share), without_names(rng, CELL, share))
    robot, seen = named.robot.robot, set()
    for q in [np.array([0.0, 0.3, -0.4]), *robot.random_configuration(rng, 12)]:
        one, two = (solve(world.problem(robot.fk(q)), budget=Budget(10.0)) for world in (named, nameless))
        assert one.status is two.status
        assert (one.q is None) == (two.q is None) and (one.q is None or np.array_equal(one.q, two.q))
        seen.add(one.status)
    assert seen == {Status.SOLVED, Status.BLOCKED}
    paths = [plan_in_world(world, *map(np.array, STARTS), seed=1) for world in (named, nameless)]
    assert paths[0].path is not None and paths[1].path is not None
    assert np.array_equal(paths[0].path.configurations, paths[1].path.configurations)


def test_explanations_name_what_has_no_name(tmp_path) -> None:  # type: ignore[no-untyped-def]
    cell = CELL.replace('<body name="block"', "<body").replace('<geom name="block"', "<geom")
    world = world_of(tmp_path, ARM, cell)
    problem = world.problem(world.robot.robot.fk(np.array([0.0, 0.3, -0.4])))
    result = solve(problem, budget=Budget(3.0))
    assert result.status is Status.BLOCKED
    assert [cause.name for cause in explain(problem, result).causes] == ["body 1"]


def test_a_body_and_a_geom_of_one_name_are_taken_away_apart(tmp_path) -> None:  # type: ignore[no-untyped-def]
    world = world_of(tmp_path, ARM, CELL)
    problem = world.problem(Pose.from_xyz([0.3, 0.0, 0.6]))
    names = [obstacle_name(piece) for piece in problem.obstacles]
    assert sorted(names) == ["block", "wall", "wall (geom)"]
    at = {"wall (geom)": np.array([1.57, 1.0, -0.6]), "wall": np.array([-1.57, 1.0, -0.6])}
    assert all(world.clearance(q).distance < 0 for q in at.values())
    for gone, q in at.items():
        relaxed = world.relaxed(problem, [gone])
        assert relaxed.checker is not None
        assert sorted(obstacle_name(piece) for piece in relaxed.obstacles) == sorted({*names} - {gone})
        assert {name for name, other in at.items() if relaxed.checker(other).distance < 0} == {*at} - {gone}
        assert relaxed.checker(q).distance > 0


def test_geoms_are_asked_for_by_name_once(tmp_path) -> None:  # type: ignore[no-untyped-def]
    world = world_of(tmp_path, ARM, CELL)
    near = world.close_to(["wall"])
    assert sorted(obstacle_name(piece) for piece in near.obstacles) == ["block", "wall"]
    with pytest.raises(UnknownNameError, match="there is no geom named 'wall \\(geom\\)'"):
        world.close_to(["wall (geom)"])
