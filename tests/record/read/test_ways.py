"""Who planned the ways of a run: told by the recording's query documents alone, whatever the run says of itself."""

from __future__ import annotations

import dataclasses
import io
import json
from collections.abc import Iterable, Mapping
from pathlib import Path

import mujoco
import numpy as np
import pytest
from rich.console import Console

from tests.record.conftest import RESULT, record_toy
from workcell.geometry.types import FreeSpace
from workcell.ik.judge.exact import ExactKinematics
from workcell.ik.observing import report
from workcell.ik.problem import IKProblem
from workcell.ik.result import IKResult, Status
from workcell.model.loading.load import load_robot
from workcell.model.robot import Robot
from workcell.pose import Array
from workcell.record.read.compare import compare
from workcell.record.read.reader import read
from workcell.record.read.review import Check, Review, review
from workcell.record.show.page import page
from workcell.record.show.terminal import review_table
from workcell.record.write.recording import Recording
from workcell.record.write.rrd import RrdWriter
from workcell.record.write.solver_log import QUERIES

HERE = np.array([0.3, -1.1, 1.2, 0.4, 0.9, -0.2])
SPACE = FreeSpace([[-9.0, -9, -9]], [[9.0, 9, 9]])


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("ur10")


def step(robot: Robot, to: Array, solver: str = "ikspark", **changes: object) -> tuple[IKProblem, IKResult]:
    """A step from HERE, within 0.2 rad a joint and 0.5 in Eq. 75, answered by a solver."""
    problem = IKProblem(robot, robot.fk(to), q_reference=HERE, max_step=0.2, max_link_rotation=0.5)
    answer = IKResult(Status.SOLVED, solver, q=to, stats={"cpu_s": 0.004, "sdps": 3.0})
    return problem, dataclasses.replace(answer, **changes)


def goal(robot: Robot, solver: str = "ikspark") -> tuple[IKProblem, IKResult]:
    return IKProblem(robot, robot.fk(HERE)), IKResult(Status.SOLVED, solver, q=HERE, stats={"cpu_s": 0.01})


Answered = Iterable[tuple[IKProblem, IKResult]]


def recorded(
    path: Path, ways: Mapping[str, Answered], planner: str | None = "ikspark", says: str | None = None
) -> Path:
    with Recording(path, task="ways", planner=planner) as recording:
        for what, answered in ways.items():
            with recording.queries(what):
                for problem, answer in answered:
                    report(problem, answer)
        recording.set_result(RESULT | {"planner": says or planner})
    return path


def check_of(found: Review) -> Check | None:
    return next((check for check in found.checks if check.name == "planner"), None)


@pytest.fixture(scope="module")
def ways(robot: Robot) -> dict[str, list[tuple[IKProblem, IKResult]]]:
    """One way by its planner, in cuboids and by cuts, and one by local steps."""
    qs = HERE + np.random.default_rng(3).uniform(-0.1, 0.1, (6, 6))
    among = {"cuboids": np.zeros(0, dtype=np.int64), "free_space": SPACE}
    return {
        "onto the board": [
            goal(robot),
            *(step(robot, q, **among) for q in qs[:3]),
            step(robot, qs[3], "ikspark+cuts"),
            step(robot, qs[4], status=Status.NOT_FOUND, q=None),
        ],
        "off the board": [step(robot, q, "local", stats={"cpu_s": 0.001}) for q in qs],
    }


@pytest.fixture
def parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """A solver with a part of its own name."""
    from workcell.ik import registry

    entry = dataclasses.replace(registry.SOLVERS["ikspark"], within="ikspark", listed=False)
    monkeypatch.setattr(registry, "SOLVERS", {**registry.SOLVERS, "ikspark+cuts": entry})


def test_a_way_by_others_than_the_planner_fails_the_review_by_name(
    tmp_path: Path, ways: dict[str, Answered], parts: None
) -> None:
    found = review(recorded(tmp_path / "a.rrd", ways))
    check = check_of(found)
    assert check is not None and not check.passed
    assert "off the board: 6 of 6 by local" in check.finding
    assert "onto" not in check.finding
    assert found.verdict == "not achieved"


def test_the_planner_s_own_parts_pass_and_are_counted(
    tmp_path: Path, ways: dict[str, Answered], parts: None
) -> None:
    found = review(recorded(tmp_path / "a.rrd", {"onto the board": ways["onto the board"]}))
    assert check_of(found) == Check(
        "planner", True, "all 5 configurations are ikspark's, 3 in cuboids, 1 by ikspark+cuts"
    )
    assert found.achieved


