"""A pool of free space: free by linear programs of its own, never less, the same again, and shared with reason."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from tests.geometry.shapes import BOUNDED, points_inside, random_piece
from workcell.errors import InputError
from workcell.geometry.free_space.pool import MOST_CUBOIDS, FreeSpacePool
from workcell.geometry.free_space.valid import check_free, still_free
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.types import FreePolytope, FreeSpace, Piece
from workcell.pose import Array, Pose

BOUNDS = np.array([[-1.0, -1, -1], [1, 1, 1]])


def cell(seed: int, kinds: tuple[str, ...] = ("box", "hull"), each: int = 4) -> list[Piece]:
    rng = np.random.default_rng(seed)
    return [random_piece(rng, kind, large=0.3, spread=0.8) for kind in kinds for _ in range(each)]


def spheres(seed: int, count: int = 12) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    return rng.uniform(-0.9, 0.9, (count, 3)), rng.uniform(0.01, 0.15, count)


def corners_of(piece: Piece) -> Array:
    if piece.kind == "hull":
        assert piece.vertices is not None
        return piece.pose.apply(piece.vertices)
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return piece.pose.apply(signs * piece.size)


def depth(A: Array, b: Array, corners: Array) -> float:
    """How deep {x: A x <= b} and the hull of some corners share a point: a linear program over its weights."""
    k = len(corners)
    found = linprog(
        np.append(np.zeros(k), -1.0),
        A_ub=np.hstack([A @ corners.T, np.ones((len(A), 1))]),
        b_ub=b,
        A_eq=np.append(np.ones(k), 0.0)[None],
        b_eq=[1.0],
        bounds=[(0, None)] * k + [(None, None)],
    )
    assert found.status == 0
    return float(-found.fun)


def planes(space: FreeSpace) -> list[tuple[Array, Array]]:
    axes = np.vstack([np.eye(3), -np.eye(3)])
    cuboids = [(axes, np.concatenate([b, -a])) for a, b in zip(space.lower, space.upper, strict=True)]
    return cuboids + [(p.A, p.b) for p in space.polytopes]


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=4, deadline=None)
def test_nothing_in_a_pool_shares_a_point_with_an_obstacle(seed: int) -> None:
    obstacles = cell(seed)
    pool = FreeSpacePool(obstacles, BOUNDS)
    for part in range(3):
        pool.grow(*spheres(seed + part))
    assert len(pool.free_space)
    for A, b in planes(pool.free_space):
        assert all(depth(A, b, corners_of(piece)) <= 1e-9 for piece in obstacles)
    check_free(pool.free_space, obstacles)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=4, deadline=None)
def test_nothing_in_a_pool_holds_a_point_of_a_curved_obstacle(seed: int) -> None:
    obstacles = cell(seed, BOUNDED, 2)
    pool = FreeSpacePool(obstacles, BOUNDS)
    pool.grow(*spheres(seed, 20))
    rng = np.random.default_rng(seed)
    for A, b in planes(pool.free_space):
        for piece in obstacles:
            assert not np.any(np.all(points_inside(rng, piece, 1000) @ A.T < b - 1e-9, axis=1))


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=6, deadline=None)
def test_every_sphere_that_touches_nothing_is_held_from_then_on(seed: int) -> None:
    obstacles = cell(seed)
    pool, packed = FreeSpacePool(obstacles, BOUNDS), ObstacleArrays(obstacles)
    asked: list[tuple[Array, Array]] = []
    for part in range(3):
        centre, radius = spheres(seed + part)
        pool.grow(centre, radius)
        clear = packed.distances(centre).min(axis=1) > radius + 1e-4
        clear &= (np.abs(centre) + radius[:, None] < 1 - 1e-4).all(axis=1)
        asked.append((centre[clear], radius[clear]))
        assert all(pool.holds(*before).all() for before in asked)


def test_a_sphere_in_a_corner_gets_a_polytope_and_one_with_room_a_cuboid() -> None:
    # a wall through the origin, turned by 45 degrees: a ball can be nearer to it than any aligned cube around the ball
    half = np.sin(np.pi / 8)
    wall = Piece("wall", "box", Pose([0, 0, 0], [np.sqrt(1 - half**2), 0, 0, half]), np.array([0.1, 2, 2]))
    beside = np.array([0.25, 0.25, 0.0]) / np.sqrt(2)
    pool = FreeSpacePool([wall], BOUNDS)
    space = pool.grow([beside], [0.14])
    assert (
        len(space.polytopes) == 1 and space.polytopes[0].holds_spheres(beside[None], np.array([0.14])).all()
    )
    assert len(pool.grow([[0.5, 0.5, 0.0]], [0.1]).polytopes) == 1


def test_what_is_held_adds_nothing_and_the_same_object_comes_back() -> None:
    pool = FreeSpacePool(cell(3), BOUNDS)
    first = pool.grow(*spheres(5))
    assert pool.grow(*spheres(5)) is first and pool.free_space is first
    assert pool.grow(np.zeros((0, 3))) is first
    assert pool.counts.calls == 2 and pool.counts.points == 24 and pool.counts.seeds <= 12


def test_a_point_inside_an_obstacle_or_out_of_bounds_adds_nothing() -> None:
    block = Piece("block", "box", Pose.identity(), np.full(3, 0.2))
    pool = FreeSpacePool([block], BOUNDS, [0.05])
    space = pool.grow([[0.0, 0, 0], [0.1, -0.19, 0.1], [3.0, 0, 0]])
    assert len(space) == 0 and not space.polytopes


def test_where_a_sphere_touches_what_is_free_of_it_is_held() -> None:
    block = Piece("block", "box", Pose.identity(), np.full(3, 0.2))
    pool = FreeSpacePool([block], BOUNDS)
    space = pool.grow([[0.25, 0, 0]], [0.1])
    assert len(space) == 1 and pool.holds([[0.25, 0, 0]], [0.0499]).all() and not space.polytopes
    assert pool.grow([[0.25, 0, 0]], [0.1]) is space


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=3, deadline=None)
def test_the_same_questions_in_the_same_order_make_the_same(seed: int) -> None:
    pools = [FreeSpacePool(cell(seed), BOUNDS, [0.02, 0.1]) for _ in range(2)]
    for part in range(3):
        centre, radius = spheres(seed + part)
        first, second = (pool.grow(centre, None if part == 1 else radius) for pool in pools)
        assert np.array_equal(first.lower, second.lower) and np.array_equal(first.upper, second.upper)
        assert len(first.polytopes) == len(second.polytopes)


def test_without_radii_the_largest_of_the_pools_that_is_free_counts() -> None:
    block = Piece("block", "box", Pose.identity(), np.full(3, 0.2))
    pool = FreeSpacePool([block], BOUNDS, [0.05, 0.1])
    pool.grow([[0.28, 0, 0], [0.5, 0, 0]])
    assert pool.holds([[0.28, 0, 0], [0.5, 0, 0]], [0.05, 0.1]).all()


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=3, deadline=None)
def test_a_pool_among_other_obstacles_begins_with_what_is_free_of_them_and_is_its_own(seed: int) -> None:
    obstacles, (centre, radius) = cell(seed), spheres(seed)
    pool = FreeSpacePool(obstacles, BOUNDS)
    space = pool.grow(centre, radius)
    fewer = pool.among(obstacles[1:])
    assert fewer.free_space is space
    more = pool.among([*obstacles, *cell(seed + 1)])
    for A, b in planes(more.free_space):
        assert all(depth(A, b, corners_of(piece)) <= 1e-9 for piece in more.obstacles)
    fewer.grow(*spheres(seed + 1))
    assert pool.free_space is space


def test_a_pool_that_is_full_grows_no_more() -> None:
    pool = FreeSpacePool(cell(2), BOUNDS)
    middle = np.random.default_rng(0).uniform(-0.9, 0.9, (MOST_CUBOIDS, 3))
    pool._space = FreeSpace(middle - 1e-4, middle + 1e-4)
    assert pool.grow(*spheres(1)) is pool._space


@pytest.mark.parametrize(
    "points, radii",
    [
        ([[0.0, 0]], None),
        ([[0, 0, np.nan]], None),
        ([[0, 0, 0]], [0.1, 0.2]),
        ([[0, 0, 0]], [-0.1]),
        ([["x", 0, 0]], None),
        ([[0, 0, 0]], [np.inf]),
    ],
)
def test_points_that_are_none_are_refused(points: list, radii: list | None) -> None:
    with pytest.raises(InputError, match="points"):
        FreeSpacePool([], BOUNDS).grow(points, radii)


# ---- free space of another scene -------------------------------------------------------------------------------------


def test_free_space_of_another_scene_is_refused_with_the_cuboid_and_the_obstacle() -> None:
    block = Piece("block", "box", Pose.from_xyz([0.3, 0, 0]), np.full(3, 0.1))
    space = FreeSpace([[-0.5] * 3, [0.35, -0.05, -0.05]], [[-0.1] * 3, [0.6, 0.05, 0.05]])
    with pytest.raises(InputError, match="cuboid 1 overlaps the obstacle 'block'") as refused:
        check_free(space, [block])
    assert "inflate_cuboids" in str(refused.value.remedy)
    check_free(FreeSpace([[-0.5] * 3], [[-0.1] * 3]), [block])
    kept = still_free(space, [block])
    assert len(kept) == 1 and kept.upper[0] == pytest.approx([-0.1] * 3)
    slope = np.array([1.0, 1, 0]) / np.sqrt(2)
    roof = FreePolytope(np.vstack([np.eye(3), -np.eye(3), slope]), np.array([0.5] * 6 + [0.3]), 0.0)
    with pytest.raises(InputError, match="polytope 0 overlaps"):
        check_free(FreeSpace(np.zeros((0, 3)), np.zeros((0, 3)), polytopes=(roof,)), [block])


@given(st.integers(0, 2**32 - 1), st.sampled_from(BOUNDED))
@settings(max_examples=25, deadline=None)
def test_it_is_refused_exactly_where_a_cuboid_holds_a_point_of_an_obstacle(seed: int, kind: str) -> None:
    rng = np.random.default_rng(seed)
    piece = random_piece(rng, kind, large=0.3)
    middle, half = rng.uniform(-0.6, 0.6, 3), rng.uniform(0.05, 0.3, 3)
    points = points_inside(rng, piece, 4000)
    inside = bool(np.any(np.all(np.abs(points - middle) < half - 1e-5, axis=1)))
    near = bool(np.any(np.all(np.abs(points - middle) < half + 0.05, axis=1)))
    space = FreeSpace([middle - half], [middle + half])
    try:
        check_free(space, [piece])
    except InputError:
        assert near
    else:
        assert not inside


def test_a_cuboid_below_the_ground_is_refused() -> None:
    ground = Piece("ground", "halfspace", Pose.from_xyz([0, 0, -0.1]), np.zeros(0))
    check_free(FreeSpace([[-1, -1, -0.1]], [[1, 1, 1]]), [ground])
    with pytest.raises(InputError, match="'ground'"):
        check_free(FreeSpace([[-1, -1, -0.2]], [[1, 1, 1]]), [ground])
