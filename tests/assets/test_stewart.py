"""The two platforms on six legs: published points and lengths, loops that close, and a platform that stays."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from workcell import Scene

ROOT = Path(__file__).resolve().parents[2]
CELLS = ROOT / "assets" / "cells"
FACTS = json.loads((Path(__file__).resolve().parent / "published" / "stewart.json").read_text())
PLATFORMS = ("stewart", "stewart_dietmaier")

Vector = NDArray[np.float64]


@cache
def model_of(name: str) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(CELLS / f"{name}.xml"))


def facts(name: str) -> dict[str, Any]:
    return {key: np.array(value) for key, value in FACTS[name].items()}


def at_home(name: str) -> mujoco.MjData:
    model = model_of(name)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    mujoco.mj_forward(model, data)
    return data


def missed(data: mujoco.MjData) -> Vector:
    """What the connects miss, metres, by MuJoCo's own measure."""
    rows = data.efc_type[: data.nefc] == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    return np.array(data.efc_pos[: data.nefc][rows])


def placed(name: str, position: Vector, rotation: Rotation) -> mujoco.MjData:
    """The platform's frame at a pose, every leg as long as it must be and pointing where it must."""
    model, given = model_of(name), facts(name)
    data = mujoco.MjData(model)
    legs = rotation.apply(given["platform_points"]) + position - given["base_points"]
    for k, leg in enumerate(legs, start=1):
        length = np.linalg.norm(leg)
        frame = Rotation.from_quat(np.roll(model.body(f"leg{k}_lower").quat, -1))
        turn, _ = Rotation.align_vectors([frame.inv().apply(leg / length)], [[0, 0, 1]])
        data.joint(f"leg{k}_ball").qpos = np.roll(turn.as_quat(), 1)
        data.joint(f"leg{k}_slide").qpos = length
    data.joint("platform").qpos = [*position, *np.roll(rotation.as_quat(), 1)]
    mujoco.mj_forward(model, data)
    return data


def random_poses(name: str, n: int) -> list[tuple[Vector, Rotation]]:
    """Of the platform's frame, around those of the paper on IKSPARK: its centre in a box, turned by up to 60 deg."""
    rng, centre = np.random.default_rng(5), facts(name)["centre"]
    poses = []
    for _ in range(n):
        at = rng.uniform([0.2, -0.3, 0.8], [0.8, 0.3, 1.05])
        angles = rng.uniform(-1, 1, 3) * [np.pi / 3, np.pi / 12, np.pi / 12]
        rotation = Rotation.from_euler("ZYX", angles)
        poses.append((at - rotation.apply(centre), rotation))
    return poses


@pytest.mark.parametrize("name", PLATFORMS)
def test_points_of_base_and_platform_are_the_published_ones(name: str) -> None:
    model, given, data = model_of(name), facts(name), at_home(name)
    for k in range(1, 7):
        np.testing.assert_allclose(data.body(f"leg{k}_lower").xpos, given["base_points"][k - 1], atol=1e-9)
        np.testing.assert_allclose(model.site(f"platform{k}").pos, given["platform_points"][k - 1], atol=1e-9)
    np.testing.assert_allclose(model.site("platform").pos, given["centre"], atol=1e-9)
    assert np.array_equal(model.site("platform").quat, [1, 0, 0, 0])


@pytest.mark.parametrize("name", PLATFORMS)
def test_it_is_assembled_at_zero_and_at_home(name: str) -> None:
    model, data = model_of(name), at_home(name)
    np.testing.assert_array_equal(data.qpos, model.qpos0)
    assert len(missed(data)) == 18 and np.abs(missed(data)).max() < 1e-12
    assert data.ncon == 0
    np.testing.assert_allclose(data.ctrl[:6], data.actuator_length[:6], atol=1e-12)


@pytest.mark.parametrize("name", PLATFORMS)
def test_a_slide_s_value_is_the_length_of_its_leg(name: str) -> None:
    for position, rotation in random_poses(name, 50):
        data = placed(name, position, rotation)
        assert np.abs(missed(data)).max() < 1e-9
        np.testing.assert_allclose(
            data.site("platform").xpos, position + rotation.apply(facts(name)["centre"]), atol=1e-9
        )


