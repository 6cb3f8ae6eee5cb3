"""Both checkers are asked about a file of answers; what one of them refuses is refused, and named."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from tests.ik.arms import beads, seven
from tests.sets.documents import problem_set_document
from workcell.bench.reference.generate import generate
from workcell.errors import InputError
from workcell.ik.problem import Budget
from workcell.proofs.exact.verdicts import Verdict
from workcell.sets.problems import parse_problem_set
from workcell.sets.second_opinion import second_opinions
from workcell.sets.solving import solve_set, verify_answers


@pytest.fixture(scope="module")
def answered(tmp_path_factory):
    """(set file, set, answers): ten problems of a seven-joint arm, half of them impossible."""
    folder = tmp_path_factory.mktemp("answered")
    robot = seven()
    sets = [generate(robot, beads(robot), kind, 5, seed=3) for kind in ("unreachable", "workcell")]
    document = problem_set_document(replace(sets[0], problems=sets[0].problems + sets[1].problems))
    file = folder / "set.json"
    file.write_text(json.dumps(document))
    problem_set, answers = parse_problem_set(document), folder / "answers.jsonl"
    solve_set(problem_set, budget=Budget(5.0), out=answers)
    return file, problem_set, answers


def test_both_accept_honest_answers(answered):
    file, problem_set, answers = answered
    lines = []
    second = second_opinions(file, answers, trees=True, progress=lambda: lines.append(1))
    assert len(lines) == len(second) == 10
    assert not [verdict for verdict in second.values() if verdict.refusal is not None]
    report = verify_answers(problem_set, answers, second)
    assert not report.refused
    assert (report.twice, report.proved, report.solved) == (10, 5, 5)
    assert report.to_json()["checked_twice"] == 10


def test_what_one_of_them_refuses_is_refused(answered):
    file, problem_set, answers = answered
    second = second_opinions(file, answers, trees=True)
    name = problem_set.problems[0].id
    second[name] = Verdict(1, name, "UNREACHABLE", "it is not so")
    report = verify_answers(problem_set, answers, second)
    assert len(report.refused) == 1
    assert "line 1" in report.refused[0]
    assert "the exact checker refuses what the first accepts: it is not so" in report.refused[0]
    assert (report.twice, report.proved, report.solved) == (9, 4, 5)


def test_what_is_wrong_is_refused_by_both(answered, tmp_path):
    file, problem_set, answers = answered
    lines = [json.loads(line) for line in answers.read_text().splitlines()]
    lines[-1]["q"] = (np.array(lines[-1]["q"]) + 1e-3).tolist()
    lines[0]["certificate"], lines[1]["certificate"] = lines[1]["certificate"], None
    lines[2]["status"] = "BLOCKED_IN_MODEL"
    wrong = tmp_path / "wrong.jsonl"
    wrong.write_text("".join(json.dumps(line) + "\n" for line in lines))
    second = second_opinions(file, wrong, trees=True)
    refused = [verdict.line for verdict in second.values() if verdict.refusal is not None]
    assert refused == [1, 2, 3, 10]
    report = verify_answers(problem_set, wrong, second)
    assert len(report.refused) == 4
    assert all("(the exact checker: " in line for line in report.refused)


def test_trees_may_be_left_out(answered, tmp_path):
    file, _, answers = answered
    lines = [json.loads(line) for line in answers.read_text().splitlines()]
    lines[0]["certificate"]["kind"] = "branch"
    changed = tmp_path / "tree.jsonl"
    changed.write_text(json.dumps(lines[0]) + "\n")
    (verdict,) = second_opinions(file, changed, trees=False).values()
    assert not verdict.asked
    (verdict,) = second_opinions(file, changed, trees=True).values()
    assert verdict.refusal is not None


def test_a_file_that_cannot_be_read_is_an_input_error(answered, tmp_path):
    file, _, answers = answered
    with pytest.raises(InputError, match="exact checker"):
        second_opinions(file, tmp_path / "none.jsonl", trees=True)
    with pytest.raises(InputError, match="exact checker"):
        second_opinions(answers, answers, trees=True)


def test_it_runs_alone(answered, tmp_path):
    file, _, answers = answered
    run = [sys.executable, "-m", "workcell.proofs.exact"]
    done = subprocess.run([*run, file, answers], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert "5 SOLVED" in done.stdout
    wrong = tmp_path / "wrong.jsonl"
    wrong.write_text(answers.read_text().replace('"status": "SOLVED"', '"status": "BLOCKED"'))
    done = subprocess.run([*run, file, wrong], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stdout.count("refused: line ") == 5
    done = subprocess.run([*run, file], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr[:6]) == (2, "usage:")
    done = subprocess.run([*run, file, tmp_path], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr[:6]) == (2, "error:")
