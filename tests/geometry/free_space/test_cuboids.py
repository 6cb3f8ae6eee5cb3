import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.geometry.shapes import BOUNDED, points_inside, random_piece
from workcell.errors import InputError, ModelError
from workcell.geometry.covers.outer import robot_cover
from workcell.geometry.decompose import check_base_is_free
from workcell.geometry.free_space.cuboids import (
    GAP,
    biased_seeds,
    inflate_cuboids,
    outermost,
    random_seeds,
    select_cuboids,
)
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.separation import separations, support
from workcell.geometry.types import FreeSpace, Piece
from workcell.model.scene import Scene
from workcell.pose import Pose

BOUNDS = np.array([[-1.0, -1, -1], [1, 1, 1]])


def aligned_box(name, lower, upper):
    lower, upper = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    return Piece(name, "box", Pose.from_xyz((lower + upper) / 2), (upper - lower) / 2)


@given(st.integers(0, 2**32 - 1), st.sampled_from(BOUNDED))
@settings(max_examples=60, deadline=None)
def test_support_is_the_largest_over_the_piece(seed, kind):
    rng = np.random.default_rng(seed)
    piece = random_piece(rng, kind)
    direction = rng.normal(size=(30, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    points = points_inside(rng, piece, 5000)
    largest = (points @ direction.T).max(axis=0)
    found = support(piece, direction)
    assert np.all(found >= largest - 1e-9) and np.all(found - largest < 0.05)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=8, deadline=None)
def test_cuboids_are_free_of_every_kind_of_obstacle(seed):
    rng = np.random.default_rng(seed)
    obstacles = [random_piece(rng, kind, large=0.3, spread=1.0) for kind in BOUNDED for _ in range(3)]
    obstacles.append(Piece("ground", "halfspace", Pose.from_xyz([0, 0, -0.9]), np.zeros(0)))
    free = inflate_cuboids(random_seeds(BOUNDS, 40, seed=seed), obstacles, BOUNDS)
    assert len(free) and free.margin is not None and free.margin.min() >= 0
    assert np.all(free.lower >= BOUNDS[0] - 1e-9) and np.all(free.upper <= BOUNDS[1] + 1e-9)
    for piece in obstacles[:-1]:
        points = points_inside(rng, piece, 2000)[:, None]
        assert not np.any(np.all((points > free.lower) & (points < free.upper), axis=2))
    assert free.lower[:, 2].min() >= -0.9


def test_ten_thousand_pairs_against_coal():
    coal = pytest.importorskip("coal")
    rng = np.random.default_rng(7)
    obstacles = [random_piece(rng, "box", large=0.25, spread=1.0) for _ in range(25)]
    obstacles += [random_piece(rng, "capsule", large=0.2, spread=1.0) for _ in range(15)]
    free = inflate_cuboids(random_seeds(BOUNDS, 330, seed=1), obstacles, BOUNDS)
    pairs = overlaps = 0
    request, result = coal.CollisionRequest(), coal.CollisionResult()
    shapes = [
        coal.Box(*(2 * p.size)) if p.kind == "box" else coal.Capsule(p.size[0], 2 * p.size[1])
        for p in obstacles
    ]
    places = [coal.Transform3s(p.pose.rotation, p.pose.position) for p in obstacles]
    for low, high in zip(free.lower, free.upper, strict=True):
        cuboid, at = coal.Box(*(high - low)), coal.Transform3s(np.eye(3), (low + high) / 2)
        for shape, place in zip(shapes, places, strict=True):
            result.clear()
            pairs += 1
            overlaps += coal.collide(cuboid, at, shape, place, request, result) > 0
    assert overlaps == 0 and pairs >= 10_000


def test_one_wall_stops_the_faces_exactly():
    walls = [
        aligned_box("wall", [0.5, -2, -2], [0.6, 2, 2]),
        aligned_box("board", [-2, -2, 0.3], [0.5, 2, 0.31]),
    ]
    free = inflate_cuboids([[0.0, 0, 0]], walls, BOUNDS)
    assert free.upper[0] == pytest.approx([0.5, 1, 0.3], abs=2e-5)
    assert free.lower[0] == pytest.approx([-1, -1, -1], abs=2e-5)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=8, deadline=None)
