"""Forged certificates about mechanisms: honest ones hold, false ones are refused by both checkers."""

import json

import pytest

from workcell.bench.forgeries.mechanisms import (
    exact_refusal,
    mechanism_cases,
    mechanism_forgeries,
    mechanism_rows,
    refusal,
    restated,
)
from workcell.ik.problem import Budget
from workcell.ik.solve_mechanism import solve_mechanism


@pytest.mark.parametrize("case", mechanism_cases(), ids=lambda case: case.name)
def test_a_case_holds_of_its_own_and_not_of_its_twin(case):
    text = json.dumps(case.certificate)
    assert refusal(case.own, text) is None and exact_refusal(case.own, text) is None
    assert solve_mechanism(case.twin, budget=Budget(20.0)).solved
    for lie in (json.dumps(case.borrowed()), restated(case.twin, json.dumps(case.borrowed()))):
        assert refusal(case.twin, lie) is not None and exact_refusal(case.twin, lie) is not None


def test_of_a_hundred_forgeries_none_is_accepted_and_none_ends_in_an_error():
    rows = mechanism_rows(112, 3, None)
    assert len(rows) == 4
    for row in rows:
        assert row["n"] > 0 and row["accepted"] == 0 and row["errors"] == 0, row["first"]


def test_the_same_seed_makes_the_same_forgeries():
    one, two = ([text for _, _, text in mechanism_forgeries(30, 7)] for _ in range(2))
    assert one == two
