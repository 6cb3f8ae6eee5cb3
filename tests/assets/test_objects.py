"""The mug, the cup and the shelf cell: true shapes, pieces that leave openings free, a cell that stands still."""

from __future__ import annotations

import importlib.util
import sys
import tomllib
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import mujoco
import numpy as np
import pytest
import trimesh

ROOT = Path(__file__).resolve().parents[2]
OBJECTS = ROOT / "assets" / "objects"
CELL = ROOT / "assets" / "cells" / "shelf.xml"
TASK = ROOT / "tasks" / "shelf_grasp.toml"
NAMES = ("mug", "cup")


def load_script(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"objects_{name}", OBJECTS / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


make_meshes = load_script("make_meshes")
decompose = load_script("decompose")


def shelf_with_objects() -> mujoco.MjModel:
    cell = mujoco.MjSpec.from_file(str(CELL))
    for name in NAMES:
        thing = mujoco.MjSpec.from_file(str(OBJECTS / f"{name}.xml"))
        cell.attach(thing, site=cell.site(f"{name}_place"), prefix=f"{name}/")
        cell.body(f"{name}/{name}").add_freejoint(name=f"{name}/free")
    return cell.compile()


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return shelf_with_objects()


@pytest.fixture(scope="module")
def data(model: mujoco.MjModel) -> mujoco.MjData:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return data


@pytest.fixture(scope="module")
def cell() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(CELL))


def smallest_distance(name: str, centre: np.ndarray, half_size: np.ndarray) -> float:
    """Distance of an axis-aligned box, in the object's frame, to the nearest of its collision pieces."""
    spec = mujoco.MjSpec.from_file(str(OBJECTS / f"{name}.xml"))
    body = spec.worldbody.add_body(name="probe", pos=centre)
    body.add_geom(name="probe", type=mujoco.mjtGeom.mjGEOM_BOX, size=half_size)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    probe = model.geom("probe").id
    pieces = [g for g in range(model.ngeom) if model.geom_contype[g] and g != probe]
    assert len(pieces) > 10
    return min(mujoco.mj_geomDistance(model, data, probe, g, 1.0, None) for g in pieces)


# --- the meshes ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("vessel", make_meshes.VESSELS, ids=lambda vessel: vessel.name)
def test_committed_meshes_are_what_the_script_makes(vessel, tmp_path: Path) -> None:
    make_meshes.write_obj(tmp_path / "visual.obj", make_meshes.solid(vessel))
    fresh, committed = (
        decompose.load(p) for p in (tmp_path / "visual.obj", OBJECTS / f"meshes/{vessel.name}_visual.obj")
    )
    assert fresh.volume == pytest.approx(committed.volume, rel=1e-5)
    np.testing.assert_allclose(fresh.bounds, committed.bounds, atol=2e-6)
    pieces = make_meshes.pieces(vessel)
    stored = decompose.load_pieces(vessel.name)
    assert len(pieces) == len(stored)
    for piece, other in zip(pieces, stored, strict=True):
        assert piece.volume == pytest.approx(other.volume, rel=1e-3)
        np.testing.assert_allclose(piece.bounds, other.bounds, atol=2e-6)


def test_mug_is_concave_and_has_the_stated_size() -> None:
    mug = decompose.load(OBJECTS / "meshes/mug_visual.obj")
    assert mug.is_watertight
    assert mug.euler_number == 0, "one handle: a torus topologically"
    np.testing.assert_allclose(mug.bounds[0], [-0.040, -0.040, 0.0], atol=1e-5)
    np.testing.assert_allclose(mug.bounds[1][1:], [0.040, 0.095], atol=1e-5)
    assert mug.volume < 0.4 * mug.convex_hull.volume


