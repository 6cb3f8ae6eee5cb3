"""The planner's view: spheres, and cuboids: those that decided in the links' colours, others faintly."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb

from tests.record.sight import Mask, around, ball_at, box_at, geoms_seen, inside
from workcell.geometry.free_space.polytopes import solid_of
from workcell.geometry.types import FreePolytope, FreeSpace, SphereCover
from workcell.ik.observing import report
from workcell.ik.problem import IKProblem
from workcell.ik.result import IKResult, Status
from workcell.model.scene import Scene
from workcell.pose import Array
from workcell.record.read.review import Review, review
from workcell.record.render.raster import Camera
from workcell.record.render.tessellate import tessellate
from workcell.record.shapes import polytope_shape
from workcell.record.show.cameras import choose_cameras
from workcell.record.show.moments import key_moments
from workcell.record.show.outline import box_edges, creases, dashes
from workcell.record.show.planner_view import has_planner_view, planner_view
from workcell.record.show.studio import Studio
from workcell.record.write.recording import Recording

TILE = (240, 180)
TIMES = np.linspace(0.0, 1.0, 41)
RADIUS = 0.1
BLUE, GREEN = (0.20, 0.60, 0.85), (0.25, 0.65, 0.35)


@pytest.fixture(autouse=True, scope="module")
def small_tiles() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("workcell.record.show.planner_view._TILE", TILE)
        patch.setattr("workcell.record.show.planner_view._VIEW", TILE)
        yield


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene.load("blocked")


@pytest.fixture(scope="module")
def motion(scene: Scene) -> Array:
    """Raw positions (41, nq): the arm turns about its base, by 1.2 rad."""
    qpos = np.tile(scene.initial_qpos(), (41, 1))
    qpos[:, scene.robot().qpos_addresses[0]] += np.linspace(-0.6, 0.6, 41)
    return qpos


@pytest.fixture(scope="module")
def balls(scene: Scene, motion: Array) -> Array:
    """Where the one sphere of the cover, around the tool, is: (41, 3)."""
    arm = scene.robot()
    return arm.robot.link_transforms(motion[:, arm.qpos_addresses])[:, arm.robot.dof, :3, 3]


@pytest.fixture(scope="module")
def space(balls: Array) -> FreeSpace:
    """Two boxes that overlap in the middle of the ball's way, and a third where it never comes."""
    low, high = balls.min(axis=0) - 0.12, balls.max(axis=0) + 0.12
    middle, axis = (low + high) / 2, int(np.ptp(balls, axis=0).argmax())
    sign = np.sign(balls[-1, axis] - balls[0, axis])
    first_high, second_low = high.copy(), low.copy()
    first_high[axis], second_low[axis] = middle[axis] + 0.13, middle[axis] - 0.13
    boxes = [(low, first_high), (second_low, high)][:: int(sign)]
    aside = (low - (0.0, 0.0, 0.35), high - (0.0, 0.0, 0.45))
    return FreeSpace(*(np.array(corners) for corners in zip(*boxes, aside, strict=True)))


