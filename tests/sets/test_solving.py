"""Whole sets: answers by line, the same for any number of processes, and a re-check that believes nothing.

Earlier files stay intact.
"""

import json
import os
from pathlib import Path

import pytest

from tests.ik.arms import beads, planar, seven
from workcell.bench.reference.generate import generate
from workcell.bench.tables import list_benches, run_bench
from workcell.errors import InputError, OutputError, UnknownNameError
from workcell.ik.problem import Budget
from workcell.sets.problems import ProblemSet, load_problem_set
from workcell.sets.solving import problem_seed, solve_set, verify_answers

DATA = Path(__file__).parent / "files"


@pytest.fixture(scope="module")
def seven_set():
    return load_problem_set(DATA / "seven_random.json")


@pytest.fixture(scope="module")
def solved(seven_set, tmp_path_factory):
    out = tmp_path_factory.mktemp("answers") / "seven.jsonl"
    solve_set(seven_set, out=out)
    return out


def _lines(path):
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_one_line_a_problem(seven_set, solved):
    lines = _lines(solved)
    assert [line["id"] for line in lines] == [named.id for named in seven_set.problems]
    assert [line["status"] for line in lines] == ["SOLVED"] * 3 + ["UNREACHABLE"]
    for line in lines:
        assert {"id", "status", "q", "time_s", "cpu_s", "solver", "certificate"} <= set(line)
        assert (line["q"] is None) == (line["status"] != "SOLVED")
        assert line["cpu_s"] > 0
    assert [line["certificate"]["kind"] for line in lines] == ["solution"] * 3 + ["reach"]
    assert all(line["certificate"]["data"]["middle"]["values"] == line["q"] for line in lines[:3])


def test_the_recheck_agrees(seven_set, solved):
    report = verify_answers(seven_set, solved)
    assert (report.solved, report.proved, report.unanswered, report.missing) == (3, 1, 0, 0)
    assert report.refused == [] and report.certified == 3
    figures = report.to_json()
    assert figures["max_position_error_m"] < 1e-4 and figures["min_clearance_m"] >= 0
    assert len(report.rows()) == len(figures)


def test_processes_change_no_answer(seven_set, solved, tmp_path):
    summary = solve_set(seven_set, jobs=2, out=tmp_path / "two.jsonl")
    assert [(a["id"], a["status"], a["q"]) for a in _lines(tmp_path / "two.jsonl")] == [
        (a["id"], a["status"], a["q"]) for a in _lines(solved)
    ]
    assert summary.statuses == {"SOLVED": 3, "UNREACHABLE": 1}
    assert summary.to_json()["n"] == 4 and dict(summary.rows())["problems"] == 4


def test_a_problem_has_its_own_seed(seven_set, solved):
    last = ProblemSet("last", seven_set.robot, seven_set.cover, seven_set.problems[2:3])
    out = solved.with_name("last.jsonl")
    solve_set(last, out=out)
    assert _lines(out)[0]["q"] == _lines(solved)[2]["q"]
    assert problem_seed(0, "a") == problem_seed(0, "a") != problem_seed(1, "a")


def test_an_interruption_keeps_what_was_found_and_what_was_there(seven_set, tmp_path):
    out = tmp_path / "answers.jsonl"
    out.write_text("precious\n")
    calls = []

    def interrupt():
        calls.append(1)
        if len(calls) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt, match=r"answers\.jsonl\.partial"):
        solve_set(seven_set, out=out, progress=interrupt)
    assert out.read_text() == "precious\n"
    partial = tmp_path / "answers.jsonl.partial"
    assert len(_lines(partial)) == 2
    assert verify_answers(seven_set, partial).missing == 2


