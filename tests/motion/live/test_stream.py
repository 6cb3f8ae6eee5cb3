"""Recorded streams of poses: what is a goal when, and what no stream could have said."""

import numpy as np
import pytest

from workcell.errors import InputError, UnknownNameError
from workcell.motion.live.stream import COLUMNS, GoalStream, stream_of
from workcell.motion.live.stream_file import read_stream

HEAD = ",".join(COLUMNS)
UNIT = [1.0, 0.0, 0.0, 0.0]


def written(tmp_path, text, name="trace.csv"):
    path = tmp_path / name
    path.write_text(text)
    return path


def rows(*stamps):
    """A row at each stamp, at x = 0.1, 0.2, ..."""
    return [[t, 0.1 * k, 0.0, 0.5, *UNIT] for k, t in enumerate(stamps, start=1)]


def x_at(stream, t, **options):
    goal = stream.at(t, **options).goal
    return None if goal is None else pytest.approx(goal.position[0])


def test_the_newest_goal_not_later_than_asked_with_its_stamp():
    stream = stream_of(rows(1.0, 1.03, 1.5))
    assert stream.at(0.9).goal is None and "not begun" in stream.at(0.9).reason
    assert (x_at(stream, 1.0), x_at(stream, 1.02), x_at(stream, 1.03)) == (0.1, 0.1, 0.2)
    assert stream.at(1.4).stamp == 1.03 and x_at(stream, 9.0) == 0.3
    assert (stream.begin, stream.end, stream.tools, stream.faults) == (1.0, 1.5, (), ())


def test_poses_between_rows_where_asked_but_not_across_a_gap():
    stream = stream_of(rows(1.0, 1.05, 1.5))
    assert x_at(stream, 1.025, interpolate=True) == 0.15
    assert stream.at(1.025, interpolate=True).stamp == 1.025
    assert x_at(stream, 1.3, interpolate=True) == 0.2
    assert stream.at(1.3, interpolate=True).stamp == 1.05


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({1: np.nan}, "not finite"),
        ({3: np.inf}, "not finite"),
        ({4: 0.5}, "length 0.5"),
        ({0: 0.5}, "backwards"),
        ({0: np.nan}, "time is nan"),
    ],
)
def test_what_a_live_stream_may_say_is_no_goal_until_the_next_row(changed, reason):
    values = rows(1.0, 1.1, 1.2)
    for column, value in changed.items():
        values[1][column] = value
    stream = stream_of(values)
    said = stream.at(1.15)
    assert said.goal is None and reason in said.reason
    assert x_at(stream, 1.2) == 0.3 and len(stream.faults) == 1


def test_a_clock_that_stands_brings_its_last_row():
    stream = stream_of(rows(1.0, 1.0, 1.0))
    assert x_at(stream, 1.0) == 0.3 and not stream.faults


def test_csv_with_columns_in_any_order_comments_and_a_mark(tmp_path):
    order = ["qw", "qx", "qy", "qz", "t", "x", "y", "z"]
    text = "\ufeff# made by hand\r\n" + ",".join(order) + "\r\n\r\n1,0,0,0, 0.5 ,0.4,0.1,0.2\r\n"
    stream = read_stream(written(tmp_path, text))
    assert stream.at(0.5).goal.position == pytest.approx([0.4, 0.1, 0.2])


def test_json_lines(tmp_path):
    line = '{"t": 0.5, "x": 1, "y": 2, "z": 3, "qw": 1, "qx": 0, "qy": 0, "qz": 0}\n'
    stream = read_stream(written(tmp_path, line + line.replace("0.5", "0.6").replace('"x": 1', '"x": null')))
    assert stream.at(0.5).goal.position == pytest.approx([1, 2, 3])
    assert "not finite" in stream.at(0.7).reason


