"""The rasteriser against closed forms and a brute-force oracle."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from workcell.pose import Pose
from workcell.record.render.raster import Camera, Surface, rasterise
from workcell.record.render.shade import Light, Line, blend, draw_line, halve, shade
from workcell.record.render.tessellate import Triangles, balls, tessellate
from workcell.record.shapes import Shape

WHITE = np.ones(4)
LEVEL = Camera(np.array([-4.0, 0.0, 0.0]), np.zeros(3), 200, 160, fov_deg=40.0)


def surface(
    kind: str, size: list[float], position: list[float], ident: int = 0, rgba: np.ndarray = WHITE
) -> Surface:
    shape = Shape("", kind, np.array(size), Pose.from_xyz(position), rgba)  # type: ignore[arg-type]
    return Surface(tessellate(shape), rgba, ident)


@pytest.mark.parametrize(
    ("kind", "size", "volume"),
    [
        ("box", [0.3, 0.2, 0.1], 8 * 0.3 * 0.2 * 0.1),
        ("ellipsoid", [0.3, 0.2, 0.1], 4 / 3 * np.pi * 0.3 * 0.2 * 0.1),
        ("cylinder", [0.2, 0.5, 0.0], np.pi * 0.2**2 * 1.0),
        ("capsule", [0.2, 0.5, 0.0], np.pi * 0.2**2 * 1.0 + 4 / 3 * np.pi * 0.2**3),
    ],
)
def test_tessellated_solids_are_closed_and_face_outwards(kind: str, size: list[float], volume: float) -> None:
    mesh = surface(kind, size, [0.4, -0.1, 0.2]).triangles
    corners = mesh.vertices[mesh.faces]
    signed = np.einsum("ti,ti->t", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0
    assert signed == pytest.approx(volume, rel=0.02)
    vector_area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).sum(axis=0)
    assert vector_area == pytest.approx(np.zeros(3), abs=1e-9)
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.all(np.einsum("ti,ti->t", flat, mesh.normals[mesh.faces].mean(axis=1)) > 0)
    assert np.linalg.norm(mesh.normals, axis=1) == pytest.approx(1.0)


def test_a_sphere_is_a_disc_of_the_right_size_in_the_right_place() -> None:
    buffers = rasterise([surface("ellipsoid", [0.5] * 3, [0, 0, 0])], LEVEL)
    focal = 80 / np.tan(np.radians(20.0))
    radius = focal * np.tan(np.arcsin(0.5 / 4.0))
    rows, columns = np.nonzero(buffers.ident >= 0)
    assert len(rows) == pytest.approx(np.pi * radius**2, rel=0.02)
    assert (columns + 0.5).mean() == pytest.approx(100, abs=0.3)
    assert (rows + 0.5).mean() == pytest.approx(80, abs=0.3)
    assert 1.0 / buffers.nearness.max() == pytest.approx(3.5, abs=0.01)


def test_right_is_right_and_up_is_up() -> None:
    """A camera that looks along +x has -y on its right."""
    right = rasterise([surface("ellipsoid", [0.1] * 3, [0, -0.5, 0])], LEVEL)
    above = rasterise([surface("ellipsoid", [0.1] * 3, [0, 0, 0.5])], LEVEL)
    assert np.nonzero(right.ident >= 0)[1].min() > 100
    assert np.nonzero(above.ident >= 0)[0].max() < 80


def test_the_nearer_thing_hides_the_farther_in_any_order() -> None:
    near, far = surface("box", [0.1] * 3, [-1, 0, 0], 1), surface("box", [0.4] * 3, [1, 0, 0], 2)
    for order in ([near, far], [far, near]):
        buffers = rasterise(order, LEVEL)
        assert buffers.ident[80, 100] == 1
        assert set(np.unique(buffers.ident)) == {-1, 1, 2}
    continued = rasterise([near], LEVEL, onto=rasterise([far], LEVEL))
    assert np.array_equal(continued.ident, rasterise([near, far], LEVEL).ident)


def test_a_floor_that_runs_under_the_camera_is_clipped() -> None:
    camera = Camera(np.array([0.0, 0.0, 1.0]), np.array([3.0, 0.0, 1.0]), 120, 90, fov_deg=50.0)
    buffers = rasterise([surface("plane", [50.0, 50.0, 0.0], [0, 0, 0])], camera)
    assert np.all(buffers.ident[:44] == -1)
    assert np.all(buffers.ident[50:] == 0)
    points = buffers.points(camera)
    assert np.abs(points[:, 2]).max() < 1e-6
    assert np.all(points[:, 0] > 0)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_random_triangles_against_ray_casting(seed: int) -> None:
    """Every pixel's nearest triangle by Moeller and Trumbore's intersection of its ray with each triangle."""
    rng = np.random.default_rng(seed)
    camera = Camera(np.array([-3.0, 0.2, 0.1]), np.zeros(3), 24, 20, fov_deg=45.0)
    corners = rng.uniform(-1.3, 1.3, size=(6, 3, 3))
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    away = np.einsum("ti,ti->t", facing, corners[:, 0] - camera.position) > 0
    corners[away] = corners[away][:, ::-1]
    surfaces = [
        Surface(Triangles(c, np.tile([1.0, 0, 0], (3, 1)), np.array([[0, 1, 2]])), WHITE, k)
        for k, c in enumerate(corners)
    ]
    buffers = rasterise(surfaces, camera)
    scale = 2 * np.tan(np.radians(45.0) / 2) / camera.height
    column, row = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    view = np.stack([(column + 0.5 - 12) * scale, (10 - row - 0.5) * scale, np.ones(row.shape)], axis=-1)
    depth, hit = _cast(camera.position, view @ camera.axes, corners)
    same = buffers.ident == hit
    assert np.sum(~same) <= 2  # centres on an edge
    covered = same & (hit >= 0)
    assert 1.0 / buffers.nearness[covered] == pytest.approx(depth[covered], rel=1e-6)


def _cast(origin: np.ndarray, directions: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    best, hit = np.full(directions.shape[:2], np.inf), np.full(directions.shape[:2], -1)
    for k, (a, b, c) in enumerate(corners):
        h, s = np.cross(directions, c - a), origin - a
        q, det = np.cross(s, b - a), h @ (b - a)
        with np.errstate(divide="ignore", invalid="ignore"):
            u, v, t = (h @ s) / det, (directions @ q) / det, ((c - a) @ q) / det
        inside = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & (t < best)
        best[inside], hit[inside] = t[inside], k
    return best, hit


def test_points_are_where_the_camera_sees_them() -> None:
    for camera in (LEVEL, Camera(np.array([1.0, -3.0, 2.0]), np.zeros(3), 80, 80, extent=2.5)):
        buffers = rasterise([surface("ellipsoid", [0.5, 0.4, 0.3], [0, 0, 0])], camera)
        points = buffers.points(camera)
        assert np.sum((points / [0.5, 0.4, 0.3]) ** 2, axis=1) == pytest.approx(1.0, abs=0.03)
        rows, columns = np.nonzero(buffers.ident >= 0)
        assert camera.project(points)[:, :2] == pytest.approx(
            np.stack([columns + 0.5, rows + 0.5], axis=1), abs=1e-6
        )


def test_a_ball_throws_its_shadow_on_the_floor() -> None:
    floor, ball = surface("plane", [3, 3, 0], [0, 0, 0]), surface("ellipsoid", [0.3] * 3, [0, 0, 0.6], 1)
    light = Light.over(np.zeros(3), 3.0, [floor, ball])
    direction = light.camera.position / np.linalg.norm(light.camera.position)
    shadow = -direction * 0.6 / direction[2] + [0, 0, 0.6]
    up = np.array([[0.0, 0.0, 1.0]])
    assert light.lit(shadow[None], up)[0] == 0.0
    assert light.lit(np.array([[1.5, 1.5, 0.0]]), up)[0] == 1.0


def test_pictures_have_colours_in_range_and_outlines_darken() -> None:
    buffers = rasterise([surface("box", [0.4] * 3, [0, 0, 0], rgba=np.array([1.0, 0, 0, 1]))], LEVEL)
    picture = shade(buffers, LEVEL)
    assert picture.shape == (160, 200, 3)
    assert picture.min() >= 0.0
    assert picture.max() <= 1.0
    assert picture[80, 100, 0] > 3 * picture[80, 100, 1]
    edge = np.nonzero(buffers.ident[80] >= 0)[0][0] - 1
    assert picture[80, edge].sum() < picture[80, edge - 5].sum()
    assert halve(picture).shape == (80, 100, 3)


def test_lines_shine_through_faintly_where_hidden() -> None:
    wall = surface("box", [0.05, 2, 2], [0, 0, 0])
    buffers = rasterise([wall], LEVEL)
    picture = np.zeros((160, 200, 3))
    for x, strength in ((-1.0, 1.0), (1.0, 0.3)):
        line = Line(np.array([[x, -0.5, 0.0], [x, 0.5, 0.0]]), (1.0, 0.0, 0.0))
        drawn = draw_line(picture, buffers, LEVEL, line)
        assert drawn[80, 100, 0] == pytest.approx(strength)
        assert drawn[20, 100, 0] == 0.0
    behind = Line(np.array([[-6.0, 0, 0], [-7.0, 0, 0]]), (1.0, 0.0, 0.0))
    assert np.array_equal(draw_line(picture, buffers, LEVEL, behind), picture)


def test_translucent_things_let_through_what_is_behind_and_are_hidden_by_what_is_before() -> None:
    wall = rasterise([surface("box", [0.05, 2, 2], [0, 0, 0])], LEVEL)
    picture = np.full((160, 200, 3), 0.5)
    blue = np.array([0.0, 0.0, 1.0, 0.3])
    before = blend(picture, wall, LEVEL, [surface("ellipsoid", [0.3] * 3, [-1, 0, 0], rgba=blue)])
    hidden = blend(picture, wall, LEVEL, [surface("ellipsoid", [0.3] * 3, [1, 0, 0], rgba=blue)])
    assert before[80, 100, 2] > before[80, 100, 0] > 0.1
    assert np.array_equal(hidden, picture)


def test_balls_are_closed_face_outwards_and_touch_their_spheres_from_inside() -> None:
    centres, radii = np.array([[0.0, 0.1, 0.2], [2.0, 0.0, 0.0]]), np.array([0.5, 0.2])
    mesh = balls(centres, radii)
    owner = np.repeat([0, 1], len(mesh.vertices) // 2)
    assert np.linalg.norm(mesh.vertices - centres[owner], axis=1) == pytest.approx(radii[owner])
    assert mesh.normals == pytest.approx((mesh.vertices - centres[owner]) / radii[owner, None])
    corners = mesh.vertices[mesh.faces]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.all(np.einsum("ti,ti->t", flat, mesh.normals[mesh.faces].mean(axis=1)) > 0)
    assert flat.sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)
    volume = np.einsum("ti,ti->t", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0
    assert volume == pytest.approx(4 / 3 * np.pi * (radii**3).sum(), rel=0.1)


@pytest.mark.parametrize("extent", [None, 3.0])
@pytest.mark.parametrize(("x", "strength"), [(-0.5, 1.0), (-0.49, 1.0), (0.5, 0.3)])
def test_lines_on_a_surface_are_seen_and_those_behind_it_shine_through(
    extent: float | None, x: float, strength: float
) -> None:
    camera = Camera(np.array([-4.0, 0.0, 0.0]), np.zeros(3), 200, 160, extent=extent)
    buffers = rasterise([surface("box", [0.5, 1.0, 1.0], [0, 0, 0])], camera)
    black = np.zeros((160, 200, 3))
    line = Line(np.array([[x, -0.3, 0.0], [x, 0.3, 0.0]]), (1.0, 1.0, 1.0), 1.0, 0.3)
    assert draw_line(black, buffers, camera, line)[80, 100] == pytest.approx(strength)
