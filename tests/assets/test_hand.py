"""The Shadow-type hand: kinematics, limits, masses and extents of the facts; contact points; a grasp of a cube."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.assets.test_robots import COLLISION_GROUP, extent, geoms_of, outside, transform, turned
from workcell import Scene

ROOT = Path(__file__).resolve().parents[2]
FACTS: dict[str, Any] = json.loads(
    (Path(__file__).resolve().parent / "published" / "shadow_hand.json").read_text()
)
MOVABLE = [joint for joint in FACTS["joints"] if "axis" in joint]
GRASP = [
    0.099076,
    0.058977,
    -0.100226,
    0.218905,
    0.715691,
    0.509436,
    -0.165198,
    0.408605,
    0.482614,
    0.567101,
    0.222951,
    -0.121403,
    1.142954,
    0.758885,
    0.705610,
    0.086030,
    -0.176193,
    0.203929,
    0.873475,
    0.366125,
    1.104281,
    0.129498,
    0.133823,
    0.486025,
]
"""A configuration in the cell `hand_cube` in which thumb and fingers touch their faces of the cube."""
FINGERS = ("ff", "mf", "rf", "lf", "th")

Vector = NDArray[np.float64]


@cache
def cell() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(ROOT / "assets" / "cells" / "hand_cube.xml"))


@cache
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(ROOT / "assets" / "robots" / "shadow_hand.xml"))


def at(q: Vector) -> mujoco.MjData:
    data = mujoco.MjData(model())
    data.qpos[:] = q
    mujoco.mj_forward(model(), data)
    return data


def random_configurations(n: int) -> Vector:
    ranges = model().jnt_range
    return np.random.default_rng(3).uniform(ranges[:, 0], ranges[:, 1], (n, model().nq))


def published_poses(q: Vector) -> dict[str, Vector]:
    """T_forearm_link of every link, from the published joint origins and axes alone."""
    angles = {joint["name"]: float(q[k]) for k, joint in enumerate(MOVABLE)}
    poses = {"rh_forearm": np.eye(4)}
    for joint in FACTS["joints"]:
        pose = poses[joint["parent"]] @ transform(joint["xyz"], joint["quat"])
        poses[joint["child"]] = pose @ turned(joint["axis"], angles[joint["name"]])
    return poses


def test_kinematics_match_the_facts() -> None:
    assert [model().joint(j).name for j in range(model().njnt)] == [joint["name"] for joint in MOVABLE]
    assert model().nq == 24
    for q in random_configurations(50):
        data, links = at(q), published_poses(q)
        assert {model().body(body).name for body in range(1, model().nbody)} == set(links)
        for link, pose in links.items():
            np.testing.assert_allclose(data.body(link).xpos, pose[:3, 3], atol=1e-9)
            np.testing.assert_allclose(data.body(link).xmat.reshape(3, 3), pose[:3, :3], atol=1e-9)
        grasp = links["rh_palm"] @ transform(FACTS["grasp_site"]["xyz"], FACTS["grasp_site"]["quat"])
        np.testing.assert_allclose(data.site("tool").xpos, grasp[:3, 3], atol=1e-9)


def test_limits_and_forces_match_the_facts_and_every_joint_is_driven() -> None:
    assert model().nu == len(MOVABLE)
    for k, joint in enumerate(MOVABLE):
        np.testing.assert_array_equal(model().jnt_range[k], joint["range"])
        actuator = model().actuator(joint["name"])
        assert actuator.trnid[0] == k
        np.testing.assert_array_equal(actuator.ctrlrange, joint["range"])
        effort = joint["effort"] or 1.0  # J2 and J1 of the fingers have none in the source
        np.testing.assert_array_equal(actuator.forcerange, [-effort, effort])
        velocity = model().numeric(f"{joint['name']}:velocity").data[0]
        assert model().numeric(f"{joint['name']}:acceleration").data[0] > velocity > 1


def test_masses_match_the_facts() -> None:
    for link, mass in FACTS["masses"].items():
        assert model().body(link).mass[0] == pytest.approx(mass, rel=1e-6), link


def test_collision_geometry_covers_each_link_and_is_not_fat() -> None:
    data = at(model().key("home").qpos)
    for link, published in FACTS["extents"].items():
        geoms = geoms_of(model(), model().body(link).id, COLLISION_GROUP)
        excess = (extent(model(), data, link, geoms) - published) * np.repeat([-1.0, 1.0], 3)
        assert excess.min() >= -0.005, (link, excess)
        assert excess.max() <= 0.003, (link, excess)


@pytest.mark.parametrize("finger", FINGERS)
def test_contact_points_lie_on_the_distal_link_and_look_out_of_it(finger: str) -> None:
    data = at(random_configurations(1)[0])
    (capsule,) = geoms_of(model(), model().body(f"rh_{finger}distal").id, COLLISION_GROUP)
    tip, ball = data.site(f"{finger}_tip"), data.site(f"{finger}_ball")
    assert outside(model(), data, capsule, tip.xpos[None])[0] == pytest.approx(0, abs=1e-9)
    out = tip.xmat.reshape(3, 3)[:, 2]
    radius = model().geom_size[capsule, 0]
    np.testing.assert_allclose(ball.xpos + radius * out, tip.xpos, atol=1e-9)
    # the finger's own frame: out of the pad and towards the end
    own = data.body(f"rh_{finger}distal").xmat.reshape(3, 3).T @ out
    np.testing.assert_allclose(own, [0, -np.cos(np.deg2rad(40)), np.sin(np.deg2rad(40))], atol=1e-9)


def test_pads_of_middle_links_and_palm_look_out_of_them() -> None:
    data = at(random_configurations(1)[0])
    for site in (*(f"{finger}_middle" for finger in FINGERS), "palm"):
        found = data.site(site)
        solids = geoms_of(model(), int(model().site_bodyid[found.id]), COLLISION_GROUP)
        out = found.xmat.reshape(3, 3)[:, 2]
        for step in (0.0, 0.002):
            distance = min(
                outside(model(), data, geom, (found.xpos + step * out)[None])[0] for geom in solids
            )
            assert distance == pytest.approx(step, abs=1e-9), site


def test_home_is_inside_the_limits_and_free_of_contact() -> None:
    home = model().key("home").qpos
    assert np.all((home >= model().jnt_range[:, 0]) & (home <= model().jnt_range[:, 1]))
    assert at(home).ncon == 0 and at(np.zeros(24)).ncon == 0


def test_no_pair_of_links_touches_in_most_configurations() -> None:
    touches: dict[tuple[int, ...], int] = {}
    configurations = random_configurations(300)
    for q in configurations:
        for pair in {tuple(sorted(pair)) for pair in model().geom_bodyid[at(q).contact.geom].tolist()}:
            touches[pair] = touches.get(pair, 0) + 1
    assert max(touches.values()) < 0.5 * len(configurations), touches


def test_only_links_whose_joints_meet_in_a_point_are_excluded() -> None:
    data = at(random_configurations(1)[0])
    for exclude in mujoco.MjSpec.from_file(str(ROOT / "assets" / "robots" / "shadow_hand.xml")).excludes:
        outer = model().body(exclude.bodyname2)
        between = model().body(int(outer.parentid[0]))
        assert model().body(int(between.parentid[0])).name == exclude.bodyname1
        np.testing.assert_allclose(data.body(outer.id).xpos, data.body(between.id).xpos, atol=1e-12)


def test_it_keeps_still_at_home() -> None:
    data = mujoco.MjData(model())
    mujoco.mj_resetDataKeyframe(model(), data, model().key("home").id)
    mujoco.mj_step(model(), data, 500)
    assert np.abs(data.qpos - model().key("home").qpos).max() < 0.02
    assert np.abs(data.qvel).max() < 1e-3 and data.ncon == 0


# The cell with the cube


def grasping() -> mujoco.MjData:
    data = mujoco.MjData(cell())
    data.qpos[:24] = GRASP
    mujoco.mj_forward(cell(), data)
    return data


def touching(data: mujoco.MjData) -> set[str]:
    """The geoms that touch the cube."""
    pairs = [{cell().geom(geom).name for geom in pair} for pair in data.contact.geom]
    return {name for pair in pairs if "cube" in pair for name in pair - {"cube"}}


def test_in_its_cell_the_hand_is_the_same_and_begins_away_from_the_cube() -> None:
    assert [cell().joint(j).name for j in range(25)] == [*(f"hand/{j['name']}" for j in MOVABLE), "cube"]
    for qpos in (cell().qpos0, cell().key("hand/home").qpos):
        data = mujoco.MjData(cell())
        data.qpos[:] = qpos
        mujoco.mj_forward(cell(), data)
        mujoco.mj_collision(cell(), data)
        assert touching(data) <= {"pedestal"}
        cube = cell().geom("cube").id
        hand = [geom for geom in range(cell().ngeom) if cell().geom_group[geom] == COLLISION_GROUP]
        assert min(mujoco.mj_geomDistance(cell(), data, geom, cube, 0.1, None) for geom in hand) > 0.008


def test_thumb_and_fingers_reach_their_faces_of_the_cube_and_touch_nothing_else() -> None:
    data, half = grasping(), cell().geom("cube").size[0]
    assert np.all((np.array(GRASP) > cell().jnt_range[:24, 0]) & (np.array(GRASP) < cell().jnt_range[:24, 1]))
    for finger in FINGERS:
        face = data.site("thumb_face" if finger == "th" else "fingers_face")
        radius = model().geom_size[
            geoms_of(model(), model().body(f"rh_{finger}distal").id, COLLISION_GROUP)[0], 0
        ]
        ball = face.xmat.reshape(3, 3).T @ (data.site(f"hand/{finger}_ball").xpos - face.xpos)
        assert ball[2] == pytest.approx(radius, abs=1e-4) and np.abs(ball[:2]).max() < half - 0.005
        out = data.site(f"hand/{finger}_tip").xmat.reshape(3, 3)[:, 2]
        assert out @ face.xmat.reshape(3, 3)[:, 2] < -0.7  # with the pad, not with the nail
    pairs = [{cell().geom(geom).name for geom in pair} for pair in data.contact.geom]
    assert all("cube" in pair for pair in pairs)
    assert all(name == "pedestal" or name.endswith("distal_collision") for name in touching(data))


def test_a_grasp_holds_the_cube_and_lifts_it_by_the_wrist() -> None:
    data = grasping()
    torque = np.zeros(cell().nv)
    for finger, force in zip(FINGERS, (-2.0, -2.0, -2.0, -1.0, 7.0), strict=True):
        jacobian = np.zeros((3, cell().nv))
        mujoco.mj_jacSite(cell(), data, jacobian, None, cell().site(f"hand/{finger}_ball").id)
        torque += force * jacobian[0]
    data.ctrl[:] = GRASP + torque[:24] / cell().actuator_gainprm[:, 0]
    mujoco.mj_step(cell(), data, 250)
    before, wrist = data.body("cube").xpos.copy(), float(data.ctrl[1])
    for step in range(600):
        data.ctrl[1] = wrist - 0.3 * min(1.0, step / 400)
        mujoco.mj_step(cell(), data)
    assert data.body("cube").xpos[2] - before[2] > 0.025
    assert touching(data) == {f"hand/rh_{finger}distal_collision" for finger in FINGERS}


def test_the_cube_stays_on_its_pedestal() -> None:
    data = mujoco.MjData(cell())
    before = cell().body("cube").pos
    mujoco.mj_step(cell(), data, 500)
    assert np.linalg.norm(data.body("cube").xpos - before) < 1e-3


def test_it_is_a_scene() -> None:
    scene = Scene.load("hand_cube")
    assert {"floor", "pedestal", "stand", "cube"} <= set(scene.obstacles)
