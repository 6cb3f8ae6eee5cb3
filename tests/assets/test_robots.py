"""The robot files: kinematics, limits and extents against published facts; contacts, visuals, inertias, gripper."""

from __future__ import annotations

import importlib.util
import json
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

ROOT = Path(__file__).resolve().parents[2]
ROBOTS = ROOT / "assets" / "robots"
FACTS = Path(__file__).resolve().parent / "published"
FLANGE = {
    "sawyer": "right_hand",
    "ur10": "tool0",
    "iiwa14": "attachment_site",
    "fanuc_lrmate200ic": "tool0",
    "ur5": "tool0",
    "jaco": "palm",
    "iiwa7": "ee",
    "hubo_arm": "hand",
    "hubo_waist_arm": "hand",
}
ARMS = tuple(FLANGE)

COVER_TOLERANCE = 0.005
FATNESS_TOLERANCE = 0.02
VISUAL_GROUP, COLLISION_GROUP = 2, 3
PLACEHOLDERS = {
    "torso",
    "screen",
    "ee_link",
}  # links that have no shape in the source: frames with a tiny marker

Vector = NDArray[np.float64]


@cache
def facts(name: str) -> dict[str, Any]:
    return json.loads((FACTS / f"{name}.json").read_text())


@cache
def model_of(name: str) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(ROBOTS / f"{name}.xml"))


def at_home(model: mujoco.MjModel) -> mujoco.MjData:
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    mujoco.mj_forward(model, data)
    return data


def transform(xyz: Any, quat_wxyz: Any) -> Vector:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(np.roll(quat_wxyz, -1)).as_matrix()
    matrix[:3, 3] = xyz
    return matrix


def turned(axis: Any, angle: float) -> Vector:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(angle * np.asarray(axis)).as_matrix()
    return matrix


def movable(name: str) -> list[dict[str, Any]]:
    return [joint for joint in facts(name)["joints"] if "axis" in joint]


def chain_poses(name: str, q: Vector) -> dict[str, Vector]:
    """T_base_link of every link from the published joint origins and axes alone."""
    joints = facts(name)["joints"]
    poses = {joints[0]["parent"]: np.eye(4)}
    angles = dict(zip([joint["name"] for joint in movable(name)], q, strict=True))
    for joint in joints:
        pose = poses[joint["parent"]] @ transform(joint["xyz"], joint["quat"])
        if "axis" in joint:
            pose = pose @ turned(joint["axis"], angles[joint["name"]])
        poses[joint["child"]] = pose
    return poses


def tool_poses(name: str, links: dict[str, Vector]) -> dict[str, Vector]:
    tools = facts(name)["tools"]
    poses = {site: links[tool["link"]] @ transform(tool["xyz"], tool["quat"]) for site, tool in tools.items()}
    return poses | {"tool": poses[FLANGE[name]]}


def random_configurations(name: str, n: int) -> Vector:
    model = model_of(name)
    return np.random.default_rng(7).uniform(model.jnt_range[:, 0], model.jnt_range[:, 1], (n, model.nq))


@pytest.mark.parametrize("name", ARMS)
def test_kinematics_in_mujoco_match_the_facts(name: str) -> None:
    model = model_of(name)
    data = mujoco.MjData(model)
    assert model.body(1).name == facts(name)["joints"][0]["parent"]
    for q in random_configurations(name, 50):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        links = chain_poses(name, q)
        assert {model.body(b).name for b in range(1, model.nbody)} == set(links)
        for link, expected in links.items():
            body = data.body(link)
            np.testing.assert_allclose(body.xpos, expected[:3, 3], atol=1e-9)
            np.testing.assert_allclose(body.xmat.reshape(3, 3), expected[:3, :3], atol=1e-9)
        for site, expected in tool_poses(name, links).items():
            np.testing.assert_allclose(data.site(site).xpos, expected[:3, 3], atol=1e-9)
            np.testing.assert_allclose(data.site(site).xmat.reshape(3, 3), expected[:3, :3], atol=1e-9)


