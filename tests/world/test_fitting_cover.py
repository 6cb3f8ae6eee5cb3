"""Finer spheres where the hand comes close: they still hold the hand, and touch nothing there."""

import numpy as np
import pytest

from tests.geometry.shapes import points_inside
from workcell.geometry.covers.outer import cover_of
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.types import Piece, SphereCover
from workcell.model.scene import Scene
from workcell.motion.tool_paths.poses import line
from workcell.pose import Pose
from workcell.world.fitting_cover import fitting_cover, hand_pieces
from workcell.world.planning_world import PlanningWorld


@pytest.fixture(scope="module")
def bin_world():
    """A hand in a bin with a part between its fingers, and the way out: (world, poses)."""
    scene = Scene.load("tasks/bin_picking.toml")
    grasp = scene.site_pose("block/grasp")
    world = PlanningWorld.of(scene, opening=scene.task["opening"], approached=["block"])
    carrying = world.holding("block", grasp.inverse() @ scene.object_pose("block"))
    up = Pose.from_xyz([0.0, 0.0, scene.task["lift"]]) @ grasp
    return carrying.standing_on(scene.task["floor"]), tuple(line(grasp, up))


def clearances(world, pose, *, radii=True):
    """(m,) metres between the tool link's spheres (or their centres) at a tool pose and the nearest obstacle."""
    tool = world.robot.robot.tool()
    its = world.cover.link == tool.link
    centres = (pose @ tool.T_link_tool.inverse()).apply(world.cover.centre[its])
    return ObstacleArrays(world.obstacles).distances(centres).min(axis=1) - radii * world.cover.radius[its]


def test_spheres_that_touch_on_the_way_are_finer_and_touch_no_more(bin_world):
    world, way = bin_world
    fitted = world.fitting(way)
    assert min(clearances(world, pose).min() for pose in way) < 0
    assert min(clearances(fitted, pose).min() for pose in way) > 0
    assert len(world.cover) < len(fitted.cover) < 5 * len(world.cover)
    assert fitted.pool is world.pool and fitted.obstacles is world.obstacles


def test_every_point_of_the_hand_and_of_what_it_holds_is_in_a_sphere(bin_world):
    world, way = bin_world
    cover = world.fitting(way).cover
    its = cover.link == world.robot.robot.tool().link
    pieces = hand_pieces(world.scene, world.robot, world.attached)
    assert {piece.name for piece in pieces} >= {"block/block", "iiwa14/gripper/finger_left_collision"}
    for piece in pieces:
        points = points_inside(np.random.default_rng(0), piece, 4000)
        apart = np.linalg.norm(points[:, None] - cover.centre[its], axis=2)
        assert np.all((apart <= cover.radius[its] + 1e-9).any(axis=1)), piece.name


def test_other_links_keep_their_spheres_and_their_spheres_the_names_of_their_pieces(bin_world):
    world, way = bin_world
    cover, link = world.fitting(way).cover, world.robot.robot.tool().link
    for before, after in zip(
        (world.cover.centre, world.cover.radius), (cover.centre, cover.radius), strict=True
    ):
        assert np.array_equal(before[world.cover.link < link], after[cover.link < link])
    assert len(cover.source) == len(cover) and "block/block" in cover.source
    assert np.all(cover.overshoot <= world.overshoot + 1e-9)


def test_where_nothing_touches_the_world_is_the_same(bin_world):
    world, _ = bin_world
    high = (Pose.from_xyz([0.4, 0.0, 1.0]),)
    assert world.fitting(high) is world and world.fitting(()) is world


def test_a_pose_that_puts_the_hand_into_an_obstacle_is_not_fitted_to(bin_world):
    world, way = bin_world
    sunk = Pose.from_xyz([0.0, 0.0, -0.05]) @ way[0]
    assert clearances(world, sunk).min() < 0 and world.fitting((sunk,)) is world
    assert len(world.fitting((sunk, *way)).cover) == len(world.fitting(way).cover)


def test_a_large_piece_keeps_the_spheres_that_it_has():
    board = Piece("board", "box", Pose.identity(), np.array([0.5, 0.4, 0.02]))
    shelf = Piece("shelf", "box", Pose.from_xyz([0.0, 0.0, -0.04]), np.array([0.5, 0.4, 0.01]))
    cover = SphereCover(np.array([3]), np.zeros((1, 3)), np.array([0.65]), "outer", np.array([0.63]))
    fitted = fitting_cover(cover, [board], 3, np.eye(4)[None], [shelf])
    assert np.array_equal(fitted.centre, cover.centre)


def test_a_lid_is_refined_where_it_is_near_and_still_held():
    lid = Piece("lid", "box", Pose.from_xyz([0.1, 0.0, 0.05]), np.array([0.2, 0.15, 0.005]))
    wall = Piece("wall", "box", Pose.from_xyz([0.32, 0.0, 0.05]), np.array([0.01, 0.5, 0.5]))
    cover = cover_of([lid], 0.02, link=3)
    fitted = fitting_cover(cover, [lid], 3, np.eye(4)[None], [wall])
    near = ObstacleArrays([wall]).distances
    assert (
        (near(cover.centre)[:, 0] - cover.radius).min()
        < 0
        < (near(fitted.centre)[:, 0] - fitted.radius).min()
    )
    points = points_inside(np.random.default_rng(0), lid, 3000)
    apart = np.linalg.norm(points[:, None] - fitted.centre, axis=2)
    assert np.all((apart <= fitted.radius + 1e-9).any(axis=1))


def test_what_fits_is_not_made_finer_again(bin_world):
    world, way = bin_world
    fitted = world.fitting(way)
    assert fitted.fitting(way) is fitted
