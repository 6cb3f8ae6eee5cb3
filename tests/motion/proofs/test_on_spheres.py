"""The compiled proof: never wrong against dense sampling, exact on closed forms, and it finds a planted graze."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from workcell.errors import InputError
from workcell.geometry.types import Piece, SphereCover
from workcell.model.serial import serial_robot
from workcell.motion.body import Upright, column_bounds
from workcell.motion.path import Path, Trajectory
from workcell.motion.polynomials import PolynomialMotion
from workcell.motion.proofs.on_spheres import CoverProver
from workcell.pose import Pose, axis_angle_to_matrix


def scatter(rng, count):
    """Convex pieces of every kind around the arm, some of them turned."""
    pieces = []
    for k in range(count):
        position = rng.uniform(-0.9, 0.9, 3)
        pose = Pose.from_rotation(
            position, axis_angle_to_matrix(np.array([0.6, 0.0, 0.8]), rng.uniform(0, 3))
        )
        kind = ("box", "sphere", "capsule", "cylinder", "ellipsoid", "hull")[k % 6]
        if kind == "hull":
            pieces.append(Piece(f"p{k}", "hull", pose, np.zeros(0), rng.normal(size=(8, 3)) * 0.08))
        else:
            size = {"box": 3, "sphere": 1, "capsule": 2, "cylinder": 2, "ellipsoid": 3}[kind]
            pieces.append(Piece(f"p{k}", kind, pose, rng.uniform(0.03, 0.12, size)))
    return tuple(pieces)


@pytest.fixture(scope="module")
def cover7():
    rng = np.random.default_rng(5)
    link = np.repeat(np.arange(1, 8), 3)
    return SphereCover(link, rng.uniform(-0.05, 0.15, (21, 3)), rng.uniform(0.03, 0.06, 21))


def clearances(arm, cover, pieces, q):
    """By plain numpy: link poses of `Robot`, distances of the exact judge."""
    from workcell.ik.judge.exact import ExactDistances

    centres = cover.centres_world(arm.link_transforms(q))
    distances = ExactDistances(pieces)(centres.reshape(-1, 3)).reshape(*centres.shape[:2], -1)
    return (distances - cover.radius[:, None]).min(axis=(1, 2))


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_a_proved_path_is_clear_at_every_dense_sample(arm7, cover7, seed):
    rng = np.random.default_rng(seed)
    pieces = scatter(rng, 6)
    start = rng.uniform(-2, 2, 7)
    points = np.clip(start + np.cumsum(rng.normal(size=(3, 7)) * 0.15, axis=0), -3, 3)
    proof = CoverProver(arm7, cover7, pieces).path(points)
    path = Path(arm7, points)
    dense = clearances(arm7, cover7, pieces, path.at(np.linspace(0, 2, 400)))
    if proof.proved:
        assert dense.min() >= proof.margin >= 0
    else:
        assert dense.min() < 2e-3 and proof.reason
        assert clearances(arm7, cover7, pieces, path.at([proof.failed_at]))[0] < 1e-6


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_a_proved_trajectory_is_clear_between_its_samples(arm7, cover7, seed):
    rng = np.random.default_rng(seed)
    pieces = scatter(rng, 6)
    c = np.concatenate(
        [rng.uniform(-2, 2, (1, 7, 1)), rng.normal(size=(1, 7, 5)) * [0.4, 0.3, 0.2, 0.1, 0.1]], axis=2
    )
    motion = PolynomialMotion(c, np.array([1.0]))
    proof = CoverProver(arm7, cover7, pieces).motion(motion)
    dense = clearances(arm7, cover7, pieces, motion.at(np.linspace(0, 1, 400)))
    if proof.proved:
        assert dense.min() >= proof.margin >= 0
    else:
        assert dense.min() < 2e-3 and 0 <= proof.failed_at <= 1


def test_lines_and_polynomials_of_degree_one_agree(arm7, cover7):
    rng = np.random.default_rng(3)
    pieces = scatter(rng, 8)
    prover = CoverProver(arm7, cover7, pieces)
    outcomes = set()
    for _ in range(20):
        path = Path(arm7, np.clip(np.cumsum(rng.normal(size=(3, 7)) * 0.3, axis=0), -3, 3))
        q = path.configurations
        a_second_a_line = PolynomialMotion(
            np.stack([q[:-1], np.diff(q, axis=0)], axis=2), np.ones(len(q) - 1)
        )
        line, curve = prover.path(path), prover.motion(a_second_a_line)
        assert line.proved == curve.proved
        outcomes.add(line.proved)
        if line.proved:
            assert curve.margin == pytest.approx(line.margin, abs=1e-6)
    assert outcomes == {True, False}


def test_a_graze_of_one_millimetre_is_found_and_a_miss_of_one_is_not(planar, planar_cover):
    """The tip sphere's centre sweeps the arc of radius 1.15; the ball sits 1 mm in its way, or 1 mm out of it."""
    path = np.array([[-0.6, 0.0, 0.0], [0.6, 0.0, 0.0]])
    for depth, proved in ((1e-3, False), (-1e-3, True)):
        reach = 1.15 + 0.06 + 0.02 - depth
        ball = Piece(
            "ball", "sphere", Pose.from_xyz([reach * np.cos(0.123), reach * np.sin(0.123), 0]), [0.02]
        )
        proof = CoverProver(planar, planar_cover, [ball]).path(path)
        assert proof.proved is proved
        if not proved:
            assert "collision" in proof.reason and "ball" in proof.reason
            assert -0.6 + 1.2 * proof.failed_at == pytest.approx(0.123, abs=0.07)
        else:
            assert 0 < proof.margin <= 1e-3


