from dataclasses import replace

import mujoco
import numpy as np
import pytest

from workcell.bench.geometry.covers import violations
from workcell.errors import InputError, ModelError, UnknownNameError
from workcell.geometry.covers.inner import inner_obstacle_cover, inscribed_balls
from workcell.geometry.covers.outer import cover_of
from workcell.geometry.covers.proof import prove_cover
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.pieces import hull_piece, pieces_of_bodies, robot_pieces, scene_obstacles
from workcell.geometry.types import Piece
from workcell.model.scene import Scene
from workcell.pose import Pose


def compile_world(body: str, asset: str = ""):
    return mujoco.MjModel.from_xml_string(
        f"<mujoco><asset>{asset}</asset><worldbody>{body}</worldbody></mujoco>"
    )


def test_only_what_collides_counts():
    model = compile_world(
        '<geom name="seen" type="box" size="1 1 1" contype="0" conaffinity="0"/>'
        '<geom name="hit" type="sphere" size="1"/>'
    )
    assert [piece.name for piece in pieces_of_bodies(model, [0])] == ["hit"]


def test_mesh_is_its_hull_where_mujoco_has_it():
    corners = "0 0 0  .2 0 0  0 .3 0  0 0 .4  .05 .05 .05"
    model = compile_world(
        '<body pos="1 2 3" euler="30 40 50"><geom name="m" type="mesh" mesh="m"/></body>',
        f'<mesh name="m" vertex="{corners}"/>',
    )
    (piece,) = pieces_of_bodies(model, [1])
    assert piece.kind == "hull" and piece.vertices is not None and len(piece.vertices) == 4
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    world = data.xpos[1] + np.array([0.2, 0, 0]) @ data.xmat[1].reshape(3, 3).T
    found = piece.pose.apply(piece.vertices)
    assert (
        np.linalg.norm(found - world, axis=1).min() < 1e-7
    )  # MuJoCo keeps mesh vertices in single precision


@pytest.mark.parametrize("count", [9, 40])
def test_a_coarser_hull_is_taken_where_mujoco_collides_one(count):
    """`maxhullvert` leaves out vertices; MuJoCo's distances to a small ball are those to the piece."""
    rng = np.random.default_rng(0)
    vertices = rng.normal(size=(count, 3))
    vertices *= 0.2 / np.linalg.norm(vertices, axis=1, keepdims=True)
    model = compile_world(
        '<body><geom type="mesh" mesh="m"/></body><body><freejoint/><geom type="sphere" size="0.01"/></body>',
        f'<mesh name="m" vertex="{" ".join(map(str, vertices.ravel()))}" maxhullvert="8"/>',
    )
    data, packed = mujoco.MjData(model), ObstacleArrays(pieces_of_bodies(model, [1]))
    for _ in range(50):
        centre = rng.normal(size=3)
        data.qpos[:3] = centre * rng.uniform(0.22, 0.5) / np.linalg.norm(centre)
        mujoco.mj_kinematics(model, data)
        found = mujoco.mj_geomDistance(model, data, 0, 1, 2.0, None)
        assert found == pytest.approx(packed.nearest(data.qpos[None, :3])[0][0] - 0.01, abs=1e-6)


def test_height_field_agrees_with_mujocos_own_rays():
    rng = np.random.default_rng(0)
    elevation = " ".join(f"{v:.3f}" for v in rng.uniform(0, 1, 20))
    model = compile_world(
        '<geom name="hills" type="hfield" hfield="h" pos=".1 .2 .3" euler="10 0 20"/>',
        f'<hfield name="h" nrow="4" ncol="5" size=".5 .4 .3 .1" elevation="{elevation}"/>',
    )
    pieces = pieces_of_bodies(model, [0])
    assert len(pieces) == 2 * 3 * 4
    packed, data = ObstacleArrays(pieces), mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    hits = 0
    for _ in range(60):
        start, down = np.array([*rng.uniform([-0.3, -0.1], [0.5, 0.5]), 3.0]), np.array([0.0, 0, -1])
        depth = mujoco.mj_ray(model, data, start, down, None, 1, -1, np.array([-1], dtype=np.int32))
        if depth > 0:
            hits += 1
            assert abs(packed.nearest(start + depth * down)[0]) < 1e-6
    assert hits > 30


@pytest.mark.parametrize(
    ("vertices", "words"),
    [
        (np.zeros((0, 3)), "empty"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], "flat"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, np.nan]], "not finite"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "flat"),
    ],
)
def test_bad_meshes_are_named(vertices, words):
    with pytest.raises(ModelError, match=f"broken_mesh.*{words}"):
        hull_piece("broken_mesh", vertices)