def test_each_tool_has_goals_of_its_own(tmp_path):
    text = f"{HEAD},tool\n0,1,0,0,1,0,0,0,left\n0.1,2,0,0,1,0,0,0,right\n0.2,3,0,0,1,0,0,0,left\n"
    text += "1.5,4,0,0,1,0,0,0,left\n"
    stream = read_stream(written(tmp_path, text))
    assert stream.tools == ("left", "right")
    early, both, late = stream.at(0.05), stream.at(0.2), stream.at(1.5)
    assert early.goal["right"] is None and "right: the stream has not begun" in early.reason
    assert [both.goal[name].position[0] for name in ("left", "right")] == [3, 2] and both.stamp == 0.2
    assert late.goal["right"] is None and "right: nothing was said for 1.40 s" in late.reason
    stream.check_tools(["left", "right", "third"])
    with pytest.raises(UnknownNameError, match="no tool named 'right'"):
        stream.check_tools(["left"])


def test_several_arms_need_a_tool():
    stream = stream_of(rows(0.0))
    stream.check_tools(["only"])
    with pytest.raises(InputError, match="which of 2 tools"):
        stream.check_tools(["left", "right"])


def test_a_clock_may_be_set_to_zero():
    stream = stream_of(rows(1.7e9, 1.7e9 + 0.5)).from_zero()
    assert stream.begin == 0.0 and stream.at(0.5).stamp == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "holds no rows"),
        ("# nothing\n\n", "holds no rows"),
        (HEAD + "\n", "a header and no rows"),
        (HEAD.replace(",qz", "") + "\n0,0,0,0,1,0,0\n", r"trace.csv:1: lacks qz"),
        (HEAD + ",t\n0,0,0,0,1,0,0,0,0\n", r"trace.csv:1: has 't' twice"),
        (HEAD + ",tol\n0,0,0,0,1,0,0,0,a\n", r"trace.csv:1: there is no column named 'tol'"),
        (HEAD + "\n0,0,0,0,1,0,0,0\n0.1,0,0,0,1,0,0\n", r"trace.csv:3: has 7 cells, the header 8"),
        (HEAD + "\n0,0,zero,0,1,0,0,0\n", r"trace.csv:2: y: 'zero' is no number"),
        (HEAD + '\n"0,0,0,0,1,0,0,0\n', r"trace.csv:2: is no line of CSV"),
        (HEAD + ",tool\n0,0,0,0,1,0,0,0,\n", r"trace.csv:2: names no tool"),
        (HEAD + "\nnan,0,0,0,1,0,0,0\n", "no row has a time"),
        ('{"t": 0, "x": 0}\n', r"trace.csv:1: lacks y, z, qw, qx, qy, qz"),
        ('{"t": 0,\n', r"trace.csv:1: is not JSON"),
        ('{"t": 0, "t": 1}\n', r"trace.csv:1: has the key 't' twice"),
    ],
)
def test_what_no_stream_could_say_names_file_and_line(tmp_path, text, complaint):
    with pytest.raises(InputError if "no column" not in complaint else UnknownNameError, match=complaint):
        read_stream(written(tmp_path, text))


@pytest.mark.parametrize("value", ['"1"', "true", "[1]"])
def test_json_that_holds_no_number(tmp_path, value):
    line = '{"t": 0, "x": VALUE, "y": 2, "z": 3, "qw": 1, "qx": 0, "qy": 0, "qz": 0}'
    with pytest.raises(InputError, match=r"trace.csv:1: x: .* is no number"):
        read_stream(written(tmp_path, line.replace("VALUE", value)))


def test_files_that_are_no_text(tmp_path):
    with pytest.raises(InputError, match="can't be read"):
        read_stream(tmp_path / "absent.csv")
    with pytest.raises(InputError, match="can't be read"):
        read_stream(tmp_path)
    binary = tmp_path / "binary.csv"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not a text file"):
        read_stream(binary)


def test_rows_with_and_without_a_tool():
    named = stream_of(rows(0.0)).rows[0]
    with pytest.raises(InputError, match="some rows name a tool"):
        GoalStream("made", (named, type(named)(0.1, "left", named.pose)))
