"""`workcell plan` and the re-check of its files, on a small set of the planar arm."""

import json

import numpy as np
import pytest

from workcell.cli import exit_codes
from workcell.cli.main import main
from workcell.errors import InputError
from workcell.ik.problem import Budget
from workcell.sets.paths import holds_paths, verify_paths
from workcell.sets.planning import plan_set
from workcell.sets.problems import load_problem_set


def run(*arguments):
    """The exit code of a command."""
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    return ended.value.code


@pytest.fixture
def documents(request):
    """The set file of the planar arm that the tests of `solve` use, with starts."""
    source = request.config.rootpath / "tests" / "sets" / "files" / "planar_free.json"
    document = json.loads(source.read_text())
    problems = document["problems"][:3]
    dof = len(document["robot"]["joints"])
    for problem in problems:
        problem["start"] = [0.1] * dof
    document["problems"] = problems
    return document


@pytest.fixture
def set_file(documents, tmp_path):
    path = tmp_path / "set.json"
    path.write_text(json.dumps(documents))
    return path


def test_a_set_is_planned_and_its_file_verified(set_file, tmp_path, capsys):
    out = tmp_path / "paths.jsonl"
    assert run("plan", set_file, "--budget-s", "2", "--out", out) == exit_codes.DONE
    assert "paths proved" in capsys.readouterr().out
    lines = [json.loads(line) for line in out.read_text().splitlines()]
    assert lines
    for line in lines:
        assert set(line) >= {"id", "status", "path", "proved", "time_s", "cpu_s", "duration_s"}
    assert all(line["status"] == "SOLVED" and line["proved"] for line in lines)
    assert run("verify", set_file, out, "--json") == exit_codes.DONE
    report = json.loads(capsys.readouterr().out)
    assert report["paths"] == len(lines) and report["refused"] == []
    again = plan_set(load_problem_set(set_file), budget=Budget(2.0), out=tmp_path / "again.jsonl")
    assert again.proved == len(lines)
    paths = [json.loads(line)["path"] for line in (tmp_path / "again.jsonl").read_text().splitlines()]
    assert paths == [line["path"] for line in lines]


def test_optimised_paths_are_shorter_and_say_by_how_much(set_file, tmp_path, capsys):
    files = [tmp_path / f"{k}.jsonl" for k in range(2)]
    for file in files:
        assert (
            run("plan", set_file, "--optimise-iterations", "200", "--out", file, "--json") == exit_codes.DONE
        )
    assert '"mean_lower_bound_rad"' in capsys.readouterr().out
    first, second = ([json.loads(line) for line in file.read_text().splitlines()] for file in files)
    assert [line["path"] for line in first] == [line["path"] for line in second]
    for line in first:
        length = np.linalg.norm(np.diff(line["path"], axis=0), axis=1).sum()
        assert line["length_rad"] == pytest.approx(length)
        assert line["lower_bound_rad"] <= length + 1e-9 <= line["first_length_rad"] + 2e-9
    assert run("verify", set_file, files[0]) == exit_codes.DONE
    assert run("plan", set_file, "--optimise-s", "-1") == exit_codes.BAD_INPUT
    plain = plan_set(load_problem_set(set_file), budget=Budget(2.0))
    assert plain.first_length == () and plain.to_json()["mean_lower_bound_rad"] is None


def test_wrong_lines_are_refused_by_number(set_file, tmp_path):
    out = tmp_path / "paths.jsonl"
    plan_set(load_problem_set(set_file), budget=Budget(2.0), out=out)
    lines = [json.loads(line) for line in out.read_text().splitlines()]
    lines[0]["path"][0][0] += 0.01
    lines[1]["path"] = None
    wrong = [
        *map(json.dumps, lines),
        "not json",
        json.dumps({"id": "nobody", "path": []}),
        json.dumps(lines[2]),
    ]
    out.write_text("\n".join(wrong))
    assert holds_paths(out)
    report = verify_paths(load_problem_set(set_file), out)
    assert report.solved == 1 and len(report.refused) == 5
    for text, reason in zip(
        ("line 1", "line 2", "line 4", "line 5", "line 6"),
        ("begins", "without a path", "not JSON", "no problem", "second answer"),
        strict=True,
    ):
        assert any(line.startswith(text) and reason in line for line in report.refused)


def test_answers_are_not_paths(tmp_path):
    file = tmp_path / "answers.jsonl"
    file.write_text('{"id": "a", "status": "SOLVED", "q": [0]}\n')
    assert not holds_paths(file)


def test_the_first_object_of_a_file_says_whether_it_holds_paths(tmp_path):
    file = tmp_path / "paths.jsonl"
    file.write_text('{half\n"text"\n7\n{"id": "a", "path": null}\n{"id": "b", "q": null}\n')
    assert holds_paths(file)
    file.write_text('"text"\n')
    assert not holds_paths(file)


def test_a_problem_without_a_start_is_named(documents, tmp_path, capsys):
    del documents["problems"][1]["start"]
    file = tmp_path / "set.json"
    file.write_text(json.dumps(documents))
    assert run("plan", file) == exit_codes.BAD_INPUT
    error = capsys.readouterr().err
    assert documents["problems"][1]["id"] in error and "no start" in error


def test_a_start_in_collision_is_bad_input(documents, tmp_path):
    documents["robot"]["spheres"] = [[1, 0.2, 0.0, 0.0, 0.05]]
    for problem in documents["problems"]:
        problem["obstacles"] = {"boxes": [{"centre": [0.2, 0.03, 0.0], "half": [0.02, 0.02, 0.02]}]}
    file = tmp_path / "set.json"
    file.write_text(json.dumps(documents))
    with pytest.raises(InputError, match=r"overlap by .*free configuration"):
        plan_set(load_problem_set(file))
    assert np.isfinite(documents["problems"][0]["start"]).all()
