"""The judge against pin, coal and closed forms, and everything it must refuse."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.ik.arms import beads, box, planar, random_arm, seven
from workcell.errors import InputError
from workcell.geometry.types import Piece, SphereCover
from workcell.ik.judge.exact import ExactDistances, ExactKinematics, exact_distances, rotations
from workcell.ik.judge.verify import verify
from workcell.ik.problem import Clearance, IKProblem, Tolerances
from workcell.model.robot import Tool
from workcell.pose import Pose, quat_to_matrix


def _random_pose(rng):
    quat = rng.normal(size=4)
    return Pose(rng.normal(size=3), quat / np.linalg.norm(quat))


def _pieces(rng):
    vertices = rng.normal(size=(14, 3)) * [0.3, 0.2, 0.25]
    return [
        Piece("box", "box", _random_pose(rng), np.array([0.3, 0.2, 0.1])),
        Piece("ball", "sphere", _random_pose(rng), np.array([0.3])),
        Piece("capsule", "capsule", _random_pose(rng), np.array([0.1, 0.25])),
        Piece("cylinder", "cylinder", _random_pose(rng), np.array([0.2, 0.3])),
        Piece("egg", "ellipsoid", _random_pose(rng), np.array([0.3, 0.2, 0.1])),
        Piece("floor", "halfspace", _random_pose(rng), np.zeros(0)),
        Piece("hull", "hull", _random_pose(rng), np.zeros(0), vertices),
    ]


@pytest.mark.parametrize("sliding", [False, True])
def test_kinematics_agree_with_pinocchio(sliding):
    pin = pytest.importorskip("pinocchio")
    rng = np.random.default_rng(3)
    for _ in range(5):
        robot = random_arm(rng, sliding=sliding)
        model, parent = pin.Model(), 0
        base = pin.SE3(robot.T_world_base.rotation, robot.T_world_base.position)
        for k in range(robot.dof):
            place = pin.SE3(robot.joint_rotation[k], robot.joint_xyz[k])
            joint = (
                pin.JointModelPrismaticUnaligned if robot.prismatic[k] else pin.JointModelRevoluteUnaligned
            )
            parent = model.addJoint(parent, joint(robot.axis[k]), base * place if k == 0 else place, f"j{k}")
        data, q = model.createData(), robot.random_configuration(rng)
        pin.forwardKinematics(model, data, q)
        kinematics = ExactKinematics(robot)
        rotation, position = kinematics.links(q)
        for k in range(1, robot.dof + 1):
            assert np.allclose(rotation[k], data.oMi[k].rotation, atol=1e-12)
            assert np.allclose(position[k], data.oMi[k].translation, atol=1e-12)
        tool = robot.fk(q)
        R, p = kinematics.tool(rotation, position)
        assert np.allclose(R, tool.rotation, atol=1e-12)
        assert np.allclose(p, tool.position, atol=1e-12)


@given(st.integers(0, 10_000))
def test_rotations_of_unit_quaternions(seed):
    quats = np.random.default_rng(seed).normal(size=(5, 4))
    quats /= np.linalg.norm(quats, axis=1, keepdims=True)
    assert np.allclose(rotations(quats), quat_to_matrix(quats), atol=1e-15)


def test_distances_are_remembered_for_a_tuple_but_not_for_a_list_which_may_change():
    first, second = _pieces(np.random.default_rng(1))[:2]
    pieces = (first,)
    assert exact_distances(pieces) is exact_distances(pieces)
    changing, points = [first], np.ones((3, 3))
    before = exact_distances(changing)(points)
    changing[0] = second
    assert np.array_equal(exact_distances(changing)(points), ExactDistances((second,))(points))
    assert not np.array_equal(exact_distances(changing)(points), before)


def test_a_robot_is_judged_by_its_own_kinematics_after_many_others():
    rng = np.random.default_rng(8)
    for _ in range(40):
        robot = random_arm(rng)
        q = robot.random_configuration(rng)
        assert verify(IKProblem(robot, robot.fk(q)), q).accepted


def _coal_shape(coal, piece):
    if piece.kind == "box":
        return coal.Box(*(2 * piece.size))
    if piece.kind == "sphere":
        return coal.Sphere(piece.size[0])
    if piece.kind == "capsule":
        return coal.Capsule(piece.size[0], 2 * piece.size[1])
    if piece.kind == "cylinder":
        return coal.Cylinder(piece.size[0], 2 * piece.size[1])
    if piece.kind == "ellipsoid":
        return coal.Ellipsoid(*piece.size)
    if piece.kind == "halfspace":
        return coal.Halfspace(np.array([0.0, 0, 1]), 0.0)
    points = coal.StdVec_Vec3s()
    points.extend(list(piece.vertices))
    return coal.Convex.convexHull(points, True, "Qt")


def test_distances_agree_with_coal():
    coal = pytest.importorskip("coal")
    rng = np.random.default_rng(5)
    pieces = _pieces(rng)
    points = rng.normal(size=(40, 3)) * 1.5
    found = ExactDistances(pieces)(points)
    radius, compared = 0.02, 0
    for column, piece in enumerate(pieces):
        shape = _coal_shape(coal, piece)
        place = coal.Transform3s(piece.pose.rotation, piece.pose.position)
        for row, point in enumerate(points):
            if found[row, column] > radius + 1e-3:
                request, result = coal.DistanceRequest(), coal.DistanceResult()
                here = coal.Transform3s(np.eye(3), point)
                distance = coal.distance(coal.Sphere(radius), here, shape, place, request, result)
                assert distance + radius == pytest.approx(found[row, column], abs=2e-6, rel=2e-6), piece.kind
                compared += 1
    assert compared > 150


def test_distances_inside_are_the_depth_to_the_surface():
    rng = np.random.default_rng(11)
    for piece in _pieces(rng):
        distances = ExactDistances([piece])
        middle = np.zeros(3) if piece.vertices is None else piece.vertices.mean(axis=0)
        inside = piece.pose.apply(middle + 0.02 * rng.normal(size=(4, 3)))
        if piece.kind == "halfspace":
            inside = inside - piece.pose.rotation[:, 2] * 0.5
        depth = distances(inside)[:, 0]
        assert np.all(depth < 0), piece.kind
        # a ball of that depth around the point stays inside, and just touches the surface
        directions = rng.normal(size=(4000, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        for point, d in zip(inside, depth, strict=True):
            rim = distances(point - d * directions)[:, 0]
            assert rim.max() <= 1e-9
            assert rim.max() >= -0.05 * abs(d)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000))
def test_distances_are_lipschitz_and_follow_the_pose(seed):
    rng = np.random.default_rng(seed)
    pieces = _pieces(rng)
    a, b = rng.normal(size=(2, 6, 3))
    one, two = ExactDistances(pieces)(a), ExactDistances(pieces)(b)
    assert np.all(np.abs(one - two) <= np.linalg.norm(a - b, axis=1)[:, None] + 1e-9)
    T = _random_pose(rng)
    moved = [Piece(p.name, p.kind, T @ p.pose, p.size, p.vertices) for p in pieces]
    assert np.allclose(ExactDistances(moved)(T.apply(a)), one, atol=1e-9)


@given(st.integers(0, 10_000), st.floats(-0.02, 2.0))
def test_an_ellipsoid_along_its_normals(seed, distance):
    axes = np.array([0.3, 0.2, 0.1])
    v = np.random.default_rng(seed).normal(size=3)
    foot = axes * v / np.linalg.norm(v)
    normal = foot / axes**2 / np.linalg.norm(foot / axes**2)
    egg = Piece("egg", "ellipsoid", Pose.identity(), axes)
    assert ExactDistances([egg])((foot + distance * normal)[None])[0, 0] == pytest.approx(distance, abs=1e-12)


@pytest.mark.parametrize("centre", [(0.0, 0, 0), (0.3, 0, 0), (0, 0, 0.1), (1e-9, 0, 0.0999)])
def test_an_ellipsoid_at_its_axes(centre):
    egg = Piece("egg", "ellipsoid", Pose.identity(), np.array([0.3, 0.2, 0.1]))
    expected = {0.0: -0.1, 0.3: 0.0, 0.1: 0.0, 0.0999: -1e-4}[centre[0] if centre[0] > 1e-6 else centre[2]]
    assert ExactDistances([egg])(np.array([centre]))[0, 0] == pytest.approx(expected, abs=1e-9)


def _reach(q=(0.3, 0.8), **parts):
    robot = planar()
    return IKProblem(robot, robot.fk(np.array(q)), **parts), np.array(q)


def test_a_solution_is_accepted_with_its_figures():
    problem, q = _reach(cover=beads(planar()), obstacles=(box("far wall", (0.0, 2.0, 0.0), (0.1, 0.1, 0.1)),))
    verdict = verify(problem, q)
    assert verdict.accepted and verdict.within_limits and not verdict.reasons
    assert verdict.position_error < 1e-12 and verdict.rotation_error < 1e-12
    centres = np.array(
        [[0, 0], [0.25 * np.cos(0.3), 0.25 * np.sin(0.3)], [0.5 * np.cos(0.3), 0.5 * np.sin(0.3)]]
    )
    middle = centres[2] + 0.2 * np.array([np.cos(1.1), np.sin(1.1)])
    expected = min(np.hypot(max(abs(x) - 0.1, 0), 1.9 - y) for x, y in [*centres, middle]) - 0.05
    assert verdict.clearance.distance == pytest.approx(expected, abs=1e-12)
    assert verdict.clearance.pair[1] == "far wall"


def test_pose_errors_are_what_they_were_made_to_be():
    robot, q = seven(), np.array([0.3, 0.5, -0.4, 1.0, 0.2, -0.7, 0.1])
    reached = robot.fk(q)
    turn = Pose(np.zeros(3), np.array([np.cos(0.01), 0.0, np.sin(0.01), 0.0]))
    target = Pose(reached.position + np.array([0.0, 0.003, 0.004]), (turn @ reached).quat_wxyz)
    verdict = verify(IKProblem(robot, target), q)
    assert verdict.position_error == pytest.approx(0.005, abs=1e-12)
    assert verdict.rotation_error == pytest.approx(0.02, abs=1e-12)
    assert not verdict.accepted and len(verdict.reasons) == 2
    loose = Tolerances(position=0.0051, rotation=0.0201)
    assert verify(IKProblem(robot, target, tolerances=loose), q).accepted


@pytest.mark.parametrize(
    ("q", "words"),
    [
        ([np.nan, 0.0], "not finite"),
        ([np.inf, 0.0], "not finite"),
        ([0.1], "1 joint values"),
        ([[0.3, 0.8]], "shape"),
        ("nonsense", "not a list of numbers"),
        (None, "shape"),
        ([], "0 joint values"),
    ],
)
def test_what_is_no_configuration_is_refused(q, words):
    problem, _ = _reach()
    verdict = verify(problem, q)
    assert not verdict.accepted and words in verdict.reasons[0]


def test_limits_are_kept_to_a_millionth():
    robot = planar(limit=1.0)
    for excess, fine in ((0.9e-6, True), (1.1e-6, False)):
        q = np.array([1.0 + excess, 0.5])
        verdict = verify(IKProblem(robot, robot.fk(q)), q)
        assert verdict.accepted is fine and verdict.within_limits is fine
    assert "j1" in verdict.reasons[0]


def test_a_collision_names_sphere_obstacle_and_depth():
    q = np.array([0.0, 0.0])
    robot = planar()
    wall = box("wall", (0.9, 0.0, 0.0), (0.2, 0.1, 0.1))
    verdict = verify(IKProblem(robot, robot.fk(q), (wall,), beads(robot)), q)
    assert not verdict.accepted
    assert "sphere 3 (link2) is 50 mm inside wall" in verdict.reasons[0]
    assert verdict.clearance.distance == pytest.approx(-0.05)


def test_the_safety_margin_is_demanded():
    q, robot = np.array([0.0, 0.0]), planar()
    wall = box("wall", (0.9, 0.0, 0.0), (0.1, 0.1, 0.1))
    cover = SphereCover(np.array([2]), np.array([[0.2, 0, 0]]), np.array([0.05]))
    for margin, fine in ((0.049, True), (0.051, False)):
        problem = IKProblem(robot, robot.fk(q), (wall,), cover, tolerances=Tolerances(safety_margin=margin))
        assert verify(problem, q).accepted is fine


def test_a_checker_decides_instead_of_the_spheres():
    q, robot = np.array([0.0, 0.0]), planar()
    wall = box("wall", (0.9, 0.0, 0.0), (0.2, 0.1, 0.1))
    clear = IKProblem(
        robot, robot.fk(q), (wall,), beads(robot), checker=lambda q: Clearance(0.01, ("a", "b"))
    )
    assert verify(clear, q).accepted
    for distance, words in ((-0.002, "a is 2 mm inside b"), (np.nan, "not a number")):
        hit = IKProblem(robot, robot.fk(q), checker=lambda q, d=distance: Clearance(d, ("a", "b")))
        assert words in verify(hit, q).reasons[0]


def test_the_larger_of_two_pose_errors_counts():
    robot, q = seven(), np.full(7, 0.3)
    target = robot.fk(q)
    agreeing = IKProblem(robot, target, tool_pose=robot.fk)
    assert verify(agreeing, q).accepted
    elsewhere = Pose.from_xyz([0.0, 0.002, 0.0]) @ target
    verdict = verify(IKProblem(robot, target, tool_pose=lambda _: elsewhere), q)
    assert not verdict.accepted and verdict.position_error == pytest.approx(0.002, abs=1e-9)
    assert not verify(IKProblem(robot, elsewhere, tool_pose=lambda _: elsewhere), q).accepted


def test_bounds_against_the_reference():
    robot, q = planar(), np.array([0.3, 0.8])
    near = {"q_reference": q - 0.05}
    assert verify(IKProblem(robot, robot.fk(q), max_step=0.05, **near), q).accepted
    assert "moves by" in verify(IKProblem(robot, robot.fk(q), max_step=0.049, **near), q).reasons[0]
    # the last link turns by 0.1 rad: 2 sqrt(2) sin(0.05) in the Frobenius norm
    turned = 2 * np.sqrt(2) * np.sin(0.05)
    assert verify(IKProblem(robot, robot.fk(q), max_link_rotation=turned + 1e-6, **near), q).accepted
    refused = verify(IKProblem(robot, robot.fk(q), max_link_rotation=turned - 1e-6, **near), q)
    assert "link2 turns" in refused.reasons[0]


@pytest.mark.parametrize("margin", [-0.01, float("nan"), float("inf")])
def test_a_margin_that_allows_penetration_is_bad_input(margin):
    with pytest.raises(InputError, match="safety margin"):
        Tolerances(safety_margin=margin)


def test_joints_beyond_the_tool_are_bad_input():
    # the solvers' models and proofs take the target for the pose of the last link
    robot = seven()
    elbow = replace(robot, tools={"elbow": Tool("elbow", 4, Pose.identity())}, default_tool="elbow")
    with pytest.raises(InputError, match=r"elbow.*link 4 of 7.*chain"):
        IKProblem(elbow, elbow.fk(np.zeros(7)))
    assert IKProblem(elbow.chain(), elbow.fk(np.zeros(7))).robot.dof == 4


@pytest.mark.parametrize("bound", [float("nan"), 0.0, -1.0])
def test_a_bound_on_link_rotation_that_makes_no_sense_is_bad_input(bound):
    robot = seven()
    with pytest.raises(InputError, match="max_link_rotation"):
        IKProblem(robot, Pose.identity(), q_reference=np.zeros(7), max_link_rotation=bound)
    with pytest.raises(InputError, match="needs q_reference"):
        IKProblem(robot, Pose.identity(), max_link_rotation=0.5)


def test_half_turns_are_measured():
    robot, q = planar(), np.array([0.3, 0.8])
    reached = robot.fk(q)
    flipped = Pose(reached.position, (reached @ Pose(np.zeros(3), np.array([0.0, 1, 0, 0]))).quat_wxyz)
    assert verify(IKProblem(robot, flipped), q).rotation_error == pytest.approx(np.pi, abs=1e-6)
    assert np.allclose(quat_to_matrix(flipped.quat_wxyz)[:, 0], reached.rotation[:, 0])