def test_the_margin_is_a_share_of_the_clearance(planar, planar_cover):
    ball = Piece("ball", "sphere", Pose.from_xyz([1.4, 0, 0]), [0.1])
    prover = CoverProver(planar, planar_cover, [ball])
    a = np.array([[-0.3, 0.0, 0.0], [0.3, 0.0, 0.0]])
    for keep in (0.0, 0.5, 0.95):
        assert keep * 0.0899 <= prover.path(a, keep=keep).margin <= 0.09
    assert prover.path(a, floor=0.08).proved and not prover.path(a, floor=0.091).proved


def test_links_that_must_keep_clear_of_each_other(planar, planar_cover):
    """Folding the planar arm brings its last link onto its first."""
    folded = np.array([[0.0, 0.0, 0.0], [0.0, 2.9, 2.9]])
    prover = CoverProver(planar, planar_cover, ())
    assert prover.path(folded).proved
    pairs = [(i, j) for i in range(4) for j in range(8, 12)]
    proof = CoverProver(planar, planar_cover, (), self_pairs=pairs).path(folded)
    assert not proof.proved and "collision between sphere" in proof.reason
    dense = Path(planar, folded).at(np.linspace(0, 1, 2001))
    centres = planar_cover.centres_world(planar.link_transforms(dense))
    apart = np.linalg.norm(centres[:, :4, None] - centres[:, None, 8:], axis=-1).min(axis=(1, 2)) - 0.12
    first = np.argmax(apart < 0) / 2000
    almost = np.array([folded[0], folded[0] + (first - 0.01) * (folded[1] - folded[0])])
    assert CoverProver(planar, planar_cover, (), self_pairs=pairs).path(almost).proved


def test_the_tool_stays_in_its_cone(planar, planar_cover):
    """Turning the planar arm by 0.4 rad turns its tool's x axis by as much."""
    turn = np.array([[0.0, 0.0, 0.0], [0.4, 0.0, 0.0]])
    wide = Upright(0.41, tool_axis=(1, 0, 0), direction=(1, 0, 0))
    tight = Upright(0.39, tool_axis=(1, 0, 0), direction=(1, 0, 0))
    assert CoverProver(planar, planar_cover, (), upright=wide).path(turn).proved
    refused = CoverProver(planar, planar_cover, (), upright=tight).path(turn)
    assert not refused.proved and "cone" in refused.reason


def test_bounds_on_the_columns_hold(arm7, cover7):
    rng = np.random.default_rng(0)
    bound = column_bounds(arm7, cover7)
    for q in rng.uniform(-3, 3, (200, 7)):
        T = arm7.link_transforms(q)
        centres = cover7.centres_world(T)
        for k in range(7):
            axis = T[k + 1, :3, :3] @ arm7.axis[k]
            away = np.linalg.norm(np.cross(centres - T[k + 1, :3, 3], axis), axis=1)
            moved = cover7.link > k
            assert np.all(away[moved] <= bound[cover7.link[moved], k] + 1e-9)