def test_body_volume_matches_the_closed_form() -> None:
    """Without its handle, the mug is a difference of cylinders less the chamfer at the foot and the rim's corners.

    Rings by Pappus (area times the way of its centroid), circles as regular 64-gons, the rim's half circle as 6 chords.
    """
    body = make_meshes.solid(replace(make_meshes.MUG, handle=None))
    cylinders = np.pi * (0.040**2 * 0.095 - 0.035**2 * 0.089)
    chamfer = 2 * np.pi * (0.040 - 0.002 / 3) * 0.002**2 / 2
    rim_corners = 2 * np.pi * 0.0375 * (2 - 3 * np.sin(np.pi / 6)) * 0.0025**2
    polygon = 64 / (2 * np.pi) * np.sin(2 * np.pi / 64)
    assert body.volume == pytest.approx(polygon * (cylinders - chamfer - rim_corners), rel=1e-6)


@pytest.mark.parametrize("name", NAMES)
def test_pieces_fill_the_solid_tightly(name: str) -> None:
    solid = decompose.load(OBJECTS / f"meshes/{name}_visual.obj")
    fit = decompose.measure(solid, decompose.load_pieces(name), samples=1500)
    assert 1.0 <= fit.volume_ratio < 1.075
    assert fit.overshoot < 0.8e-3
    assert fit.gap < 0.05e-3


@pytest.mark.parametrize("name", NAMES)
def test_committed_pieces_are_convex_and_small(name: str) -> None:
    paths = sorted((OBJECTS / "meshes").glob(f"{name}_*.obj"))
    assert sum(path.stat().st_size for path in paths) < 300_000
    for path in paths:
        if "piece" in path.name:
            piece = decompose.load(path)
            assert piece.is_watertight
            assert piece.volume == pytest.approx(piece.convex_hull.volume, rel=1e-3)


def test_coacd_cuts_a_concave_mesh_and_refuses_an_open_one() -> None:
    bracket = trimesh.boolean.union(
        [
            trimesh.creation.box(bounds=[[0, 0, 0], [0.1, 0.1, 0.02]]),
            trimesh.creation.box(bounds=[[0, 0, 0], [0.02, 0.1, 0.1]]),
        ]
    )
    pieces = decompose.decompose(bracket)
    fit = decompose.measure(bracket, pieces, samples=500)
    assert len(pieces) >= 2
    assert bracket.convex_hull.volume > 1.5 * bracket.volume
    assert fit.volume_ratio == pytest.approx(1.0, abs=0.05)
    again = decompose.decompose(bracket)
    assert [p.volume for p in again] == [p.volume for p in pieces]
    bracket.update_faces(np.arange(len(bracket.faces)) > 0)
    with pytest.raises(ValueError, match="watertight"):
        decompose.decompose(bracket)


# --- a finger fits ------------------------------------------------------------------------------------------------


def test_a_finger_fits_inside_the_mug() -> None:
    for angle_order in ((0.006, 0.010), (0.010, 0.006)):
        box = np.array([*angle_order, 0.030])
        assert smallest_distance("mug", np.array([0.0, 0.0, 0.095 - 0.030]), box) > 0.015


def test_a_finger_fits_between_the_wall_and_the_middle() -> None:
    assert smallest_distance("mug", np.array([0.0, 0.024, 0.065]), np.array([0.010, 0.006, 0.030])) > 0.002


def test_the_handle_is_open() -> None:
    """20 mm x 40 mm free between wall and handle, all the way through along y."""
    assert smallest_distance("mug", np.array([0.0505, 0.0, 0.049]), np.array([0.010, 0.05, 0.020])) > 0.0


def test_the_hull_of_the_mug_would_block_both() -> None:
    """The negative control: were the mug one mesh, physics would collide its hull."""
    hull = decompose.load(OBJECTS / "meshes/mug_visual.obj").convex_hull
    assert hull.contains([[0.0, 0.0, 0.06], [0.055, 0.0, 0.049]]).all()


def test_a_finger_fits_inside_the_cup() -> None:
    assert smallest_distance("cup", np.array([0.0, 0.0, 0.055]), np.array([0.006, 0.010, 0.030])) > 0.01


