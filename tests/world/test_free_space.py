"""A world's queries share a free space that grows; worlds made from it begin with what is free there too."""

import numpy as np
import pytest

from workcell.geometry.free_space.cuboids import holds_spheres
from workcell.geometry.free_space.valid import check_free
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.ik.problem import ITSELF
from workcell.model.scene import Scene
from workcell.motion.tool_paths.poses import line
from workcell.pose import Pose
from workcell.world.planning_world import PlanningWorld


@pytest.fixture(scope="module")
def scene():
    return Scene.load("tasks/machine_tending.toml")


def unheld(world: PlanningWorld) -> np.ndarray:
    """Free points (k, 3) of the workspace that no cuboid of the world holds."""
    points = np.random.default_rng(0).uniform([-0.5, -1, 0], [1.2, 1, 1.5], (2000, 3))
    clear = ObstacleArrays(world.obstacles).distances(points).min(axis=1) > 0.01
    return points[clear & ~world.pool.holds(points, np.zeros(len(points)))]


def test_queries_of_a_world_share_what_one_of_them_adds(scene):
    world = PlanningWorld.of(scene, approached=["blank"])
    first, second = (world.problem(Pose.from_xyz([0.5, 0, z])) for z in (0.5, 0.6))
    before = world.free_space
    assert first.free_space is before and first.grow is not None and second.grow is not None
    free = unheld(world)[:1]
    grown = first.grow(free)
    assert (
        not holds_spheres(before, free, np.zeros(1)).any() and holds_spheres(grown, free, np.zeros(1)).any()
    )
    assert world.free_space is grown and second.grow(np.zeros((0, 3))) is grown
    assert world.problem(first.target).free_space is grown


def test_the_start_is_in_the_free_space_and_every_way_that_is_asked_for(scene):
    world = PlanningWorld.of(scene, approached=["blank"])
    q = world.robot.start + np.array([0.3, 0, 0, 0, 0, 0])
    more = world.with_free_space_around([q])
    moving = world.cover.link > 0
    centres = world.cover.centres_world(world.robot.robot.link_transforms(np.array([world.robot.start, q])))
    held = more.pool.holds(centres[:, moving], world.cover.radius[moving])
    assert held.all() and more.pool is not world.pool


def test_the_hand_is_in_free_space_all_along_a_way_that_is_asked_for(scene):
    world = PlanningWorld.of(scene, approached=["blank"])
    grasp = scene.site_pose("blank/grasp")
    way = line(Pose.from_xyz([0, 0, 0.3]) @ grasp, Pose.from_xyz([0, 0, 0.1]) @ grasp)
    asked = world.with_free_space_along(way)
    tool = world.robot.robot.tool()
    its = world.cover.link == tool.link
    for pose in way:
        centres = (pose @ tool.T_link_tool.inverse()).apply(world.cover.centre[its])
        assert asked.pool.holds(centres, world.cover.radius[its]).all()
    assert asked.pool is not world.pool and world.with_free_space_along(()).free_space is world.free_space


def test_derived_worlds_begin_with_it_and_grow_apart(scene):
    world = PlanningWorld.of(scene, approached=["blank"])
    held = world.holding("blank", Pose.identity())
    assert np.array_equal(held.free_space.lower, world.free_space.lower)
    lifting = held.standing_on(scene.task["posts"])
    assert lifting.free_space is held.free_space
    closer = held.close_to(scene.task["close_up"])
    assert closer.free_space is held.free_space
    post = next(piece for piece in held.obstacles if piece not in lifting.obstacles)
    at = post.pose.position[None]
    lifting.pool.grow(at, np.full(1, 0.01))
    assert lifting.pool.holds(at, [0.01]).all() and not held.pool.holds(at, [0.0]).any()
    check_free(lifting.free_space, lifting.obstacles)
    with pytest.raises(Exception, match="overlaps"):
        check_free(lifting.free_space, held.obstacles)


def test_what_was_left_out_before_is_an_obstacle_to_the_cuboids_again(scene):
    near = PlanningWorld.of(scene, approached=["blank"]).close_to(scene.task["close_up"])
    gone = [p for p in PlanningWorld.of(scene).obstacles if p.geom not in {o.geom for o in near.obstacles}]
    near.pool.grow(np.array([piece.pose.position for piece in gone]), np.full(len(gone), 0.01))
    again = near.holding("blank", Pose.identity())
    assert len(again.free_space) < len(near.free_space)
    check_free(again.free_space, again.obstacles)


def test_questions_about_other_obstacles_or_spheres_have_no_free_space(scene):
    world = PlanningWorld.of(scene)
    problem = world.problem(Pose.from_xyz([0.5, 0, 0.5]))
    inside = problem.inside()
    assert inside is not None
    for other in (world.relaxed(problem, {ITSELF}), inside):
        assert other.free_space is None and other.grow is None