def recorded(path: Path, scene: Scene, motion: Array, space: FreeSpace, planner: str) -> Review:
    """Waypoints every fifth frame; ikspark has the ball in the first box in one half of them, then in the second."""
    arm = scene.robot()
    cover = SphereCover(np.array([arm.robot.dof]), np.zeros((1, 3)), np.array([RADIUS]))
    with Recording(path, task="swing", planner=planner, frame_rate=1000.0) as recording:
        recording.log_scene(scene)
        recording.log_free_space(space)
        recording.log_cover(arm, cover)
        with recording.queries("the swing"):
            way = motion[::5, arm.qpos_addresses]
            for k, (before, q) in enumerate(itertools.pairwise(way)):
                asked = IKProblem(arm.robot, arm.robot.fk(q), cover=cover, q_reference=before, max_step=0.3)
                home = np.array([int(k >= len(way) // 2)]) if planner == "ikspark" else None
                report(asked, IKResult(Status.SOLVED, planner, q=q, cuboids=home, free_space=space))
        recording.log_states(TIMES, motion)
    return review(path)


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory, scene: Scene, motion: Array, space: FreeSpace) -> Review:
    return recorded(tmp_path_factory.mktemp("view") / "run.rrd", scene, motion, space, "ikspark")


@pytest.fixture(scope="module")
def page(found: Review) -> Axes:
    (axes,) = planner_view(found).axes
    return axes


@pytest.fixture(scope="module")
def studio(found: Review) -> Studio:
    return Studio(found.stage, choose_cameras(found.stage, *TILE)[0])


def edge_points(low: Array, high: Array) -> Array:
    """Points (k, 3) along the twelve edges of a box."""
    share = np.linspace(0.0, 1.0, 200)[:, None]
    corners = [np.where(side, high, low) for side in itertools.product((False, True), repeat=3)]
    pairs = [(a, b) for a, b in itertools.combinations(corners, 2) if np.sum(a != b) == 1]
    return np.concatenate([a + share * (b - a) for a, b in pairs])


def test_a_moment_a_tile_with_the_links_that_are_in_cuboids_below(
    found: Review, page: Axes, scene: Scene
) -> None:
    assert has_planner_view(found)
    moments = key_moments(found, 4)
    assert len(page.images) == len(moments) == 4
    words = [text.get_text() for text in page.texts]
    hand = scene.robot().robot.link_names[-1]
    captions = [line for line in words if line.startswith("in cuboid")]
    assert captions[0] == f"in cuboid 0: {hand}" and captions[-1] == f"in cuboid 1: {hand}"
    assert len(captions) == 4
    assert any("colours: cuboids that the planner, ikspark, had the links in" in line for line in words)
    (legend,) = (text for text in page.texts if text.get_text() == hand)
    assert to_rgb(legend.get_color()) == pytest.approx(found.stage.uses[0].rgb)
    for moment in moments:
        assert any(line.startswith(f"{moment.time:.2f} s") for line in words)


def mask_of(studio: Studio, space: FreeSpace) -> list[Mask]:
    """For each cuboid the pixels (h, w) that its edges go through."""
    masks = []
    for low, high in zip(space.lower, space.upper, strict=True):
        mask = np.zeros((studio.height, studio.width), dtype=bool)
        column, row = np.array([studio.place(point) for point in edge_points(low, high)]).T
        seen = (column > 0) & (column < studio.width) & (row > 0) & (row < studio.height)
        mask[row[seen].astype(int), column[seen].astype(int)] = True
        masks.append(mask)
    return masks


def test_spheres_are_drawn_in_blue_where_they_are_and_nowhere_else(
    found: Review, page: Axes, studio: Studio, scene: Scene, motion: Array, balls: Array, space: FreeSpace
) -> None:
    camera = Camera(studio.camera.position, studio.camera.target, *TILE, studio.camera.fov_deg)
    lines = around(np.any(mask_of(studio, space), axis=0), 2)
    data = mujoco.MjData(scene.model)
    for moment, tile in zip(key_moments(found, 4), page.images, strict=True):
        row = int(np.searchsorted(TIMES, moment.time + 1e-9)) - 1
        data.qpos[:] = motion[row]
        mujoco.mj_forward(scene.model, data)
        ball, hidden = ball_at(camera, balls[row], RADIUS), geoms_seen(scene.model, data, camera)[1]
        picture, bare = np.asarray(tile.get_array()), studio.picture(moment.time)
        changed = np.abs(picture - bare).max(axis=2) > 1e-6
        seen = inside(ball < hidden) & ~lines
        assert seen.sum() > 200
        nearer = np.linalg.norm(bare - BLUE, axis=2) - np.linalg.norm(picture - BLUE, axis=2)
        assert np.mean(nearer[seen] > 0.05) > 0.95
        assert not np.any(changed & ~around(ball < hidden) & ~lines)


def test_the_cuboids_in_use_are_drawn_stronger_than_the_others(
    found: Review, page: Axes, studio: Studio, space: FreeSpace
) -> None:
    """In the link's colour, with a badge, and nothing shines through; the others in thin green."""
    masks, mine = mask_of(studio, space), found.stage.uses[0].rgb
    for k, used in ((0, 0), (3, 1)):
        time, tile = key_moments(found, 4)[k].time, page.images[k]
        left, right, bottom, top = tile.get_extent()
        picture, bare = np.asarray(tile.get_array()), studio.picture(time, ("spheres",))
        badges = {
            int(text.get_text())
            for text in page.texts
            if text.get_text().isdigit()
            and left < text.get_position()[0] < right
            and top < text.get_position()[1] < bottom
        }
        assert badges == {used}
        for number, mask in enumerate(masks):
            rgb = mine if number == used else GREEN
            others = around(np.any([m for n, m in enumerate(masks) if n != number], axis=0), 3)
            alone = mask & ~others
            assert alone.sum() > 40
            gap = np.linalg.norm(bare - rgb, axis=2)[alone]
            left_over = np.linalg.norm(picture - rgb, axis=2)[alone] / gap
            assert np.mean(left_over < 0.95) > 0.8
            strong = float(np.mean(left_over < 0.05))
            assert strong > 0.7 if number == used else strong < 0.1


def test_where_no_cuboid_decided_all_are_thin_and_it_is_said(
    tmp_path: Path, scene: Scene, motion: Array, space: FreeSpace, studio: Studio
) -> None:
    seen = recorded(tmp_path / "auto.rrd", scene, motion, space, "auto")
    (page,) = planner_view(seen).axes
    words = [text.get_text() for text in page.texts]
    assert any("no cuboid decided anything; planner: auto" in line for line in words)
    assert words.count("no cuboid decided here: auto answered the swing") == len(page.images) == 4
    assert not any(line.isdigit() for line in words)
    masks, moments = mask_of(studio, space), key_moments(seen, 4)
    for moment, tile in zip(moments, page.images, strict=True):
        picture, bare = np.asarray(tile.get_array()), studio.picture(moment.time, ("spheres",))
        mask = np.any(masks, axis=0)
        left_over = np.linalg.norm(picture - GREEN, axis=2)[mask] / np.linalg.norm(bare - GREEN, axis=2)[mask]
        assert np.mean(left_over < 0.97) > 0.7 and np.mean(left_over < 0.05) < 0.1


def test_a_box_of_several_links_has_dashes_of_all_their_colours() -> None:
    edges = box_edges(np.zeros(3), np.ones(3))
    colours = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
    cut = dashes(edges, colours)
    assert [rgb for _, rgb in cut] == colours
    lengths = [np.nansum(np.linalg.norm(np.diff(line, axis=0), axis=1)) for line, _ in cut]
    assert sum(lengths) == pytest.approx(12.0) and min(lengths) > 3.5
    ((whole, _),) = dashes(edges, colours[:1])
    assert np.nansum(np.linalg.norm(np.diff(whole, axis=0), axis=1)) == pytest.approx(12.0)


def test_the_edges_of_a_solid_are_where_its_sides_meet() -> None:
    """Not the diagonals that cut its sides into triangles."""
    faces = np.concatenate([np.eye(3), -np.eye(3), [np.full(3, 3**-0.5)]])
    solid = FreePolytope(faces, np.array([1.0, 1, 1, 1, 1, 1, 1.2]), 0.0)
    edges = creases(tessellate(polytope_shape(solid, np.ones(4))))
    drawn = {tuple(np.sort(np.round(edge[[0, -1]] @ [1, 10, 100], 5))) for edge in edges}
    expected = solid_of(solid)
    ends = expected.vertices[expected.edges] @ [1, 10, 100]
    assert len(edges) == len(expected.edges) == 15
    assert drawn == {tuple(np.sort(np.round(pair, 5))) for pair in ends}


def test_without_links_the_cuboids_themselves_are_drawn_in_green(tmp_path: Path) -> None:
    low, high = np.array([0.2, -0.3, 0.1]), np.array([0.8, 0.3, 0.5])
    with Recording(tmp_path / "run.rrd", task="boxes") as recording:
        recording.log_free_space(FreeSpace(low[None], high[None]))
    found = review(tmp_path / "run.rrd")
    (page,) = planner_view(found).axes
    (tile,) = page.images
    picture = np.asarray(tile.get_array())
    camera = choose_cameras(found.stage, *TILE)[0]
    bare, box = Studio(found.stage, camera).picture(0.0), box_at(camera, low, high)
    green = (bare - picture)[..., [0, 2]].min(axis=2) - (bare - picture)[..., 1]
    assert 500 < box.sum() < 0.9 * box.size
    assert green[inside(box)].min() > 0.01
    assert not np.any(np.abs(bare - picture).max(axis=2)[~around(box)] > 1e-6)


def test_a_recording_without_spheres_and_cuboids_has_no_planner_view(toy_file: Path) -> None:
    assert not has_planner_view(review(toy_file))
