"""`Shape`: one drawable solid. It comes from a compiled MuJoCo geom or from a recording, and goes to either."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from workcell.pose import Array, Pose

if TYPE_CHECKING:
    import mujoco

    from workcell.geometry.polytope import Polytope
    from workcell.geometry.types import FreePolytope, Piece

ShapeKind = Literal["box", "ellipsoid", "capsule", "cylinder", "plane", "mesh"]

PLANE_HALF_SIZE = 3.0
"""Metres: half the side of the square that stands for an infinite plane."""

ROBOT_SPHERE_RGBA, OBSTACLE_SPHERE_RGBA = (0.20, 0.60, 0.85, 0.35), (0.36, 0.42, 0.48, 0.25)
"""Of the spheres that cover robots, and obstacles."""

COLLISION_GROUP = 3
"""Geoms of this MuJoCo group (and above) are collision geometry that a viewer hides."""


@dataclass(frozen=True, slots=True)
class Shape:
    """A solid with a colour, in the frame of the entity (or body) that carries it.

    Attributes:
        name: the geom's name.
        kind: box, ellipsoid (spheres too), capsule, cylinder (both along z), plane (normal z) or mesh.
        size: (3,) metres: box half sizes; ellipsoid semi-axes; capsule and cylinder [radius, half length, 0];
            plane half sides [x, y, 0]; mesh: ones.
        pose: `T_entity_shape`.
        rgba: (4,) in [0, 1].
        vertices, normals: (k, 3) of a mesh, else None.
        faces: (f, 3) indices, counter-clockwise seen from outside, else None.
    """

    name: str
    kind: ShapeKind
    size: Array
    pose: Pose
    rgba: Array
    vertices: Array | None = None
    normals: Array | None = None
    faces: NDArray[np.int64] | None = None


def polytope_shape(polytope: FreePolytope, rgba: Array) -> Shape:
    """A polytope of free space as a mesh in the world frame, flat on its sides."""
    from workcell.geometry.free_space.polytopes import solid_of

    return _flat_mesh(solid_of(polytope), rgba)


def piece_shape(piece: Piece, rgba: Array, grown: float = 0.0) -> Shape:
    """A piece as a mesh in its outer frame, flat on its sides, a little larger so that it hides what it stands for."""
    from workcell.geometry.polytope import polytope_of

    if piece.kind == "halfspace":
        size = np.array([PLANE_HALF_SIZE, PLANE_HALF_SIZE, 0.0])
        return Shape(piece.name, "plane", size, piece.pose, rgba)
    solid = polytope_of(piece)
    middle = solid.vertices.mean(axis=0)
    reach = np.linalg.norm(solid.vertices - middle, axis=1).max()
    larger = replace(solid, vertices=middle + (1.0 + grown / reach) * (solid.vertices - middle))
    return _flat_mesh(larger, rgba)


def _flat_mesh(solid: Polytope, rgba: Array) -> Shape:
    corners = solid.vertices[solid.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ij,ij->i", normal, corners.mean(axis=1) - solid.vertices.mean(axis=0)) < 0
    corners[inward], normal[inward] = corners[inward][:, ::-1], -normal[inward]
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    faces = np.arange(3 * len(corners), dtype=np.int64).reshape(-1, 3)
    points, normals = corners.reshape(-1, 3), np.repeat(normal, 3, axis=0)
    return Shape("", "mesh", np.ones(3), Pose.identity(), rgba, points, normals, faces)


def geom_shape(model: mujoco.MjModel, geom: int) -> Shape | None:
    """The geom in its body's frame; None for kinds that are not drawn (height fields, signed distance fields)."""
    import mujoco

    kinds: dict[int, ShapeKind] = {
        int(mujoco.mjtGeom.mjGEOM_PLANE): "plane",
        int(mujoco.mjtGeom.mjGEOM_SPHERE): "ellipsoid",
        int(mujoco.mjtGeom.mjGEOM_CAPSULE): "capsule",
        int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): "ellipsoid",
        int(mujoco.mjtGeom.mjGEOM_CYLINDER): "cylinder",
        int(mujoco.mjtGeom.mjGEOM_BOX): "box",
        int(mujoco.mjtGeom.mjGEOM_MESH): "mesh",
    }
    kind = kinds.get(int(model.geom_type[geom]))
    if kind is None:
        return None
    size = np.array(model.geom_size[geom])
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_SPHERE:
        size = np.full(3, size[0])
    elif kind == "plane":
        size = np.array([s if s > 0 else PLANE_HALF_SIZE for s in size[:2]] + [0.0])
    elif kind in ("capsule", "cylinder"):
        size = np.array([size[0], size[1], 0.0])
    pose = Pose(model.geom_pos[geom], model.geom_quat[geom])
    name = model.geom(geom).name.rsplit("/", 1)[-1] or f"geom{geom}"
    if kind != "mesh":
        return Shape(name, kind, size, pose, geom_rgba(model, geom))
    vertices, normals, faces = mesh_arrays(model, int(model.geom_dataid[geom]))
    return Shape(name, "mesh", np.ones(3), pose, geom_rgba(model, geom), vertices, normals, faces)


