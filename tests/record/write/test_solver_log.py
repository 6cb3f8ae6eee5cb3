"""Solver stages in a recording: what the solvers told is in the file, and a review says it again."""

from __future__ import annotations

import io
import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
from rich.console import Console

from tests.record.conftest import RESULT, record_toy
from workcell.geometry.types import FreeSpace, SphereCover
from workcell.ik.observing import report
from workcell.ik.problem import IKProblem
from workcell.ik.result import IKResult, Status
from workcell.ik.solve import solve
from workcell.ik.stages import SolverStage
from workcell.model.loading.load import load_robot
from workcell.model.robot import Robot
from workcell.record.read.compare import compare
from workcell.record.read.queries import recorded_queries, stage_rows
from workcell.record.read.reader import read
from workcell.record.read.review import Review, review
from workcell.record.show.page import page
from workcell.record.show.page_tables import cuboid_section, solver_section
from workcell.record.show.plots import plot_metrics
from workcell.record.show.terminal import review_table
from workcell.record.write.recording import Recording
from workcell.record.write.rrd import RrdWriter
from workcell.record.write.solver_log import CPU, LOG, QUERIES, RESIDUAL


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("ur10")


@pytest.fixture(scope="module")
def problem(robot: Robot) -> IKProblem:
    return IKProblem(robot, robot.fk(np.array([0.3, -1.1, 1.2, 0.4, 0.9, -0.2])))


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory, problem: IKProblem) -> tuple[Path, list[IKResult]]:
    """A recording of three queries, and what was answered."""
    path = tmp_path_factory.mktemp("queries") / "run.rrd"
    with Recording(path, task="asking") as recording:
        with recording.queries("the part"):
            results = [solve(problem, solver="ikspark"), solve(problem, solver="cidgik")]
        solve(problem)
        with recording.queries("the tray"):
            results.append(solve(problem))
        recording.set_result(RESULT)
    return path, results


def text_of(found: Review) -> str:
    console = Console(file=io.StringIO(), width=120)
    console.print(review_table(found))
    return console.file.getvalue()  # type: ignore[attr-defined]


def test_every_query_and_stage_comes_back(told: tuple[Path, list[IKResult]]) -> None:
    path, results = told
    queries = review(path).queries
    assert [query.what for query in queries] == ["the part", "the part", "the tray"]
    step = 0
    for query, result in zip(queries, results, strict=True):
        assert (query.solver, query.status) == (result.solver, result.status.value)
        assert query.cpu_ms == pytest.approx(1e3 * result.stats["cpu_s"], abs=1e-3)
        assert query.first_step == step
        assert [stage.name for stage in query.stages] == [stage.name for stage in result.stages]
        gaps = [stage.gap for stage in result.stages]
        assert np.allclose([stage.residual for stage in query.stages], gaps, rtol=1e-3, equal_nan=True)
        step += len(result.stages)


def test_log_and_series_run_over_the_solvers_steps(told: tuple[Path, list[IKResult]]) -> None:
    path, results = told
    stages = [stage for result in results for stage in result.stages]
    entities = read(path).entities
    assert entities[LOG].rows() == len(stages) + len(results)
    assert {level[0] for level in entities[LOG].over_time("TextLog:level")[1]} == {"DEBUG"}
    gaps = np.array([stage.gap for stage in stages])
    written = entities[RESIDUAL].numbers("Scalars:scalars")[1][:, 0]
    assert sorted(written) == pytest.approx(sorted(np.log10(np.maximum(gaps[np.isfinite(gaps)], 1e-16))))
    spent = entities[CPU].numbers("Scalars:scalars")[1][:, 0]
    assert spent.sum() == pytest.approx(sum(1e3 * stage.cpu_s for stage in stages))


def test_the_solvers_have_a_timeline_of_their_own(told: tuple[Path, list[IKResult]]) -> None:
    from rerun.chunk import RrdReader

    steps = []
    for chunk in RrdReader(told[0]).stream():
        if chunk.entity_path.strip("/") == CPU:
            assert {"sim_time", "step", "solver_step"} <= set(chunk.timeline_names)
            steps += chunk.to_record_batch().column("solver_step").to_pylist()
    assert sorted(steps) == list(range(sum(len(result.stages) for result in told[1])))


