"""Pictures of recordings: they are written, and the cameras see the work."""

from __future__ import annotations

from pathlib import Path

import matplotlib.image
import mujoco
import numpy as np
import pytest

from tests.record.conftest import record_toy
from workcell.errors import OutputError
from workcell.record.read.reader import read
from workcell.record.read.review import review
from workcell.record.read.stage import Stage
from workcell.record.render.raster import rasterise
from workcell.record.show.cameras import choose_cameras
from workcell.record.show.pictures import Studio, write_pictures
from workcell.record.write.recording import Recording

WALLED = """
<mujoco><worldbody>
  <body name="wall" pos="0 -0.5 0.5"><geom type="box" size="1.5 0.02 1.5"/></body>
  <body name="left" pos="-1 0.5 0.5"><geom type="box" size="0.02 1.5 1.5"/></body>
  <body name="ball" pos="0 0 0.5"><freejoint/><geom type="sphere" size="0.08" rgba="0 1 0 1"/></body>
</worldbody></mujoco>
"""


@pytest.fixture(autouse=True)
def small_tiles(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("workcell.record.show.pictures._TILE", (200, 150))


def test_pictures_are_written(tmp_path: Path, toy: mujoco.MjModel) -> None:
    paths = write_pictures(review(record_toy(tmp_path / "toy.rrd", toy)), tmp_path / "png")
    assert [path.name for path in paths] == ["contact_sheet.png", "plots.png"]
    sheet = matplotlib.image.imread(paths[0])
    assert sheet.shape[0] > 600
    assert sheet.shape[1] > 600
    assert sheet.std() > 0.1


def test_pictures_of_a_recording_without_anything_to_see(tmp_path: Path) -> None:
    with Recording(tmp_path / "empty.rrd", task="empty") as recording:
        recording.event(0.0, "nothing happened")
    assert len(write_pictures(review(tmp_path / "empty.rrd"), tmp_path)) == 2


def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    with Recording(tmp_path / "empty.rrd", task="empty") as recording:
        recording.event(0.0, "nothing happened")
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OutputError):
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


def test_a_thing_that_moves_is_drawn_where_it_is(tmp_path: Path, toy: mujoco.MjModel) -> None:
    stage = Stage.of(read(record_toy(tmp_path / "toy.rrd", toy)))
    studio = Studio(stage, choose_cameras(stage, 200, 150)[0])
    first, last = studio.picture(0.0), studio.picture(2.0)
    assert first.shape == (150, 200, 3)
    place = studio.place(stage.pose("world/objects/box/visual/box", 2.0).position).astype(int)
    assert last[place[1], place[0], 2] > last[place[1], place[0], 0]
    assert np.abs(first - last).max() > 0.2