def test_auto_may_do_as_it_likes_and_says_who_did(tmp_path: Path, ways: dict[str, Answered]) -> None:
    check = check_of(review(recorded(tmp_path / "a.rrd", ways, planner="auto")))
    assert check == Check("planner", True, "auto: of 11 6 by local, 4 by ikspark, 1 by ikspark+cuts")


def test_a_run_that_names_another_planner_than_its_recording(
    tmp_path: Path, ways: dict[str, Answered]
) -> None:
    path = recorded(tmp_path / "a.rrd", ways, planner="cidgik", says="auto")
    check = check_of(review(path))
    assert check is not None and not check.passed and "cidgik" in check.finding and "auto" in check.finding


def test_no_planner_named_or_nothing_asked_no_such_check(
    tmp_path: Path, toy: mujoco.MjModel, ways: dict[str, Answered]
) -> None:
    assert check_of(review(recorded(tmp_path / "a.rrd", ways, planner=None))) is None
    assert check_of(review(recorded(tmp_path / "b.rrd", {}))) is None
    assert check_of(review(record_toy(tmp_path / "c.rrd", toy))) is None


def test_steps_and_turns_are_measured_against_their_bounds(
    tmp_path: Path, robot: Robot, ways: dict[str, list[tuple[IKProblem, IKResult]]]
) -> None:
    """Against a plain loop, with the judge's kinematics."""
    onto, off = review(recorded(tmp_path / "a.rrd", ways)).ways
    assert (onto.what, onto.queries, onto.steps, onto.unsolved) == ("onto the board", 6, 5, 1)
    assert (onto.in_cuboids, onto.sdps, off.in_cuboids, off.sdps) == (3, 15, 0, 0)
    assert off.by == (("local", 6),) and dict(onto.by) == {"ikspark": 4, "ikspark+cuts": 1}
    assert onto.cpu_ms == pytest.approx(10 + 5 * 4) and off.cpu_ms == pytest.approx(6)
    kinematics = ExactKinematics(robot)
    before, _ = kinematics.links(HERE)
    for row in (onto, off):
        solved = [
            answer.q
            for problem, answer in ways[row.what]
            if answer.q is not None and problem.max_step is not None
        ]
        steps = [np.abs(q - HERE).max() for q in solved]
        turns = [np.linalg.norm(kinematics.links(q)[0] - before, axis=(1, 2)).max() for q in solved]
        assert row.step is not None and row.link_rotation is not None
        assert (row.step.largest, row.step.bound) == pytest.approx((max(steps), 0.2), abs=1e-6)
        assert (row.link_rotation.largest, row.link_rotation.bound) == pytest.approx(
            (max(turns), 0.5), abs=1e-5
        )


def test_the_joint_nearest_to_its_own_bound_counts(tmp_path: Path, robot: Robot) -> None:
    bounds = np.array([0.5, 0.5, 0.5, 0.5, 0.05, 0.5])
    q = HERE + np.array([0.3, 0, 0, 0, 0.04, 0])
    problem = IKProblem(robot, robot.fk(q), q_reference=HERE, max_step=bounds)
    (row,) = review(
        recorded(tmp_path / "a.rrd", {"w": [(problem, IKResult(Status.SOLVED, "ikspark", q=q))]})
    ).ways
    assert row.step is not None
    assert (row.step.largest, row.step.bound) == pytest.approx((0.04, 0.05))
    assert row.link_rotation is not None and row.link_rotation.bound is None


@pytest.mark.parametrize(("bound", "passes"), [(0.11, True), (0.1, False)])
def test_a_step_beyond_its_bound_fails_the_review(
    tmp_path: Path, robot: Robot, bound: float, passes: bool
) -> None:
    """As no judge would let it, and a document might say."""
    q = HERE + np.array([0, 0, 0.1 + 1e-5, 0, 0, 0])
    problem = IKProblem(robot, robot.fk(q), q_reference=HERE, max_step=bound, max_link_rotation=0.5)
    found = review(
        recorded(tmp_path / "a.rrd", {"a way": [(problem, IKResult(Status.SOLVED, "ikspark", q=q))]})
    )
    (check,) = (check for check in found.checks if check.name == "continuity")
    assert check.passed == passes == found.achieved
    assert f"largest joint step 0.1 of {bound} (a way)" in check.finding
    assert "largest link rotation 0.141 of 0.5 (a way)" in check.finding, (
        "the square root of 2, times the sine"
    )


def text_of(found: Review) -> str:
    console = Console(file=io.StringIO(), width=200)
    console.print(review_table(found))
    return console.file.getvalue()  # type: ignore[attr-defined]


