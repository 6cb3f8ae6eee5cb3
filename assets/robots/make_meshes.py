"""Generates the meshes that the robots show: turned parts, bent tubes and rounded boxes, all of our own design.

    python assets/robots/make_meshes.py          (a second; needs trimesh)

They are for the eye only: they stay inside the collision primitives of the robot files (to a millimetre or two), and
nothing collides with them.  A mesh `<robot>_<link>_<part>.stl` lies in the frame of its link. Metres.

The shapes are built from three operations: `turned` (a profile revolved about an axis), `tube` (an ellipse swept
along a planar path) and `rounded_box`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

MESHES = Path(__file__).resolve().parent / "meshes"
SEGMENTS = 32  # around a circle
FILLET_STEPS = 3

Points = NDArray[np.float64]


def skin(rings: Sequence[Points]) -> trimesh.Trimesh:
    """The closed surface through rings of equally many points; the first and last ring may shrink to a point."""
    n = len(rings[0])
    vertices = np.concatenate([*rings, [rings[0].mean(axis=0), rings[-1].mean(axis=0)]])
    first, last = len(vertices) - 2, len(vertices) - 1
    here = np.arange(n)
    after = (here + 1) % n
    faces = []
    for k in range(len(rings) - 1):
        a, b = k * n, (k + 1) * n
        faces.append(np.column_stack([a + here, a + after, b + after]))
        faces.append(np.column_stack([a + here, b + after, b + here]))
    top = (len(rings) - 1) * n
    faces.append(np.column_stack([np.full(n, first), after, here]))
    faces.append(np.column_stack([np.full(n, last), top + here, top + after]))
    mesh = trimesh.Trimesh(vertices, np.concatenate(faces), process=True)
    if mesh.volume < 0:
        mesh.invert()
    return mesh


def turned(start: ArrayLike, end: ArrayLike, profile: Sequence[tuple[float, float]]) -> trimesh.Trimesh:
    """A profile of (distance from `start`, radius) revolved about the axis from `start` to `end`."""
    origin, axis = np.asarray(start, float), np.subtract(end, start)
    axis = axis / np.linalg.norm(axis)
    side = np.cross(axis, [1.0, 0, 0] if abs(axis[0]) < 0.9 else [0, 1.0, 0])
    side /= np.linalg.norm(side)
    angle = np.linspace(0, 2 * np.pi, SEGMENTS, endpoint=False)[:, None]
    circle = np.cos(angle) * side + np.sin(angle) * np.cross(axis, side)
    return skin([origin + distance * axis + radius * circle for distance, radius in profile])


def barrel(
    start: ArrayLike, end: ArrayLike, radius: float, fillet: float = 0.012, waist: float = 0.0
) -> trimesh.Trimesh:
    """A cylinder with rounded edges; `waist` makes it thinner in the middle."""
    length = float(np.linalg.norm(np.subtract(end, start)))
    turn = np.linspace(0, np.pi / 2, FILLET_STEPS + 1)
    rise = [(fillet * (1 - np.cos(t)), radius - fillet * (1 - np.sin(t))) for t in turn]
    profile = [*rise, *((length - distance, r) for distance, r in reversed(rise))]
    if waist:
        middle = np.linspace(fillet, length - fillet, 9)[1:-1]
        bow = [
            (z, radius - waist * np.sin(np.pi * (z - fillet) / (length - 2 * fillet)) ** 2) for z in middle
        ]
        profile = [*rise, *bow, *profile[len(rise) :]]
    return turned(start, end, profile)


def dome(start: ArrayLike, end: ArrayLike, radius: float, share: float = 1.0) -> trimesh.Trimesh:
    """A cylinder from `start` that ends at `end` in a half ball; `share` < 1: only that share of its angle."""
    length = float(np.linalg.norm(np.subtract(end, start)))
    turn = np.linspace((1 - share) * np.pi / 2, np.pi / 2, 7)
    cap = [(length - radius * (1 - np.sin(t)), max(radius * np.cos(t), 1e-4)) for t in turn]
    return turned(start, end, cap if share < 1 else [(0.0, radius), *cap])


def disc(start: ArrayLike, end: ArrayLike, radius: float) -> trimesh.Trimesh:
    """A thin plate or cap with a small chamfer on its edge."""
    return barrel(
        start, end, radius, fillet=min(0.004, 0.45 * float(np.linalg.norm(np.subtract(end, start))))
    )


def tube(
    path: Sequence[tuple[float, float]], half_x: Sequence[float], half_normal: Sequence[float]
) -> trimesh.Trimesh:
    """An ellipse swept along a smooth path through points (y, z).

    Half width along x, half thickness across the path. The points are joined by a monotone parameter and
    cubic interpolation, so that a few of them make a round bend.
    """
    knots = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    at = np.linspace(0, knots[-1], 13)
    y, z = (_smooth(knots, np.asarray(path)[:, k], at) for k in range(2))
    width, thickness = (np.interp(at, knots, values) for values in (half_x, half_normal))
    slope = np.column_stack([np.gradient(y, at), np.gradient(z, at)])
    slope /= np.linalg.norm(slope, axis=1)[:, None]
    angle = np.linspace(0, 2 * np.pi, SEGMENTS, endpoint=False)
    rings = []
    for k in range(len(at)):
        across = thickness[k] * np.sin(angle)
        x = width[k] * np.cos(angle)
        rings.append(np.column_stack([x, y[k] - slope[k, 1] * across, z[k] + slope[k, 0] * across]))
    return skin(rings)


def _smooth(knots: Points, values: Points, at: Points) -> Points:
    """Cubic Hermite interpolation with slopes from the neighbours."""
    slopes = np.gradient(values, knots)
    k = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, len(knots) - 2)
    h = knots[k + 1] - knots[k]
    t = (at - knots[k]) / h
    return np.asarray(
        (1 + 2 * t) * (1 - t) ** 2 * values[k]
        + t * (1 - t) ** 2 * h * slopes[k]
        + t**2 * (3 - 2 * t) * values[k + 1]
        + t**2 * (t - 1) * h * slopes[k + 1]
    )


def rounded_box(lower: ArrayLike, upper: ArrayLike, radius: float) -> trimesh.Trimesh:
    """The box between two corners, with rounded edges."""
    ball = trimesh.creation.icosphere(subdivisions=2, radius=radius).vertices
    low, high = np.asarray(lower, float) + radius, np.asarray(upper, float) - radius
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), axis=-1).reshape(-1, 3)
    return trimesh.convex.convex_hull((corners[:, None, :] + ball).reshape(-1, 3))


def sawyer() -> dict[str, list[trimesh.Trimesh]]:
    """Red shells, dark joint caps, a head with a screen, a pedestal on four legs."""
    return {
        "pedestal_column": [
            turned(
                [-0.02, 0, -0.86],
                [-0.02, 0, 0],
                [
                    (0, 0.178),
                    (0.05, 0.178),
                    (0.3, 0.15),
                    (0.7, 0.14),
                    (0.82, 0.14),
                    (0.845, 0.15),
                    (0.86, 0.15),
                ],
            )
        ],
        "controller_box": [rounded_box([-0.435, -0.2, -0.645], [-0.215, 0.2, -0.115], 0.02)],
        "right_arm_base_link": [
            turned(
                [0, 0, 0],
                [0, 0, 1],
                [(0, 0.105), (0.03, 0.105), (0.045, 0.098), (0.06, 0.08), (0.078, 0.075)],
            )
        ],
        "right_l0_shell": [
            barrel([0, 0, 0.002], [0, 0, 0.3], 0.068, 0.015),
            barrel([0.081, -0.06, 0.237], [0.081, 0.048, 0.237], 0.068),
            rounded_box([-0.02, -0.058, 0.175], [0.09, 0.045, 0.298], 0.02),
        ],
        "right_l0_cap": [
            disc([0.081, -0.08, 0.237], [0.081, -0.058, 0.237], 0.062),
            disc([0, 0, 0.295], [0, 0, 0.311], 0.05),
        ],
        "head": [
            barrel([0, 0, -0.027], [0, 0, 0.2335], 0.04),
            rounded_box([-0.04, -0.128, 0.01], [0.029, 0.128, 0.19], 0.015),
        ],
        "right_l1_shell": [
            barrel([0, 0, 0.002], [0, 0, 0.178], 0.068, 0.018),
            turned([0, -0.01, 0.1425], [0, -1, 0.1425], [(0, 0.0522), (0.1285, 0.0522)]),
        ],
        "right_l1_cap": [disc([0, 0, 0.176], [0, 0, 0.1955], 0.058)],
        "right_l2_shell": [
            barrel([0, 0, 0.014], [0, 0, 0.262], 0.0528, 0.006, waist=0.006),
            barrel([0, -0.041, 0.26], [0, 0.04, 0.26], 0.0534, 0.01),
        ],
        "right_l2_cap": [
            disc([0, 0, 0.001], [0, 0, 0.015], 0.0515),
            disc([0, 0.038, 0.26], [0, 0.0532, 0.26], 0.046),
        ],
        "right_l3_shell": [
            barrel([0, 0, -0.001], [0, 0, -0.158], 0.0542, 0.014),
            turned([0, 0, -0.1265], [0, -1, -0.1265], [(0, 0.0455), (0.125, 0.0455)]),
        ],
        "right_l3_cap": [disc([0, 0, -0.156], [0, 0, -0.1725], 0.046)],
        "right_l4_shell": [
            barrel([0, 0, 0.012], [0, 0, 0.275], 0.0448, 0.006, waist=0.007),
            barrel([0, -0.016, 0.272], [0, 0.03, 0.272], 0.0435, 0.012),
        ],
        "right_l4_cap": [
            disc([0, 0, 0.0], [0, 0, 0.013], 0.0435),
            disc([0, -0.026, 0.272], [0, -0.014, 0.272], 0.033),
        ],
        "right_l5_shell": [
            barrel([0, 0, 0.001], [0, 0, 0.14], 0.0478, 0.014),
            turned([0, 0, 0.1053], [0, -1, 0.1053], [(0, 0.0465), (0.0695, 0.0465)]),
        ],
        "right_l5_cap": [disc([0, 0, 0.138], [0, 0, 0.152], 0.038)],
        "right_l6_cuff": [
            barrel([0, 0, -0.0395], [0, 0, 0.014], 0.0415, 0.006),
            rounded_box([-0.028, 0, -0.035], [0.028, 0.0675, 0.013], 0.01),
        ],
        "right_l6_flange": [disc([0, 0, 0.013], [0, 0, 0.0245], 0.0365)],
    }


def ur10() -> dict[str, list[trimesh.Trimesh]]:
    """Silver housings and tubes; blue caps on the free end of every joint."""
    return {
        "base_link": [
            turned([0, 0, 0], [0, 0, 1], [(0, 0.075), (0.012, 0.075), (0.018, 0.072), (0.037, 0.072)]),
            rounded_box([-0.028, -0.092, 0.001], [0.028, 0, 0.036], 0.006),
        ],
        "shoulder_link_shell": [
            barrel([0, 0, -0.088], [0, 0, 0.07], 0.0752, 0.014),
            barrel([0, 0, 0], [0, 0.084, 0], 0.0745, 0.006),
        ],
        "shoulder_link_cap": [barrel([0, 0, 0.055], [0, 0, 0.0878], 0.072, 0.015)],
        "upper_arm_link_shell": [
            barrel([0, -0.133, 0], [0, 0.022, 0], 0.0752, 0.012),
            barrel([0, -0.1035, 0.612], [0, -0.005, 0.612], 0.0622, 0.01),
            barrel([0, -0.0445, 0], [0, -0.0445, 0.095], 0.0745, 0.012),
            barrel([0, -0.0445, 0.54], [0, -0.0445, 0.612], 0.0585, 0.008),
        ],
        "upper_arm_link_tube": [barrel([0, -0.0445, 0.03], [0, -0.0445, 0.6], 0.0545, 0.003)],
        "upper_arm_link_cap": [
            barrel([0, 0.005, 0], [0, 0.042, 0], 0.072, 0.015),
            barrel([0, -0.02, 0.612], [0, 0.0154, 0.612], 0.0595, 0.013),
        ],
        "forearm_link_shell": [
            barrel([0, -0.05, 0], [0, 0.066, 0], 0.0601, 0.01),
            barrel([0, -0.038, 0.5723], [0, 0.0605, 0.5723], 0.047, 0.008),
            barrel([0, 0, 0], [0, 0, 0.078], 0.058, 0.012),
        ],
        "forearm_link_tube": [turned([0, 0, 0.02], [0, 0, 1], [(0, 0.0438), (0.55, 0.0438)])],
        "forearm_link_cap": [
            barrel([0, -0.0688, 0], [0, -0.035, 0], 0.0575, 0.013),
            barrel([0, -0.0548, 0.5723], [0, -0.025, 0.5723], 0.0445, 0.01),
        ],
        "wrist_1_link_shell": [
            barrel([0, 0.062, 0], [0, 0.115, 0], 0.0455, 0.004),
            barrel([0, 0.1149, -0.04], [0, 0.1149, 0.0612], 0.0458, 0.008),
        ],
        "wrist_1_link_cap": [barrel([0, 0.1149, -0.0565], [0, 0.1149, -0.028], 0.0435, 0.01)],
        "wrist_2_link_shell": [
            barrel([0, 0, 0.063], [0, 0, 0.115], 0.0455, 0.004),
            barrel([0, -0.04, 0.1157], [0, 0.0608, 0.1157], 0.0458, 0.008),
        ],
        "wrist_2_link_cap": [barrel([0, -0.057, 0.1157], [0, -0.028, 0.1157], 0.0435, 0.01)],
        "wrist_3_link": [
            turned(
                [0, 0.0618, 0],
                [0, 1, 0],
                [(0, 0.045), (0.021, 0.045), (0.023, 0.042), (0.0302, 0.042), (0.0302, 0.0315)],
            )
        ],
    }


def iiwa14() -> dict[str, list[trimesh.Trimesh]]:
    """White shells that swing from one side of the arm to the other; grey joint lids."""
    return {
        "base": [
            turned(
                [0, 0, 0],
                [0, 0, 1],
                [
                    (0, 0.121),
                    (0.018, 0.121),
                    (0.024, 0.116),
                    (0.06, 0.106),
                    (0.1, 0.094),
                    (0.135, 0.0865),
                    (0.145, 0.0855),
                ],
            ),
            rounded_box([-0.135, -0.055, 0.012], [-0.03, 0.055, 0.11], 0.015),
        ],
        "link1": _shell_link(0.0855, 0.08, 0.2025, (0, -0.1152), 0.0852),
        "link1_lid": [dome([0, 0, 0.2025], [0, -0.1157, 0.2025], 0.0855, 0.55)],
        "link2": _housing_link(0.0855, 0.1316, 0.068, 0.068, 0.196),
        "link2_lid": [dome([0, 0, 0], [0, 0, 0.1321], 0.0858, 0.55)],
        "link3": _shell_link(0.068, 0.075, 0.2155, (0, 0.1142), 0.0677),
        "link3_lid": [dome([0, 0, 0.2155], [0, 0.1146, 0.2155], 0.068, 0.55)],
        "link4": _housing_link(0.068, 0.1142, 0.0675, 0.067, 0.176),
        "link4_lid": [dome([0, 0, 0], [0, 0, 0.1146], 0.0684, 0.55)],
        "link5": _shell_link(0.068, 0.06, 0.2155, (0.045, 0.0985), 0.0512),
        "link5_lid": [dome([0, 0.045, 0.2155], [0, 0.099, 0.2155], 0.0515, 0.55)],
        "link6": [
            barrel([0, 0, -0.066], [0, 0, 0.0665], 0.066, 0.022),
            turned(
                [0, -0.086, 0],
                [0, 1, 0],
                [
                    (0, 0.012),
                    (0.003, 0.026),
                    (0.01, 0.04),
                    (0.028, 0.057),
                    (0.066, 0.065),
                    (0.11, 0.061),
                    (0.15, 0.052),
                    (0.166, 0.0502),
                ],
            ),
        ],
        "link6_lid": [disc([0, 0, -0.0645], [0, 0, -0.0705], 0.044)],
        "link7": [
            turned(
                [0, 0, 0],
                [0, 0, 1],
                [
                    (-0.0005, 0.0515),
                    (0.012, 0.0515),
                    (0.016, 0.0495),
                    (0.036, 0.0495),
                    (0.038, 0.045),
                    (0.045, 0.045),
                    (0.045, 0.0315),
                ],
            )
        ],
    }


def _shell_link(
    radius: float, rise: float, joint_z: float, shell_y: tuple[float, float], shell_radius: float
) -> list[trimesh.Trimesh]:
    """An odd link: a column about z that bends sideways and ends as a domed shell around the next joint's axis."""
    inner, outer = shell_y
    middle = outer - np.sign(outer) * 0.85 * shell_radius
    bend = tube(
        [
            (0, 0.004),
            (0, rise * 0.35),
            (0, rise * 0.6),
            (0.38 * middle, rise + 0.015),
            (0.87 * middle, joint_z - 0.06),
            (middle, joint_z),
        ],
        [
            radius - 0.0005,
            radius - 0.0005,
            radius - 0.001,
            0.84 * radius,
            0.8 * shell_radius,
            0.9 * shell_radius,
        ],
        [
            radius - 0.0005,
            radius - 0.0005,
            radius - 0.001,
            0.7 * radius,
            0.7 * shell_radius,
            0.7 * shell_radius,
        ],
    )
    return [bend, dome([0, inner, joint_z], [0, outer, joint_z], shell_radius)]