def geom_rgba(model: mujoco.MjModel, geom: int) -> Array:
    """Colour (4,) as MuJoCo shows it: the material's where the geom keeps the default grey, else its own."""
    rgba, material = np.array(model.geom_rgba[geom], dtype=float), int(model.geom_matid[geom])
    if material >= 0 and np.allclose(rgba, [0.5, 0.5, 0.5, 1.0]):
        rgba = np.array(model.mat_rgba[material], dtype=float)
        rgba[:3] *= _texture_mean(model, material)
    clipped: Array = np.clip(rgba, 0.0, 1.0)
    return clipped


def _texture_mean(model: mujoco.MjModel, material: int) -> Array:
    """Mean colour (3,) of the material's RGB texture, in [0, 1]; ones without one."""
    import mujoco

    texture = int(model.mat_texid[material, mujoco.mjtTextureRole.mjTEXROLE_RGB])
    if texture < 0:
        return np.ones(3)
    start, channels = int(model.tex_adr[texture]), int(model.tex_nchannel[texture])
    pixels = int(model.tex_width[texture]) * int(model.tex_height[texture])
    texels = model.tex_data[start : start + pixels * channels].reshape(pixels, channels)
    mean: Array = np.resize(texels.mean(axis=0)[:3], 3) / 255.0
    return mean


def mesh_arrays(model: mujoco.MjModel, mesh: int) -> tuple[Array, Array, NDArray[np.int64]]:
    """Vertices and normals (k, 3) and faces (f, 3) of a compiled mesh.

    MuJoCo indexes positions and normals apart; a vertex here is a pair of the two, so that creases stay sharp.
    """
    at, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    corners = np.stack(
        [model.mesh_face[at : at + count].ravel(), model.mesh_facenormal[at : at + count].ravel()], axis=1
    )
    pairs, inverse = np.unique(corners, axis=0, return_inverse=True)
    vertices = model.mesh_vert[int(model.mesh_vertadr[mesh]) + pairs[:, 0]].astype(float)
    normals = model.mesh_normal[int(model.mesh_normaladr[mesh]) + pairs[:, 1]].astype(float)
    return vertices, normals, inverse.reshape(-1, 3).astype(np.int64)


def has_visuals(model: mujoco.MjModel, body: int) -> bool:
    """Whether some geom of the body is there to be looked at."""
    start = int(model.body_geomadr[body])
    return any(not _hidden(model, geom) for geom in range(start, start + int(model.body_geomnum[body])))


def _hidden(model: mujoco.MjModel, geom: int) -> bool:
    return int(model.geom_group[geom]) >= COLLISION_GROUP or float(geom_rgba(model, geom)[3]) == 0.0


def body_shapes(model: mujoco.MjModel, body: int) -> tuple[list[Shape], list[Shape]]:
    """(visual, collision) shapes of a body; where nothing is visual, the collision geometry is what one sees."""
    visual: list[Shape] = []
    collision: list[Shape] = []
    start = int(model.body_geomadr[body])
    for geom in range(start, start + int(model.body_geomnum[body])):
        shape = geom_shape(model, geom)
        if shape is None:
            continue
        (collision if _hidden(model, geom) else visual).append(shape)
    return (visual, collision) if visual else (collision, [])