def test_the_review_tells_them_in_words_json_page_and_plot(told: tuple[Path, list[IKResult]]) -> None:
    found = review(told[0])
    text, html = text_of(found), page(found)
    assert "Who planned  3 queries (1 by ikspark, 1 by cidgik, 1 by hjcd), 3 solved" in text
    rows = json.loads(json.dumps(found.to_json()))["solver_stages"]
    assert {row["what"] for row in rows} == {"the part", "the tray"}
    for row in rows:
        assert row["stage"] in text
        assert row["stage"] in html
    spent = sum(stage.cpu_ms for query in found.queries for stage in query.stages)
    assert sum(row["cpu_ms"] for row in rows) == pytest.approx(spent)
    reduction = next(r for r in stage_rows(found.queries) if (r.solver, r.stage) == ("ikspark", "snap"))
    assert reduction.smallest < 1e-5
    axes = plot_metrics(found).axes[-1]
    assert axes.get_title(loc="left").startswith("rank residual")
    assert axes.get_yscale() == "log"


def test_two_runs_are_compared_by_their_stages(
    tmp_path: Path, told: tuple[Path, list[IKResult]], problem: IKProblem
) -> None:
    with Recording(tmp_path / "b.rrd", task="asking") as recording, recording.queries("the part"):
        solve(problem, solver="cidgik")
    found = compare(review(told[0]), review(tmp_path / "b.rrd"))
    assert ("the part", "ikspark", "verify", 1, 0) in found.stages
    assert not any(solver == "cidgik" for _, solver, _, _, _ in found.stages)
    assert not compare(review(told[0]), review(told[0])).stages


def test_cuboids_of_the_solver_itself_are_told_by_the_recording_s_numbers(
    tmp_path: Path, robot: Robot, problem: IKProblem
) -> None:
    other = FreeSpace([[7, 7, 7]], [[8, 8, 8]])
    space = FreeSpace([[0, 0, 0], [1, 1, 1]], [[1, 1, 1], [2, 2, 2]])
    cover = SphereCover(np.array([0, 1, 1, 2]), np.zeros((4, 3)), np.full(4, 0.1))
    asked = IKProblem(robot, problem.target, cover=cover, free_space=space)
    stage = SolverStage("judge", 0.001, solver="ikspark")
    homes = np.array([-1, 1, 0, 1])
    answer = IKResult(
        Status.SOLVED, "ikspark", stages=(stage,), cuboids=homes, free_space=space, stats={"cpu_s": 0.002}
    )
    with Recording(tmp_path / "run.rrd", task="asking") as recording, recording.queries("the part"):
        recording.log_free_space(other)
        report(asked, answer)
    found = review(tmp_path / "run.rrd")
    names = robot.link_names
    assert found.queries[0].cuboids == {names[1]: [1, 2], names[2]: [2]}
    assert f"the part: {names[1]} in 1 and 2, {names[2]} in 2" in text_of(found)


def test_a_recording_without_stages_says_nothing_of_them(tmp_path: Path, toy: mujoco.MjModel) -> None:
    found = review(record_toy(tmp_path / "toy.rrd", toy))
    text, html = text_of(found), "".join([*cuboid_section(found), *solver_section(found)])
    assert found.queries == () and found.cuboids == ()
    assert found.missing == ()
    for words in ("Solver stages", "Cuboids in use"):
        assert words not in text
    assert html == ""
    assert found.to_json()["solver_stages"] == []
    assert len(plot_metrics(found).axes) == len(found.series)


def test_documents_that_make_no_sense_are_left_out(tmp_path: Path) -> None:
    good = {
        "query": 1,
        "what": "w",
        "solver": "s",
        "status": "SOLVED",
        "cpu_ms": 1.0,
        "first_step": 0,
        "stages": [],
    }
    texts = [
        "not JSON",
        "[]",
        json.dumps({**good, "stages": [{}]}),
        json.dumps({**good, "query": "x"}),
        json.dumps(good),
    ]
    writer = RrdWriter(tmp_path / "odd.rrd")
    index = np.arange(len(texts))
    writer.send_documents(QUERIES, (index.astype(float), index, index), texts)
    writer.finish(tmp_path / "odd.rrd")
    assert [query.number for query in recorded_queries(read(tmp_path / "odd.rrd"))] == [1]


def test_queries_of_an_unfinished_file_are_there_as_far_as_it_goes(
    tmp_path: Path, told: tuple[Path, list[IKResult]], problem: IKProblem
) -> None:
    """A killed process leaves what was flushed: the first query, not the second."""
    recording = Recording(tmp_path / "run.rrd", task="asking")
    with recording.queries("first"):
        solve(problem)
    recording.flush()
    with recording.queries("second"):
        solve(problem)
    found = review(recording.partial_path)
    recording.close()
    assert [query.what for query in found.queries] == ["first"]
    assert any("not finished" in text for text in found.missing)
    assert found.verdict == "incomplete"
    data = told[0].read_bytes()
    (tmp_path / "cut.rrd").write_bytes(data[: 3 * len(data) // 4])
    cut = review(tmp_path / "cut.rrd")
    assert cut.verdict == "incomplete"
    assert len(cut.queries) <= 3
