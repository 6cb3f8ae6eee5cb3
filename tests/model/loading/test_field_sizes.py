"""Height fields too large are refused by name, wherever their size stands, before memory is taken for them."""

import os
import resource
import struct

import pytest

from workcell.errors import ModelError
from workcell.model.loading.field_sizes import check_field_sizes
from workcell.model.scene import Scene

CELL = """
<mujoco><compiler meshdir="{folder}"/><asset><hfield name="hill" {what} size="1 1 0.2 0.1"/></asset>
<worldbody><geom type="hfield" hfield="hill"/></worldbody></mujoco>
"""


def png(columns, rows):
    return b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sII", 13, b"IHDR", columns, rows) + b"\x08\x00\x00\x00\x00"


@pytest.mark.parametrize("folder", ["", "fields"])
@pytest.mark.parametrize(
    ("what", "file"),
    [
        ('nrow="10000" ncol="10000"', None),
        ('file="hill.png"', png(12000, 9000)),
        ('file="hill.bin" content_type="image/vnd.mujoco.hfield"', struct.pack("<ii", 9000, 12000)),
    ],
)
def test_a_field_of_a_hundred_million_points_is_refused_and_takes_no_memory(tmp_path, what, file, folder):
    (tmp_path / "cell.xml").write_text(CELL.format(what=what, folder=folder))
    if file is not None:
        (tmp_path / folder).mkdir(exist_ok=True)
        place = tmp_path / folder / what.split('"')[1]
        place.write_bytes(file)
        if place.suffix == ".bin":  # zeros that take no room
            os.truncate(place, 8 + 4 * 9000 * 12000)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(ModelError, match=r"height field 'hill' has \d+ x \d+ points.*1,000,000"):
        Scene.load(tmp_path / "cell.xml")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # kilobytes


@pytest.mark.parametrize("head", [b"", b"short", png(0, 5), b"\xff" * 24])
def test_a_head_that_says_nothing_is_left_to_mujoco(tmp_path, head):
    (tmp_path / "cell.xml").write_text(CELL.format(what='file="hill.png"', folder=""))
    (tmp_path / "hill.png").write_bytes(head)
    with pytest.raises(ModelError, match="MuJoCo can't"):
        Scene.load(tmp_path / "cell.xml")


def test_a_field_of_usual_size_is_none_of_it(tmp_path):
    import mujoco

    spec = mujoco.MjSpec.from_string(CELL.format(what='nrow="100" ncol="100"', folder=""))
    check_field_sizes(spec, tmp_path / "cell.xml")
    assert spec.compile().nhfield == 1