def _housing_link(
    radius: float, top: float, column_radius: float, end_radius: float, column_end: float
) -> list[trimesh.Trimesh]:
    """An even link: a domed housing about z that narrows into a column along y."""
    neck = tube(
        [
            (0, 0.45 * top),
            (0.3 * column_end, 0.33 * top),
            (0.65 * column_end, 0.06 * top),
            (0.85 * column_end, 0),
            (column_end, 0),
        ],
        [0.93 * radius, 0.84 * radius, 0.98 * column_radius, column_radius, end_radius],
        [0.5 * top, 0.85 * radius, 0.98 * column_radius, column_radius, end_radius],
    )
    return [dome([0, 0, 0], [0, 0, top], radius), neck]


def gripper() -> dict[str, list[trimesh.Trimesh]]:
    """The palm of the parallel gripper."""
    return {
        "adapter": [barrel([0, 0, 0.0], [0, 0, 0.036], 0.0349, 0.003)],
        "palm": [rounded_box([-0.022, -0.062, 0.035], [0.022, 0.062, 0.076], 0.006)],
    }


def main() -> None:
    MESHES.mkdir(exist_ok=True)
    for robot, parts in {
        "sawyer": sawyer(),
        "ur10": ur10(),
        "iiwa14": iiwa14(),
        "gripper": gripper(),
    }.items():
        for part, pieces in parts.items():
            trimesh.util.concatenate(pieces).export(MESHES / f"{robot}_{part}.stl")
    size = sum(path.stat().st_size for path in MESHES.glob("*.stl"))
    print(f"{len(list(MESHES.glob('*.stl')))} meshes, {size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
