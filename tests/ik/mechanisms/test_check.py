"""The checker believes nothing: what is damaged, overclaims or is forged is refused, and says why."""

import json
from dataclasses import replace

import numpy as np
import pytest

from tests.ik.mechanisms.planted import planted
from workcell.bench.forgeries.mutants import CHANGES, forged
from workcell.errors import InputError
from workcell.ik.certificate import Certificate
from workcell.ik.mechanisms.check import (
    COST_KIND,
    KIND,
    asked_for,
    check_cost,
    check_mechanism,
    margin,
    why_no_bound,
)
from workcell.ik.mechanisms.goals import FrameGoal
from workcell.ik.mechanisms.hashing import mechanism_hash
from workcell.ik.mechanisms.problem import MechanismProblem, MechanismTolerances
from workcell.ik.mechanisms.proofs.multipliers import Multipliers
from workcell.ik.mechanisms.proofs.words import nothing_reaches
from workcell.model.mechanism.mechanism import Closure, Frame, Joint, Mechanism
from workcell.pose import Pose

X, Y, Z = np.eye(3)
HERE = Pose.identity()


def slider(lower=-0.5, upper=0.5):
    """A carriage on a rail along x, on it a hinge about z and an arm of 1 m; a ball at its end carries a tool."""
    joints = (
        Joint("rail", "slide", 0, HERE, X, lower, upper),
        Joint("arm", "hinge", 1, HERE, Z, -1.0, 1.0),
        Joint("wrist", "ball", 2, Pose.from_xyz(X), np.zeros(3), 0.0, 1.0),
    )
    return Mechanism(
        "slider",
        joints,
        ("world", "carriage", "arm", "hand"),
        frames={"tool": Frame("tool", 3, HERE), "elbow": Frame("elbow", 2, Pose.from_xyz(X))},
    )


PROBLEM = MechanismProblem(slider(), (FrameGoal.at("elbow", [1.0, 1.2, 0.0]),))


def certificate(problem=PROBLEM, hangs=(-1.0, -1.0, 1.0, -1.0), covered=None, **numbers):
    """The multipliers, with what an honest certificate would say of them."""
    covered = asked_for(problem) if covered is None else np.array(covered)
    m = replace(Multipliers.none(problem), **{name: np.array(value) for name, value in numbers.items()})
    by = np.array(hangs).astype(np.int64)
    data = {**m.parts(), "hangs": np.array(hangs, dtype=float), "tolerances": covered}
    found = margin(problem, m, by, covered)
    return Certificate(
        KIND, "kinematics", nothing_reaches(problem, covered), found, mechanism_hash(problem), data
    )


PROOF = certificate(positions=[Y])
"""The elbow is at most 1 m from the rail, whose rotation is known: `y - 1.2` is below zero everywhere."""


def test_an_honest_proof_holds():
    # the arm's angle is at most 1 rad: with its half-space, or without
    assert check_mechanism(PROBLEM, PROOF) is None
    assert PROOF.margin == pytest.approx(0.2, abs=1e-3)
    assert certificate(positions=[Y], chords=[0.0, 0.3, 0.0]).margin > 0.2
    assert check_mechanism(PROBLEM, certificate(positions=[Y], chords=[0.0, 0.3, 0.0])) is None
    assert PROOF.statement == (
        "No configuration within the joint limits reaches all goals within 0.1 mm and 0.001 rad, obstacles aside."
    )
    again = Certificate.from_json(json.loads(json.dumps(PROOF.to_json())))
    assert check_mechanism(PROBLEM, again) is None


def test_slides_are_as_long_as_they_are():
    far = replace(PROBLEM, goals=(FrameGoal.at("elbow", [1.6, 0.0, 0.0]),))
    assert check_mechanism(far, certificate(far, positions=[X])) is None
    longer = replace(far, mechanism=slider(upper=0.7))
    assert "margin" in check_mechanism(longer, certificate(longer, positions=[X]))
    endless = replace(far, mechanism=slider(upper=np.inf))
    assert "margin" in check_mechanism(endless, certificate(endless, positions=[X]))
    # across the rail it does not matter, and the goal bounds how far it can be
    across = replace(PROBLEM, mechanism=slider(-np.inf, np.inf))
    assert check_mechanism(across, certificate(across, positions=[Y])) is None


def changed(certificate=PROOF, /, **changes):
    return replace(certificate, **changes)


def with_data(**arrays):
    return replace(PROOF, data={**PROOF.data, **{name: np.array(value) for name, value in arrays.items()}})


