"""Lines about the problems of a set: read with their faults, and judged once each, whatever they claim."""

from dataclasses import dataclass, field
from pathlib import Path

import pytest

from workcell.errors import InputError
from workcell.sets.lines import read_lines, recheck
from workcell.sets.problems import load_problem_set

DATA = Path(__file__).parent / "files"


@dataclass(frozen=True)
class Said:
    id: str
    right: bool


@dataclass
class Tally:
    unanswered: int = 0
    refused: list[str] = field(default_factory=list)


def parse(value):
    if not isinstance(value, dict):
        raise InputError("says nothing")
    return Said(value["id"], value["right"])


def test_lines_keep_their_numbers_and_tell_their_faults(tmp_path):
    file = tmp_path / "a.jsonl"
    file.write_text('{"id": "a"}\n\n  \n{half\n"text"\n' + "[" * 100_000 + "\n7\n")
    lines = list(read_lines(file))
    assert [(line.number, line.value) for line in lines] == [
        (1, {"id": "a"}),
        (4, None),
        (5, "text"),
        (6, None),
        (7, 7),
    ]
    assert [line.fault for line in lines] == [
        None,
        "is not JSON (Expecting property name enclosed in double quotes, column 2)",
        None,
        "is nested too deeply",
        None,
    ]


def test_a_number_that_python_will_not_read_is_a_fault_of_its_line(tmp_path):
    file = tmp_path / "a.jsonl"
    file.write_text("9" * 5_000 + "\n7\n")
    first, second = read_lines(file)
    assert first.fault == "holds a number of too many digits" and second.value == 7


def test_files_that_can_not_be_read(tmp_path):
    with pytest.raises(InputError, match=r"none\.jsonl: can't be read: No such file"):
        list(read_lines(tmp_path / "none.jsonl"))
    (tmp_path / "binary.jsonl").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match=r"binary\.jsonl: is not a text file \(a file of JSON lines\)"):
        list(read_lines(tmp_path / "binary.jsonl"))


def test_every_problem_is_judged_once_and_refusals_name_the_line(tmp_path):
    problem_set = load_problem_set(DATA / "seven_random.json")
    first, second, *_ = (named.id for named in problem_set.problems)
    file = tmp_path / "a.jsonl"
    file.write_text(
        "\n".join(
            [
                "nonsense",
                "5",
                '{"id": "nobody", "right": true}',
                f'{{"id": "{first}", "right": false}}',
                f'{{"id": "{first}", "right": true}}',
                f'{{"id": "{second}", "right": true}}',
            ]
        )
    )
    judged, report = [], Tally()

    def judge(named, said):
        judged.append((named.id, said))
        return None if said.right else "is wrong"

    recheck(problem_set, file, report, parse, judge)
    assert judged == [(first, Said(first, False)), (second, Said(second, True))]
    assert report.refused == [
        "line 1: is not JSON (Expecting value, column 1)",
        "line 2: says nothing",
        "line 3: the set has no problem 'nobody'",
        f"line 4: {first}: is wrong",
        f"line 5: a second answer to {first!r}",
    ]
    assert report.unanswered == 1  # the problem whose only line was judged, and refused
