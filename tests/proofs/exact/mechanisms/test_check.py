"""Two checkers that share no code agree about proofs on mechanisms, number by number, and refuse the same."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.ik.ikspark.mechanisms.test_claim import (
    at,
    certificate_of,
    cost_multipliers,
    four_bar,
    platform,
    two_arms,
)
from tests.ik.mechanisms.planted import planted
from tests.ik.mechanisms.proofs.rows import random_multipliers
from workcell.ik.certificate import Certificate
from workcell.ik.ikspark.mechanisms.claim import certify_cost
from workcell.ik.ikspark.mechanisms.hanging import ways_to_hang
from workcell.ik.mechanisms.check import asked_for, check_mechanism, cost_bound, margin
from workcell.ik.mechanisms.document import question_document
from workcell.ik.mechanisms.goals import FrameGoal, InRegion
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.proofs.graph import Graph
from workcell.pose import Pose
from workcell.proofs.exact.certificates import read_certificate
from workcell.proofs.exact.mechanisms.__main__ import main
from workcell.proofs.exact.mechanisms.bound import upper_bound
from workcell.proofs.exact.mechanisms.check import check
from workcell.proofs.exact.mechanisms.derived import derive
from workcell.proofs.exact.mechanisms.hanging import Hanging
from workcell.proofs.exact.mechanisms.multipliers import read_multipliers
from workcell.proofs.exact.mechanisms.question import read_question
from workcell.proofs.exact.mechanisms.sums import Sum
from workcell.proofs.exact.reading import RefusedError
from workcell.proofs.exact.spans import ONE, span

Z = np.array([0.0, 0.0, 1.0])
FOLDER = Path(__file__).parents[4] / "docs" / "proofs" / "mechanisms"


def document_of(m, by, covered, kind="mechanism/1"):
    data = {**m.parts(), "hangs": by.astype(float), "tolerances": covered}
    return Certificate(kind, "kinematics", "", 1.0, "0" * 64, data).to_json()


def exactly(problem, document, *, near=None):
    """U(F) and z in whole numbers, as doubles."""
    question = read_question(json.loads(json.dumps(question_document(problem))))
    m = read_multipliers(question, read_certificate(document))
    covered = tuple(span(value) for value in m.tolerances)
    reached = near is None
    derived = derive(question, covered, covered[0] if reached else span(near))
    sums = Sum(question, derived, m, covered, reached=reached)
    hanging = Hanging(question, derived, m.hangs, covered[2], reached=reached)
    value = upper_bound(question, derived, m, sums, hanging, covered[1])
    assert value.high - value.low <= 1e-12 * ONE
    return value.high / ONE, m.size.high / ONE


@pytest.mark.parametrize("seed", range(30))
def test_bounds_are_the_same_whatever_the_multipliers(seed):
    problem, _ = planted(seed)
    rng, covered = np.random.default_rng(seed), asked_for(problem)
    for by in [np.full(problem.mechanism.link_count, -1), *ways_to_hang(problem, Graph.of(problem, covered))]:
        m = random_multipliers(problem, rng, 0.7)
        # half-spaces where nodes turn by a hinge
        held = [b for b in by.tolist() if 0 <= b < len(problem.mechanism.joints)]
        m.chords[held] = np.abs(rng.normal(size=len(held))) * (Graph.of(problem, covered).half[held] < np.pi)
        try:
            found = margin(problem, m, by, covered)
            value, size = exactly(problem, document_of(m, by, covered))
        except (ValueError, RefusedError):
            with pytest.raises(RefusedError):
                exactly(problem, document_of(m, by, covered))
            continue
        assert -value / size - 2e-9 == pytest.approx(found, abs=1e-11 * max(1.0, abs(found)))


@pytest.mark.parametrize("seed", range(8))
def test_bounds_on_costs_are_the_same(seed):
    problem, _ = planted(seed)
    rng, covered = np.random.default_rng(seed), asked_for(problem)
    by = ways_to_hang(problem, Graph.of(problem, covered, near=0.7), reached=False)[0]
    m = random_multipliers(problem, rng)
    found = cost_bound(problem, m, by, covered, 0.7)
    if not np.isfinite(found):
        return
    value, size = exactly(problem, document_of(m, by, covered, "mechanism_cost/1"), near=0.7)
    squares = 0.25 * float(np.sum(m.positions**2) + np.sum(m.rotations**2))
    assert -squares - value - 2e-9 * size - 1e-12 * squares == pytest.approx(found, abs=1e-11 * abs(found))


def out_of_reach():
    plane = InRegion.plane("pen", Z, 0.3)
    yield MechanismProblem(four_bar(), (FrameGoal.at("pen", [2.5, 0.0, 0.0]),))
    yield MechanismProblem(four_bar(), regions=(plane,))
    yield MechanismProblem(platform(), (FrameGoal.posed("plate", at(0.0, 0.0, 1.5)),))
    yield MechanismProblem(two_arms(), (FrameGoal.posed("bar", at(2.0)),))
    yield MechanismProblem(
        two_arms(), (FrameGoal.at("bar", [1.5, 0.0, 0.0]),), q_reference=two_arms().home, max_step=0.2
    )


@pytest.mark.parametrize("problem", list(out_of_reach()), ids=lambda problem: problem.mechanism.name)
def test_what_the_solver_proves_holds_for_both(problem, tmp_path, capsys):
    certificate = certificate_of(problem)
    assert certificate is not None and check_mechanism(problem, certificate) is None
    question, proof = question_document(problem), certificate.to_json()
    assert check(question, proof) == certificate.statement
    files = [tmp_path / "question.json", tmp_path / "proof.json"]
    for file, document in zip(files, (question, proof), strict=True):
        file.write_text(json.dumps(document))
    assert main(list(map(str, files))) == 0
    assert capsys.readouterr().out == f"holds: {certificate.statement}\n"
    files[1].write_text(json.dumps({**proof, "margin": 2.0 * proof["margin"]}))
    assert main(list(map(str, files))) == 1
    assert "it says a margin of" in capsys.readouterr().out
    for key, value in (
        ("kind", "mechanism/2"),
        ("scope", "geometry"),
        ("statement", "None."),
        ("margin", -proof["margin"]),
    ):
        with pytest.raises(RefusedError):
            check(question, {**proof, key: value})
    # asked for less strictly, or of a mechanism that is a little larger, it is another question
    wide = {**question, "tolerances": {**question["tolerances"], "closure": 1e-2}}
    with pytest.raises(RefusedError, match="tolerances"):
        check(wide, proof)


def test_a_bound_on_the_cost_holds_for_both():
    problem = MechanismProblem(platform(), (FrameGoal.posed("plate", Pose.from_xyz([0.5, 0.3, 1.6])),))
    _, errors, found = cost_multipliers(problem)
    _, certificate = certify_cost(problem, errors, found)
    question = question_document(problem)
    assert check(question, certificate.to_json()) == certificate.statement
    with pytest.raises(RefusedError, match="and proves"):
        check(question, replace(certificate, margin=1.001 * certificate.margin).to_json())


@pytest.mark.parametrize(
    ("change", "because"),
    [
        ({"format": "workcell-mechanism-question/2"}, "format"),
        ({"joints": []}, "nothing moves"),
        ({"joints": None}, "no 'joints'"),
        ({"tolerances": {}}, "position is no number"),
        ({"max_step": [0.1]}, "max_step has not 3 numbers"),
        ({"max_link_rotation": 0.1}, "bounds need a reference"),
        ({"closures": [{"kind": "rope", "links": [1, 2], "frames": [{}, {}]}]}, "connect or weld"),
        ({"goals": [{"link": 9, "xyz": [0, 0, 0], "quat": [1, 0, 0, 0]}]}, "is on no link"),
        ({"goals": [{"link": 1, "xyz": [0, 0, 0], "quat": [0, 0, 0, 0]}]}, "quaternion of a goal is zero"),
        (
            {
                "goals": [
                    {
                        "link": 1,
                        "xyz": [0, 0, 0],
                        "quat": [1, 0, 0, 0],
                        "rotation": [[1, 0, 0], [0, 1, 0], [0, 1e-6, 1]],
                    }
                ]
            },
            "rotation that is none",
        ),
        (
            {
                "goals": [
                    {
                        "link": 1,
                        "xyz": [0, 0, 0],
                        "quat": [1, 0, 0, 0],
                        "axis": [1, 0, 0],
                        "direction": [1, 1, 0],
                    }
                ]
            },
            "no unit vector",
        ),
    ],
)
def test_a_question_that_is_none_is_refused(change, because):
    question = question_document(MechanismProblem(four_bar(), (FrameGoal.at("pen", [2.5, 0.0, 0.0]),)))
    with pytest.raises(RefusedError, match=because):
        read_question({**question, **change})


@pytest.mark.parametrize("name", ["four_bar", "platform", "platform_cost"])
def test_an_example_of_the_document_holds(name):
    question, proof = (
        json.loads((FOLDER / f"{name}.{what}.json").read_text()) for what in ("question", "certificate")
    )
    assert check(question, proof) == proof["statement"]
    for entry in proof["data"].values():
        # a number that is not what it was is not what was proved, or proves less
        if any(entry["values"]):
            kept, entry["values"] = entry["values"], [-3.0 * value for value in entry["values"]]
            with pytest.raises(RefusedError):
                check(question, proof)
            entry["values"] = kept