@pytest.mark.parametrize("name", ARMS)
def test_kinematics_in_pinocchio_match_the_facts(name: str) -> None:
    pin = pytest.importorskip("pinocchio")
    model = pin.buildModelFromMJCF(str(ROBOTS / f"{name}.xml"))
    data = model.createData()
    assert list(model.names)[1:] == [joint["name"] for joint in movable(name)]
    np.testing.assert_allclose(model.referenceConfigurations["home"], at_home(model_of(name)).qpos)
    for q in random_configurations(name, 50):
        pin.framesForwardKinematics(model, data, q)
        links = chain_poses(name, q)
        expected = [(link, pin.FrameType.BODY, pose) for link, pose in links.items()]
        # a link and its site may share a name, so a frame is looked up together with its type
        expected += [(site, pin.FrameType.OP_FRAME, pose) for site, pose in tool_poses(name, links).items()]
        for frame, kind, pose in expected:
            index = model.getFrameId(frame, kind)
            assert index < model.nframes, frame
            np.testing.assert_allclose(data.oMf[index].homogeneous, pose, atol=1e-9)


@pytest.mark.parametrize("name", ARMS)
def test_limits_match_the_facts(name: str) -> None:
    model = model_of(name)
    assert model.njnt == model.nu == len(movable(name))
    for joint in movable(name):
        in_model = model.joint(joint["name"])
        assert model.jnt_limited[in_model.id] and model.jnt_actfrclimited[in_model.id]
        np.testing.assert_array_equal(in_model.range, joint["range"])
        actuator = model.actuator(joint["name"])
        assert actuator.trnid[0] == in_model.id
        effort = joint.get("effort", actuator.ctrlrange[1])  # where none is published, the file says its own
        np.testing.assert_array_equal(model.jnt_actfrcrange[in_model.id], [-effort, effort])
        np.testing.assert_array_equal(actuator.ctrlrange, [-effort, effort])
        assert model.numeric(f"{joint['name']}:velocity").data[0] == pytest.approx(
            joint["velocity"], rel=1e-12
        )
        assert model.numeric(f"{joint['name']}:acceleration").data[0] > joint["velocity"]


@pytest.mark.parametrize("name", ARMS)
def test_masses_match_the_facts(name: str) -> None:
    model = model_of(name)
    for link, mass in facts(name)["masses"].items():
        assert model.body(link).mass[0] == pytest.approx(mass, rel=1e-6), link


@pytest.mark.parametrize("name", ARMS)
def test_inertia_matrix_is_well_conditioned_and_gravity_is_within_effort(name: str) -> None:
    model = model_of(name)
    data = at_home(model)
    mass_matrix = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass_matrix)
    assert np.linalg.eigvalsh(mass_matrix).min() > 0.01
    assert np.all(np.abs(data.qfrc_bias) < 0.8 * model.jnt_actfrcrange[:, 1])


@pytest.mark.parametrize("name", ARMS)
def test_the_motors_hold_the_arm_at_home(name: str) -> None:
    model = model_of(name)
    data = at_home(model)
    home = data.qpos.copy()
    for _ in range(250):
        data.ctrl[:] = data.qfrc_bias + 50 * (home - data.qpos) - 5 * data.qvel
        mujoco.mj_step(model, data)
    np.testing.assert_allclose(data.qpos, home, atol=1e-4)
    assert np.all(np.abs(data.ctrl) < model.actuator_ctrlrange[:, 1])


# Collision geometry against the extents


def geoms_of(model: mujoco.MjModel, body: int, group: int) -> list[int]:
    return [g for g in range(model.ngeom) if model.geom_bodyid[g] == body and model.geom_group[g] == group]


