"""The planner's view: spheres, and cuboids: those that links are in are drawn strongly, others faintly."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
import pytest
from matplotlib.axes import Axes

from tests.record.sight import Mask, around, ball_at, box_at, geoms_seen, inside
from workcell.geometry.types import FreeSpace, SphereCover
from workcell.model.scene import Scene
from workcell.pose import Array
from workcell.record.read.review import Review, review
from workcell.record.render.raster import Camera
from workcell.record.show.cameras import choose_cameras
from workcell.record.show.moments import key_moments
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


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory, scene: Scene, motion: Array, space: FreeSpace) -> Review:
    arm = scene.robot()
    path = tmp_path_factory.mktemp("view") / "run.rrd"
    cover = SphereCover(np.array([arm.robot.dof]), np.zeros((1, 3)), np.array([RADIUS]))
    with Recording(path, task="swing", frame_rate=1000.0) as recording:
        recording.log_scene(scene)
        recording.log_free_space(space)
        recording.log_cover(arm, cover)
        recording.log_states(TIMES, motion)
    return review(path)


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
    """In the colour of their number's badge, and nothing shines through; the others in thin green."""
    masks = mask_of(studio, space)
    for k, used in ((0, 0), (3, 1)):
        time, tile = key_moments(found, 4)[k].time, page.images[k]
        left, right, bottom, top = tile.get_extent()
        picture, bare = np.asarray(tile.get_array()), studio.picture(time, ("spheres",))
        badges = {
            int(text.get_text()): text.get_bbox_patch().get_facecolor()[:3]
            for text in page.texts
            if text.get_text().isdigit()
            and left < text.get_position()[0] < right
            and top < text.get_position()[1] < bottom
        }
        assert set(badges) == {used}
        for number, mask in enumerate(masks):
            rgb = badges.get(number, GREEN)
            others = around(np.any([m for n, m in enumerate(masks) if n != number], axis=0), 3)
            alone = mask & ~others
            assert alone.sum() > 40
            gap = np.linalg.norm(bare - rgb, axis=2)[alone]
            left_over = np.linalg.norm(picture - rgb, axis=2)[alone] / gap
            assert np.mean(left_over < 0.95) > 0.8
            strong = float(np.mean(left_over < 0.05))
            assert strong > 0.7 if number == used else strong < 0.1


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
