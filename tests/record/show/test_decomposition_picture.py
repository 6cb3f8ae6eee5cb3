"""The picture of a decomposition: every sphere, cuboid and solid is where it is, in its own panel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tests.record.sight import Mask, around, inside
from workcell.geometry.decompose import Decomposition
from workcell.geometry.free_space.polytopes import inflate_polytope
from workcell.geometry.pieces import move_piece, robot_pieces, scene_obstacles
from workcell.geometry.types import FreeSpace, SphereCover
from workcell.model.scene import Scene
from workcell.pose import Array, Pose
from workcell.record.show.decomposition import COLOURS, decomposition_figure

CELL = """<mujoco model="cell"><worldbody>
  <body name="table" pos=".7 0 -.2"><geom name="top" type="box" size=".15 .2 .02"/></body>
  <body name="post" pos=".3 .7 0"><geom name="post" type="cylinder" size=".04 .15"/></body>
  <site name="robot_mount"/>
</worldbody></mujoco>"""

PLANES = ((0, 2), (0, 1))
"""World axes across and up of the upper row of panels, from the side, and of the lower one, from above."""

GREY = np.array([0.36, 0.42, 0.48])
CUBOID = np.array([[0.4, 0.3, -0.1], [0.6, 0.5, 0.0]])
BESIDE_THE_HAND = np.array([-0.2, 0.3, -0.3])
"""Where from the hand the smallest sphere stands, so that nothing hides it."""
POLYTOPE = np.array([[-0.1, 0.3, -0.2], [0.05, 0.5, -0.1]])

Silhouette = Callable[[Array, list[int]], Mask]
"""Which places (h, w, 2) of a plane of two world axes a part covers."""

METRICS = {
    "robot_spheres": 1,
    "base_spheres": 1,
    "obstacle_spheres": 2,
    "robot_overshoot_max_m": 0.04,
    "cuboids": 2,
    "polytopes": 1,
    "covered_fraction": 0.5,
}


@pytest.fixture(scope="module")
def parts(tmp_path_factory: pytest.TempPathFactory) -> Decomposition:
    """A cell with few parts, far from each other: not a decomposition of it, but drawn as one."""
    path = tmp_path_factory.mktemp("cell") / "cell.xml"
    path.write_text(CELL)
    scene = Scene.load(path, robot="ur10")
    arm = scene.robot()
    dof = arm.robot.dof
    polytope = inflate_polytope(POLYTOPE.mean(axis=0), (), POLYTOPE)
    assert polytope is not None
    cuboids = FreeSpace([[0.1, 0.3, 0.3], CUBOID[0]], [[0.3, 0.5, 0.4], CUBOID[1]])
    q = np.array(arm.start)
    poses = [Pose.from_matrix(T) for T in arm.robot.link_transforms(q)]
    links = zip(poses, robot_pieces(scene.model, arm), strict=True)
    beside_the_hand = poses[-1].rotation.T @ BESIDE_THE_HAND
    return Decomposition(
        "cell",
        arm.name,
        arm.robot,
        q,
        tuple(move_piece(piece, pose) for pose, link in links for piece in link),
        scene_obstacles(scene, arm.name),
        SphereCover(
            np.array([0, dof, dof]),
            np.array([np.zeros(3), np.zeros(3), beside_the_hand]),
            np.array([0.3, 0.1, 0.08]),
            "outer",
        ),
        SphereCover(np.array([0, 0]), np.array([[0.3, 0.7, 0.0], [0.7, 0.1, -0.2]]), np.array([0.18, 0.1])),
        replace(cuboids, polytopes=(polytope,)),
        METRICS,
    )


def drawn(figure: Figure) -> Array:
    """The figure's pixels (h, w, 3) in [0, 1], the first row at its bottom, as matplotlib counts them."""
    figure.set_dpi(60)
    figure.canvas.draw()
    return np.asarray(figure.canvas.buffer_rgba(), dtype=float)[::-1, :, :3] / 255.0


def colour(picture: Array, axes: Axes, place: Array) -> Array:
    """The colour (3,) at a place (2,) of a panel."""
    column, row = axes.transData.transform(place).astype(int)
    return picture[row, column]


def places(picture: Array, axes: Axes) -> Array:
    """Where in a panel each pixel is (h, w, 2)."""
    row, column = np.mgrid[: picture.shape[0], : picture.shape[1]] + 0.5
    pixels = np.stack([column, row], axis=-1).reshape(-1, 2)
    return axes.transData.inverted().transform(pixels).reshape(*row.shape, 2)


def disc(centre: Array, radius: float) -> Silhouette:
    return lambda place, plane: np.linalg.norm(place - centre[plane], axis=-1) < radius


def box(corners: Array) -> Silhouette:
    low, high = corners
    return lambda place, plane: np.all((place > low[plane]) & (place < high[plane]), axis=-1)


@pytest.fixture(scope="module")
def figure(parts: Decomposition) -> Figure:
    return decomposition_figure(parts)


@pytest.fixture(scope="module")
def picture(figure: Figure) -> Array:
    return drawn(figure)