def test_quintics_pass_through_the_samples_and_their_bounds_hold(arm7):
    t = np.linspace(0, 1, 6)
    rng = np.random.default_rng(1)
    q, qd, qdd = (rng.normal(size=(6, 7)) for _ in range(3))
    motion = PolynomialMotion.of_trajectory(Trajectory("arm", t, q, qd, qdd))
    for order, values in enumerate((q, qd, qdd)):
        assert np.allclose(motion.at(t, order), values, atol=1e-9)
    divided = motion.divided(5)
    assert len(divided) == 5 * len(motion) and divided.duration == pytest.approx(motion.duration)
    inside = np.linspace(0, 0.999, 400)
    assert np.allclose(divided.at(inside), motion.at(inside), atol=1e-9)
    for order in (1, 2, 3):
        dense = np.abs(motion.at(np.linspace(0, 0.2 - 1e-12, 500), order)).max(axis=0)
        bound = motion.largest(order)[0]
        assert np.all(dense <= bound + 1e-9) and np.all(bound <= 4 * dense + 1e-9)


def test_bad_input(planar, planar_cover):
    prover = CoverProver(planar, planar_cover, ())
    with pytest.raises(InputError, match="not finite"):
        prover.path([[0, 0, 0], [np.nan, 0, 0]])
    with pytest.raises(InputError, match="shape"):
        prover.path([[0, 0], [1, 0]])
    with pytest.raises(InputError, match="without configurations"):
        prover.path(np.zeros((0, 3)))
    with pytest.raises(InputError, match="floor"):
        prover.path([[0, 0, 0], [1, 0, 0]], floor=np.nan)
    with pytest.raises(InputError, match="inner"):
        inner = SphereCover(planar_cover.link, planar_cover.centre, planar_cover.radius, "inner")
        CoverProver(planar, inner, ())
    with pytest.raises(InputError, match="durations"):
        PolynomialMotion(np.zeros((1, 3, 2)), np.array([0.0]))
    with pytest.raises(InputError, match="tilt"):
        Upright(0.0)
    with pytest.raises(InputError, match="no direction"):
        Upright(0.3, tool_axis=(0, 0, 0))
    with pytest.raises(InputError, match="not among"):
        CoverProver(planar, planar_cover, (), self_pairs=[(0, 99)])


def test_sliding_joints():
    """A carriage with an arm on it: the sphere sits on the sliding axis, and still moves with it."""
    joints = [
        {"name": name, "xyz": xyz, "quat": [1, 0, 0, 0], "axis": axis, "lower": -2.0, "upper": 2.0}
        for name, xyz, axis in (("slide", [0, 0, 0], [1, 0, 0]), ("turn", [0.1, 0, 0], [0, 0, 1]))
    ]
    robot = replace(serial_robot("cart", joints, Pose.identity()), prismatic=np.array([True, False]))
    cover = SphereCover(np.array([1, 2]), np.array([[0, 0, 0], [0.3, 0, 0]]), np.array([0.05, 0.05]))
    wall = Piece("wall", "box", Pose.from_xyz([1.0, 0, 0]), [0.1, 1.0, 1.0])
    prover = CoverProver(robot, cover, [wall])
    # the tip reaches x = slide + 0.1 + 0.3 cos(turn) + 0.05, the wall begins at 0.9
    assert prover.path([[0.0, 0.0], [0.449, 0.0]]).proved
    assert not prover.path([[0.0, 0.0], [0.451, 0.0]]).proved
    assert prover.path([[0.0, 1.5], [0.7, 1.5]]).proved
    bound = column_bounds(robot, cover)
    assert np.allclose(bound, [[0, 0], [1, 0], [1, 0.3]])


def test_a_slide_beyond_its_limits_proves_nothing():
    """A turntable with a slide: how fast the tip turns is bounded by how far the slide goes."""
    joints = [
        {"name": name, "xyz": [0, 0, 0], "quat": [1, 0, 0, 0], "axis": axis, "lower": -upper, "upper": upper}
        for name, axis, upper in (("turn", [0, 0, 1], 3.0), ("slide", [1, 0, 0], 0.01))
    ]
    robot = replace(serial_robot("table", joints, Pose.identity()), prismatic=np.array([False, True]))
    cover = SphereCover(np.array([2]), np.zeros((1, 3)), np.array([0.01]))
    prover = CoverProver(robot, cover, [Piece("wall", "box", Pose.from_xyz([-1.5, 0, 0]), [1.0, 3.0, 3.0])])
    q = np.array([[-2.9, 1.0], [2.9, 1.0]])
    with pytest.raises(InputError, match="slide slides to 1 m"):
        prover.path(q)
    with pytest.raises(InputError, match="slide slides to 1 m"):
        prover.motion(PolynomialMotion(np.stack([q[:1], np.diff(q, axis=0)], axis=2), np.ones(1)))
    assert prover.path([[-2.9, 0.01 + 1e-7], [2.9, 0.01]]).proved
