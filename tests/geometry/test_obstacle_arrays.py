import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.geometry.shapes import BOUNDED, points_inside, random_piece
from workcell.geometry.engine import ClearanceEngine
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.types import Piece, SphereCover
from workcell.model.serial import serial_robot
from workcell.pose import Pose

KINDS = (*BOUNDED, "halfspace")


@given(st.integers(0, 2**32 - 1), st.sampled_from(KINDS))
@settings(max_examples=60, deadline=None)
def test_gradients_agree_with_finite_differences(seed, kind):
    rng = np.random.default_rng(seed)
    packed = ObstacleArrays([random_piece(rng, kind)])
    points = rng.uniform(-1, 1, (20, 3))
    _, gradient = packed.distances_and_gradients(points)
    assert np.allclose(np.linalg.norm(gradient, axis=-1), 1.0, atol=1e-9)
    h = 1e-6
    for axis in range(3):
        step = np.eye(3)[axis] * h
        ahead, behind = packed.distances(points + step), packed.distances(points - step)
        middle = packed.distances(points)
        smooth = np.abs(ahead + behind - 2 * middle) < 1e-9  # not across a ridge between two nearest points
        slope = (ahead - behind) / (2 * h)
        assert np.all(np.abs(slope - gradient[..., axis])[smooth] < 1e-6)


@given(st.integers(0, 2**32 - 1), st.sampled_from(BOUNDED))
@settings(max_examples=60, deadline=None)
def test_points_of_the_piece_are_inside_and_the_gradient_leads_to_the_surface(seed, kind):
    rng = np.random.default_rng(seed)
    piece = random_piece(rng, kind)
    packed = ObstacleArrays([piece])
    assert packed.distances(points_inside(rng, piece, 200)).max() <= 1e-9
    points = rng.uniform(-1, 1, (50, 3))
    distance, gradient = packed.distances_and_gradients(points)
    foot = points - distance * gradient[:, 0]
    assert np.abs(packed.distances(foot)).max() < 1e-8
    outside = distance[:, 0] > 0  # no point of the piece is nearer than the foot
    samples = points_inside(rng, piece, 300)
    nearest = np.linalg.norm(points[:, None] - samples, axis=2).min(axis=1)
    assert np.all(nearest[outside] >= distance[outside, 0] - 1e-9)


@pytest.mark.parametrize("kind", BOUNDED)
def test_distances_agree_with_coal(kind):
    coal = pytest.importorskip("coal")
    rng = np.random.default_rng(3)
    for _ in range(25):
        piece = random_piece(rng, kind)
        shapes = {
            "box": lambda p=piece: coal.Box(*(2 * p.size)),
            "sphere": lambda p=piece: coal.Sphere(p.size[0]),
            "capsule": lambda p=piece: coal.Capsule(p.size[0], 2 * p.size[1]),
            "cylinder": lambda p=piece: coal.Cylinder(p.size[0], 2 * p.size[1]),
            "ellipsoid": lambda p=piece: coal.Ellipsoid(*p.size),
            "hull": lambda p=piece: _coal_hull(coal, p),
        }
        place = coal.Transform3s(piece.pose.rotation, piece.pose.position)
        centre = rng.uniform(-1, 1, 3)
        found = ObstacleArrays([piece]).nearest(centre)[0] - 0.02
        if found < 1e-3:
            continue
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        request.gjk_tolerance = 1e-12
        there = coal.Transform3s(np.eye(3), centre)
        expected = coal.distance(shapes[kind](), place, coal.Sphere(0.02), there, request, result)
        assert found == pytest.approx(expected, abs=1e-6 if kind == "ellipsoid" else 1e-9)


def _coal_hull(coal, piece):
    points = coal.StdVec_Vec3s()
    for vertex in piece.vertices:
        points.append(vertex)
    return coal.Convex.convexHull(points, False, "")


def test_nearest_and_floor_are_the_smallest_and_a_bound_below_it():
    rng = np.random.default_rng(1)
    packed = ObstacleArrays([random_piece(rng, kind) for kind in KINDS for _ in range(3)])
    points = rng.uniform(-1, 1, (4, 100, 3))
    every, gradients = packed.distances_and_gradients(points)
    distance, gradient, index = packed.nearest(points)
    assert np.allclose(distance, every.min(axis=-1), atol=1e-12)
    picked = np.take_along_axis(gradients, index[..., None, None], axis=-2)[..., 0, :]
    assert np.allclose(gradient, picked)
    floor = packed.floor(points)
    assert np.all(floor <= distance + 1e-12)
    assert np.array_equal(floor <= 0, distance <= 0)


def test_no_obstacles_means_infinitely_far():
    distance, gradient, index = ObstacleArrays([]).nearest(np.zeros((2, 3)))
    assert np.all(np.isinf(distance)) and not gradient.any() and np.all(index == -1)


def test_robot_gradient_agrees_with_finite_differences():
    rng = np.random.default_rng(2)
    joints = [
        {
            "name": f"j{k}",
            "xyz": rng.uniform(-0.2, 0.2, 3),
            "quat": _unit(rng),
            "axis": [0, 0, 1],
            "lower": -3,
            "upper": 3,
        }
        for k in range(6)
    ]
    robot = serial_robot("random", joints, Pose.identity())
    cover = SphereCover(rng.integers(0, 7, 30), rng.uniform(-0.1, 0.1, (30, 3)), np.full(30, 0.03))
    obstacles = ObstacleArrays([random_piece(rng, kind) for kind in BOUNDED])
    q = rng.uniform(-2, 2, 6)
    engine = ClearanceEngine(robot, cover, obstacles)
    distance, jacobian, _ = engine.sphere_clearances_and_gradients(q)
    assert np.allclose(distance, engine.sphere_clearances(q))
    h = 1e-6
    for k in range(6):
        step = np.eye(6)[k] * h
        slope = (engine.sphere_clearances(q + step) - engine.sphere_clearances(q - step)) / (2 * h)
        assert np.allclose(slope, jacobian[:, k], atol=1e-6)
    assert not jacobian[cover.link == 0].any()


def _unit(rng):
    quat = rng.normal(size=4)
    return quat / np.linalg.norm(quat)


def test_piece_of_one_formula():
    box = Piece("box", "box", Pose.identity(), np.array([1.0, 2.0, 3.0]))
    assert ObstacleArrays([box]).distances([[2.0, 3.0, 4.0], [0.5, 0, 0]]).ravel() == pytest.approx(
        [3**0.5, -0.5]
    )