def test_words_json_and_page_say_the_same(tmp_path: Path, ways: dict[str, Answered]) -> None:
    found = review(recorded(tmp_path / "a.rrd", ways))
    text, html = text_of(found), page(found)
    rows = json.loads(json.dumps(found.to_json()))["ways"]
    for row, told in zip(rows, found.ways, strict=True):
        assert {"what", "queries", "by", "in_cuboids", "sdps", "cpu_ms", "step", "link_rotation"} <= set(row)
        assert sum(one["solved"] for one in row["by"]) + row["unsolved"] == row["queries"]
        assert row["step"]["largest"] <= row["step"]["bound"] == 0.2
        assert all(cell in text and f">{cell}</td>" in html for cell in told.cells)
    assert "FAILED planner" in text


def test_two_runs_are_compared_by_who_planned(tmp_path: Path, ways: dict[str, Answered]) -> None:
    first = review(recorded(tmp_path / "a.rrd", ways))
    second = review(recorded(tmp_path / "b.rrd", {**ways, "off the board": ways["onto the board"]}))
    found = compare(first, second)
    assert found.ways == (("off the board", "6 local", "4 ikspark, 1 ikspark+cuts, 1 unsolved"),)
    assert not compare(first, first).ways
    assert json.loads(json.dumps(found.to_json()))["ways"][0]["first"] == "6 local"


def forged(tmp_path: Path, texts: list[str]) -> Review:
    """A recording of these query documents."""
    path = tmp_path / "forged.rrd"
    writer = RrdWriter(path)
    writer.log_document("manifest", json.dumps({"format": 3, "task": "t", "seed": 0, "planner": "ikspark"}))
    writer.log_document("result", json.dumps(RESULT))
    index = np.arange(len(texts))
    writer.send_documents(QUERIES, (index.astype(float), index, index), texts)
    writer.finish(path)
    return review(path)


GOOD = {
    "query": 0,
    "what": "w",
    "solver": "ikspark",
    "status": "SOLVED",
    "cpu_ms": 1.0,
    "first_step": 0,
    "stages": [],
    "kind": "step",
    "in_cuboids": True,
    "sdps": 1,
    "step": 0.1,
    "max_step": 0.2,
}


@pytest.mark.parametrize(
    "second",
    [
        "no JSON",
        "[]",
        json.dumps({**GOOD, "query": 1, "solver": None}),
        json.dumps({**GOOD, "query": 1, "solver": ["ikspark"]}),
        json.dumps({**GOOD, "query": 0}),
        json.dumps({**GOOD, "query": 2}),
        json.dumps({key: value for key, value in GOOD.items() if key != "solver"}),
    ],
    ids=["no JSON", "no object", "nobody", "a list", "the same twice", "one is missing", "no solver"],
)
def test_documents_that_are_missing_or_make_no_sense_do_not_pass(tmp_path: Path, second: str) -> None:
    check = check_of(forged(tmp_path, [json.dumps(GOOD), second]))
    assert check is not None and not check.passed


def test_numbers_that_are_none_are_unknown(tmp_path: Path) -> None:
    odd = {**GOOD, "sdps": "many", "step": "NaN", "max_step": True, "link_rotation": float("nan"), "kind": 7}
    found = forged(tmp_path, [json.dumps(odd)])
    (row,) = found.ways
    assert (row.steps, row.in_cuboids, row.sdps, row.step, row.link_rotation) == (None,) * 5
    assert json.loads(json.dumps(found.to_json(), allow_nan=False))["ways"][0]["sdps"] is None
    assert "?" in text_of(found)


def test_an_older_layout_is_read_and_what_it_does_not_tell_is_unknown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ways: dict[str, Answered]
) -> None:
    monkeypatch.setattr("workcell.record.write.scene_log.FORMAT", 2)
    monkeypatch.setattr("workcell.record.write.solver_log.query_facts", lambda *_: {})
    found = review(recorded(tmp_path / "old.rrd", ways, planner=None))
    assert found.manifest["format"] == 2
    assert not [words for words in found.missing if "layout" in words]
    assert check_of(found) is None
    assert [row.step for row in found.ways] == [None, None]
    assert [row.in_cuboids for row in found.ways] == [None, None]
    assert dict(found.ways[1].by) == {"local": 6}


def test_the_planner_is_in_the_manifest(tmp_path: Path) -> None:
    path = recorded(tmp_path / "a.rrd", {})
    assert review(path).manifest["planner"] == "ikspark"
    assert "planner" not in review(recorded(tmp_path / "b.rrd", {}, planner=None)).manifest
    assert QUERIES not in read(path).entities