@pytest.mark.parametrize("name", PLATFORMS)
def test_legs_are_long_enough_for_the_paper_s_poses_and_only_slides_are_driven(name: str) -> None:
    model = model_of(name)
    slides = [model.joint(f"leg{k}_slide") for k in range(1, 7)]
    for position, rotation in random_poses(name, 300):
        data = placed(name, position, rotation)
        lengths = np.array([data.joint(joint.id).qpos[0] for joint in slides])
        assert np.all((lengths > slides[0].range[0]) & (lengths < slides[0].range[1]))
    for k, joint in enumerate(slides):
        assert joint.range.tolist() == [0.2, 2.6] and model.actuator(k).trnid[0] == joint.id
        assert model.numeric(f"leg{k + 1}_slide:velocity").data[0] > 0
    kinds = [int(kind) for kind in model.jnt_type]
    assert kinds.count(int(mujoco.mjtJoint.mjJNT_BALL)) == 6 and model.nv == 30
    assert not model.jnt_limited[model.jnt_type == mujoco.mjtJoint.mjJNT_BALL].any()


def test_dietmaier_s_forty_postures_have_one_set_of_lengths() -> None:
    given = facts("stewart_dietmaier")
    assert len(given["postures"]) == 40
    for pose in given["postures"]:
        data = placed("stewart_dietmaier", pose[:3], Rotation.from_quat(np.roll(pose[3:], -1)))
        lengths = [data.joint(f"leg{k}_slide").qpos[0] for k in range(1, 7)]
        np.testing.assert_allclose(lengths, given["leg_lengths"], atol=1e-9)
        assert np.abs(missed(data)).max() < 1e-9
    home = at_home("stewart_dietmaier")
    lengths = [home.joint(f"leg{k}_slide").qpos[0] for k in range(1, 7)]
    np.testing.assert_allclose(lengths, given["leg_lengths"], atol=1e-12)


def drive_columns(name: str, data: mujoco.MjData) -> Vector:
    """How the drives (n, 6) move with the platform, whose legs follow it."""
    model = model_of(name)
    jacobian = np.zeros((6, model.nv))
    rows = []
    mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], model.site("platform").id)
    platform = jacobian[:, model.joint("platform").dofadr[0] :][:, :6]
    for k in range(1, 7):
        leg = data.site(f"platform{k}").xpos - data.body(f"leg{k}_lower").xpos
        direction = leg / np.linalg.norm(leg)
        arm = data.site(f"platform{k}").xpos - data.site("platform").xpos
        rows.append(np.hstack([direction, np.cross(arm, direction)]) @ platform)
    if model.nu == 7:
        rows.append(platform[5])
    return np.array(rows)


def test_six_legs_do_not_hold_griffis_and_duffy_s_platform_and_the_seventh_drive_does() -> None:
    for position, rotation in random_poses("stewart", 100):
        columns = drive_columns("stewart", placed("stewart", position, rotation))
        assert np.linalg.svd(columns[:6])[1].min() < 1e-12
        assert np.linalg.svd(columns)[1].min() > 0.2


def test_six_legs_hold_dietmaier_s_platform_at_home() -> None:
    assert np.linalg.svd(drive_columns("stewart_dietmaier", at_home("stewart_dietmaier")))[1].min() > 0.1


def test_legs_keep_apart_in_the_paper_s_poses() -> None:
    for position, rotation in random_poses("stewart", 200):
        assert placed("stewart", position, rotation).ncon == 0


def test_legs_that_cross_are_in_contact() -> None:
    data = placed("stewart", np.array([1.5, 0.87, 1.0]), Rotation.from_euler("z", np.pi))
    names = {model_of("stewart").geom(geom).name for pair in data.contact.geom for geom in pair}
    assert len(names) >= 2 and all(name.startswith("leg") for name in names)


@pytest.mark.parametrize("name", PLATFORMS)
def test_the_drives_hold_the_platform(name: str) -> None:
    model, data = model_of(name), at_home(name)
    before = data.site("platform").xpos.copy()
    worst = 0.0
    for _ in range(1000):
        mujoco.mj_step(model, data)
        worst = max(worst, float(np.abs(missed(data)).max()))
    assert worst < 2e-5
    assert np.linalg.norm(data.site("platform").xpos - before) < 0.005
    assert np.abs(data.qvel).max() < 1e-3
    assert np.all(np.abs(data.actuator_force) < 0.5 * model.actuator_forcerange[:, 1])


@pytest.mark.parametrize("name", PLATFORMS)
def test_links_have_plausible_masses(name: str) -> None:
    model = model_of(name)
    moving = model.body_weldid > 0
    assert np.all((model.body_mass[moving] >= 1.0) & (model.body_mass[moving] <= 30.0))
    assert np.all(model.body_inertia[moving] > 1e-5)


@pytest.mark.parametrize("name", PLATFORMS)
def test_a_platform_is_a_scene_without_a_robot(name: str) -> None:
    scene = Scene.load(name)
    assert not scene.robots and not scene.objects
    assert {f"leg{k}_slide" for k in range(1, 7)} <= set(scene.actuators())
