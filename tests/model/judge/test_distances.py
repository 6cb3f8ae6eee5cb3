"""Distances do not depend on the user's options, and are never positive where geoms meet."""

import itertools

import mujoco
import numpy as np
import pytest

from tests.model.judge.shapes import CONVEX, hill, numbers, pair_model, scatter
from workcell.model.judge.distances import judge_model

OPTIONS = [
    '<option ccd_iterations="3"/>',
    '<option ccd_tolerance="0.1"/>',
    '<option><flag nativeccd="disable"/></option>',
    '<option o_margin="0.5"><flag override="enable" contact="disable" constraint="disable"/></option>',
]


@pytest.mark.parametrize("option", OPTIONS)
def test_options_of_the_file_change_nothing(option):
    for first, second in itertools.product(CONVEX, CONVEX):
        sizes = np.random.default_rng(0).uniform(0.02, 0.2, (2, 3))
        plain = pair_model(np.random.default_rng(1), first, second, sizes=sizes)
        odd = pair_model(np.random.default_rng(1), first, second, option, sizes)
        before = odd.opt.ccd_iterations, odd.opt.ccd_tolerance, odd.opt.disableflags, odd.opt.enableflags
        data, rng = mujoco.MjData(odd), np.random.default_rng(2)
        for _ in range(5):
            scatter(odd, data, rng, 0.1)
            assert judge_model(odd).distance(data, 0, 1, 10.0) == judge_model(plain).distance(
                data, 0, 1, 10.0
            )
        after = odd.opt.ccd_iterations, odd.opt.ccd_tolerance, odd.opt.disableflags, odd.opt.enableflags
        assert before == after


@pytest.mark.parametrize("second", CONVEX)
@pytest.mark.parametrize("first", ["plane", "hfield", *CONVEX])
def test_what_mujoco_has_in_contact_has_no_positive_distance(first, second):
    rng, met = np.random.default_rng([ord(c) for c in first + second]), 0
    for _ in range(12):
        sizes = None if rng.random() < 0.5 else rng.uniform(0.05, 0.3, (2, 3))
        model = pair_model(rng, first, second, sizes=sizes)
        judge, data = judge_model(model), mujoco.MjData(model)
        for _ in range(15):
            scatter(model, data, rng, 0.15)
            distances = [
                judge.distance(data, *pair, limit) for pair in ((0, 1), (1, 0)) for limit in (10.0, 0.01)
            ]
            mujoco.mj_collision(judge.model, data)
            if data.ncon:
                met += 1
                assert max(distances) <= 0.0 if data.contact.dist.min() < -1e-6 else max(distances) < 1e-6
            elif (first, second) not in (("box", "capsule"), ("capsule", "box")):
                assert min(distances) > -1e-6
    assert met


def _segment_to_box(start, end, half):
    """The distance between a segment and a box, by search."""
    low, high = 0.0, 1.0

    def away(t):
        return float(np.linalg.norm(np.maximum(np.abs(start + t * (end - start)) - half, 0.0)))

    for _ in range(90):
        a, b = low + (high - low) / 3, high - (high - low) / 3
        low, high = (low, b) if away(a) <= away(b) else (a, high)
    return min(away(low), away(0.0), away(1.0))


def test_a_capsule_through_a_thin_plate_is_in_it():
    rng, through = np.random.default_rng(4), 0
    for _ in range(80):
        half, capsule = 10 ** rng.uniform([-3.3, -1, -1], [-2, 0, 0]), 10 ** rng.uniform(-3, 0, 3)
        model = pair_model(rng, "box", "capsule", sizes=[half, capsule])
        judge, data = judge_model(model), mujoco.MjData(model)
        for _ in range(10):
            scatter(model, data, rng, 0.1)
            R, z = data.geom_xmat[0].reshape(3, 3), data.geom_xmat[1].reshape(3, 3)[:, 2]
            ends = [R.T @ (data.geom_xpos[1] + s * capsule[1] * z - data.geom_xpos[0]) for s in (-1, 1)]
            true = _segment_to_box(*ends, half) - capsule[0]
            found, points = judge.distance(data, 0, 1, 10.0, near := np.zeros(6)), near.reshape(2, 3)
            if true > 0:
                assert found == pytest.approx(true, abs=1e-6)
            else:
                assert found <= 1e-9
                through += mujoco.mj_geomDistance(model, data, 0, 1, 10.0, None) > 0
                assert (np.abs(R.T @ (points[0] - data.geom_xpos[0])) <= half + capsule[0] + 1e-6).all()
    assert through > 20  # MuJoCo's own distance is positive there


def test_the_points_of_a_field_are_as_far_apart_as_the_distance_says():
    rng = np.random.default_rng(5)
    for second in CONVEX:
        model = pair_model(rng, "hfield", second, sizes=rng.uniform(0.02, 0.1, (2, 3)))
        judge, data = judge_model(model), mujoco.MjData(model)
        for _ in range(40):
            scatter(model, data, rng, 0.5)
            one, other = np.zeros(6), np.zeros(6)
            found = judge.distance(data, 0, 1, 10.0, one)
            assert judge.distance(data, 1, 0, 10.0, other) == found
            assert np.array_equal(one.reshape(2, 3), other.reshape(2, 3)[::-1])
            if found > 0:
                assert np.linalg.norm(one[:3] - one[3:]) == pytest.approx(found, abs=1e-6)
                assert judge.distance(data, 0, 1, 0.5 * found) == 0.5 * found


def test_the_distance_to_a_field_is_that_to_its_prisms():
    rng = np.random.default_rng(6)
    asset = hill(rng, (4, 5))
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><asset>{asset}</asset><worldbody><geom type="hfield" hfield="hill"/>'
        '<body><freejoint/><geom type="sphere" size="0.05"/></body></worldbody></mujoco>'
    )
    from workcell.geometry.engine import ObstacleArrays
    from workcell.geometry.pieces import pieces_of_bodies

    prisms = ObstacleArrays(pieces_of_bodies(model, [0]))
    data = mujoco.MjData(model)
    for _ in range(300):
        data.qpos[:3] = rng.normal(size=3) * 0.5
        mujoco.mj_kinematics(model, data)
        found = judge_model(model).distance(data, 0, 1, 10.0)
        distance = prisms.nearest(data.qpos[None, :3])[0][0]
        assert found == pytest.approx(distance - 0.05, abs=1e-7) if distance > 0 else found < -0.04


def test_large_fields_cost_what_is_near():
    rng = np.random.default_rng(7)
    heights = np.cumsum(rng.normal(size=(700, 700)), axis=0)
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><asset><hfield name="h" nrow="700" ncol="700" size="20 20 1 0.1"/></asset><worldbody>'
        f'<geom type="hfield" hfield="h"/><body><freejoint/><geom type="box" size="{numbers([0.1] * 3)}"/></body>'
        "</worldbody></mujoco>"
    )
    model.hfield_data[:] = ((heights - heights.min()) / np.ptp(heights)).ravel()
    judge, data = judge_model(model), mujoco.MjData(model)
    import time

    judge.distance(data, 0, 1, 10.0)
    began = time.process_time()
    for _ in range(200):
        data.qpos[:3] = [*rng.uniform(-20, 20, 2), rng.uniform(0, 3)]
        mujoco.mj_kinematics(model, data)
        judge.distance(data, 0, 1, 10.0)
    assert (time.process_time() - began) / 200 < 5e-3
