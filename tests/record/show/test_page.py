"""The HTML page of a review: whole, self-contained, harmless, and drawn by a browser where one is installed."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image

from tests.record.conftest import RESULT, record_toy
from workcell.errors import OutputError
from workcell.record.read.review import review
from workcell.record.show.page import page, write_page


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
    return write_page(review(record_toy(folder / "toy.rrd", model, odd)), folder / "toy.html")


def test_the_page_is_one_file_with_everything_in_it(written: Path) -> None:
    text, parser = written.read_text(), _Balance()
    parser.feed(text)
    assert parser.open == []
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


def test_the_film_has_a_picture_for_each_time_and_they_differ(written: Path, tmp_path: Path) -> None:
    script = re.search(r'id="film">(.*?)</script>', written.read_text(), re.DOTALL)
    assert script is not None
    film = json.loads(script[1])
    assert len(film["times"]) == len(film["frames"]) >= 24
    assert film["times"][0] == 0.0
    assert film["times"][-1] == pytest.approx(2.0)
    pictures = []
    for name, frame in (("first", film["frames"][0]), ("last", film["frames"][-1])):
        (tmp_path / name).write_bytes(base64.b64decode(frame.removeprefix("data:image/jpeg;base64,")))
        pictures.append(np.asarray(Image.open(tmp_path / name), dtype=float))
    assert pictures[0].shape == (480, 640, 3)
    assert np.abs(pictures[0] - pictures[1]).max() > 50


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
