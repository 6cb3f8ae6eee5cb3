"""What every checker asks: shapes, sizes, indices in range, and that nothing more is said than was found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.ik.lifted_arms import seven_axis
from workcell.ik.certificate import Certificate
from workcell.ik.claims.form import overclaims, whole_numbers, wrong_form, wrong_tolerances
from workcell.ik.problem import IKProblem, Tolerances

SHAPES = {"one": (3,), "two": (2, None)}


def certificate(**data: np.ndarray) -> Certificate:
    numbers = {"one": np.ones(3), "two": np.zeros((2, 5)), **data}
    return Certificate("reach", "kinematics", "So it is.", 0.5, "0" * 64, numbers)


def test_the_right_arrays_are_right() -> None:
    assert wrong_form(certificate(), SHAPES) is None
    assert wrong_form(certificate(two=np.zeros((2, 0)), one=np.full(3, -1e50)), SHAPES) is None


@pytest.mark.parametrize(
    ("data", "because"),
    [
        ({"one": np.ones(4)}, "'one' is of shape [4], not [3]"),
        ({"two": np.ones(2)}, "'two' is of shape [2], not [2, any]"),
        ({"one": np.ones((3, 1))}, "'one' is of shape [3, 1]"),
        ({"one": np.array([1.0, np.nan, 0.0])}, "not finite"),
        ({"one": np.array([1.0, np.inf, 0.0])}, "not finite"),
        ({"one": np.array([1.0, -1.1e50, 0.0])}, "larger than 1e+50"),
        ({"three": np.ones(1)}, "'three' has no place in a proof of kind 'reach'"),
    ],
)
def test_wrong_arrays_are_named(data: dict[str, np.ndarray], because: str) -> None:
    assert because in str(wrong_form(certificate(**data), SHAPES))


def test_missing_arrays_are_named() -> None:
    assert wrong_form(certificate(), {**SHAPES, "three": (1,)}) == "'three' is missing"


@given(st.lists(st.floats(width=64), max_size=5), st.integers(0, 10))
def test_only_whole_numbers_in_range_become_indices(values: list[float], below: int) -> None:
    right = all(value in range(below) for value in values)
    assert whole_numbers(np.array(values, dtype=float), below) is right
    if right:
        assert all(0 <= int(value) < below for value in values)


def test_tolerances_are_neither_narrower_than_asked_for_nor_beyond_all_sense() -> None:
    robot = seven_axis()
    problem = IKProblem(robot, robot.fk(np.zeros(7)), tolerances=Tolerances(1e-3, 1e-2))
    assert wrong_tolerances(problem, np.array([1e-3, 1e-2, 0.0])) is None
    for values in ([1e-4, 1e-2, 0.0], [1e-3, 1e-3, 0.0], [1e-3, 1e-2, -1e-300], [np.nan, 1.0, 0.0]):
        assert "narrower" in str(wrong_tolerances(problem, np.array(values)))
    assert "exceed" in str(wrong_tolerances(problem, np.array([1e-3, 1.1, 0.0])))


def test_what_is_said_is_what_was_found() -> None:
    said = certificate()
    found = ("kinematics", 0.5, "So it is.")
    assert overclaims(said, *found) is None
    assert overclaims(replace(said, margin=0.5 + 4e-7), *found) is None
    assert "the margin is 0.5, not 0.501" in str(overclaims(replace(said, margin=0.501), *found))
    assert "the margin" in str(overclaims(replace(said, margin=0.499), *found))
    assert "the margin" in str(overclaims(replace(said, margin=float("nan")), *found))
    assert "of the scope 'kinematics'" in str(overclaims(replace(said, scope="geometry"), *found))
    assert "the statement" in str(overclaims(replace(said, statement="So it may be."), *found))