def test_no_face_could_go_further(seed):
    """Maximal: every face, pushed out by 2 mm, hits an obstacle or the bounds (boxes, hulls and balls are exact).

    An obstacle counts as hit within GAP of each face, which is at most sqrt(3) GAP along a separating direction.
    """
    rng = np.random.default_rng(seed)
    obstacles = [
        random_piece(rng, kind, large=0.3, spread=0.8) for kind in ("box", "hull", "sphere") for _ in range(3)
    ]
    free = inflate_cuboids(random_seeds(BOUNDS, 5, seed=seed), obstacles, BOUNDS)
    for low, high in zip(free.lower, free.upper, strict=True):
        for axis in range(3):
            for corner, step in ((0, -2e-3), (1, 2e-3)):
                pushed = np.array([low, high])
                pushed[corner, axis] += step
                at_bounds = abs(pushed[corner, axis]) > 1
                margin, _ = separations(pushed[:1], pushed[1:], obstacles)
                assert at_bounds or margin.min() < 3**0.5 * GAP


def test_seeds_in_obstacles_are_skipped_and_counted():
    block = aligned_box("block", [-0.2, -0.2, -0.2], [0.2, 0.2, 0.2])
    free = inflate_cuboids([[0, 0, 0], [0.5, 0, 0], [3, 0, 0]], [block], BOUNDS)
    assert free.skipped_seeds == 2 and len(free) == 1
    assert len(inflate_cuboids([[0, 0, 0]], [block], BOUNDS)) == 0


def test_duplicates_and_contained_cuboids_are_dropped():
    lower = np.array([[0.0, 0, 0], [0, 0, 0], [0.2, 0.2, 0.2], [0.5, 0.5, 0.5]])
    upper = np.array([[1.0, 1, 1], [1, 1, 1], [0.8, 0.8, 0.8], [1.5, 1.5, 1.5]])
    assert sorted(outermost(lower, upper)) == [0, 3]


def test_selection_keeps_what_holds_the_most():
    free = FreeSpace([[0, 0, 0], [2, 0, 0], [0, 0, 0]], [[1, 1, 1], [3, 1, 1], [0.4, 0.4, 0.4]])
    centres = np.array([[[0.5, 0.5, 0.5], [0.7, 0.5, 0.5], [2.5, 0.5, 0.5]]])
    chosen = select_cuboids(free, centres, np.full(3, 0.1), most=5)
    assert len(chosen) == 2 and chosen.lower[0, 0] == 0 and chosen.lower[1, 0] == 2


def test_shelf_cell_is_well_covered():
    scene = Scene.load("shelf_grasp")
    robot = scene.robot()
    from workcell.geometry.free_space.fill import fill_free_space, spheres_held, workspace_box
    from workcell.geometry.pieces import scene_obstacles

    cover = robot_cover(scene.model, robot, overshoot=0.04)
    obstacles = scene_obstacles(scene)
    free = fill_free_space(robot.robot, cover, obstacles, [robot.start])
    assert 1 <= len(free) <= 12
    assert spheres_held(free, robot.robot, cover, obstacles, samples=100, seed=5).in_any >= 0.9
    seeds = biased_seeds(robot.robot, cover, robot.start)
    assert len(seeds) == 2 * len(cover)
    assert np.array_equal(seeds, biased_seeds(robot.robot, cover, robot.start))
    inside = ObstacleArrays(obstacles).distances((free.lower + free.upper) / 2)
    assert inside.min() > 0 and workspace_box(robot.robot).shape == (2, 3)


def test_bad_input_is_named():
    block = aligned_box("block", [-2, -2, -2], [2, 2, 2])
    with pytest.raises(InputError, match=r"workspace lies inside the obstacle 'block'"):
        inflate_cuboids([[0, 0, 0]], [block], BOUNDS)
    with pytest.raises(InputError, match="lower < upper"):
        inflate_cuboids([[0, 0, 0]], [], BOUNDS[::-1])
    with pytest.raises(InputError, match="seeds must be finite"):
        inflate_cuboids([[np.nan, 0, 0]], [], BOUNDS)
    scene = Scene.load("shelf_grasp")
    with pytest.raises(ModelError, match=r"base of sawyer lies inside block"):
        check_base_is_free(scene.robot().robot, [block])
