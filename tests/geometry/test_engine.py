"""The clearance engine against plain numpy, MuJoCo, closed forms and finite differences."""

from __future__ import annotations

import dataclasses
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.geometry.plain_distances import plain_distances
from tests.geometry.shapes import BOUNDED, random_piece
from tests.ik.arms import random_arm
from workcell.errors import InputError, ModelError
from workcell.geometry.engine import ClearanceEngine
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.types import Piece, SphereCover
from workcell.pose import Pose

KINDS = (*BOUNDED, "halfspace")


def cell(seed: int, sliding: bool = False, count: int = 3) -> ClearanceEngine:
    """A branched robot with 20 spheres among pieces of all kinds, some boxes along the axes."""
    rng = np.random.default_rng(seed)
    arm = random_arm(rng, 7, sliding)
    robot = dataclasses.replace(arm, parents=np.array([0, 1, 2, 2, 4, 3, 6]))
    cover = SphereCover(rng.integers(0, 8, 20), rng.uniform(-0.1, 0.1, (20, 3)), rng.uniform(0.02, 0.06, 20))
    pieces = [random_piece(rng, kind) for kind in BOUNDED for _ in range(count)]
    pieces += [
        dataclasses.replace(piece, pose=Pose(piece.pose.position, [1, 0, 0, 0])) for piece in pieces[:count]
    ]
    rng.shuffle(pieces)
    pairs = [(i, j) for i in range(20) for j in range(i) if abs(int(cover.link[i]) - int(cover.link[j])) > 1]
    return ClearanceEngine(robot, cover, pieces, pairs)


def plain_gaps(engine: ClearanceEngine, q: np.ndarray) -> np.ndarray:
    centres = engine.cover.centres_world(engine.robot.link_transforms(q))
    columns = [plain_distances(centres, piece)[0] for piece in engine.obstacles.pieces]
    return np.column_stack(columns) - engine.cover.radius[:, None]


def plain_self_gaps(engine: ClearanceEngine, q: np.ndarray) -> np.ndarray:
    centres, (i, j) = engine.cover.centres_world(engine.robot.link_transforms(q)), engine.pairs.T
    return np.linalg.norm(centres[i] - centres[j], axis=1) - engine.cover.radius[i] - engine.cover.radius[j]


@given(st.integers(0, 2**32 - 1), st.sampled_from(KINDS))
@settings(max_examples=60, deadline=None)
def test_points_to_pieces_equal_the_plain_formulas(seed, kind):
    rng = np.random.default_rng(seed)
    piece, points = random_piece(rng, kind), rng.uniform(-0.8, 0.8, (40, 3))
    packed = ObstacleArrays([piece])
    distance, gradient = packed.distances_and_gradients(points)
    expected, direction = plain_distances(points, piece)
    assert np.allclose(distance[:, 0], expected, rtol=0, atol=1e-12)
    assert np.allclose(packed.distances(points)[:, 0], expected, rtol=0, atol=1e-12)
    assert np.allclose(gradient[:, 0], direction, atol=1e-7)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_a_box_turned_by_quarters_is_a_box_along_the_axes(seed):
    rng = np.random.default_rng(seed)
    half, quarter = rng.uniform(0.05, 0.3, 3), np.sqrt(0.5)
    turns = [
        [quarter, quarter, 0, 0],
        [quarter, 0, quarter, 0],
        [quarter, 0, 0, -quarter],
        [0.5, 0.5, 0.5, 0.5],
    ]
    pose = Pose(rng.uniform(-0.3, 0.3, 3), turns[rng.integers(4)])
    points = rng.uniform(-0.8, 0.8, (40, 3))
    packed = ObstacleArrays([Piece("box", "box", pose, half)])
    expected, direction = plain_distances(points, packed.pieces[0])
    distance, gradient = packed.distances_and_gradients(points)
    assert np.allclose(distance[:, 0], expected, atol=1e-12)
    assert np.allclose(gradient[:, 0], direction, atol=1e-9)


