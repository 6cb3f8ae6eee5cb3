"""Generates the meshes of the mug and the cup: a smooth one to look at, convex pieces to collide with.

    python assets/objects/make_meshes.py          (2 s; needs trimesh and manifold3d)

A physics engine collides the convex hull of a mesh, and the hull of a mug is a solid block: no finger would fit inside
the cup or through the handle. So each vessel is also cut, by construction, into pieces that are convex:

* the floor, one disc: the only piece that touches the board it stands on;
* the wall, `WALL_SECTORS` sectors: outside they are exact, inside their hull cuts the arc by its chord;
* the handle, a tube bent along half a superellipse, cut into `HANDLE_PIECES` lengths.

`decompose.py` measures these pieces against the ones that coacd finds for the same mesh.

Frame: origin at the centre of the underside, z up, the handle towards +x. Metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

MESHES = Path(__file__).resolve().parent / "meshes"
CIRCLE_SEGMENTS = 64
WALL_SECTORS = 16
HANDLE_PIECES = 8
RINGS_PER_PIECE = 3
TUBE_SEGMENTS = 12

Points = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Handle:
    """A tube along half a superellipse |x/reach|^n + |z/half_height|^n = 1 in the plane y = 0, open to the wall."""

    reach: float
    half_height: float
    centre_z: float
    tube_radius: float  # in the plane of the handle
    tube_half_width: float  # along y
    exponent: float = 2.5


@dataclass(frozen=True, slots=True)
class Vessel:
    """A surface of revolution with a flat floor; it tapers when the radii differ."""

    name: str
    bottom_radius: float
    top_radius: float
    height: float
    wall: float
    floor: float
    mass: float
    handle: Handle | None = None

    def outer_radius(self, z: float) -> float:
        """Radius of the outer surface at height `z`."""
        return self.bottom_radius + (self.top_radius - self.bottom_radius) * z / self.height


MUG = Vessel(
    name="mug",
    bottom_radius=0.040,
    top_radius=0.040,
    height=0.095,
    wall=0.005,
    floor=0.006,
    mass=0.30,
    handle=Handle(reach=0.036, half_height=0.031, centre_z=0.049, tube_radius=0.0045, tube_half_width=0.0065),
)
CUP = Vessel(
    name="cup", bottom_radius=0.029, top_radius=0.038, height=0.085, wall=0.004, floor=0.005, mass=0.16
)
VESSELS = (MUG, CUP)


def floor_profile(vessel: Vessel) -> Points:
    """(radius, z) of the floor disc, with a small chamfer at the foot."""
    chamfer = 0.002
    return np.array(
        [
            (vessel.outer_radius(0.0) - chamfer, 0.0),
            (vessel.outer_radius(chamfer), chamfer),
            (vessel.outer_radius(vessel.floor), vessel.floor),
        ]
    )


def wall_profile(vessel: Vessel) -> Points:
    """(radius, z) around the wall's cross-section: up the outside, over the rounded rim, down the inside. Convex."""
    rim = vessel.wall / 2
    top = vessel.height - rim
    angles = np.linspace(0.0, np.pi, 7)
    centre = vessel.outer_radius(top) - rim
    over_rim = np.column_stack([centre + rim * np.cos(angles), top + rim * np.sin(angles)])
    outer = (vessel.outer_radius(vessel.floor), vessel.floor)
    inner = (vessel.outer_radius(vessel.floor) - vessel.wall, vessel.floor)
    return np.vstack([outer, over_rim, inner])


def revolve(profile: Points, angles: Points) -> Points:
    """Every profile point turned about z by every angle: (len(angles) * len(profile), 3)."""
    radius, z = profile.T
    x = np.outer(np.cos(angles), radius)
    y = np.outer(np.sin(angles), radius)
    return np.stack([x, y, np.broadcast_to(z, x.shape)], axis=-1).reshape(-1, 3)


def handle_rings(vessel: Vessel, handle: Handle) -> Points:
    """Cross-sections of the handle, (rings, TUBE_SEGMENTS, 3), evenly spaced along it; both ends lie in the wall."""
    turn = np.linspace(-np.pi / 2, np.pi / 2, 4001)
    power = 2 / handle.exponent
    x = vessel.outer_radius(handle.centre_z) - vessel.wall / 2 + handle.reach * np.cos(turn) ** power
    z = handle.centre_z + handle.half_height * np.sign(turn) * np.abs(np.sin(turn)) ** power
    length = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(z)))])
    stations = np.linspace(0.0, length[-1], HANDLE_PIECES * (RINGS_PER_PIECE - 1) + 1)
    x, z = np.interp(stations, length, x), np.interp(stations, length, z)
    tangent_x, tangent_z = np.gradient(x), np.gradient(z)
    tangent_z[[0, -1]] = 0.0  # both ends leave the wall at right angles
    norm = np.hypot(tangent_x, tangent_z)
    normal = np.column_stack([tangent_z / norm, np.zeros_like(x), -tangent_x / norm])
    around = 2 * np.pi * np.arange(TUBE_SEGMENTS) / TUBE_SEGMENTS
    centres = np.column_stack([x, np.zeros_like(x), z])[:, None, :]
    across = handle.tube_radius * np.cos(around)[None, :, None] * normal[:, None, :]
    sideways = handle.tube_half_width * np.sin(around)[None, :, None] * np.array([0.0, 1.0, 0.0])
    return centres + across + sideways