# --- the MJCF files -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("vessel", make_meshes.VESSELS, ids=lambda vessel: vessel.name)
def test_inertial_is_that_of_the_true_solid(vessel) -> None:
    model = mujoco.MjModel.from_xml_path(str(OBJECTS / f"{vessel.name}.xml"))
    body = model.body(vessel.name).id
    solid = make_meshes.solid(vessel)
    solid.density = vessel.mass / solid.volume
    assert model.body_mass[body] == pytest.approx(vessel.mass)
    np.testing.assert_allclose(model.body_ipos[body], solid.center_mass, atol=1e-5)
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, model.body_iquat[body])
    rotation = rotation.reshape(3, 3)
    stated = rotation @ np.diag(model.body_inertia[body]) @ rotation.T
    np.testing.assert_allclose(stated, solid.moment_inertia, atol=1e-8)


@pytest.mark.parametrize("name", NAMES)
def test_names_and_groups(name: str) -> None:
    model = mujoco.MjModel.from_xml_path(str(OBJECTS / f"{name}.xml"))
    assert model.nbody == 2
    assert model.body(1).name == name
    pieces = [model.geom(g) for g in range(model.ngeom) if model.geom_contype[g]]
    assert [g.name for g in pieces] == [f"{name}_piece_{i:02d}" for i in range(len(pieces))]
    assert all(g.group[0] == 3 for g in pieces)
    assert len(pieces) == len(decompose.load_pieces(name))
    assert model.geom(f"{name}_visual").group[0] == 2


def test_objects_attach_and_compile_from_any_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    model = shelf_with_objects()
    assert model.geom("mug/mug_piece_00").id >= 0
    assert model.site("cup/grasp").id >= 0


