"""Rerun's archetypes of solids, and its colours."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from workcell.pose import Array
from workcell.record.shapes import Shape


def colour_bytes(rgba: Sequence[float] | Array) -> list[int]:
    """Four integers 0..255 of a colour in [0, 1]."""
    return [round(255 * float(value)) for value in rgba]


def archetype_of(rr: Any, shape: Shape) -> Any:
    """What Rerun draws a shape with."""
    colour, solid = colour_bytes(shape.rgba), rr.components.FillMode.Solid
    if shape.kind == "mesh":
        return rr.Mesh3D(
            vertex_positions=shape.vertices,
            vertex_normals=shape.normals,
            triangle_indices=shape.faces,
            albedo_factor=colour,
        )
    if shape.kind == "capsule":
        radius, half = float(shape.size[0]), float(shape.size[1])
        # Rerun's capsule starts at the origin and goes up; MuJoCo's is centred there.
        return rr.Capsules3D(
            lengths=[2 * half], radii=[radius], translations=[[0, 0, -half]], colors=[colour], fill_mode=solid
        )
    if shape.kind == "cylinder":
        lengths, radii = [2 * float(shape.size[1])], [float(shape.size[0])]
        return rr.Cylinders3D(lengths=lengths, radii=radii, colors=[colour], fill_mode=solid)
    if shape.kind == "ellipsoid":
        return rr.Ellipsoids3D(half_sizes=[shape.size], colors=[colour], fill_mode=solid)
    return rr.Boxes3D(half_sizes=[shape.size], colors=[colour], fill_mode=solid)