def tube_mesh(rings: Points) -> trimesh.Trimesh:
    """The watertight tube through the rings, with fans at both ends."""
    count, around = rings.shape[:2]
    vertices = np.vstack([rings.reshape(-1, 3), rings[0].mean(axis=0), rings[-1].mean(axis=0)])
    faces = []
    for ring in range(count - 1):
        for k in range(around):
            a, b = ring * around + k, ring * around + (k + 1) % around
            faces += [(a, b, b + around), (a, b + around, a + around)]
    last = (count - 1) * around
    for k in range(around):
        faces.append((count * around, (k + 1) % around, k))
        faces.append((count * around + 1, last + k, last + (k + 1) % around))
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    if mesh.volume < 0:
        mesh.invert()
    return mesh


def solid(vessel: Vessel) -> trimesh.Trimesh:
    """The true vessel: outer surface, cavity and handle as one watertight, concave mesh."""
    floor, wall = floor_profile(vessel), wall_profile(vessel)
    outline = np.vstack([(0.0, 0.0), floor[:2], wall[:-1], wall[-1], (0.0, vessel.floor)])
    body = trimesh.creation.revolve(outline, sections=CIRCLE_SEGMENTS)
    if vessel.handle is None:
        return body
    tube = tube_mesh(handle_rings(vessel, vessel.handle))
    return trimesh.boolean.union([body, tube], engine="manifold")


def pieces(vessel: Vessel) -> list[trimesh.Trimesh]:
    """The convex pieces: floor, wall sectors, handle lengths, in this order."""
    circle = 2 * np.pi * np.arange(CIRCLE_SEGMENTS + 1) / CIRCLE_SEGMENTS
    clouds = [revolve(floor_profile(vessel), circle[:-1])]
    step = CIRCLE_SEGMENTS // WALL_SECTORS
    for sector in range(WALL_SECTORS):
        clouds.append(revolve(wall_profile(vessel), circle[sector * step : (sector + 1) * step + 1]))
    if vessel.handle is not None:
        rings = handle_rings(vessel, vessel.handle)
        stride = RINGS_PER_PIECE - 1
        for piece in range(HANDLE_PIECES):
            clouds.append(rings[piece * stride : (piece + 1) * stride + 1].reshape(-1, 3))
    return [trimesh.convex.convex_hull(cloud) for cloud in clouds]


def write_obj(path: Path, mesh: trimesh.Trimesh) -> None:
    """Wavefront OBJ with vertices rounded to the micrometre, so that regenerating gives the same bytes."""
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in mesh.vertices + 0.0]
    lines += [f"f {a} {b} {c}" for a, b, c in mesh.faces + 1]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


def inertial(vessel: Vessel) -> str:
    """The MJCF inertial element of the true solid: the vessel's mass at uniform density."""
    mesh = solid(vessel)
    mesh.density = vessel.mass / mesh.volume
    centre, inertia = np.round(mesh.center_mass, 6) + 0.0, np.round(mesh.moment_inertia, 9) + 0.0
    full = (inertia[0, 0], inertia[1, 1], inertia[2, 2], inertia[0, 1], inertia[0, 2], inertia[1, 2])
    pos, fullinertia = (" ".join(f"{value:g}" for value in row) for row in (centre, full))
    return f'<inertial mass="{vessel.mass:g}" pos="{pos}" fullinertia="{fullinertia}"/>'


def main() -> None:
    MESHES.mkdir(exist_ok=True)
    for vessel in VESSELS:
        for old in MESHES.glob(f"{vessel.name}_*.obj"):
            old.unlink()
        write_obj(MESHES / f"{vessel.name}_visual.obj", solid(vessel))
        parts = pieces(vessel)
        for index, part in enumerate(parts):
            write_obj(MESHES / f"{vessel.name}_piece_{index:02d}.obj", part)
        print(f"{vessel.name}: {len(parts)} convex pieces\n  {inertial(vessel)}")


if __name__ == "__main__":
    main()
