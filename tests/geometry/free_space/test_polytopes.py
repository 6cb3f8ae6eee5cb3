"""Polytopes of free space: largest ellipsoids by closed forms, planes against samples, proofs against points."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.geometry.shapes import BOUNDED, points_inside, random_piece
from workcell.errors import InputError
from workcell.geometry.free_space.cuboids import inflate_cuboids
from workcell.geometry.free_space.ellipsoid import Ellipsoid, facing, largest_ellipsoid
from workcell.geometry.free_space.polytopes import inflate_polytope
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.separation import support, support_point
from workcell.geometry.types import FreePolytope, Piece
from workcell.pose import Pose, quat_to_matrix

BOUNDS = np.array([[-1.0, -1, -1], [1, 1, 1]])


def turned(rng: np.random.Generator) -> np.ndarray:
    quat = rng.normal(size=4)
    return quat_to_matrix(quat / np.linalg.norm(quat))


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_the_largest_ellipsoid_in_a_turned_box_is_the_one_with_its_half_sizes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    half, rotation, middle = rng.uniform(0.05, 2.0, 3), turned(rng), rng.normal(size=3)
    A = np.vstack([np.eye(3), -np.eye(3)]) @ rotation.T
    found = largest_ellipsoid(A, A @ middle + np.concatenate([half, half]))
    assert found.volume == pytest.approx(4 / 3 * np.pi * np.prod(half), rel=1e-5)
    assert found.centre == pytest.approx(middle, abs=1e-4)
    assert found.shape @ found.shape.T == pytest.approx((rotation * half**2) @ rotation.T, abs=1e-3)


def test_the_largest_ellipsoid_in_a_tetrahedron_has_its_share_of_the_volume() -> None:
    corners = np.array([[0.0, 0, 0], [1, 0.2, 0], [0.3, 1.5, 0.1], [0.2, 0.4, 0.9]])
    A, b = [], []
    for k in range(4):
        face = np.delete(corners, k, axis=0)
        normal = np.cross(face[1] - face[0], face[2] - face[0])
        normal *= -np.sign(normal @ (corners[k] - face[0])) / np.linalg.norm(normal)
        A.append(normal)
        b.append(normal @ face[0])
    volume = abs(np.linalg.det(corners[1:] - corners[0])) / 6
    # an affine map makes it regular: the ball in a regular tetrahedron fills pi / (6 sqrt 3) of it
    assert largest_ellipsoid(np.array(A), np.array(b)).volume == pytest.approx(
        volume * np.pi / (6 * np.sqrt(3)), rel=1e-5
    )


def test_an_empty_polytope_is_refused() -> None:
    A = np.vstack([np.eye(3), -np.eye(3)])
    with pytest.raises(InputError, match="empty or flat"):
        largest_ellipsoid(A, np.array([-1.0, 1, 1, 0.5, 1, 1]))


@given(st.integers(0, 2**32 - 1), st.sampled_from(BOUNDED))
@settings(max_examples=60, deadline=None)
def test_a_farthest_point_reaches_the_support_and_is_of_the_piece(seed: int, kind: str) -> None:
    rng = np.random.default_rng(seed)
    piece, direction = random_piece(rng, kind), rng.normal(size=3)
    point = support_point(piece, direction)
    assert direction @ point == pytest.approx(float(support(piece, direction)), abs=1e-9)
    assert ObstacleArrays([piece]).distances(point)[0] <= 1e-9


@given(st.integers(0, 2**32 - 1), st.sampled_from(BOUNDED))
@settings(max_examples=60, deadline=None)
def test_the_facing_plane_is_as_far_as_the_nearest_point_of_the_piece(seed: int, kind: str) -> None:
    rng = np.random.default_rng(seed)
    piece = random_piece(rng, kind)
    shape = np.tril(rng.normal(size=(3, 3)))
    np.fill_diagonal(shape, rng.uniform(0.2, 1.0, 3))
    centre = piece.pose.position + rng.uniform(0.7, 2.0) * np.array([0.6, 0.0, 0.8])
    ellipsoid = Ellipsoid(shape, centre)
    normal = facing(piece, ellipsoid)
    plane = (-float(support(piece, -normal)) - normal @ centre) / np.linalg.norm(shape.T @ normal)
    points = points_inside(rng, piece, 4000) - centre
    nearest = np.linalg.norm(np.linalg.solve(shape, points.T), axis=0).min()
    # the plane keeps the piece out, so it is nearer than any point; and it touches the nearest one
    assert plane <= nearest + 1e-9
    assert plane >= 0.8 * nearest - 0.05


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=6, deadline=None)
def test_polytopes_are_free_of_every_kind_of_obstacle_and_hold_their_seed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    obstacles = [random_piece(rng, kind, large=0.3, spread=1.0) for kind in BOUNDED for _ in range(3)]
    obstacles.append(Piece("ground", "halfspace", Pose.from_xyz([0, 0, -0.9]), np.zeros(0)))
    for point in rng.uniform(*BOUNDS, size=(4, 3)):
        found = inflate_polytope(point, obstacles, BOUNDS)
        if found is None:
            assert ObstacleArrays(obstacles).distances(point).min() < 1e-4 or np.abs(point).max() > 1 - 1e-4
            continue
        assert found.margin >= 0
        assert np.all(found.A @ point <= found.b)
        for piece in obstacles[:-1]:
            inside = np.all(points_inside(rng, piece, 2000) @ found.A.T < found.b, axis=1)
            assert not inside.any()
        shot = rng.uniform(*BOUNDS, size=(3000, 3))
        assert shot[np.all(shot @ found.A.T < found.b, axis=1), 2].min(initial=0.0) >= -0.9


def test_between_slanting_walls_a_polytope_is_larger_than_every_cuboid() -> None:
    quat = [np.cos(np.pi / 8), 0.0, np.sin(np.pi / 8), 0.0]
    across = quat_to_matrix(np.array(quat))[:, 2]
    walls = [
        Piece(name, "box", Pose(side * 0.25 * across, quat), np.array([3.0, 3.0, 0.05]))
        for name, side in (("left", -1), ("right", 1))
    ]
    polytope = inflate_polytope([0.0, 0.0, 0.0], walls, BOUNDS)
    cuboids = inflate_cuboids([[0.0, 0.0, 0.0]], walls, BOUNDS)
    assert polytope is not None
    shot = np.random.default_rng(0).uniform(*BOUNDS, size=(20000, 3))
    between = np.abs(shot @ across) < 0.2
    in_polytope = np.all(shot @ polytope.A.T < polytope.b, axis=1)
    in_cuboid = np.all((shot > cuboids.lower[0]) & (shot < cuboids.upper[0]), axis=1)
    assert in_polytope[np.abs(shot @ across) < 0.2 - 1e-4].all() and not in_polytope[~between].any()
    assert in_cuboid.sum() < 0.5 * between.sum()


def test_a_seed_without_room_gives_nothing_and_a_wrong_one_is_named() -> None:
    ball = Piece("ball", "sphere", Pose.identity(), np.array([0.3]))
    assert inflate_polytope([0.1, 0, 0], [ball], BOUNDS) is None
    assert inflate_polytope([2.0, 0, 0], [ball], BOUNDS) is None
    with pytest.raises(InputError, match="seed"):
        inflate_polytope([np.nan, 0, 0], [ball], BOUNDS)


def test_a_sphere_counts_as_held_with_its_radius() -> None:
    box = FreePolytope(np.vstack([np.eye(3), -np.eye(3)]), np.ones(6), 0.0)
    held = box.holds_spheres(np.array([[[0.0, 0, 0], [0.5, 0, 0], [0.5, 0, 0]]]), np.array([1.0, 0.6, 0.4]))
    assert held.tolist() == [[True, False, True]]
