"""The HTML page of a review: whole, self-contained, harmless, and drawn by a browser where one is installed."""

from __future__ import annotations

import base64
import io
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import mujoco
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

from tests.record.conftest import RESULT, record_toy, toy_seen
from tests.record.sight import coloured
from workcell.errors import OutputError
from workcell.pose import Array
from workcell.record.read.review import review
from workcell.record.show.cameras import choose_cameras
from workcell.record.show.page import page, write_page

FRAME = (320, 240)
"""Pixels of the film's frames in these tests."""


class _Balance(HTMLParser):
    """Counts tags that are opened and closed, and gathers references to other files."""

    EMPTY = ("meta", "img", "br", "input")

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.references: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in self.EMPTY:
            self.open.append(tag)
        self.references += [value for name, value in attrs if name in ("src", "href") and value]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from tests.record.conftest import TOY

    folder = tmp_path_factory.mktemp("page")
    model = mujoco.MjModel.from_xml_string(TOY)
    odd = RESULT | {"note": "<script>alert('no')</script>"}
    found = review(record_toy(folder / "toy.rrd", model, odd))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("workcell.record.show.pictures._TILE", (200, 150))
        patch.setattr("workcell.record.show.page._FRAME", FRAME)
        return write_page(found, folder / "toy.html")


def test_the_page_is_one_file_with_everything_in_it(written: Path) -> None:
    text, parser = written.read_text(), _Balance()
    parser.feed(text)
    assert parser.open == []
    assert parser.references
    assert all(reference.startswith("data:image/") for reference in parser.references)
    assert "http" not in text
    for word in (
        "toy: achieved",
        "the box is held",
        "clearance mm",
        "smallest clearance",
        "metrics/clearance",
    ):
        assert word in text


def picture_in(uri: str) -> Array:
    """The picture (h, w, 3) in [0, 1] that a page holds."""
    data = re.fullmatch(r"data:image/(?:png|jpeg);base64,(.*)", uri)[1]
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB"), dtype=float) / 255.0


def test_the_film_shows_arm_and_box_at_each_time(written: Path, toy: mujoco.MjModel) -> None:
    script = re.search(r'id="film">(.*?)</script>', written.read_text(), re.DOTALL)
    assert script is not None
    film = json.loads(script[1])
    assert len(film["times"]) == len(film["frames"]) >= 24
    assert film["times"][0] == 0.0
    assert film["times"][-1] == pytest.approx(2.0)
    camera = choose_cameras(review(written.with_suffix(".rrd")).stage, *FRAME)[0]
    for k in (0, len(film["times"]) // 2, -1):
        picture, seen = picture_in(film["frames"][k]), toy_seen(toy, camera, film["times"][k], edge=5)
        assert picture.shape == (*FRAME[::-1], 3) and {"upper", "box"} <= set(seen)
        for name in ("upper", "box"):
            its_colour = coloured(picture, toy.geom(name).rgba, within=0.06)
            for other, pixels in seen.items():
                share = its_colour[pixels].mean()
                assert share > 0.99 if other == name else share < 0.002, (name, other, k)


def test_the_page_has_the_pictures_and_the_plots(written: Path, toy: mujoco.MjModel) -> None:
    found = dict(re.findall(r'<img alt="([^"]*)" src="([^"]*)">', written.read_text()))
    assert list(found) == ["key moments, each from two sides", "metrics over time"]
    sheet, plots = (picture_in(uri) for uri in found.values())
    assert np.allclose(sheet[20, -20], to_rgb("#2e7d32"), atol=0.01)  # the green of a verdict `achieved`
    for name in ("upper", "box"):
        assert coloured(sheet, toy.geom(name).rgba).sum() > 5_000
    curve = np.abs(plots - to_rgb("#1f6fb4")).max(axis=2) < 0.05
    assert curve[: len(plots) // 2].sum() > 500 and curve[len(plots) // 2 :].sum() > 500


def test_text_of_the_run_is_not_taken_for_html(written: Path) -> None:
    text = written.read_text()
    assert "<script>alert" not in text
    assert "&lt;script&gt;alert" in text


def test_a_recording_without_geometry_still_makes_a_page(tmp_path: Path) -> None:
    from workcell.record.write.recording import Recording

    with Recording(tmp_path / "empty.rrd", task="empty", seed=0) as recording:
        recording.event(0.0, "nothing to see")
    text = page(review(tmp_path / "empty.rrd"))
    assert "missing: no poses" in text
    assert 'id="film"' not in text


def test_a_place_that_cannot_be_written_is_named(written: Path, toy_file: Path) -> None:
    with pytest.raises(OutputError, match="can't be written"):
        write_page(review(toy_file), written / "below_a_file.html")


def test_a_browser_draws_the_page(written: Path, tmp_path: Path) -> None:
    browser = shutil.which("chromium") or shutil.which("chromium-browser")
    if browser is None:
        pytest.skip("Chromium is not installed")
    shot = tmp_path / "shot.png"
    command = [
        browser,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        f"--user-data-dir={tmp_path / 'profile'}",
    ]
    command += [f"--screenshot={shot}", "--window-size=1300,900", written.as_uri()]
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    picture = np.asarray(Image.open(shot).convert("RGB"), dtype=float)
    assert np.allclose(picture[20, 1000], (46, 125, 50), atol=2)  # the green of a verdict `achieved`
    film = picture[120:560, 40:640]
    assert film.std() > 10  # the script has put a frame there
