"""Geoms of a compiled model as the kernels of `convex` and `terrain` take them: convex cores, and height fields."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from workcell.pose import Array, read_only

if TYPE_CHECKING:
    import mujoco

PLANE, FIELD, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH, SIGNED_FIELD = range(9)
"""MuJoCo's `mjtGeom`, written out so that MuJoCo is not imported here."""

_CORES = {SPHERE: 0, CAPSULE: 1, BOX: 2, CYLINDER: 3, ELLIPSOID: 4, MESH: 5}
"""What `convex` calls them."""
_FEW = 10
"""Vertices below which MuJoCo looks at all of them and not at the hull (`mjMESH_HILLCLIMB_MIN`)."""


@dataclass(frozen=True, slots=True)
class Core:
    """A convex geom: all that is within `radius` metres of a core, see `workcell.model.judge.convex.support`."""

    kind: int
    size: Array
    vertices: Array
    radius: float


@dataclass(frozen=True, slots=True)
class Field:
    """A height field: see `workcell.model.judge.terrain.field_distance`."""

    heights: Array
    grid: Array
    levels: NDArray[np.int64]
    peaks: Array


def hull_vertices(model: mujoco.MjModel, mesh: int) -> Array:
    """The vertices (k, 3) that MuJoCo collides: of the hull it made, which `maxhullvert` may have made coarser."""
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    vertices = np.array(model.mesh_vert[first : first + count], dtype=float)
    graph = int(model.mesh_graphadr[mesh])
    if graph < 0 or count < _FEW:
        return vertices
    corners = int(model.mesh_graph[graph])
    kept: Array = vertices[np.sort(model.mesh_graph[graph + 2 + corners : graph + 2 + 2 * corners])]
    return kept


def core_of(model: mujoco.MjModel, geom: int) -> Core:
    """A geom that is convex and bounded."""
    kind, size = int(model.geom_type[geom]), np.array(model.geom_size[geom])
    vertices = np.zeros((1, 3))
    if kind == MESH:
        vertices = hull_vertices(model, int(model.geom_dataid[geom]))
    radius = float(size[0]) if kind in (SPHERE, CAPSULE) else 0.0
    return Core(_CORES[kind], read_only(size), read_only(vertices), radius)


def field_of(model: mujoco.MjModel, geom: int) -> Field:
    """A height field with the pyramid of its heights."""
    from workcell.model.judge.terrain import tallest

    field = int(model.geom_dataid[geom])
    rows, columns = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
    half_x, half_y, top, base = (float(v) for v in model.hfield_size[field])
    first = int(model.hfield_adr[field])
    data = np.array(model.hfield_data[first : first + rows * columns], dtype=float)
    heights = np.ascontiguousarray(top * data.reshape(rows, columns))
    levels, begin, wide, long = [], 0, rows - 1, columns - 1
    while True:
        levels.append((begin, wide, long))
        begin += wide * long
        if wide == 1 and long == 1:
            break
        wide, long = (wide + 1) // 2, (long + 1) // 2
    steps, peaks = np.array(levels, dtype=np.int64), np.empty(begin)
    tallest(heights, steps, peaks)
    return Field(
        read_only(heights), read_only([half_x, half_y, base]), read_only(steps, np.int64), read_only(peaks)
    )