@pytest.mark.parametrize("size", [[0.1, -0.1, 0.1], [0.1, 0.0, 0.1], [0.1, np.nan, 0.1], [0.1, 0.1]])
def test_bad_sizes_are_named(size):
    with pytest.raises(InputError, match=r"bad_box.*positive sizes"):
        Piece("bad_box", "box", Pose.identity(), np.array(size))


def test_scene_obstacles_and_robot_pieces():
    scene = Scene.load("shelf_grasp")
    everything = {piece.body for piece in scene_obstacles(scene)}
    assert {"floor", "shelf", "books", "table", "mug/mug", "cup/cup"} == everything
    assert "mug/mug" not in {piece.body for piece in scene_obstacles(scene, exclude_objects=("mug",))}
    with pytest.raises(UnknownNameError, match="mog"):
        scene_obstacles(scene, exclude_objects=("mog",))
    robot = scene.robot()
    qpos = scene.initial_qpos()
    world = {p.name: p for p in pieces_of_bodies(scene.model, robot.body_ids, qpos)}
    links = robot_pieces(scene.model, robot)
    assert sum(map(len, links)) == len(world)
    for T, pieces in zip(robot.robot.link_transforms(robot.start), links, strict=True):
        for piece in pieces:
            placed = Pose.from_matrix(T) @ piece.pose
            distance, angle = placed.error_to(world[piece.name].pose)
            assert distance < 1e-9 and angle < 1e-7


_KINDS = {
    "box": '<geom name="g" type="box" size=".05 .04 .03"/>',
    "sphere": '<geom name="g" type="sphere" size=".05"/>',
    "capsule": '<geom name="g" type="capsule" size=".03 .05"/>',
    "cylinder": '<geom name="g" type="cylinder" size=".03 .05"/>',
    "ellipsoid": '<geom name="g" type="ellipsoid" size=".05 .04 .03"/>',
    "hull": '<geom name="g" type="mesh" mesh="open"/>',
    "prisms": '<geom name="g" type="hfield" hfield="h"/>',
    "composite": '<geom name="g" type="box" size=".02 .04 .01"/>'
    '<geom type="capsule" size=".01" fromto="0 0 0 0 0 .1"/>',
}


@pytest.mark.parametrize("kind", _KINDS)
def test_every_kind_of_geom_is_covered_and_filled(kind):
    """The mesh has a hole where its fourth face would be: its hull counts."""
    assets = (
        '<mesh name="open" vertex="0 0 0  .1 0 0  0 .1 0  0 0 .1" face="0 2 1  0 1 3  0 3 2"/>'
        '<hfield name="h" nrow="2" ncol="2" size=".05 .05 .04 .02" elevation="0 1 0 .5"/>'
    )
    body = f'<body pos=".1 .2 .3" euler="10 20 30">{_KINDS[kind]}</body>'
    if kind == "prisms":
        body = _KINDS[kind]
    model = compile_world(body, assets)
    bodies = [int(model.geom_bodyid[0])]
    pieces = pieces_of_bodies(model, bodies)
    outer = cover_of(pieces, 0.03)
    assert prove_cover(pieces, outer.centre, outer.radius) is None
    inner = inner_obstacle_cover(pieces, count=4)
    assert len(inner) >= 1
    if kind == "prisms":  # of which the re-check knows nothing; the rays above do
        with pytest.raises(ModelError, match="can't be re-checked"):
            violations(model, [bodies], outer, 500, np.random.default_rng(0))
        return
    assert violations(model, [bodies], world_frame(model, outer), 500, np.random.default_rng(0)) == 0
    assert violations(model, [bodies], world_frame(model, inner), 500, np.random.default_rng(0)) == 0


def world_frame(model, cover):
    """Spheres in the world as `violations` takes them: in the frame of the geom's own body."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    body = int(model.geom_bodyid[0])
    local = (cover.centre - data.xpos[body]) @ data.xmat[body].reshape(3, 3)
    return replace(cover, centre=local)


def test_the_unsupported_is_named():
    ground = Piece("ground", "halfspace", Pose.identity(), np.zeros(0))
    with pytest.raises(InputError, match=r"ground.*half-space"):
        cover_of([ground], 0.02)
    with pytest.raises(InputError, match=r"ground.*half-space"):
        inscribed_balls([ground])