@pytest.mark.parametrize("name", NAMES)
def test_grasp_site_faces_into_the_shelf(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> None:
    rotation = data.site(f"{name}/grasp").xmat.reshape(3, 3)
    np.testing.assert_allclose(rotation[:, 2], [1, 0, 0], atol=1e-9)
    np.testing.assert_allclose(np.abs(rotation[:, 1]), [0, 1, 0], atol=1e-9)
    np.testing.assert_allclose(rotation[:, 0], [0, 0, 1], atol=1e-9)


# --- the cell -----------------------------------------------------------------------------------------------------


def test_every_obstacle_is_a_named_axis_aligned_box(cell: mujoco.MjModel) -> None:
    data = mujoco.MjData(cell)
    mujoco.mj_forward(cell, data)
    assert cell.nv == 0
    assert {cell.body(b).name for b in range(1, cell.nbody)} == {"floor", "shelf", "books", "table"}
    for g in range(cell.ngeom):
        geom = cell.geom(g)
        assert geom.name
        assert geom.type[0] == mujoco.mjtGeom.mjGEOM_BOX
        np.testing.assert_allclose(data.geom_xmat[g], np.eye(3).ravel(), atol=1e-12)
        assert geom.contype[0], "what is seen can be hit"
        assert geom.group[0] < 3, "what can be hit is seen"


def test_boxes_of_the_cell_touch_but_never_overlap(cell: mujoco.MjModel) -> None:
    data = mujoco.MjData(cell)
    mujoco.mj_forward(cell, data)
    for a in range(cell.ngeom):
        for b in range(a):
            gap = np.abs(data.geom_xpos[a] - data.geom_xpos[b]) - cell.geom_size[a] - cell.geom_size[b]
            assert gap.max() > -1e-9, (cell.geom(a).name, cell.geom(b).name)


def test_floor_lies_under_the_pedestal_and_the_robot_mount_is_the_world(cell: mujoco.MjModel) -> None:
    floor = cell.geom("floor")
    assert floor.pos[2] + floor.size[2] == pytest.approx(-0.92)
    mount = cell.site("robot_mount")
    np.testing.assert_array_equal(mount.pos, [0, 0, 0])
    np.testing.assert_array_equal(mount.quat, [1, 0, 0, 0])
    legs = [cell.geom(g) for g in range(cell.ngeom) if cell.geom(g).name.startswith("table_leg")]
    assert len(legs) == 4
    for standing in [*legs, cell.geom("shelf_left"), cell.geom("shelf_right")]:
        assert standing.pos[2] - standing.size[2] == pytest.approx(-0.92)


def test_the_middle_compartment_is_narrow(cell: mujoco.MjModel) -> None:
    """A wrist 12 cm thick passes over the board at the grasp's height with a few centimetres to spare."""
    board, above = cell.geom("shelf_middle"), cell.geom("shelf_upper")
    bottom, top = board.pos[2] + board.size[2], above.pos[2] - above.size[2]
    grasp_height = cell.site("mug_place").pos[2] + 0.0475
    assert 0.24 <= top - bottom <= 0.32
    assert 0.02 < grasp_height - 0.06 - bottom < 0.10
    assert 0.02 < top - (grasp_height + 0.06) < 0.10


def test_the_gap_between_mug_and_cup_holds_one_finger(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    def pieces(name: str) -> list[int]:
        return [g for g in range(model.ngeom) if model.geom(g).name.startswith(f"{name}/{name}_piece")]

    gap = min(
        mujoco.mj_geomDistance(model, data, a, b, 1.0, None) for a in pieces("mug") for b in pieces("cup")
    )
    assert 0.040 < gap < 0.050


def test_objects_stand_still(model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    before = {
        name: (data.body(f"{name}/{name}").xpos.copy(), data.body(f"{name}/{name}").xquat.copy())
        for name in NAMES
    }
    while data.time < 1.0:
        mujoco.mj_step(model, data)
    touching = {
        frozenset(model.body(model.geom_bodyid[g]).name for g in pair)
        for pair in data.contact.geom[: data.ncon]
    }
    assert touching == {frozenset({"mug/mug", "shelf"}), frozenset({"cup/cup", "shelf"})}
    for name, (position, quat_wxyz) in before.items():
        body = data.body(f"{name}/{name}")
        assert np.linalg.norm(body.xpos - position) < 1e-4
        assert abs(body.xquat @ quat_wxyz) > 1 - 1e-6


def test_cameras_and_options(cell: mujoco.MjModel) -> None:
    assert [cell.camera(c).name for c in range(cell.ncam)] == ["overview", "shelf_front", "side"]
    assert cell.opt.timestep == 0.002
    assert cell.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    assert (cell.vis.global_.offwidth, cell.vis.global_.offheight) == (1280, 960)
    assert cell.vis.quality.offsamples == 0


# --- the task -----------------------------------------------------------------------------------------------------


def test_the_task_names_what_exists(model: mujoco.MjModel) -> None:
    task = tomllib.loads(TASK.read_text(encoding="utf-8"))
    goals = {goal["name"] for goal in task["goals"]}
    assert set(task["task"]["path"]) <= goals
    assert (ROOT / "assets" / "cells" / f"{task['cell']}.xml").exists()
    for thing in task["objects"]:
        assert model.site(thing["place"]).id >= 0
        assert model.body(f"{thing['name']}/{thing['name']}").id > 0
    for goal in task["goals"]:
        assert model.site(goal["relative_to"]).id >= 0
    assert model.body(task["task"]["shelf"]).id > 0


def test_goals_lie_where_their_names_say(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    task = tomllib.loads(TASK.read_text(encoding="utf-8"))
    site = data.site("mug/grasp")
    rotation = site.xmat.reshape(3, 3)
    at = {goal["name"]: site.xpos + rotation @ np.array(goal["xyz"]) for goal in task["goals"]}
    front = min(
        data.geom_xpos[g][0] - model.geom_size[g][0]
        for g in range(model.ngeom)
        if model.geom(g).name.startswith("shelf_")
    )
    fingertip, handle_end = 0.0225, 0.078
    assert at["approach"][0] + fingertip < front
    assert at["retreat"][0] + handle_end < front
    np.testing.assert_allclose(at["lift"] - at["grasp"], [0, 0, task["task"]["lift_height"]], atol=1e-9)
    np.testing.assert_allclose(
        at["grasp"] - at["approach"], [task["task"]["approach_distance"], 0, 0], atol=1e-9
    )
    np.testing.assert_allclose(
        at["lift"] - at["retreat"], [task["task"]["retreat_distance"], 0, 0], atol=1e-9
    )
