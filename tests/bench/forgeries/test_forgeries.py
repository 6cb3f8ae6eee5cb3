"""Forged certificates: none is accepted, whatever it is made from; and those they are made from hold."""

from __future__ import annotations

import copy
import json
from pathlib import Path

import numpy as np
import pytest

from workcell.bench.forgeries.honest import NAMES, cases
from workcell.bench.forgeries.honest import case as made
from workcell.bench.forgeries.mutants import CHANGES, VALUES, forged
from workcell.bench.forgeries.table import exact_refusal, exact_rows, forgeries, forgery_rows, refusal
from workcell.ik.registry import PROOFS
from workcell.proofs.exact.problems import read_problems
from workcell.sets.problems import parse_problem_set
from workcell.sets.solving import verify_answers


def test_there_is_a_case_of_every_kind_of_proof() -> None:
    kinds = {case.certificate["kind"] for case in cases()}
    # those about mechanisms are forged in a bench of their own
    assert kinds == set(PROOFS) - {"farkas", "cidgik", "mechanism/1"}
    assert {case.certificate["scope"] for case in cases()} == {"kinematics", "geometry", "solution"}


@pytest.mark.parametrize("name", NAMES)
def test_honest_certificates_hold_where_they_belong_and_nowhere_else(name: str) -> None:
    case = made(name)
    assert refusal(case.problem(own=True), json.dumps(case.certificate)) is None
    assert "another problem" in str(refusal(case.problem(own=False), json.dumps(case.certificate)))
    assert refusal(case.problem(own=False), json.dumps(case.borrowed())) is not None


def test_of_hundreds_of_forgeries_none_is_accepted_and_none_ends_in_an_error() -> None:
    rows = forgery_rows(400, 1, None)
    assert sum(row["n"] for row in rows) == 400
    for row in rows:
        assert (row["accepted"], row["errors"]) == (0, 0), row["first"]


def test_the_second_checker_accepts_none_either() -> None:
    for row in exact_rows(45, 1, None):
        assert (row["accepted"], row["errors"]) == (0, 0), row["first"]


@pytest.mark.parametrize("name", [name for name in NAMES if "six" in name])
def test_both_checkers_accept_the_honest_ones(name: str, tmp_path: Path) -> None:
    case = made(name)
    (tmp_path / "set.json").write_text(json.dumps(case.own))
    problem = read_problems(tmp_path / "set.json")["one"]
    assert exact_refusal(problem, json.dumps(case.certificate)) is None
    assert refusal(case.problem(own=True), json.dumps(case.certificate)) is None


def test_the_same_seed_forges_the_same() -> None:
    one, two = ([forgery.text for forgery in forgeries(60, 7)] for _ in range(2))
    assert one == two and len(set(one)) > 40


@pytest.mark.parametrize("name", [name for name in NAMES if "six" in name])
def test_no_number_of_any_array_can_be_replaced_by_what_is_none(name: str) -> None:
    case = made(name)
    problem, document = case.problem(own=True), case.certificate
    for array, entry in document["data"].items():
        if not entry["values"]:
            continue
        for value in VALUES:
            if type(value) in (int, float) and abs(value) <= 1e50:
                continue
            changed = copy.deepcopy(document)
            changed["data"][array]["values"][-1] = value
            text = json.dumps(changed)
            reason = refusal(problem, text)
            assert reason is not None and array in reason, (array, value)


def test_a_ray_of_nothing_but_a_trace_proves_nothing() -> None:
    """The cone that a careless test allows: zeros, and one entry just below zero."""
    case = made("farkas/seven")
    for name in ("axes", "position", "limits", "chords"):
        for trace in (-0.99e-9, 0.99e-9, -1e-300, 5e-324):
            document = case.borrowed()
            for other in ("axes", "position", "limits", "chords"):
                document["data"][other]["values"] = [0.0] * len(document["data"][other]["values"])
            document["data"][name]["values"][-1] = trace
            assert refusal(case.problem(own=False), json.dumps(document)) is not None


def test_multipliers_of_what_is_zero_anyway_prove_nothing() -> None:
    """The axis of the first joint is shared by a planar link whatever it is: F is zero but for rounding."""
    case, rng = made("farkas/seven"), np.random.default_rng(0)
    for _ in range(50):
        document = case.borrowed()
        for name in ("position", "limits", "chords"):
            document["data"][name]["values"] = [0.0] * len(document["data"][name]["values"])
        axes = np.zeros((7, 3))
        axes[0] = rng.standard_normal(3)
        document["data"]["axes"]["values"] = axes.ravel().tolist()
        assert "margin -" in str(refusal(case.problem(own=False), json.dumps(document)))


def test_every_change_changes_something() -> None:
    rng = np.random.default_rng(3)
    others = [case.borrowed() for case in cases()]
    for change in CHANGES:
        texts = {forged(others[0], change, rng, others[1:]) for _ in range(20)}
        assert len(texts) > 1, change


def test_a_file_of_forged_answers_is_refused_line_by_line(tmp_path: Path) -> None:
    """As `workcell verify` meets them: inline, whatever they are, and never an end without a report."""
    case, scopes = made("farkas/six"), {"kinematics": "UNREACHABLE", "geometry": "BLOCKED"}
    problems = parse_problem_set(case.twin)
    lines = 0
    for forgery in forgeries(300, 5):
        if forgery.own or forgery.case.name != "farkas/six":
            continue
        try:
            certificate = json.loads(forgery.text)
        except ValueError:
            continue
        status = scopes.get(str(certificate.get("scope")), "UNREACHABLE")
        answers = tmp_path / f"{lines}.jsonl"
        answers.write_text(json.dumps({"id": "one", "status": status, "q": None, "certificate": certificate}))
        report = verify_answers(problems, answers)
        assert report.proved == report.solved == 0 and len(report.refused) == 1
        lines += 1
    assert lines > 10
