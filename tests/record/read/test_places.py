"""Which ways the robots were on: shares of the time, and documents that make no sense."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from workcell.record.read.places import Places, robot_places, shares_of_ways
from workcell.record.read.reader import read
from workcell.record.write.rrd import RrdWriter, entity


def test_a_way_counts_while_some_robot_is_on_it() -> None:
    left = Places("left", np.array([0.0, 2.0, 6.0]), ("in", "carry", None), ("ikspark", "ikspark", ""))
    right = Places("right", np.array([1.0, 2.0, 7.0]), (None, "carry", None), ("", "ikspark", ""))
    shares = shares_of_ways([left, right], 10.0)
    assert shares == pytest.approx({"in": 0.2, "carry": 0.5, None: 0.3})
    assert shares_of_ways([left], 10.0) == pytest.approx({"in": 0.2, "carry": 0.4, None: 0.4})
    assert shares_of_ways([right], 10.0)[None] == pytest.approx(0.5), "before its first place it is on none"
    assert shares_of_ways([], 10.0) == shares_of_ways([left], 0.0) == {}


@pytest.mark.parametrize(
    "text", ["no JSON", "[]", "7", json.dumps({"what": 3, "by": "x"}), json.dumps({"what": "w"})]
)
def test_documents_that_make_no_sense_name_no_way(tmp_path: Path, text: str) -> None:
    writer, index = RrdWriter(tmp_path / "odd.rrd"), np.arange(2)
    texts = [text, json.dumps({"what": "way in", "by": "ikspark"})]
    writer.send_documents(f"ways/{entity('an arm/1')}", (index.astype(float), index), texts)
    writer.finish(tmp_path / "odd.rrd")
    (found,) = robot_places(read(tmp_path / "odd.rrd"))
    assert found.robot == "an arm/1"
    assert (found.ways, found.by) == ((None, "way in"), ("", "ikspark"))