def test_panels_are_named_after_what_they_show_and_the_title_counts_it(figure: Figure) -> None:
    titles = [axes.get_title() for axes in figure.axes]
    shown = ("Geometry", "Spheres", "Free space")
    assert titles == [f"{what}, {side}" for side in ("from the side", "from above") for what in shown]
    assert (
        "1 spheres on the arm, 1 on its base, 2 on obstacles (at most 40 mm outside)" in figure.get_suptitle()
    )
    assert "2 cuboids and 1 polytopes that hold 50.0 %" in figure.get_suptitle()


@pytest.mark.parametrize("row", [0, 1], ids=["from the side", "from above"])
def test_geometry_obstacles_are_grey_and_the_robot_is_orange(
    parts: Decomposition, figure: Figure, picture: Array, row: int
) -> None:
    axes, plane = figure.axes[3 * row], list(PLANES[row])
    left = axes.transData.inverted().transform(axes.bbox.p0 + 5.0)[0]
    for corner in ([0.7, 0.15, -0.2], [0.6, -0.1, -0.2], [0.3, 0.7, -0.1]):
        place = np.array(corner)[plane]
        sky = colour(picture, axes, np.array([left, place[1]]))
        assert sky.min() > 0.75 and np.ptp(sky) < 0.15
        assert colour(picture, axes, place) == pytest.approx(0.55 * sky + 0.45 * GREY, abs=0.01)
    links = parts.robot.link_transforms(parts.q)[1:, :3, 3]
    for place in links[:, plane]:
        red, _, blue = colour(picture, axes, place)
        assert red - blue > 0.25


def moved(cover: SphereCover, sphere: int, by: Array) -> SphereCover:
    centre = cover.centre.copy()
    centre[sphere] += by
    return replace(cover, centre=centre)


def move_a_sphere_of_the_arm(parts: Decomposition) -> tuple[Decomposition, list[Silhouette]]:
    hand = parts.robot.link_transforms(parts.q)[-1]
    centre, by = hand[:3, 3] + BESIDE_THE_HAND, np.array([0.3, -0.5, 0.0])
    new = replace(parts, robot_cover=moved(parts.robot_cover, 2, hand[:3, :3].T @ by))
    return new, [disc(centre, 0.08), disc(centre + by, 0.08)]


def move_a_sphere_of_the_table(parts: Decomposition) -> tuple[Decomposition, list[Silhouette]]:
    centre, by = parts.obstacle_cover.centre[1], np.array([-0.3, -0.3, 0.5])
    new = replace(parts, obstacle_cover=moved(parts.obstacle_cover, 1, by))
    return new, [disc(centre, 0.1), disc(centre + by, 0.1)]


def move_a_cuboid(parts: Decomposition) -> tuple[Decomposition, list[Silhouette]]:
    lower, upper, by = (
        parts.free_space.lower.copy(),
        parts.free_space.upper.copy(),
        np.array([0.25, 0.25, 0.35]),
    )
    lower[1] += by
    upper[1] += by
    new = replace(parts, free_space=replace(parts.free_space, lower=lower, upper=upper))
    return new, [box(CUBOID), box(CUBOID + by)]


def remove_the_polytope(parts: Decomposition) -> tuple[Decomposition, list[Silhouette]]:
    return replace(parts, free_space=replace(parts.free_space, polytopes=())), [box(POLYTOPE)]


@pytest.mark.parametrize(
    ("change", "column"),
    [
        (move_a_sphere_of_the_arm, 1),
        (move_a_sphere_of_the_table, 1),
        (move_a_cuboid, 2),
        (remove_the_polytope, 2),
    ],
)
def test_a_part_is_drawn_where_it_is_and_nowhere_else(
    parts: Decomposition,
    figure: Figure,
    picture: Array,
    change: Callable[[Decomposition], tuple[Decomposition, list[Silhouette]]],
    column: int,
) -> None:
    """A picture of the part elsewhere differs where it was and is: in one panel, from both sides."""
    changed, silhouettes = change(parts)
    differs = np.abs(drawn(decomposition_figure(changed)) - picture).max(axis=2) > 0.012
    expected = np.zeros_like(differs)
    for row, plane in enumerate(PLANES):
        place = places(picture, figure.axes[3 * row + column])
        for silhouette in silhouettes:
            shown = silhouette(place, list(plane))
            assert np.mean(differs[inside(shown)]) > 0.9
            expected |= shown
    assert not np.any(differs & ~around(expected, 3))


def test_outlines_of_cuboids_are_their_corners(parts: Decomposition, figure: Figure) -> None:
    for row, plane in enumerate(PLANES):
        shown = figure.axes[3 * row + 2].images[0]
        pixels, space, axes = np.asarray(shown.get_array()), parts.free_space, list(plane)
        left, right, _, top = shown.get_extent()
        size = (right - left) / pixels.shape[1]
        for number, (low, high) in enumerate(zip(space.lower, space.upper, strict=True)):
            rows, columns = np.nonzero(np.abs(pixels - COLOURS[number]).max(axis=2) < 1e-3)
            across, up = left + (columns + 0.5) * size, top - (rows + 0.5) * size
            outline = (across.min(), up.min(), across.max(), up.max())
            assert outline == pytest.approx((*low[axes], *high[axes]), abs=2 * size)
