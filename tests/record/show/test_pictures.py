"""Pictures of recordings: everything is drawn where MuJoCo's rays meet it, and the cameras see the work."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import matplotlib.colors
import matplotlib.image
import mujoco
import numpy as np
import pytest
from matplotlib.axes import Axes

from tests.record.conftest import TOY, record_toy, toy_seen
from tests.record.sight import around, coloured
from workcell.errors import OutputError
from workcell.pose import Array
from workcell.record.read.reader import read
from workcell.record.read.review import Review, review
from workcell.record.read.stage import PLAN_RGB, TRACE_RGB, Stage
from workcell.record.render.raster import Camera, rasterise
from workcell.record.show.cameras import choose_cameras
from workcell.record.show.moments import key_moments
from workcell.record.show.pictures import contact_sheet, write_pictures
from workcell.record.show.plots import plot_metrics
from workcell.record.show.studio import Studio
from workcell.record.write.recording import Recording

WALLED = """
<mujoco><worldbody>
  <body name="wall" pos="0 -0.5 0.5"><geom type="box" size="1.5 0.02 1.5"/></body>
  <body name="left" pos="-1 0.5 0.5"><geom type="box" size="0.02 1.5 1.5"/></body>
  <body name="ball" pos="0 0 0.5"><freejoint/><geom type="sphere" size="0.08" rgba="0 1 0 1"/></body>
</worldbody></mujoco>
"""


TILE = (200, 150)


@pytest.fixture(autouse=True, scope="module")
def small_tiles() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("workcell.record.show.pictures._TILE", TILE)
        patch.setattr("workcell.record.show.pictures._ALONE", TILE)
        yield


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Review:
    """What the toy's recording shows."""
    path = tmp_path_factory.mktemp("toy") / "toy.rrd"
    return review(record_toy(path, mujoco.MjModel.from_xml_string(TOY)))


@pytest.fixture(scope="module")
def cameras(found: Review) -> tuple[Camera, Camera]:
    return choose_cameras(found.stage, *TILE)


@pytest.fixture(scope="module")
def sheet(found: Review) -> Axes:
    """The contact sheet of it, with all its tiles and words."""
    (page,) = contact_sheet(found).axes
    return page


def assert_shows(picture: Array, toy: mujoco.MjModel, camera: Camera, time: float) -> set[str]:
    """Every pixel has the colour of the thing it looks at, and of no other; the names of the things in sight."""
    seen = toy_seen(toy, camera, time)
    for name in ("floor", "upper", "box", "wedge"):
        its_colour = coloured(picture, toy.geom(name).rgba)
        for other, pixels in seen.items():
            assert np.all(its_colour[pixels] == (other == name)), (name, other, time)
    return set(seen)


def test_pictures_are_written(tmp_path: Path, found: Review, sheet: Axes) -> None:
    """The contact sheet's file holds its tiles, pixel by pixel; the plots' file has ink in every panel."""
    paths = write_pictures(found, tmp_path / "png")
    assert [path.name for path in paths] == ["contact_sheet.png", "plots.png"]
    written = matplotlib.image.imread(paths[0])[..., :3]
    for tile in sheet.images:
        left, right, bottom, top = (int(edge) for edge in tile.get_extent())
        same = np.abs(written[top:bottom, left:right] - tile.get_array()).max(axis=2) < 0.01
        assert same.mean() > 0.9  # all but the objects' names
    plots = matplotlib.image.imread(paths[1])[..., :3]
    blue = np.abs(plots - matplotlib.colors.to_rgb("#1f6fb4")).max(axis=2) < 0.05
    half = len(plots) // 2
    assert blue[:half].sum() > 500 and blue[half:].sum() > 500


def test_the_contact_sheet_shows_every_moment_from_two_sides(
    found: Review, cameras: tuple[Camera, Camera], sheet: Axes, toy: mujoco.MjModel
) -> None:
    moments = key_moments(found)
    assert len(sheet.images) == len(moments) * len(cameras) == 12
    words = {tuple(text.get_position()): text.get_text() for text in sheet.texts}
    labels = [note for note in sheet.texts if note.get_text() == "box"]
    corners = []
    for k, tile in enumerate(sheet.images):
        moment, camera = moments[k // 2], cameras[k % 2]
        seen = assert_shows(np.asarray(tile.get_array()), toy, camera, moment.time)
        assert seen >= ({"upper", "box"} if k % 2 == 0 else {"box"})
        left, right, bottom, top = tile.get_extent()
        corners.append((left, top))
        if k % 2 == 0:
            assert words[(left, top - 14)] == f"{moment.time:.2f} s"
            assert words[(left + 74, top - 14)] == moment.caption
        (place,) = [note.xy for note in labels if left < note.xy[0] < right and top < note.xy[1] < bottom]
        middle = np.array([[0.5, 0.3, 0.1 + 0.1 * moment.time]])
        assert np.array(place) - (left, top) == pytest.approx(camera.project(middle)[0, :2], abs=0.5)
    assert len(set(corners)) == 12


def test_pictures_of_a_recording_without_anything_to_see(tmp_path: Path) -> None:
    """Nothing but sky, lighter towards the ground, and a sentence where the curves would be."""
    with Recording(tmp_path / "empty.rrd", task="empty") as recording:
        recording.event(0.0, "nothing happened")
    found = review(tmp_path / "empty.rrd")
    assert len(write_pictures(found, tmp_path)) == 2
    tiles = contact_sheet(found).axes[0].images
    assert len(tiles) == 2
    for tile in tiles:
        picture = np.asarray(tile.get_array())
        assert np.all(picture == picture[:, :1])
        assert np.all(np.diff(picture[:, 0].sum(axis=1)) > 0) and picture.min() > 0.75
    (panel,) = plot_metrics(found).axes
    assert not panel.lines and panel.texts[0].get_text() == "no metrics in this recording"


def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    with Recording(tmp_path / "empty.rrd", task="empty") as recording:
        recording.event(0.0, "nothing happened")
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OutputError, match=r"contact_sheet\.png: the picture can't be written"):
        write_pictures(review(tmp_path / "empty.rrd"), tmp_path / "file")


