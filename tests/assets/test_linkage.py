"""The gripper on linkages: loops that close, jaws that stay parallel, a grasp that holds, and how it loads."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.assets.test_robots import load_script
from workcell import Scene
from workcell.model.mechanism import from_model, placing
from workcell.simulate.grasp import Hand

ROOT = Path(__file__).resolve().parents[2]
FILE = ROOT / "assets" / "robots" / "linkage_gripper.xml"
OPEN, CLOSED = 0.38, -0.38
LENGTH = 0.057  # of crank and rocker
SIDES = ("left", "right")

Vector = NDArray[np.float64]


@cache
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(FILE))


def at(angle: float) -> mujoco.MjData:
    """Both cranks at an angle, outwards, and what hangs on them."""
    data = mujoco.MjData(model())
    for side in SIDES:
        data.joint(f"{side}_crank").qpos = data.joint(f"{side}_rocker").qpos = angle
        data.joint(f"{side}_finger").qpos = -angle
    mujoco.mj_forward(model(), data)
    return data


def missed(data: mujoco.MjData) -> float:
    rows = data.efc_type[: data.nefc] == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    assert rows.sum() == 7
    return float(np.abs(data.efc_pos[: data.nefc][rows]).max())


def gap(data: mujoco.MjData) -> float:
    pads = [model().geom(f"{side}_finger_pad").id for side in SIDES]
    return float(mujoco.mj_geomDistance(model(), data, *pads, 1.0, None))


@pytest.mark.parametrize("angle", np.linspace(CLOSED, OPEN, 9))
def test_loops_close_and_fingers_swing_without_turning(angle: float) -> None:
    data = at(float(angle))
    assert missed(data) < 1e-12 and data.ncon == 0
    assert gap(data) == pytest.approx(2 * (0.0212 + LENGTH * np.sin(angle)), abs=1e-9)
    for side, way in zip(SIDES, (1, -1), strict=True):
        finger = data.body(f"{side}_finger")
        np.testing.assert_allclose(finger.xmat.reshape(3, 3), np.eye(3), atol=1e-12)
        reach = [0, way * (0.034 + LENGTH * np.sin(angle)), 0.06 + LENGTH * np.cos(angle)]
        np.testing.assert_allclose(finger.xpos, reach, atol=1e-12)


def test_it_is_assembled_at_zero_and_at_home() -> None:
    for qpos in (model().qpos0, model().key("home").qpos):
        data = mujoco.MjData(model())
        data.qpos[:] = qpos
        mujoco.mj_forward(model(), data)
        assert missed(data) < 1e-12
    np.testing.assert_array_equal(model().key("home").ctrl, [OPEN])


def test_one_hinge_is_driven_one_follows_and_four_are_passive() -> None:
    mechanism = from_model.mechanism_of(model())
    driven = {joint.name for joint in mechanism.joints if joint.driven}
    assert driven == {"left_crank", "right_crank"} and len(mechanism.joints) == 6
    (follower,) = mechanism.followers
    assert mechanism.joints[follower.joint].name == "right_crank"
    assert mechanism.joints[follower.leader].name == "left_crank"
    assert [closure.kind for closure in mechanism.closures] == ["connect", "connect"]
    values, rows = placing.missed(placing.place(mechanism, mechanism.home))
    assert np.abs(values).max() < 1e-12
    # in the plane: seven equations, of which two are the linkages' thickness, leave one degree of freedom
    assert np.linalg.matrix_rank(rows, tol=1e-9) == 5 and mechanism.dof == 6


def test_it_opens_and_closes_on_command_and_keeps_still() -> None:
    data = mujoco.MjData(model())
    mujoco.mj_resetDataKeyframe(model(), data, model().key("home").id)
    for angle in (OPEN, 0.0, CLOSED, OPEN):
        data.ctrl[0] = angle
        worst = 0.0
        for _ in range(400):
            mujoco.mj_step(model(), data)
            worst = max(worst, missed(data))
        assert worst < 2e-3 and missed(data) < 1e-4
        assert np.abs(data.qvel).max() < 1e-3
        assert gap(data) == pytest.approx(gap(at(angle)), abs=5e-4)


@pytest.mark.parametrize("width", [0.03, 0.07])
def test_it_holds_a_block_against_gravity(width: float) -> None:
    cell = mujoco.MjSpec()
    cell.worldbody.add_site(name="mount", pos=[0, 0, 1], quat=[0.7071067811865476, 0, 0.7071067811865476, 0])
    cell.attach(mujoco.MjSpec.from_file(str(FILE)), site="mount", prefix="gripper/")
    block = cell.worldbody.add_body(name="block", pos=[0.14, 0, 1])
    block.add_freejoint()
    block.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.015, width / 2, 0.03], mass=0.3)
    block.gravcomp = 1.0
    cell.option.impratio = 10
    cell.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    compiled = cell.compile()
    data = mujoco.MjData(compiled)
    data.qpos[:6] = model().key("home").qpos
    data.ctrl[0] = OPEN
    mujoco.mj_forward(compiled, data)
    assert data.ncon == 0
    data.ctrl[0] = CLOSED
    mujoco.mj_step(compiled, data, 300)
    compiled.body_gravcomp[:] = 0.0
    before = data.body("block").xpos.copy()
    mujoco.mj_step(compiled, data, 800)
    assert np.linalg.norm(data.body("block").xpos - before) < 0.003


def test_links_have_plausible_masses_and_inertias_of_their_geometry() -> None:
    inertials = load_script("inertials")
    assert FILE.name in inertials.FILES
    assert model().body_mass.sum() == pytest.approx(0.79)
    assert np.all(model().body_inertia[1:] > 1e-8)


def test_on_an_arm_it_is_a_hand_of_two_fingers(tmp_path: Path) -> None:
    task = """
format = "workcell-task/1"
name = "held"
cell = "machine"
[[robots]]
name = "ur10"
model = "ur10"
mount = "robot_mount"
gripper = "linkage_gripper"
gripper_site = "tool0"
"""
    (tmp_path / "held.toml").write_text(task)
    scene = Scene.load(tmp_path / "held.toml")
    hand = Hand.of(scene.model, scene.robot())
    assert hand is not None and (hand.closed, hand.open) == (CLOSED, OPEN)
    names = [{scene.model.body(body).name.rsplit("/", 1)[-1] for body in finger} for finger in hand.fingers]
    assert sorted(map(sorted, names)) == [
        [f"{side}_{part}" for part in ("crank", "finger", "rocker")] for side in SIDES
    ]