def support(model: mujoco.MjModel, data: mujoco.MjData, geom: int, direction: Vector) -> float:
    """Largest coordinate of a primitive along a unit direction of the world."""
    size, kind = model.geom_size[geom], mujoco.mjtGeom(model.geom_type[geom])
    local = data.geom_xmat[geom].reshape(3, 3).T @ direction
    across = float(np.hypot(local[0], local[1]))
    reach = {
        mujoco.mjtGeom.mjGEOM_SPHERE: size[0],
        mujoco.mjtGeom.mjGEOM_CAPSULE: size[0] + size[1] * abs(local[2]),
        mujoco.mjtGeom.mjGEOM_CYLINDER: size[0] * across + size[1] * abs(local[2]),
        mujoco.mjtGeom.mjGEOM_BOX: float(size @ np.abs(local)),
    }
    return float(data.geom_xpos[geom] @ direction + reach[kind])


def extent(model: mujoco.MjModel, data: mujoco.MjData, link: str, geoms: list[int]) -> Vector:
    """[min3, max3] of the geoms in the frame of the link."""
    body = data.body(link)
    axes, origin = body.xmat.reshape(3, 3).T, body.xpos
    upper = [max(support(model, data, g, axis) for g in geoms) - origin @ axis for axis in axes]
    lower = [-max(support(model, data, g, -axis) for g in geoms) - origin @ axis for axis in axes]
    return np.array([*lower, *upper])


@pytest.mark.parametrize("name", ARMS)
def test_collision_geometry_covers_each_link_and_is_not_fat(name: str) -> None:
    model = model_of(name)
    data = at_home(model)
    for link, published in facts(name)["extents"].items():
        geoms = geoms_of(model, model.body(link).id, COLLISION_GROUP)
        if link in PLACEHOLDERS:  # a marker of the source: inside the rigid body it belongs to
            weld = model.body_weldid[model.body(link).id]
            bodies = [b for b in range(1, model.nbody) if model.body_weldid[b] == weld]
            geoms = [g for b in bodies for g in geoms_of(model, b, COLLISION_GROUP)]
        excess = (extent(model, data, link, geoms) - published) * np.repeat([-1.0, 1.0], 3)
        assert excess.min() >= -COVER_TOLERANCE, (link, excess)
        if link not in PLACEHOLDERS:
            assert excess.max() <= FATNESS_TOLERANCE, (link, excess)


@pytest.mark.parametrize("name", [*ARMS, "parallel_gripper"])
def test_collision_geometry_is_primitive_and_visuals_do_not_collide(name: str) -> None:
    model = model_of(name)
    shapes = mujoco.mjtGeom
    solid = {shapes.mjGEOM_SPHERE, shapes.mjGEOM_CAPSULE, shapes.mjGEOM_CYLINDER, shapes.mjGEOM_BOX}
    for geom in range(model.ngeom):
        collides = bool(model.geom_contype[geom] or model.geom_conaffinity[geom])
        if model.geom_group[geom] == COLLISION_GROUP:
            assert collides and mujoco.mjtGeom(model.geom_type[geom]) in solid and model.geom(geom).name
        else:
            assert model.geom_group[geom] == VISUAL_GROUP and not collides


def outside(model: mujoco.MjModel, data: mujoco.MjData, geom: int, points: Vector) -> Vector:
    """Distance of points to a primitive, negative inside."""
    size, kind = model.geom_size[geom], mujoco.mjtGeom(model.geom_type[geom])
    local = (points - data.geom_xpos[geom]) @ data.geom_xmat[geom].reshape(3, 3)
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return np.linalg.norm(local, axis=1) - size[0]
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        local[:, 2] -= np.clip(local[:, 2], -size[1], size[1])
        return np.linalg.norm(local, axis=1) - size[0]
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        beyond = np.column_stack(
            [np.hypot(local[:, 0], local[:, 1]) - size[0], np.abs(local[:, 2]) - size[1]]
        )
    else:
        beyond = np.abs(local) - size
    return np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(axis=1), 0)