def test_cameras_look_past_walls(tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_string(WALLED)
    qpos = np.tile(model.qpos0, (11, 1))
    qpos[:, 0] = np.linspace(0.0, 0.6, 11)
    with Recording(tmp_path / "walls.rrd", task="walls") as recording:
        recording.log_model(model, {3: "objects/ball"}, model.qpos0)
        recording.log_states(np.linspace(0, 1, 11), qpos)
    stage = Stage.of(read(tmp_path / "walls.rrd"))
    cameras = choose_cameras(stage, 160, 120)
    for camera in cameras:
        for time in (0.0, 1.0):
            whole = rasterise(stage.surfaces(time, ("objects",)), camera).ident >= 0
            seen = rasterise(stage.surfaces(time, ("objects", "obstacles")), camera).rgb == [0, 1, 0]
            assert whole.sum() > 5
            assert np.all(seen, axis=2).sum() >= 0.9 * whole.sum()
    directions = [camera.position - camera.target for camera in cameras]
    azimuths = [np.arctan2(d[1], d[0]) for d in directions]
    assert abs(np.angle(np.exp(1j * (azimuths[0] - azimuths[1])))) > np.radians(45)


@pytest.mark.parametrize("time", [0.0, 1.0, 2.0])
def test_a_thing_that_moves_is_drawn_where_it_is(
    found: Review, cameras: tuple[Camera, Camera], toy: mujoco.MjModel, time: float
) -> None:
    picture = Studio(found.stage, cameras[0], smooth=False).picture(time)
    assert picture.shape == (150, 200, 3)
    assert assert_shows(picture, toy, cameras[0], time) == {"sky", "floor", "upper", "box", "wedge"}


def test_a_picture_without_the_arm_differs_where_the_arm_is_and_in_its_shadow(
    found: Review, cameras: tuple[Camera, Camera], toy: mujoco.MjModel
) -> None:
    studio, seen = Studio(found.stage, cameras[0]), toy_seen(toy, cameras[0], 1.0)
    whole, without = studio.picture(1.0), studio.picture(1.0, robots=False)
    assert not coloured(without, toy.geom("upper").rgba).any()
    assert np.abs(whole - without)[seen["upper"]].max(axis=1).min() > 0.05
    apart = np.where(~around(seen["upper"], 5), (without - whole).max(axis=2), 0.0)
    assert np.all(apart > -1e-6)  # a shadow less makes nothing darker
    assert not apart[seen["sky"]].any()
    assert apart[seen["floor"]].max() > 0.05


def test_the_plan_and_what_of_it_has_been_executed_are_drawn(toy_file: Path) -> None:
    """The plan from the start; the trace only as far as the time of the picture, over the plan."""
    way = np.stack([np.full(21, 0.2), np.linspace(-0.3, 0.3, 21), np.full(21, 0.7)], axis=1)
    stage = Stage.of(read(toy_file))
    studio = Studio(stage, Camera(np.array([-1.5, 0.0, 0.8]), np.array([0.2, 0.0, 0.6]), *TILE), smooth=False)
    column, row = np.array([studio.place(point) for point in way]).astype(int).T
    bare = studio.picture(1.0)
    stage.plans["arm"] = way
    stage.traces["arm"] = (np.linspace(0.0, 2.0, 21), way)
    picture = studio.picture(1.0)
    assert np.all(np.abs(bare[row, column] - PLAN_RGB).max(axis=1) > 0.2)
    assert picture[row[:10], column[:10]] == pytest.approx(np.tile(TRACE_RGB, (10, 1)))
    assert picture[row[14:], column[14:]] == pytest.approx(np.tile(PLAN_RGB, (7, 1)))
    changed = np.abs(picture - bare).max(axis=2) > 1e-9
    drawn = np.zeros_like(changed)
    drawn[row, column] = True
    assert changed[row, column].all() and not np.any(changed & ~around(drawn, 12))
