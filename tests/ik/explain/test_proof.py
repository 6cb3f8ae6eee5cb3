"""Certificates in words: of every kind, honest, refused and damaged; and the example files of the rules."""

from __future__ import annotations

import copy
import json
from pathlib import Path

import numpy as np
import pytest

from workcell.bench.forgeries.honest import NAMES, case
from workcell.bench.forgeries.mutants import CHANGES, forged
from workcell.cli.main import main
from workcell.errors import WorkcellError
from workcell.ik.certificate import Certificate
from workcell.ik.explain.kinds import KINDS
from workcell.ik.explain.proof import in_words
from workcell.ik.registry import PROOFS
from workcell.sets.problems import load_problem_set

EXAMPLES = Path(__file__).parents[3] / "docs" / "proofs"


def run(words: list[str]) -> int:
    """The exit code of a command line."""
    with pytest.raises(SystemExit) as ended:
        main(words)
    return int(ended.value.code or 0)


def told(document, problem=None) -> dict[str, object]:
    return in_words(Certificate.from_json(document), problem, "the problem").to_json()


@pytest.mark.parametrize("name", NAMES)
def test_every_kind_tells_its_claim_its_rule_and_what_it_rests_on(name: str) -> None:
    made = case(name)
    alone, checked = told(made.certificate), told(made.certificate, made.problem(own=True))
    assert alone["claims"] == made.certificate["statement"]
    assert "section" in str(alone["rule"]) and "target" in str(alone["rests on"])
    assert str(alone["holds"]).startswith("not looked at") and alone["checked"] is False
    assert checked["holds"] == "yes of 'the problem', as its checker finds" and checked["refusal"] is None
    other = told(made.borrowed(), made.problem(own=False))
    assert str(other["holds"]).startswith("no of 'the problem': ") and other["refusal"]


def test_a_tree_tells_its_shape_and_its_reasons() -> None:
    words = told(case("branch/obstacles/seven").certificate, case("branch/obstacles/seven").problem(own=True))
    nodes = case("branch/obstacles/seven").certificate["data"]["tree"]["shape"][0]
    assert f"{nodes} nodes" in str(words["tree"]) and "deep" in str(words["tree"])
    assert "a sphere collides with an obstacle" in str(words["leaves"])
    assert "sphere 2 (link3) with box 0" in str(words["collisions"])
    assert "j0" in str(words["splits"])


def test_all_kinds_that_are_read_have_words() -> None:
    assert set(KINDS) == set(PROOFS) - {"farkas", "cidgik"}
    made = copy.deepcopy(case("reach/six").certificate)
    for kind, words in (("farkas", "no longer read"), ("made up", "unknown"), ("\ud800", "unknown")):
        assert words in str(told({**made, "kind": kind})["rule"])


@pytest.mark.parametrize("name", NAMES)
def test_whatever_the_numbers_are_there_are_words_for_it(name: str) -> None:
    rng, made = np.random.default_rng(NAMES.index(name)), case(name)
    problem, others = made.problem(own=False), [case(other).borrowed() for other in NAMES[:4]]
    read = 0
    for change in list(CHANGES) * 3:
        text = forged(made.borrowed(), change, rng, others)
        try:
            certificate = Certificate.from_json(text)
        except WorkcellError:
            continue
        read += 1
        for question in (None, problem):
            json.dumps(in_words(certificate, question).to_json())
    assert read > 5


EXAMPLE_NAMES = (
    "reach",
    "last_link",
    "branch_limits",
    "branch_obstacles",
    "farkas",
    "cidgik",
    "cidgik_obstacles",
    "solution",
)


@pytest.mark.parametrize("name", EXAMPLE_NAMES)
def test_the_example_of_each_rule_holds(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    files = EXAMPLES / f"{name}.set.json", EXAMPLES / f"{name}.certificate.json"
    assert all(file.stat().st_size < 16_000 for file in files)
    assert run(["verify", str(files[0]), "--explain", str(files[1])]) == 0
    shown = capsys.readouterr().out
    assert "yes of 'one', as its checker finds" in shown and "Traceback" not in shown
    certificate = Certificate.from_json(files[1].read_text())
    assert in_words(certificate, load_problem_set(files[0]).problems[0].problem).refusal is None


def test_the_examples_are_all_there_and_the_page_names_them() -> None:
    page = (EXAMPLES.parent / "proofs.md").read_text()
    assert {file.name.partition(".")[0] for file in EXAMPLES.glob("*.json")} == set(EXAMPLE_NAMES)
    for name in EXAMPLE_NAMES:
        assert f"`{name}`" in page


def test_a_certificate_of_another_set_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    code = run(
        ["verify", str(EXAMPLES / "reach.set.json"), "--explain", str(EXAMPLES / "farkas.certificate.json")]
    )
    assert code == 2 and "belongs to no problem of the set" in capsys.readouterr().err


def test_answers_are_explained_line_by_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = case("reach/six")
    problems, answers = tmp_path / "set.json", tmp_path / "answers.jsonl"
    problems.write_text(json.dumps(made.own))
    line = {"id": "one", "status": "UNREACHABLE", "q": None, "certificate": made.certificate}
    changed = copy.deepcopy(line)
    changed["certificate"]["margin"] *= 2.0
    answers.write_text(json.dumps(line) + "\n" + json.dumps(changed) + "\n")
    assert run(["verify", str(problems), "--explain", str(answers), "--json"]) == 1
    first, second = json.loads(capsys.readouterr().out)
    assert first["id"] == "one" and first["refusal"] is None
    assert "the margin is" in second["refusal"]
    assert run(["verify", "--explain", str(answers)]) == 0
    assert "not looked at" in capsys.readouterr().out


def test_verify_says_what_it_takes(capsys: pytest.CaptureFixture[str]) -> None:
    file = str(EXAMPLES / "reach.set.json")
    for words in (
        ["verify"],
        ["verify", file],
        ["verify", file, "a.jsonl", "--explain", "b.json"],
        ["verify", "--explain", "nowhere"],
    ):
        assert run(words) == 2
        assert capsys.readouterr().err
