"""Triangles of shapes, for drawing without a graphics card."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from workcell.pose import Array
from workcell.record.shapes import Shape

_SEGMENTS = 40
_RINGS = 10


@dataclass(frozen=True, slots=True)
class Triangles:
    """A triangle mesh: vertices and unit normals (k, 3), faces (f, 3) counter-clockwise seen from outside."""

    vertices: Array
    normals: Array
    faces: NDArray[np.int64]

    def moved(self, rotation: Array, translation: Array) -> Triangles:
        """The mesh turned by (3, 3), then shifted by (3,)."""
        return Triangles(self.vertices @ rotation.T + translation, self.normals @ rotation.T, self.faces)


def tessellate(shape: Shape) -> Triangles:
    """Triangles of a shape in the frame of the entity that carries it."""
    if shape.kind == "mesh":
        local = _mesh(shape)
    elif shape.kind == "box":
        local = _box(shape.size)
    elif shape.kind == "plane":
        local = _plane(shape.size)
    elif shape.kind == "ellipsoid":
        local = _ellipsoid(shape.size)
    else:
        round_ends = shape.kind == "capsule"
        local = _revolved(_profile(float(shape.size[0]), float(shape.size[1]), round_ends))
    return local.moved(shape.pose.rotation, shape.pose.position)


def _mesh(shape: Shape) -> Triangles:
    assert shape.vertices is not None and shape.faces is not None
    vertices, faces = shape.vertices, shape.faces
    if shape.normals is not None:
        return Triangles(vertices, shape.normals, faces)
    flat = np.cross(
        vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]]
    )
    flat /= np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-300)
    return Triangles(
        vertices[faces.ravel()], np.repeat(flat, 3, axis=0), np.arange(3 * len(faces)).reshape(-1, 3)
    )


def _box(half: Array) -> Triangles:
    vertices: list[Array] = []
    normals: list[Array] = []
    faces: list[list[int]] = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for sign in (-1.0, 1.0):
            corners = np.zeros((4, 3))
            corners[:, axis] = sign
            corners[:, u] = [-1, 1, 1, -1] if sign > 0 else [-1, -1, 1, 1]
            corners[:, v] = [-1, -1, 1, 1] if sign > 0 else [-1, 1, 1, -1]
            base = 4 * len(vertices)
            faces += [[base, base + 1, base + 2], [base, base + 2, base + 3]]
            vertices.append(corners * half)
            normals.append(np.tile(sign * np.eye(3)[axis], (4, 1)))
    return Triangles(np.concatenate(vertices), np.concatenate(normals), np.array(faces))


def _plane(half: Array) -> Triangles:
    vertices = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * half
    return Triangles(vertices, np.tile([0.0, 0.0, 1.0], (4, 1)), np.array([[0, 1, 2], [0, 2, 3]]))


@lru_cache(maxsize=1)
def unit_sphere() -> Triangles:
    """A sphere of radius 1 about the origin."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, 2 * _RINGS + 1)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return _revolved(np.concatenate([ring, ring], axis=1))


def balls(centres: Array, radii: Array) -> Triangles:
    """Spheres (k, 3), (k,) as one mesh, coarse enough for thousands of them."""
    ball = _coarse_sphere()
    corners = len(ball.vertices)
    vertices = radii[:, None, None] * ball.vertices + centres[:, None]
    faces = ball.faces + corners * np.arange(len(centres))[:, None, None]
    normals = np.tile(ball.normals, (len(centres), 1))
    return Triangles(vertices.reshape(-1, 3), normals, faces.reshape(-1, 3))


@lru_cache(maxsize=1)
def _coarse_sphere() -> Triangles:
    """A sphere of radius 1 about the origin: an octahedron with every side halved twice."""
    corners = np.concatenate([np.eye(3), -np.eye(3)])
    signs = [(x, y, z) for x in (0, 3) for y in (1, 4) for z in (2, 5)]
    faces = np.array([side if (np.array(side) >= 3).sum() % 2 == 0 else side[::-1] for side in signs])
    triangles = corners[faces]
    for _ in range(2):
        a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
        ab, bc, ca = (
            middle / np.linalg.norm(middle, axis=1, keepdims=True) for middle in (a + b, b + c, c + a)
        )
        quarters = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
        triangles = np.concatenate([np.stack(quarter, axis=1) for quarter in quarters])
    points, index = np.unique(triangles.reshape(-1, 3).round(12), axis=0, return_inverse=True)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    return Triangles(points, points, index.reshape(-1, 3))


def _ellipsoid(axes: Array) -> Triangles:
    sphere = unit_sphere()
    normals = sphere.normals / axes
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Triangles(sphere.vertices * axes, normals, sphere.faces)


def _profile(radius: float, half: float, round_ends: bool) -> Array:
    """(r, z, normal r, normal z) from the bottom of a capsule or cylinder to its top."""
    if not round_ends:
        return np.array(
            [
                [0.0, -half, 0.0, -1.0],
                [radius, -half, 0.0, -1.0],
                [radius, -half, 1.0, 0.0],
                [radius, half, 1.0, 0.0],
                [radius, half, 0.0, 1.0],
                [0.0, half, 0.0, 1.0],
            ]
        )
    angle = np.linspace(0.0, np.pi / 2, _RINGS + 1)
    up = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    down = up[::-1] * [1.0, -1.0]
    low = np.concatenate([down * radius - [0.0, half], down], axis=1)
    high = np.concatenate([up * radius + [0.0, half], up], axis=1)
    return np.concatenate([low, high])


def _revolved(profile: Array) -> Triangles:
    """The surface swept by turning (r, z, normal r, normal z) rows about z; rows run from the bottom up."""
    turn = np.linspace(0.0, 2 * np.pi, _SEGMENTS, endpoint=False)
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)

    def sweep(radial: Array, axial: Array) -> Array:
        flat = radial[:, None, None] * circle
        return np.concatenate([flat, np.broadcast_to(axial[:, None, None], (*flat.shape[:2], 1))], axis=2)

    vertices = sweep(profile[:, 0], profile[:, 1]).reshape(-1, 3)
    normals = sweep(profile[:, 2], profile[:, 3]).reshape(-1, 3)
    row = np.arange(len(profile) - 1)[:, None] * _SEGMENTS
    here, after = np.arange(_SEGMENTS), np.roll(np.arange(_SEGMENTS), -1)
    a, b, c, d = row + here, row + after, row + _SEGMENTS + after, row + _SEGMENTS + here
    faces = np.concatenate([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)]).reshape(-1, 3)
    corners = vertices[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return Triangles(vertices, normals, faces[area > 1e-14])