@pytest.mark.parametrize(
    ("certificate", "because"),
    [
        (changed(kind="farkas/2"), "of kind 'farkas/2'"),
        (changed(kind=COST_KIND), "of kind 'mechanism_cost/1'"),
        (changed(problem_hash="0" * 64), "another problem"),
        (changed(scope="geometry"), "scope 'geometry'"),
        (changed(statement=PROOF.statement + " None at all."), "the statement is not what is proved"),
        (changed(margin=PROOF.margin + 1e-3), "the margin is"),
        (changed(margin=-PROOF.margin), "the margin is"),
        (with_data(positions=[-Y]), "do not prove the claim"),
        (with_data(positions=[[0.0, 0.0, 0.0]]), "do not prove the claim"),
        (with_data(positions=[-1.1e50 * Y]), "larger than"),
        (with_data(positions=[[np.nan, 0.0, 0.0]]), "not finite"),
        (with_data(positions=[Y, Y]), "of shape [2, 3], not [1, 3]"),
        (with_data(more=[1.0]), "'more' has no place"),
        (with_data(tolerances=[1e-4, 1e-3, 1e-6, 1e-7]), "narrower than those of the problem"),
        (with_data(tolerances=[0.9e-4, 1e-3, 1e-6, 1e-6]), "narrower"),
        (with_data(tolerances=[1.1, 1e-3, 1e-6, 1e-6]), "exceed 1"),
        (with_data(tolerances=[0.3, 1e-3, 1e-6, 1e-6]), "do not prove the claim"),
        (with_data(hangs=[-1.0, -1.0, 1.5, -1.0]), "no whole number in range"),
        (with_data(hangs=[-1.0, -1.0, 7.0, -1.0]), "no whole number in range"),
        (with_data(hangs=[-1.0, -1.0, 0.0, -1.0]), "does not hang by a hinge 0"),
        (with_data(hangs=[-1.0, -1.0, 2.0, -1.0]), "does not hang by a hinge 2"),
        (with_data(hangs=[-1.0, -1.0, 3.0, -1.0]), "does not hang by a goal 0"),
        (with_data(hangs=[-1.0, -1.0, 6.0, -1.0]), "is not known"),
        (with_data(hangs=[-1.0, -1.0, 6.0, 6.0]), "hangs on itself"),
        (with_data(axes=[X, X, X]), "'axes' multiplies nothing"),
        (with_data(limits=[X, X, X]), "'limits' multiplies nothing"),
        (with_data(turns=np.ones((3, 3, 3))), "'turns' multiplies nothing"),
        (with_data(steps=np.ones((3, 3, 3))), "'steps' multiplies nothing"),
        (with_data(rotations=np.ones((1, 3, 3))), "'rotations' multiplies nothing"),
        (with_data(directions=[X]), "'directions' multiplies nothing"),
        (with_data(cones=[1.0]), "'cones' multiplies nothing"),
        (with_data(links=np.ones(4)), "'links' multiplies nothing"),
        (with_data(chords=[0.0, -1.0, 0.0]), "negative: 'chords'"),
        (with_data(chords=[0.0, 0.3, 0.0], hangs=[-1.0, -1.0, -1.0, -1.0]), "the margin is"),
        (with_data(chords=[0.3, 0.0, 0.0]), "'chords' multiplies nothing"),
    ],
)
def test_what_is_wrong_is_said(certificate, because):
    assert because in check_mechanism(PROBLEM, certificate)
    assert why_no_bound(PROBLEM, certificate) is not None
    assert check_cost(PROBLEM, certificate) is None


def test_an_array_that_is_missing_is_named():
    data = {name: array for name, array in PROOF.data.items() if name != "closures"}
    assert check_mechanism(PROBLEM, replace(PROOF, data=data)) == "'closures' is missing"


def test_what_rounding_is_not_accounted_for_is_refused():
    far = replace(PROBLEM, goals=(FrameGoal.at("elbow", [0.0, 60.0, 0.0]),))
    assert "rounding is proved up to 50" in check_mechanism(far, certificate(far, positions=[Y]))
    chain = tuple(Joint(f"j{k}", "hinge", k, HERE, Z) for k in range(65))
    long = Mechanism("long", chain, tuple(map(str, range(66))), frames={"end": Frame("end", 65, HERE)})
    problem = MechanismProblem(long, (FrameGoal.at("end", [1.0, 0.0, 0.0]),))
    proof = certificate(problem, hangs=-np.ones(66), positions=[X])
    assert check_mechanism(problem, proof) == "there are 65 joints; the checker's rounding is proved up to 64"
    turned = replace(
        slider(), joints=(*slider().joints[:2], Joint("x", "hinge", 2, HERE, 1.001 * Z)), home=np.zeros(3)
    )
    problem = replace(PROBLEM, mechanism=turned)
    assert "no unit vector" in check_mechanism(problem, certificate(problem, positions=[Y]))
    odd = replace(PROBLEM, goals=(FrameGoal("elbow", np.array([1.0, 1.2, 0.0]), 1.001 * np.eye(3)),))
    assert "rotation that is none" in check_mechanism(odd, certificate(odd, positions=[Y]))


