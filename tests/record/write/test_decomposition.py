"""A decomposition, recorded and read back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from workcell.geometry.decompose import decompose
from workcell.geometry.free_space.polytopes import inflate_polytope, solid_of
from workcell.model.scene import Scene
from workcell.pose import Array
from workcell.record.read.review import Review, review
from workcell.record.shapes import polytope_shape
from workcell.record.write.decomposition import record_decomposition

CELL = """<mujoco model="cell"><worldbody>
  <body name="table" pos=".6 0 -.2"><geom name="top" type="box" size=".15 .2 .02"/></body>
  <site name="robot_mount"/>
</worldbody></mujoco>"""


def assert_boxes(found: Review, kind: str, low: Array, high: Array, within: float) -> None:
    """All solids of a kind in a recording, and no others, are in these boxes (k, 3), which they touch on all sides."""
    meshes = [surface.triangles.vertices for surface in found.stage.surfaces(0.0, (kind,))]
    recorded = np.array([[*mesh.min(axis=0), *mesh.max(axis=0)] for mesh in meshes])
    gaps = np.abs(recorded[:, None] - np.hstack([low, high])).max(axis=2)
    assert len(recorded) == len(low) > 0
    assert gaps.min(axis=0).max() < within and gaps.min(axis=1).max() < within


def test_spheres_cuboids_and_polytopes_are_in_the_recording(tmp_path: Path) -> None:
    (tmp_path / "cell.xml").write_text(CELL)
    scene = Scene.load(tmp_path / "cell.xml", robot="ur10")
    decomposition = decompose(scene, overshoot=0.06)
    found = review(record_decomposition(decomposition, scene, tmp_path / "cell.rrd"))
    assert found.achieved
    kinds = [thing.kind for thing in found.stage.things]
    assert kinds.count("free_space") == len(decomposition.free_space) + len(
        decomposition.free_space.polytopes
    )
    assert kinds.count("obstacle_spheres") == 1
    assert kinds.count("spheres") == len(np.unique(decomposition.robot_cover.link))
    assert found.result["obstacle_spheres"] == len(decomposition.obstacle_cover)
    around, (centre, radius) = decomposition.obstacle_cover, decomposition.robot_spheres()
    assert_boxes(found, "spheres", centre - radius[:, None], centre + radius[:, None], 0.02 * radius.max())
    low, high = around.centre - around.radius[:, None], around.centre + around.radius[:, None]
    assert_boxes(found, "obstacle_spheres", low, high, 0.02 * around.radius.max())
    free = decomposition.free_space
    solids = [solid_of(polytope).vertices for polytope in free.polytopes]
    low = np.array([*free.lower, *(corners.min(axis=0) for corners in solids)])
    high = np.array([*free.upper, *(corners.max(axis=0) for corners in solids)])
    assert_boxes(found, "free_space", low, high, 1e-5)
    numbered = {
        thing.owner: thing.parts[0][0].vertices for thing in found.stage.things if thing.kind == "free_space"
    }
    for number in range(len(free)):
        assert numbered[str(number)].max(axis=0) == pytest.approx(free.upper[number], abs=1e-5)


def test_a_polytope_is_drawn_as_its_surface_facing_outwards() -> None:
    bounds: Array = np.array([[-1.0, -1, -1], [1, 2, 1]])
    polytope = inflate_polytope([0.0, 0.0, 0.0], (), bounds)
    assert polytope is not None
    shape, solid = polytope_shape(polytope, np.ones(4)), solid_of(polytope)
    assert shape.vertices is not None and shape.faces is not None and shape.normals is not None
    corners = shape.vertices[shape.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.isclose(
        np.einsum("ij,ij->", corners[:, 0], normal) / 6, 12.0
    )  # the volume, by the divergence theorem
    assert len(solid.vertices) == 8