def test_outputs_that_can_not_be_written(seven_set, tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(OutputError, match="can't be written"):
        solve_set(seven_set, out=blocked / "answers.jsonl")
    if Path("/dev/full").exists():
        (tmp_path / "full.jsonl.partial").symlink_to("/dev/full")
        with pytest.raises(OutputError, match="No space"):
            solve_set(seven_set, budget=Budget(0.0), out=tmp_path / "full.jsonl")
        assert not (tmp_path / "full.jsonl").exists()
    if os.geteuid() != 0:
        locked = tmp_path / "locked"
        locked.mkdir(mode=0o500)
        with pytest.raises(OutputError, match="denied"):
            solve_set(seven_set, out=locked / "answers.jsonl")


def test_an_unknown_solver_writes_nothing(seven_set, tmp_path):
    with pytest.raises(UnknownNameError, match="ikspark"):
        solve_set(seven_set, solver="ikpsark", out=tmp_path / "a.jsonl")
    assert list(tmp_path.iterdir()) == []


def test_no_budget_finds_nothing(seven_set, tmp_path):
    summary = solve_set(seven_set, budget=Budget(0.0), out=tmp_path / "a.jsonl")
    assert summary.statuses == {"NOT_FOUND": 4} and summary.solvers == {}
    report = verify_answers(seven_set, tmp_path / "a.jsonl")
    assert report.unanswered == 4 and not report.refused


def test_an_empty_set(seven_set, tmp_path):
    empty = ProblemSet("empty", seven_set.robot, seven_set.cover, ())
    summary = solve_set(empty, jobs=2, out=tmp_path / "a.jsonl")
    assert summary.statuses == {} and (tmp_path / "a.jsonl").read_text() == ""
    assert dict(summary.rows())["problems"] == 0


def _changed(line, **changes):
    return {**line, **changes}


def _forged_proof(line):
    certificate = json.loads(json.dumps(line["certificate"]))
    certificate["data"]["slides"]["values"][3] = 9.0
    return {**line, "certificate": certificate}


def _moved_box(line, by):
    certificate = json.loads(json.dumps(line["certificate"]))
    certificate["data"]["middle"]["values"][0] += by
    return {**line, "certificate": certificate}


def _another_scope(certificate):
    return {**certificate, "scope": "kinematics"}


@pytest.mark.parametrize(
    ("index", "change", "words"),
    [
        (0, lambda a: _changed(a, q=[v + 0.01 for v in a["q"]]), "mm from its target"),
        (0, lambda a: _changed(a, q=a["q"][:-1]), "6 joint values"),
        (0, lambda a: _changed(a, q=None), "without a configuration"),
        (0, lambda a: _changed(a, q=[*a["q"][:-1], float("nan")]), "finite"),
        (0, lambda a: _changed(a, q="1 2 3"), "finite"),
        (0, lambda a: _changed(a, q=[True] * 7), "finite"),
        (0, lambda a: _changed(a, status="SURE"), "unknown status"),
        (0, lambda a: _changed(a, status=["SOLVED"]), "unknown status"),
        (0, lambda a: _changed(a, id="nobody"), "no problem 'nobody'"),
        (0, lambda a: _changed(a, id=None), '"id" is missing'),
        (1, lambda a: _changed(a, id="seven_random_0000"), "second answer"),
        (0, lambda a: _changed(a, status="UNREACHABLE", q=None, certificate=None), "without a certificate"),
        (0, lambda a: _changed(a, status="UNREACHABLE", q=None), "is about 'solution'"),
        (0, lambda a: _changed(a, status="BLOCKED", q=None), "is about 'solution'"),
        (0, lambda a: _changed(a, q=[v + 1e-9 for v in a["q"]]), "another configuration"),
        (0, lambda a: _moved_box(a, 1e-4), "does not hold"),
        (0, lambda a: _changed(a, certificate=_another_scope(a["certificate"])), "about 'kinematics'"),
        (0, lambda a: [a], "not a JSON object"),
        (3, lambda a: _changed(a, certificate=None), "without a certificate"),
        (3, lambda a: _changed(a, status="BLOCKED"), "is about 'kinematics'"),
        (3, lambda a: _changed(a, certificate={}), "not a certificate"),
        (3, lambda a: _changed(a, certificate="nowhere.json"), "can't be read"),
        (3, _forged_proof, "does not hold"),
    ],
)
def test_the_recheck_refuses(seven_set, solved, tmp_path, index, change, words):
    lines = _lines(solved)
    lines[index] = change(lines[index])
    path = tmp_path / "changed.jsonl"
    path.write_text("\n".join(json.dumps(line) for line in lines))
    report = verify_answers(seven_set, path)
    assert len(report.refused) == 1, report.refused
    assert report.refused[0].startswith(f"line {index + 1}:") and words in report.refused[0]
    assert report.solved + report.proved + report.unanswered + report.missing == 4


def test_a_certificate_for_another_problem_is_refused(solved, seven_set, tmp_path):
    lines = _lines(solved)
    lines[0] = _changed(lines[3], id=lines[0]["id"])
    path = tmp_path / "swapped.jsonl"
    path.write_text("\n".join(json.dumps(line) for line in lines))
    assert "another problem" in verify_answers(seven_set, path).refused[0]


def test_damaged_lines_are_refused_by_number(seven_set, solved, tmp_path):
    path = tmp_path / "damaged.jsonl"
    text = solved.read_text().splitlines()
    path.write_text("\n".join([text[0], "", "{half", text[1], "[" * 100_000]))
    report = verify_answers(seven_set, path)
    assert [reason.split(":")[0] for reason in report.refused] == ["line 3", "line 5"]
    assert report.solved == 2 and report.missing == 2


def test_answer_files_that_can_not_be_read(seven_set, tmp_path):
    with pytest.raises(InputError, match="No such file"):
        verify_answers(seven_set, tmp_path / "missing.jsonl")
    (tmp_path / "binary.jsonl").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not a text file"):
        verify_answers(seven_set, tmp_path / "binary.jsonl")


def test_large_certificates_stand_in_files_beside(seven_set, tmp_path, monkeypatch):
    monkeypatch.setattr("workcell.sets.answers.INLINE_NUMBERS", 0)
    out = tmp_path / "a.jsonl"
    solve_set(seven_set, out=out)
    entry = _lines(out)[3]["certificate"]
    assert entry.startswith("a_certificates/") and (tmp_path / entry).is_file()
    moved = tmp_path / "elsewhere"
    moved.mkdir()
    (tmp_path / "a_certificates").rename(moved / "a_certificates")
    out.rename(moved / "a.jsonl")
    assert verify_answers(seven_set, moved / "a.jsonl").proved == 1


def test_a_certificate_file_that_is_nested_too_deeply_is_refused(seven_set, solved, tmp_path):
    line = _lines(solved)[3]
    (tmp_path / "deep.json").write_text("[" * 100_000)
    path = tmp_path / "a.jsonl"
    path.write_text(json.dumps(_changed(line, certificate="deep.json")))
    [refused] = verify_answers(seven_set, path).refused
    assert "deep.json: not JSON: is nested too deeply" in refused


def test_blocked_answers_are_rechecked(tmp_path):
    blocked = generate(planar(), beads(planar(), 0.03), "unreachable", 4, seed=0)
    summary = solve_set(blocked, out=tmp_path / "a.jsonl")
    assert summary.statuses == {"UNREACHABLE": 2, "BLOCKED": 2}
    assert verify_answers(blocked, tmp_path / "a.jsonl").proved == 4


def test_benches_are_listed_by_name():
    benches = list_benches()
    assert {"sets", "multistart", "impossible"} <= {bench.name for bench in benches}
    assert all(bench.n >= 1 and bench.description for bench in benches)
    assert [bench.name for bench in benches] == sorted(bench.name for bench in benches)


def test_the_bench_of_set_files(tmp_path):
    for name in ("seven_random", "planar_free"):
        (tmp_path / f"{name}.json").write_bytes((DATA / f"{name}.json").read_bytes())
    (tmp_path / "seven_random.answers.json").write_text("{}")
    document = run_bench("sets", n=2, seed=1, sets=tmp_path)
    assert (document["bench"], document["n"], document["seed"]) == ("sets", 2, 1)
    rows = {row["row"]: row for row in document["rows"]}
    assert set(rows) == {f"{s}/{m}" for s in ("seven/random", "planar/free") for m in ("auto", "multistart")}
    for row in rows.values():
        assert row["n"] == 2 and row["success"] == row["success_paper_tolerance"] == 1.0
        assert row["cpu_ms_mean"] > 0 and row["cpu_ms_p95"] >= row["cpu_ms_median"] and row["paper"] is None
    json.dumps(document)


def test_benches_that_can_not_run(tmp_path):
    with pytest.raises(UnknownNameError, match="did you mean multistart"):
        run_bench("multistrat")
    with pytest.raises(InputError, match="at least 1"):
        run_bench("multistart", n=0)
    with pytest.raises(InputError, match="--sets DIR"):
        run_bench("sets")
    with pytest.raises(InputError, match="not a folder"):
        run_bench("sets", sets=tmp_path / "missing")
    with pytest.raises(InputError, match="no problem set"):
        run_bench("sets", sets=tmp_path)


def test_a_set_for_seven_joints_is_not_answered_by_one_for_two(solved):
    other = load_problem_set(DATA / "planar_free.json")
    report = verify_answers(other, solved)
    assert len(report.refused) == 4 and report.missing == 3
    assert seven().dof != other.robot.dof
