"""Meshes that are not what they seem: concave (their hull collides), inside out, or in millimetres."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from workcell.inspection.findings import Finding, beware, wrong
from workcell.pose import Array

if TYPE_CHECKING:
    import mujoco

CONCAVE = 0.05
"""Share of its volume that a mesh's hull must add for it to be called concave."""
HUGE = 20.0
"""Metres across from which a mesh can only be in other units."""


def mesh_findings(model: mujoco.MjModel) -> Iterator[Finding]:
    """Of every mesh that can collide."""
    import mujoco

    collides = (np.asarray(model.geom_contype) != 0) | (np.asarray(model.geom_conaffinity) != 0)
    meshes = np.asarray(model.geom_type) == int(mujoco.mjtGeom.mjGEOM_MESH)
    for mesh in np.unique(np.asarray(model.geom_dataid)[collides & meshes]):
        yield from _mesh(model, int(mesh))


def _mesh(model: mujoco.MjModel, mesh: int) -> Iterator[Finding]:
    name = str(model.mesh(mesh).name) or f"mesh number {mesh}"
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    vertices = np.array(model.mesh_vert[first : first + count], dtype=float)
    faces = model.mesh_face[int(model.mesh_faceadr[mesh]) :][: int(model.mesh_facenum[mesh])]
    across = float(np.ptp(vertices, axis=0).max())
    if across > HUGE:
        yield wrong(
            "mesh",
            f'mesh {name} is {across:.0f} m across: is it in millimetres? scale="0.001 0.001 0.001" makes it '
            f"{across:.0f} mm",
            mesh=name, across_m=across,
        )  # fmt: skip
    volume, hull = enclosed_volume(vertices, faces), hull_volume(vertices)
    if volume < -1e-3 * hull:
        yield beware(
            "mesh",
            f"mesh {name} is inside out: its faces are seen from inside. Its hull collides all the same; "
            "its mass is not to be trusted. Turn its faces round",
            mesh=name, volume_m3=volume,
        )  # fmt: skip
    added = hull / abs(volume) - 1.0 if abs(volume) > 1e-3 * hull else np.inf
    if added > CONCAVE:
        words = f"adds {100 * added:.0f} % to its volume" if np.isfinite(added) else "closes what is open"
        yield beware(
            "mesh",
            f"mesh {name} is concave: what collides is its convex hull, which {words}. Convex parts would follow it",
            mesh=name, hull_adds=None if np.isinf(added) else added,
        )  # fmt: skip


def enclosed_volume(vertices: Array, faces: Array) -> float:
    """Signed volume inside triangles (f, 3) of vertices (v, 3), positive where they are seen from outside."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.einsum("fi,fi->", a - vertices.mean(axis=0), np.cross(b - a, c - a)) / 6.0)


def hull_volume(vertices: Array) -> float:
    """Volume of the convex hull of points (v, 3); 0 where they lie in a plane."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return float(ConvexHull(vertices).volume)
    except QhullError:
        return 0.0