def test_a_floating_body_that_nothing_holds_proves_nothing():
    joints = (Joint("body", "free", 0, HERE, np.zeros(3)), Joint("arm", "hinge", 1, HERE, Z))
    mechanism = Mechanism(
        "loose",
        joints,
        ("world", "body", "arm"),
        (Closure("c", "connect", (1, 2), (Pose.from_xyz(X), Pose.from_xyz(3.0 * X))),),
        frames={"tool": Frame("tool", 2, HERE)},
    )
    problem = MechanismProblem(mechanism)
    # of a loop that hangs on the body its place says nothing
    inner = replace(Multipliers.none(problem), closures=np.array([X]))
    by = np.array([-1, -1, -1])
    assert np.isfinite(margin(problem, inner, by, asked_for(problem)))
    held = replace(mechanism, closures=(Closure("c", "connect", (0, 2), (HERE, Pose.from_xyz(X))),))
    problem = MechanismProblem(held, (FrameGoal.at("tool", [2.0, 0.0, 0.0]),))
    both = {"closures": np.array([X]), "positions": np.array([X])}
    m = replace(Multipliers.none(problem), **both)
    assert margin(problem, m, by, asked_for(problem)) > 0.1
    # one centimetre of tolerances is one centimetre less
    loose = np.array([1e-2, 1e-3, 1e-6, 1e-6])
    lost = margin(problem, m, by, asked_for(problem)) - margin(problem, m, by, loose)
    assert lost == pytest.approx((1e-2 - 1e-4) / np.sqrt(2.0), rel=1e-6)


def restated(problem, document):
    """What the cleverest forger says: the statement, hash and margin that a checker will compute."""
    try:
        found = Certificate.from_json(document)
        m = Multipliers.of(found.data)
        by = np.nan_to_num(np.clip(found.data["hangs"], -2.0, 1e3)).astype(np.int64)
        value = margin(problem, m, by, found.data["tolerances"])
        words = nothing_reaches(problem, found.data["tolerances"])
    except (InputError, KeyError, ValueError, IndexError, TypeError, AttributeError, FloatingPointError):
        return None
    if not np.isfinite(value):
        return None
    return replace(
        found,
        kind=KIND,
        scope="kinematics",
        statement=words,
        margin=value,
        problem_hash=mechanism_hash(problem),
    )


@pytest.mark.parametrize("seed", range(6))
def test_no_forger_proves_that_what_has_an_answer_has_none(seed):
    from workcell.ik.ikspark.mechanisms.claim import certify_empty
    from workcell.ik.ikspark.mechanisms.program import Program
    from workcell.ik.ikspark.mechanisms.relaxation import Relaxation

    problem, _ = planted(seed, MechanismTolerances(), worst=1.0)
    rng = np.random.default_rng(seed)
    goals = tuple(
        goal if goal.position is None else replace(goal, position=goal.position + rng.normal(size=3))
        for goal in problem.goals
    )
    moved = replace(problem, goals=goals)
    relaxation = Relaxation.of(moved)
    program = Program(relaxation.lift.size, relaxation.rows)
    z = program.contradiction
    if z is None:
        solution = program.solve(np.zeros(relaxation.lift.size))
        z = program.multipliers(solution.z) if solution.status == "infeasible" else None
    honest = None if z is None else certify_empty(moved, z)
    if honest is None:
        pytest.skip("the moved goal is within reach")
    document = {**honest.to_json(), "problem_hash": mechanism_hash(problem)}
    assert check_mechanism(problem, Certificate.from_json(document)) is not None
    for change in CHANGES:
        for _ in range(5):
            text = forged(document, change, rng, [document, PROOF.to_json()])
            try:
                certificate = Certificate.from_json(text)
            except InputError:
                continue
            assert check_mechanism(problem, certificate) is not None
            clever = restated(problem, text)
            assert clever is None or check_mechanism(problem, clever) is not None
