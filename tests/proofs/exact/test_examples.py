"""The examples of the document: accepted as they stand, refused when touched, no use for a target in reach."""

from __future__ import annotations

import copy
import json
import math
from pathlib import Path

import numpy as np
import pytest

from tests.proofs.exact.documents import matrix, quaternion
from workcell.proofs.exact.kinematics import check_configuration
from workcell.proofs.exact.problems import read_problems
from workcell.proofs.exact.reading import RefusedError
from workcell.proofs.exact.tree import walk
from workcell.proofs.exact.verdicts import RULES, check

FOLDER = Path(__file__).parents[3] / "docs" / "proofs"
NAMES = sorted(file.name.removesuffix(".set.json") for file in FOLDER.glob("*.set.json"))
PROOFS = [name for name in NAMES if name != "solution"]
FORGERIES = 150


def example(name):
    (problem,) = read_problems(FOLDER / f"{name}.set.json").values()
    return problem, json.loads((FOLDER / f"{name}.certificate.json").read_text())


@pytest.fixture
def few_pieces(monkeypatch):
    """A leaf that does not hold is given up soon."""
    monkeypatch.setattr(walk, "PIECES_A_LEAF", 100)
    monkeypatch.setattr(walk, "PIECES_BEYOND", 500)


@pytest.mark.parametrize("name", NAMES)
def test_an_example_holds(name):
    problem, certificate = example(name)
    check(problem, certificate)


def test_there_is_one_of_every_kind():
    assert {example(name)[1]["kind"] for name in NAMES} == set(RULES)


@pytest.mark.parametrize("name", NAMES)
def test_what_it_says_is_not_believed(name, few_pieces):
    problem, certificate = example(name)
    margin = certificate["margin"]
    scopes = {"kinematics", "geometry", "model", "solution", "none"} - {certificate["scope"]}
    for change in (
        *({"scope": scope} for scope in scopes),
        *({"margin": value} for value in (0, -margin, 2 * margin, 0.9 * margin, float("nan"), float("inf"))),
        *({"kind": kind} for kind in set(RULES) - {certificate["kind"]}),
        {"statement": certificate["statement"] + " "},
        {"statement": None},
        {"data": None},
        {"data": {}},
    ):
        with pytest.raises(RefusedError):
            check(problem, certificate | change)


@pytest.mark.parametrize("name", NAMES)
def test_arrays_that_are_none_are_refused(name, few_pieces):
    problem, certificate = example(name)
    for array in certificate["data"]:
        for change in (
            {"shape": [-1], "values": []},
            {"shape": [1.0], "values": [0.0]},
            {"shape": [True], "values": [0.0]},
            {"shape": [2], "values": [0.0]},
            {"shape": [1], "values": [None]},
            {"shape": [1], "values": ["0"]},
            {"shape": [1], "values": [10**400]},
            {"shape": [1] * 5, "values": [0.0]},
            {"values": [0.0]},
            None,
            [],
        ):
            forged = copy.deepcopy(certificate)
            forged["data"][array] = change
            with pytest.raises(RefusedError):
                check(problem, forged)
        for value in (float("nan"), float("inf"), 1e51, -1e300, 2.0**63):
            forged = copy.deepcopy(certificate)
            if array != "seal" and forged["data"][array]["values"]:
                forged["data"][array]["values"][-1] = value
                with pytest.raises(RefusedError):
                    check(problem, forged)


def reached(name, folder, rng):
    """The example's problem with the target of a configuration that is admissible and clear."""
    document = json.loads((FOLDER / f"{name}.set.json").read_text())
    robot = document["robot"]
    for _ in range(200):
        q = [rng.uniform(j["lower"], j["upper"]) for j in robot["joints"]]
        R, p = np.eye(3), np.zeros(3)
        for j, angle in zip(robot["joints"], q, strict=True):
            p = p + R @ j["xyz"]
            axis = np.array(j["axis"]) / np.linalg.norm(j["axis"])
            R = R @ matrix(j["quat"]) @ matrix([math.cos(angle / 2), *(math.sin(angle / 2) * axis)])
        xyz = (p + R @ robot["tool"]["xyz"]).tolist()
        turned = quaternion(R @ matrix(robot["tool"]["quat"]))
        document["problems"][0]["target"] = {"xyz": xyz, "quat": turned}
        file = folder / "reached.json"
        file.write_text(json.dumps(document))
        (problem,) = read_problems(file).values()
        try:
            check_configuration(problem, q)
        except RefusedError:
            continue
        return problem
    raise AssertionError("no configuration is clear")


@pytest.mark.parametrize("name", PROOFS)
def test_no_forgery_proves_that_what_is_reached_is_not(name, tmp_path, few_pieces):
    """Numbers of the example scaled, swapped, negated, made tiny or huge; what is said is what would be computed."""
    rng = np.random.default_rng(len(name))
    certificate = example(name)[1]
    rule = RULES[certificate["kind"]]
    for k in range(FORGERIES if name[:6] != "branch" else 12):
        if k % 30 == 0:
            problem = reached(name, tmp_path, rng)
        forged = copy.deepcopy(certificate)
        for array in forged["data"].values():
            if rng.uniform() < 0.4 and array["values"]:
                array["values"] = touched(array["values"], rng)
        with pytest.raises(RefusedError):
            check(problem, forged)
            raise AssertionError(f"accepted: {rule} of {forged}")


def touched(values, rng):
    numbers = np.array(values)
    which = rng.uniform(size=len(numbers)) < rng.uniform()
    how = rng.integers(7)
    if how == 0:
        numbers[which] *= rng.normal()
    elif how == 1:
        numbers[which] = -numbers[which]
    elif how == 2:
        numbers = rng.permutation(numbers)
    elif how == 3:
        numbers[which] = 0.0
    elif how == 4:
        numbers[which] += rng.normal(size=which.sum())
    elif how == 5:
        numbers[which] *= 10.0 ** rng.integers(-12, 12)
    else:
        numbers[which] = np.round(numbers[which])
    return numbers.tolist()
