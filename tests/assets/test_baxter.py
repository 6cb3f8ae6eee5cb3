"""Baxter, whole and one arm alone: kinematics, limits, masses and extents of the facts; contacts; its bench."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.assets.test_robots import COLLISION_GROUP, extent, geoms_of, transform, turned
from workcell import IKProblem, Scene, solve
from workcell.model.loading.load import load_robot

ROOT = Path(__file__).resolve().parents[2]
FACTS: dict[str, Any] = json.loads(
    (Path(__file__).resolve().parent / "published" / "baxter.json").read_text()
)
MOVABLE = [joint for joint in FACTS["joints"] if "axis" in joint]
SIDES = ("left", "right")
SITES = {"tool": "hand_link", "gripper_mount": "gripper_base_link", "endpoint": "gripper"}
WHOLE, ARM = "baxter", "baxter_arm"

Vector = NDArray[np.float64]


@cache
def model_of(name: str) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(ROOT / "assets" / "robots" / f"{name}.xml"))


def at(name: str, q: Vector) -> mujoco.MjData:
    data = mujoco.MjData(model_of(name))
    data.qpos[:] = q
    mujoco.mj_forward(model_of(name), data)
    return data


def home(name: str) -> Vector:
    return np.array(model_of(name).key("home").qpos)


def random_configurations(name: str, n: int) -> Vector:
    ranges = model_of(name).jnt_range
    return np.random.default_rng(11).uniform(ranges[:, 0], ranges[:, 1], (n, len(ranges)))


def published_poses(q: dict[str, float], root: str) -> dict[str, Vector]:
    """Poses, in a link, of all that hang on it, from the published joint origins and axes alone."""
    poses = {root: np.eye(4)}
    for joint in FACTS["joints"]:
        if joint["parent"] in poses:
            pose = poses[joint["parent"]] @ transform(joint["xyz"], joint["quat"])
            poses[joint["child"]] = (
                pose @ turned(joint["axis"], q[joint["name"]]) if "axis" in joint else pose
            )
    return poses


def assert_there(place: Any, pose: Vector) -> None:
    np.testing.assert_allclose(place.xpos, pose[:3, 3], atol=1e-9)
    np.testing.assert_allclose(place.xmat.reshape(3, 3), pose[:3, :3], atol=1e-9)


def test_kinematics_of_the_whole_match_the_facts() -> None:
    model = model_of(WHOLE)
    names = [model.joint(j).name for j in range(model.njnt)]
    assert set(names) == {joint["name"] for joint in MOVABLE} and model.nq == 14
    for q in random_configurations(WHOLE, 40):
        data, links = at(WHOLE, q), published_poses(dict(zip(names, q, strict=True)), "base")
        bodies = {model.body(body).name for body in range(1, model.nbody)}
        assert bodies == {link for link in links if not link.endswith(("gripper_base_link", "/gripper"))}
        for body in bodies:
            assert_there(data.body(body), links[body])
        for side in SIDES:
            for site, link in SITES.items():
                assert_there(data.site(f"{side}/{site}"), links[f"{side}/{link}"])


@pytest.mark.parametrize("side", SIDES)
def test_one_arm_is_either_of_them_from_its_mount(side: str) -> None:
    model = model_of(ARM)
    names = [f"{side}/{model.joint(j).name}" for j in range(model.njnt)]
    for q in random_configurations(ARM, 40):
        data = at(ARM, q)
        links = published_poses(dict(zip(names, q, strict=True)), f"{side}/arm_mount")
        for body in range(1, model.nbody):
            assert_there(data.body(body), links[f"{side}/{model.body(body).name}"])
        for site, link in SITES.items():
            assert_there(data.site(site), links[f"{side}/{link}"])


def test_limits_match_the_facts() -> None:
    model = model_of(WHOLE)
    assert model.nu == len(MOVABLE)
    for joint in MOVABLE:
        name, effort = joint["name"], joint["effort"]
        found, actuator = model.joint(name), model.actuator(name)
        np.testing.assert_array_equal(found.range, joint["range"])
        np.testing.assert_array_equal(model.jnt_actfrcrange[found.id], [-effort, effort])
        assert actuator.trnid[0] == found.id
        np.testing.assert_array_equal(actuator.ctrlrange, [-effort, effort])
        assert model.numeric(f"{name}:velocity").data[0] == joint["velocity"]
        assert model.numeric(f"{name}:acceleration").data[0] > joint["velocity"]


def test_masses_match_the_facts() -> None:
    for link, mass in FACTS["masses"].items():
        assert model_of(WHOLE).body(link).mass[0] == pytest.approx(mass, rel=1e-6), link


def test_collision_geometry_covers_each_link_and_is_not_fat() -> None:
    model, data = model_of(WHOLE), at(WHOLE, home(WHOLE))
    for link, published in FACTS["extents"].items():
        geoms = geoms_of(model, model.body(link).id, COLLISION_GROUP)
        excess = (extent(model, data, link, geoms) - published) * np.repeat([-1.0, 1.0], 3)
        assert excess.min() >= -0.005, (link, excess)
        assert excess.max() <= 0.02, (link, excess)


@pytest.mark.parametrize("name", [WHOLE, ARM])
def test_home_is_inside_the_limits_free_of_contact_and_not_singular(name: str) -> None:
    model, q = model_of(name), home(name)
    assert np.all((q > model.jnt_range[:, 0] + 0.05) & (q < model.jnt_range[:, 1] - 0.05))
    data = at(name, q)
    assert data.ncon == 0
    assert np.all(np.abs(data.qfrc_bias) < 0.8 * model.jnt_actfrcrange[:, 1])
    for site in ["tool"] if name == ARM else [f"{side}/tool" for side in SIDES]:
        jacobian = np.zeros((6, model.nv))
        mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], model.site(site).id)
        assert np.linalg.svd(jacobian)[1][:6].min() > 0.05


def test_hands_at_home_are_mirror_images() -> None:
    data = at(WHOLE, home(WHOLE))
    left, right = (data.site(f"{side}/tool").xpos for side in SIDES)
    np.testing.assert_allclose(left, right * [1, -1, 1], atol=1e-6)


@pytest.mark.parametrize(("name", "free_at_least"), [(ARM, 0.9), (WHOLE, 0.4)])
def test_no_pair_of_links_touches_in_most_configurations(name: str, free_at_least: float) -> None:
    model = model_of(name)
    touches: dict[tuple[int, ...], int] = {}
    free, configurations = 0, random_configurations(name, 400)
    for q in configurations:
        pairs = {tuple(sorted(pair)) for pair in model.geom_bodyid[at(name, q).contact.geom].tolist()}
        free += not pairs
        for pair in pairs:
            touches[pair] = touches.get(pair, 0) + 1
    assert max(touches.values(), default=0) < 0.25 * len(configurations), touches
    assert free > free_at_least * len(configurations)


@pytest.mark.parametrize("name", [WHOLE, ARM])
def test_its_motors_can_hold_it_at_home(name: str) -> None:
    model = model_of(name)
    data = at(name, home(name))
    for _ in range(500):
        data.ctrl[:] = data.qfrc_bias
        mujoco.mj_step(model, data)
    assert np.abs(data.qpos - home(name)).max() < 1e-3 and np.abs(data.qvel).max() < 1e-2


def test_either_arm_of_the_whole_is_a_robot_by_its_tool() -> None:
    arm = load_robot(ARM)
    for side in SIDES:
        found = load_robot(WHOLE, tool=f"{side}/tool")
        assert found.joint_names == tuple(f"{side}/{name}" for name in arm.joint_names)
        np.testing.assert_array_equal(found.velocity, arm.velocity)


# The bench

TASK = """
format = "workcell-task/1"
name = "bench"
cell = "baxter_bench"
{robots}
[[objects]]
name = "carton"
model = "carton"
place = "carton_place"
"""
ROBOT = """
[[robots]]
name = "{side}"
model = "baxter_arm"
mount = "{side}_mount"
gripper = "parallel_gripper"
gripper_site = "gripper_mount"
start = {start}
"""


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    starts = dict(zip(SIDES, np.split(home(WHOLE), 2), strict=True))
    robots = "".join(ROBOT.format(side=side, start=q.tolist()) for side, q in starts.items())
    path = tmp_path_factory.mktemp("bench") / "bench.toml"
    path.write_text(TASK.format(robots=robots))
    return Scene.load(path)


def test_on_the_bench_arms_stand_as_on_the_torso_and_begin_clear(bench: Scene) -> None:
    data = mujoco.MjData(bench.model)
    data.qpos[:] = bench.initial_qpos()
    mujoco.mj_forward(bench.model, data)
    whole = at(WHOLE, home(WHOLE))
    torso = data.body("torso").xpos
    for side in SIDES:
        for body in ("arm_mount", "hand_link"):
            np.testing.assert_allclose(
                data.body(f"{side}/{body}").xpos - torso, whole.body(f"{side}/{body}").xpos, atol=1e-5
            )
    touching = {bench.model.body(int(body)).name for body in bench.model.geom_bodyid[data.contact.geom].flat}
    assert touching <= {"bench", "carton/carton"}


def test_the_obstacles_are_baxter_s_own_torso_pedestal_and_head(bench: Scene) -> None:
    whole, own = model_of(WHOLE), bench.model
    for link, body in (("torso", "torso"), ("pedestal", "torso"), ("head", "torso"), ("screen", "screen")):
        for geom in geoms_of(whole, whole.body(link).id, COLLISION_GROUP):
            found = [
                g
                for g in range(own.ngeom)
                if own.geom_bodyid[g] == own.body(body).id
                and own.geom_type[g] == whole.geom_type[geom]
                and np.allclose(own.geom_size[g], whole.geom_size[geom], atol=1e-9)
            ]
            assert len(found) == 1, whole.geom(geom).name
            here, there = mujoco.MjData(own), at(WHOLE, home(WHOLE))
            mujoco.mj_kinematics(own, here)
            np.testing.assert_allclose(
                here.geom_xpos[found[0]] - here.body("torso").xpos, there.geom_xpos[geom], atol=1e-6
            )


@pytest.mark.parametrize("place", ["carton_place", "there"])
@pytest.mark.parametrize("side", SIDES)
def test_both_hands_reach_the_carton_s_handles_where_it_is_and_where_it_goes(
    bench: Scene, place: str, side: str
) -> None:
    grasp = bench.object_pose("carton").inverse() @ bench.site_pose(f"carton/{side}")
    robot = bench.robot(side).robot
    within = replace(robot, lower=robot.lower + 0.1, upper=robot.upper - 0.1)
    assert solve(IKProblem(within, bench.site_pose(place) @ grasp)).solved


def test_the_carton_is_a_load_that_two_such_arms_can_carry(bench: Scene) -> None:
    model = bench.model
    carton = model.body("carton/carton").id
    assert model.body_subtreemass[carton] == pytest.approx(1.2, abs=1e-9)
    hand = model.body_subtreemass[model.body("left/gripper/gripper").id]
    assert hand + 0.5 * model.body_subtreemass[carton] < 2.2  # the arm's payload, kg