@pytest.mark.parametrize("name", [*ARMS, "parallel_gripper"])
def test_what_is_seen_is_covered_by_what_collides(name: str) -> None:
    model = model_of(name)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for geom in np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_MESH):
        mesh = model.mesh(model.geom_dataid[geom])
        first = mesh.vertadr[0]
        vertices = model.mesh_vert[first : first + mesh.vertnum[0]].astype(float)
        points = vertices @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
        weld = model.body_weldid[model.geom_bodyid[geom]]
        bodies = [b for b in range(1, model.nbody) if model.body_weldid[b] == weld]
        solids = [g for b in bodies for g in geoms_of(model, b, COLLISION_GROUP)]
        distance = np.min([outside(model, data, g, points) for g in solids], axis=0)
        assert distance.max() < 0.003, mesh.name


# Contacts


@pytest.mark.parametrize("name", ARMS)
def test_home_is_inside_the_limits_and_free_of_contact(name: str) -> None:
    model = model_of(name)
    data = at_home(model)
    assert np.all((data.qpos > model.jnt_range[:, 0] + 0.05) & (data.qpos < model.jnt_range[:, 1] - 0.05))
    assert data.ncon == 0
    jacobian = np.zeros((6, model.nv))
    mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], model.site("tool").id)
    assert np.linalg.svd(jacobian)[1].min() > 0.05  # not singular


@pytest.mark.parametrize("name", ARMS)
def test_no_pair_of_links_touches_in_most_configurations(name: str) -> None:
    model = model_of(name)
    data = mujoco.MjData(model)
    configurations = random_configurations(name, 600)
    touches: dict[tuple[int, int], int] = {}
    free = 0
    for q in configurations:
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        pairs = {tuple(sorted(pair)) for pair in model.geom_bodyid[data.contact.geom].tolist()}
        free += not pairs
        for pair in pairs:
            touches[pair] = touches.get(pair, 0) + 1
    assert max(touches.values(), default=0) < 0.25 * len(configurations), touches
    assert free > 0.6 * len(configurations)


@pytest.mark.parametrize("name", ARMS)
def test_only_neighbours_are_excluded_from_contact(name: str) -> None:
    spec = mujoco.MjSpec.from_file(str(ROBOTS / f"{name}.xml"))
    model = model_of(name)
    weld, parent = model.body_weldid, model.body_parentid
    assert spec.excludes
    for exclude in spec.excludes:
        first, second = (weld[model.body(body).id] for body in (exclude.bodyname1, exclude.bodyname2))
        assert weld[parent[second]] == first or weld[parent[first]] == second


# Inertias, meshes