@given(st.integers(0, 2**32 - 1), st.floats(-0.9, 2.0))
@settings(max_examples=60, deadline=None)
def test_ellipsoids_have_the_distance_along_their_normals(seed, share):
    rng = np.random.default_rng(seed)
    axes = rng.uniform(0.03, 0.4, 3)
    surface = rng.normal(size=3)
    surface *= axes / np.linalg.norm(surface)
    normal = surface / axes**2
    normal /= np.linalg.norm(normal)
    # Inwards the nearest point stays the same up to the smallest radius of curvature.
    away = share * axes.min() ** 2 / axes.max()
    distance, gradient = ObstacleArrays(
        [Piece("e", "ellipsoid", Pose.identity(), axes)]
    ).distances_and_gradients(surface + away * normal)
    assert distance[0] == pytest.approx(away, abs=1e-10)
    assert gradient[0] == pytest.approx(normal, abs=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_directions_are_unit_vectors_at_the_middle(kind):
    piece = random_piece(np.random.default_rng(0), kind)
    distance, gradient = ObstacleArrays([piece]).distances_and_gradients(piece.pose.position)
    assert distance[0] <= 0 and np.linalg.norm(gradient) == pytest.approx(1.0)


@pytest.mark.parametrize("sliding", [False, True])
def test_the_engine_equals_plain_kinematics_and_distances(sliding):
    engine = cell(1, sliding)
    rng = np.random.default_rng(2)
    batch = engine.robot.random_configuration(rng, 30)
    smallest = engine.clearances(batch)
    assert np.array_equal(engine.clearances(batch, threads=3), smallest)
    for q, clearance in zip(batch, smallest, strict=True):
        gaps, self_gaps = plain_gaps(engine, q), plain_self_gaps(engine, q)
        assert np.allclose(engine.pair_distances_and_gradients(q)[0], gaps, atol=1e-12)
        assert np.allclose(engine.sphere_clearances(q), gaps.min(axis=1), atol=1e-12)
        assert np.allclose(engine.self_clearances(q), self_gaps, atol=1e-12)
        expected = min(gaps.min(), self_gaps.min())
        assert engine.clearance(q) == pytest.approx(expected, abs=1e-12)
        assert clearance == pytest.approx(expected, abs=1e-12)
        found = engine.nearest(q)
        if found.other_sphere < 0:
            assert gaps[found.sphere, found.obstacle] == pytest.approx(expected, abs=1e-12)
        else:
            pair = (engine.pairs == (found.sphere, found.other_sphere)).all(axis=1)
            assert self_gaps[pair] == pytest.approx(expected, abs=1e-12) and found.obstacle == -1


@pytest.mark.parametrize("seed", range(3))
def test_gradients_in_q_equal_finite_differences(seed):
    engine = cell(10 + seed, sliding=seed > 0)
    rng, h = np.random.default_rng(seed), 1e-6
    for q in engine.robot.random_configuration(rng, 10):
        slopes = {}
        for name in ("clearance", "sphere_clearances", "self_clearances"):
            ask, columns, bends = getattr(engine, name), [], []
            for step in np.eye(engine.robot.dof) * h:
                ahead, here, behind = ask(q + step), ask(q), ask(q - step)
                columns.append((ahead - behind) / (2 * h))
                bends.append(np.abs(ahead + behind - 2 * here))
            smooth = np.max(bends, axis=0) < 1e-10  # not across a ridge between two nearest points
            slopes[name] = np.stack(columns, axis=-1), smooth
        gradients = {
            "clearance": engine.clearance_and_gradient(q)[1],
            "sphere_clearances": engine.sphere_clearances_and_gradients(q)[1],
            "self_clearances": engine.self_clearances_and_gradients(q)[1],
        }
        for name, (slope, smooth) in slopes.items():
            assert np.abs(slope - gradients[name])[smooth].max(initial=0.0) < 1e-6
            assert np.mean(smooth) > 0.5 or name == "clearance"
        which = engine.sphere_clearances_and_gradients(q)[2]
        matrix = engine.pair_distances_and_gradients(q)[1]
        assert np.allclose(matrix[np.arange(20), which], gradients["sphere_clearances"], atol=1e-12)
        assert np.allclose(engine.nearest(q).gradient, gradients["clearance"])
        assert np.allclose(engine.clearances_and_gradients(q[None])[1][0], gradients["clearance"])


def test_every_kind_agrees_with_mujoco_on_separated_pairs():
    import mujoco

    from workcell.geometry.pieces import pieces_of_bodies

    rng = np.random.default_rng(4)
    vertices = " ".join(map(str, (0.1 * rng.normal(size=(16, 3))).ravel()))
    xml = f"""<mujoco><asset><mesh name="m" vertex="{vertices}"/></asset><worldbody>
      <geom name="box" type="box" size=".1 .2 .05" pos=".3 0 0" euler="20 30 40"/>
      <geom name="upright" type="box" size=".1 .2 .05" pos=".5 .5 0"/>
      <geom name="capsule" type="capsule" size=".05 .2" pos="-.3 .2 0" euler="70 10 0"/>
      <geom name="cylinder" type="cylinder" size=".08 .1" pos="0 -.4 .1" euler="0 50 10"/>
      <geom name="ellipsoid" type="ellipsoid" size=".08 .2 .05" pos="-.4 -.4 .1" euler="0 50 10"/>
      <geom name="ball" type="sphere" size=".1" pos="0 .4 .3"/>
      <geom name="hull" type="mesh" mesh="m" pos=".5 -.4 .3" euler="9 8 7"/>
      <geom name="floor" type="plane" size="1 1 .1" pos="0 0 -.5"/>
      <body name="probe"><freejoint/><geom name="probe" type="sphere" size=".03"/></body>
    </worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    data, pieces = mujoco.MjData(model), pieces_of_bodies(model, [0])
    packed, probe, compared = ObstacleArrays(pieces), model.geom("probe").id, 0
    for _ in range(60):
        data.qpos[:3] = rng.uniform([-0.8, -0.8, -0.4], 0.8)
        mujoco.mj_kinematics(model, data)
        ours = packed.distances(data.qpos[:3]) - 0.03
        for k, piece in enumerate(pieces):
            if ours[k] > 1e-3:
                theirs = mujoco.mj_geomDistance(model, data, model.geom(piece.name).id, probe, 5.0, None)
                assert ours[k] == pytest.approx(theirs, abs=1e-9), piece.name
                compared += 1
    assert len(pieces) == 8 and compared > 400


def test_nothing_to_hit_is_infinitely_far():
    engine = cell(0)
    empty = ClearanceEngine(engine.robot, engine.cover)
    q = engine.robot.home
    assert empty.clearance(q) == np.inf and not empty.clearance_and_gradient(q)[1].any()
    found = empty.nearest(q)
    assert (found.sphere, found.obstacle, found.other_sphere) == (-1, -1, -1)
    assert np.all(np.isinf(empty.sphere_clearances(q))) and empty.self_clearances(q).shape == (0,)
    assert empty.pair_distances_and_gradients(q)[0].shape == (20, 0)
    nobody = SphereCover(np.zeros(0, dtype=int), np.zeros((0, 3)), np.zeros(0))
    assert ClearanceEngine(engine.robot, nobody, engine.obstacles).clearance(q) == np.inf
    assert engine.clearances(np.zeros((0, 7))).shape == (0,)


def test_bad_input_is_named():
    engine = cell(0)
    with pytest.raises(InputError, match="not finite"):
        engine.clearance(np.full(7, np.nan))
    for ask, q in (
        (engine.clearance, np.zeros(6)),
        (engine.clearances, np.zeros(7)),
        (engine.clearance, 0.0),
    ):
        with pytest.raises(InputError, match="shape"):
            ask(q)
    for words in ("home", ["a"] * 7, [[0.0], [1.0, 2.0]]):
        with pytest.raises(InputError, match="not an array of numbers"):
            engine.clearance(words)
        with pytest.raises(InputError, match="not an array of numbers"):
            engine.obstacles.distances(words)
    with pytest.raises(InputError, match="threads"):
        engine.clearances(np.zeros((3, 7)), threads=0)
    for pairs in ([(0, 20)], [(1, 1)], [(-1, 2)], [0, 1], [(0.5, 1.0)]):
        with pytest.raises(InputError, match="pair"):
            ClearanceEngine(engine.robot, engine.cover, (), pairs)
    beyond = SphereCover(np.array([8]), np.zeros((1, 3)), np.ones(1))
    with pytest.raises(InputError, match="links 0"):
        ClearanceEngine(engine.robot, beyond)
    with pytest.raises(InputError, match="finite"):
        engine.obstacles.nearest([[np.nan, 0, 0]])
    with pytest.raises(InputError, match="shape"):
        engine.obstacles.nearest(np.zeros((2, 2)))
    flat = Piece(
        "sheet",
        "hull",
        Pose.identity(),
        np.zeros(0),
        np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.0]]),
    )
    with pytest.raises(ModelError, match="sheet"):
        ObstacleArrays([flat])


def test_read_only_arrays_are_taken_as_they_are():
    engine = cell(0)
    q = engine.robot.home
    assert not q.flags.writeable
    assert engine.clearance(q) == engine.clearance(np.array(q)) == engine.clearance(list(q))
    assert engine.clearances(np.tile(q, (6, 1))[::2]).shape == (3,)


def test_nothing_is_compiled_when_imported():
    code = "import sys, workcell.geometry.engine, workcell.geometry.self_collision; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("sliding", [False, True])
def test_contacts_are_all_pairs_below_the_margin(sliding):
    engine = cell(5, sliding)
    batch = engine.robot.random_configuration(np.random.default_rng(6), 12)
    for margin in (0.05, 0.0, -0.01, 3.0):
        found = engine.contacts(batch, margin)
        own = found.other_sphere >= 0
        assert np.all(np.diff(found.row) >= 0) and np.array_equal(own, found.obstacle < 0)
        for row, q in enumerate(batch):
            gaps, gradients = engine.pair_distances_and_gradients(q)
            here = (found.row == row) & ~own
            assert np.count_nonzero(gaps < margin) == np.count_nonzero(here)
            at = found.sphere[here], found.obstacle[here]
            assert np.allclose(found.gap[here], gaps[at], atol=1e-12)
            assert np.allclose(found.gradient[here], gradients[at], atol=1e-9)
            gaps, gradients = engine.self_clearances_and_gradients(q)
            near, here = gaps < margin, (found.row == row) & own
            named = np.column_stack([found.sphere[here], found.other_sphere[here]])
            assert np.array_equal(named, engine.pairs[near])
            assert np.allclose(found.gap[here], gaps[near]) and np.allclose(
                found.gradient[here], gradients[near]
            )
    with pytest.raises(InputError, match="margin"):
        engine.contacts(batch, np.nan)
