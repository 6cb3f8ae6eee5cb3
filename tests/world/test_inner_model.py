"""Models inside the real geometry: their spheres are in the robot, and their proofs hold of the compiled model."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from workcell.geometry.types import obstacle_name
from workcell.ik.certificate import problem_hash
from workcell.ik.check import check_certificate
from workcell.ik.explain.why_not import explain
from workcell.ik.result import Status
from workcell.ik.solve import solve
from workcell.model.scene import Scene
from workcell.pose import Pose
from workcell.world.inner_model import inner_model
from workcell.world.planning_world import PlanningWorld

CELL = """<mujoco model="cell"><worldbody>
  <body name="block" pos="{x} 0 .5"><geom name="block" type="box" size=".15 .15 .15"/></body>
  <body name="ghost" pos=".5 .5 .5"><geom name="ghost" type="box" size=".1 .1 .1" contype="0" conaffinity="0"/></body>
  <body name="post" pos="0 -.8 .5"><geom name="post" type="box" size=".05 .05 .5"/></body>
  <site name="robot_mount"/>
</worldbody></mujoco>"""


def world_with_block(folder, x: float) -> PlanningWorld:  # type: ignore[no-untyped-def]
    (folder / "cell.xml").write_text(CELL.format(x=x))
    return PlanningWorld.of(Scene.load(folder / "cell.xml", robot="ur10"), overshoot=0.04)


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> PlanningWorld:
    return world_with_block(tmp_path_factory.mktemp("cell"), 0.7)


TARGET = Pose.from_xyz([0.7, 0.0, 0.5])
"""In the middle of the block."""


def test_its_spheres_lie_in_the_links_and_its_obstacles_collide(world: PlanningWorld) -> None:
    model = inner_model(world.scene, world.robot, world.obstacles, world.collision)
    assert model.cover.kind == "inner"
    assert {piece.name for piece in model.obstacles} == {"block", "post"}
    q = np.array(world.robot.start)
    centres = model.cover.centres_world(world.robot.robot.link_transforms(q))
    compiled, data = world.scene.model, mujoco.MjData(world.scene.model)
    data.qpos[:] = world.collision.full_qpos(q)
    mujoco.mj_kinematics(compiled, data)
    ray = np.array([0.36, 0.48, 0.8])
    for centre, radius, name in zip(centres, model.cover.radius, model.cover.source, strict=True):
        geom = compiled.geom(name).id
        # from inside, the surface is at least the radius away in every direction
        for direction in (*np.eye(3), *-np.eye(3), ray, -ray):
            hit = _way_out(compiled, data, geom, centre, direction)
            assert hit >= radius - 1e-6


def _way_out(
    model: mujoco.MjModel, data: mujoco.MjData, geom: int, start: np.ndarray, direction: np.ndarray
) -> float:
    """How far a ray goes until it leaves a geom for good: looked for from far outside, backwards."""
    far = start + 10.0 * direction
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
        back = mujoco.mj_rayMesh(model, data, geom, far, -direction)
    else:
        pose = data.geom_xpos[geom], data.geom_xmat[geom]
        back = mujoco.mju_rayGeom(*pose, model.geom_size[geom], far, -direction, int(model.geom_type[geom]))
    assert back >= 0
    return 10.0 - back


def test_pairs_of_its_own_spheres_are_pairs_that_mujoco_collides(world: PlanningWorld) -> None:
    model = inner_model(world.scene, world.robot, world.obstacles, world.collision)
    collides = {frozenset(pair) for pair in world.collision.pairs}
    owners = [(model.cover.source[a], model.cover.source[b]) for a, b in model.self_pairs]
    assert owners
    assert all(frozenset(pair) in collides for pair in owners)


def test_a_blocked_target_is_blocked_in_reality_and_says_why(world: PlanningWorld) -> None:
    problem = world.problem(TARGET)
    result = solve(problem)
    assert result.status is Status.BLOCKED
    assert result.certificate is not None
    assert check_certificate(problem, result.certificate) is None
    elsewhere = world.problem(Pose.from_xyz([0.7, 0.01, 0.5]))
    assert check_certificate(elsewhere, result.certificate) == "the certificate belongs to another problem"
    open_ = world.relaxed(problem, ["block"])
    claimed = replace(result.certificate, problem_hash=problem_hash(open_.inside()))
    assert "need not penetrate" in str(check_certificate(open_, claimed))
    claimed = replace(result.certificate, problem_hash=problem_hash(problem))
    assert "a sphere or an obstacle that isn't there" in str(check_certificate(problem, claimed))
    why = explain(problem, result)
    assert [cause.name for cause in why.causes] == ["block"]
    assert why.solution is not None
    assert world.clearance(np.array(why.solution)).distance < 0
    assert why.closest is not None
    assert world.clearance(np.array(why.closest.q)).distance >= 0


def test_the_inside_follows_changes_of_the_question(world: PlanningWorld) -> None:
    problem = world.problem(TARGET)
    inside = world.relaxed(problem, ["block"]).inside()
    assert inside is not None
    assert {piece.name for piece in inside.obstacles} == {"post"}
    assert inside.target == TARGET


def test_obstacles_without_a_name_can_be_taken_away(tmp_path) -> None:  # type: ignore[no-untyped-def]
    """A nameless geom of the world, as many cells have them; what else was allowed stays allowed."""
    (tmp_path / "cell.xml").write_text(
        '<mujoco><worldbody><site name="robot_mount"/><geom type="box" pos=".7 0 .5" size=".15 .15 .15"/>'
        '<body name="post" pos="0 -.8 .5"><geom name="post" type="box" size=".05 .05 .5"/></body></worldbody></mujoco>'
    )
    world = PlanningWorld.of(Scene.load(tmp_path / "cell.xml", robot="ur10"), overshoot=0.04)
    problem = world.problem(TARGET)
    box, post = (obstacle_name(piece) for piece in problem.obstacles)
    assert (box, post) == ("world/geom 1 (box)", "post")
    q = world.robot.robot.home
    without_box, without_both = world.relaxed(problem, [box]), world.relaxed(problem, [box, post])
    assert [piece.name for piece in without_box.obstacles] == ["post"]
    assert without_box.checker is not None and without_both.checker is not None
    near = [world.clearance(q).distance, without_box.checker(q).distance, without_both.checker(q).distance]
    assert near == sorted(near)
    ignored = world.collision.ignoring([], [problem.obstacles[0].geom])
    assert not any(box in pair for pair in ignored.pairs)
    assert any("post" in pair for pair in ignored.pairs)