def load_script(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"robots_{name}", ROBOTS / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_inertials_in_the_files_are_those_of_the_collision_geometry() -> None:
    inertials = load_script("inertials")
    for name in inertials.FILES:
        text = (ROBOTS / name).read_text()
        assert inertials.with_inertials(text) == text, "run assets/robots/inertials.py"


def test_meshes_are_small_and_all_in_use() -> None:
    files = {path.name: path.stat().st_size for path in (ROBOTS / "meshes").iterdir()}
    assert sum(files.values()) < 2_000_000
    used = set()
    for name in (*ARMS, "parallel_gripper"):
        spec = mujoco.MjSpec.from_file(str(ROBOTS / f"{name}.xml"))
        used |= {mesh.file for mesh in spec.meshes}
    assert used == set(files)


# Assembly


def assembled() -> mujoco.MjModel:
    """The Sawyer with its gripper on a mount in a cell that was not read from a file."""
    cell = mujoco.MjSpec()
    cell.worldbody.add_site(name="mount", pos=[0.2, 0.1, 0.92], quat=[0.6, 0, 0, 0.8])
    arm = mujoco.MjSpec.from_file(str(ROBOTS / "sawyer.xml"))
    gripper = mujoco.MjSpec.from_file(str(ROBOTS / "parallel_gripper.xml"))
    arm.attach(gripper, site="right_hand", prefix="gripper/")
    arm.compile()  # else MuJoCo warns that the keyframe of the arm may lose its prefix
    cell.attach(arm, site="mount", prefix="sawyer/")
    return cell.compile()


def test_attached_robot_keeps_its_names_and_stands_where_it_was_put() -> None:
    model = assembled()
    data = mujoco.MjData(model)
    q = random_configurations("sawyer", 1)[0]
    data.qpos[:7] = q
    mujoco.mj_forward(model, data)
    mount = transform([0.2, 0.1, 0.92], [0.6, 0, 0, 0.8])
    expected = mount @ tool_poses("sawyer", chain_poses("sawyer", q))["tool"]
    np.testing.assert_allclose(data.site("sawyer/tool").xpos, expected[:3, 3], atol=1e-9)
    offset = expected[:3, :3].T @ (data.site("sawyer/gripper/tool").xpos - expected[:3, 3])
    np.testing.assert_allclose(offset, [0, 0, 0.1525], atol=1e-9)  # along the approach direction
    assert model.numeric("sawyer/right_j0:velocity").data[0] == 1.74
    assert model.actuator("sawyer/gripper/gripper").ctrlrange.tolist() == [0, 0.045]
    np.testing.assert_array_equal(model.key("sawyer/home").qpos[:7], at_home(model_of("sawyer")).qpos)


def test_attached_robot_touches_nothing_at_home_and_has_no_permanent_contact_with_the_gripper() -> None:
    model = assembled()
    data = mujoco.MjData(model)
    for opening in (0.0, 0.045):
        data.qpos[:] = [*at_home(model_of("sawyer")).qpos, opening, opening]
        mujoco.mj_forward(model, data)
        assert data.ncon == 0


def pad_gap(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    geoms = [model.geom(f"{side}_pad").id for side in ("finger_left", "finger_right")]
    return float(mujoco.mj_geomDistance(model, data, *geoms, 1.0, None))


def test_gripper_opens_to_90_mm_and_closes_symmetrically() -> None:
    model = model_of("parallel_gripper")
    data = mujoco.MjData(model)
    for command, gap in ((0.045, 0.09), (0.02, 0.04), (0.0, 0.0), (0.045, 0.09)):
        data.ctrl[0] = command
        for _ in range(300):
            mujoco.mj_step(model, data)
            assert abs(data.qpos[0] - data.qpos[1]) < 1e-4
            assert np.all(np.abs(data.qvel) < 0.3)
        assert pad_gap(model, data) == pytest.approx(gap, abs=1e-3)


@pytest.mark.parametrize("width", [0.08, 0.085])
def test_gripper_holds_a_cylinder_against_gravity(width: float) -> None:
    cell = mujoco.MjSpec()
    cell.worldbody.add_site(name="mount", pos=[0, 0, 1], quat=[0.7071067811865476, 0, 0.7071067811865476, 0])
    gripper = mujoco.MjSpec.from_file(str(ROBOTS / "parallel_gripper.xml"))
    cell.attach(gripper, site="mount", prefix="gripper/")
    cup = cell.worldbody.add_body(name="cup", pos=[0.14, 0, 1])
    cup.add_freejoint()
    cup.add_geom(type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[width / 2, 0.045, 0], mass=0.35)
    cup.gravcomp = 1.0
    cell.option.impratio = 10
    cell.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    model = cell.compile()
    data = mujoco.MjData(model)
    data.qpos[:2] = data.ctrl[0] = 0.045
    mujoco.mj_forward(model, data)
    assert data.ncon == 0  # the open fingers clear it
    data.ctrl[0] = 0.0
    mujoco.mj_step(model, data, 250)
    model.body_gravcomp[:] = 0.0
    before = data.body("cup").xpos.copy()
    mujoco.mj_step(model, data, 1000)
    assert np.linalg.norm(data.body("cup").xpos - before) < 0.002
