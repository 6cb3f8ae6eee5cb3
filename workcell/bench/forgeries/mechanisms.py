"""Forged certificates about mechanisms, handed to both checkers: how many they accept (none may be)."""

from __future__ import annotations

import contextlib
import copy
import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from workcell.bench.forgeries.mutants import CHANGES, Document, forged
from workcell.bench.forgeries.tally import Tally
from workcell.bench.rows import Bench, Row
from workcell.errors import WorkcellError
from workcell.ik.certificate import Certificate
from workcell.ik.ikspark.mechanisms.claim import certify_cost
from workcell.ik.mechanisms.check import COST_KIND, KIND, check_mechanism, cost_bound, margin, why_no_bound
from workcell.ik.mechanisms.document import question_document
from workcell.ik.mechanisms.goals import FrameGoal
from workcell.ik.mechanisms.hashing import mechanism_hash
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.proofs.multipliers import Multipliers
from workcell.ik.mechanisms.proofs.words import nothing_is_closer, nothing_reaches
from workcell.ik.problem import Budget
from workcell.ik.solve_mechanism import solve_mechanism
from workcell.model.mechanism.mechanism import Closure, Frame, Joint, Mechanism
from workcell.pose import Array, Pose
from workcell.proofs.exact.mechanisms.check import check
from workcell.proofs.exact.reading import RefusedError, parse

RESTATED = 0.5
"""Share of forgeries that say of themselves what a checker computes."""
_Z = np.array([0.0, 0.0, 1.0])
_NONE = np.zeros(3)


@dataclass(frozen=True, slots=True)
class MechanismCase:
    """A certificate, its question, and one of the same form whose goals are within reach."""

    name: str
    own: MechanismProblem
    twin: MechanismProblem
    certificate: Document

    def borrowed(self) -> Document:
        """The certificate as one who forges hands it in for the twin."""
        return {**copy.deepcopy(self.certificate), "problem_hash": mechanism_hash(self.twin)}


@lru_cache(maxsize=1)
def mechanism_cases() -> tuple[MechanismCase, ...]:
    """One of every sort of mechanism, and a bound on a cost."""
    bar, plate = four_bar(), platform()
    far, near = Pose.from_xyz([0.1, 0.0, 1.5]), Pose.from_xyz([0.1, 0.0, 1.0])
    pen = _reachable()
    asked = (
        ("four-bar", bar, FrameGoal.at("pen", [1.1, 0.9, 0.0]), FrameGoal.at("pen", pen)),
        ("platform", plate, FrameGoal.posed("plate", far), FrameGoal.posed("plate", near)),
        ("platform/place", plate, FrameGoal.at("plate", far.position), FrameGoal.at("plate", near.position)),
    )
    cases = [_case(name, mechanism, goals) for name, mechanism, *goals in asked]
    away = MechanismProblem(bar, (FrameGoal.at("pen", 4.0 * pen),))
    errors = np.zeros((1, 12))
    errors[0, 9:] = -2.0 * pen
    found = certify_cost(away, errors, {})
    assert found is not None
    twin = replace(away, goals=(FrameGoal.at("pen", pen),))
    return (*cases, MechanismCase("cost", away, twin, found[1].to_json()))


def _case(name: str, mechanism: Mechanism, goals: list[FrameGoal]) -> MechanismCase:
    own, twin = (MechanismProblem(mechanism, (goal,)) for goal in goals)
    result = solve_mechanism(own, budget=Budget(20.0))
    assert result.certificate is not None, name
    assert solve_mechanism(twin, budget=Budget(20.0)).solved, name
    return MechanismCase(name, own, twin, result.certificate.to_json())


def _reachable() -> Array:
    """Where the pen is with the crank along the ground: the coupler and the rocker meet above it."""
    c = (1.0 + 0.7**2 - 0.8**2) / 1.4
    s = np.sqrt(1.0 - c * c)
    pen: Array = np.array([0.3 + 0.5 * c - 0.2 * s, 0.5 * s + 0.2 * c, 0.0])
    return pen


def four_bar() -> Mechanism:
    """A crank of 0.3 m, a coupler of 1 m with a pen, a rocker of 0.8 m, a ground of 1 m."""
    start = Pose.identity()
    joints = (
        Joint("crank", "hinge", 0, start, _Z),
        Joint("coupler", "hinge", 1, Pose.from_xyz([0.3, 0.0, 0.0]), _Z),
        Joint("rocker", "hinge", 0, Pose.from_xyz([1.0, 0.0, 0.0]), _Z, -3.0, 3.0),
    )
    pin = (Pose.from_xyz([1.0, 0.0, 0.0]), Pose.from_xyz([0.8, 0.0, 0.0]))
    frames = {"pen": Frame("pen", 2, Pose.from_xyz([0.5, 0.2, 0.0]))}
    closures = (Closure("pin", "connect", (2, 3), pin),)
    return Mechanism("four-bar", joints, ("world", "crank", "coupler", "rocker"), closures, frames=frames)


def platform() -> Mechanism:
    """A plate that floats on six legs, each a ball, a slide and a connect."""
    joints, names, closures = [], ["world"], []
    for leg in range(6):
        foot, top = (
            Pose.from_xyz([radius * np.cos(angle), radius * np.sin(angle), 0.0])
            for radius, angle in ((0.5, leg * np.pi / 3), (0.3, 0.5 + leg * np.pi / 3))
        )
        joints.append(Joint(f"foot{leg}", "ball", 0, foot, _NONE))
        joints.append(Joint(f"leg{leg}", "slide", 2 * leg + 1, Pose.identity(), _Z, 0.7, 1.3))
        names += [f"foot{leg}", f"rod{leg}"]
        closures.append(Closure(f"top{leg}", "connect", (2 * leg + 2, 13), (Pose.identity(), top)))
    joints.append(Joint("plate", "free", 0, Pose.identity(), _NONE))
    frames = {"plate": Frame("plate", 13, Pose.identity())}
    return Mechanism("platform", tuple(joints), (*names, "plate"), tuple(closures), frames=frames)


def mechanism_forgeries(n: int, seed: int) -> Iterator[tuple[MechanismCase, str, str]]:
    """`n` of them: of which case, by which change, the text; each is handed in for the case's twin."""
    rng, every = np.random.default_rng(seed), mechanism_cases()
    borrowed = [case.borrowed() for case in every]
    changes = list(CHANGES)
    for k in range(n):
        case, change = every[k % len(every)], changes[(k // len(every)) % len(changes)]
        text = forged(borrowed[k % len(every)], change, rng, borrowed)
        yield case, change, restated(case.twin, text) if rng.random() < RESTATED else text


def restated(problem: MechanismProblem, text: str) -> str:
    """A certificate that says of itself what its numbers show, as far as they show anything."""
    clumsy = (WorkcellError, KeyError, ValueError, IndexError, TypeError, OverflowError)
    with contextlib.suppress(*clumsy), np.errstate(over="ignore", invalid="ignore"):
        found = Certificate.from_json(text)
        m, covered = Multipliers.of(found.data), found.data["tolerances"]
        by = np.clip(found.data["hangs"], -2.0, 1e3).astype(np.int64)
        if found.kind == COST_KIND:
            value = cost_bound(problem, m, by, covered, math.sqrt(max(found.margin, 0.0)))
            words = nothing_is_closer(problem, covered, value)
        else:
            value, words = margin(problem, m, by, covered), nothing_reaches(problem, covered)
        if np.isfinite(value):
            return json.dumps(replace(found, scope="kinematics", statement=words, margin=value).to_json())
    return text


def refusal(problem: MechanismProblem, text: str) -> str | None:
    """Why a certificate's text proves nothing of a question, or None: then it is taken for a proof."""
    try:
        certificate = Certificate.from_json(text)
    except WorkcellError as error:
        return str(error)
    checker = why_no_bound if certificate.kind == COST_KIND else check_mechanism
    return checker(problem, certificate)


def exact_refusal(problem: MechanismProblem, text: str) -> str | None:
    """The same by the second checker."""
    try:
        check(question_document(problem), parse(text))
    except RefusedError as error:
        return str(error)
    return None


def mechanism_rows(n: int, seed: int, sets: Path | None) -> list[Row]:
    """A row for each kind of proof and each checker."""
    checkers: dict[str, Callable[[MechanismProblem, str], str | None]] = {
        "first": refusal,
        "exact": exact_refusal,
    }
    tallies = {(kind, name): Tally() for kind in (KIND, COST_KIND) for name in checkers}
    for case, change, text in mechanism_forgeries(n, seed):
        for name, checker in checkers.items():
            tallies[str(case.certificate["kind"]), name].hand_in(
                f"{case.name}, {change}: ", text, checker, case.twin
            )
    return [tally.row(f"forgeries-mechanisms/{name}/{kind}") for (kind, name), tally in tallies.items()]


BENCHES = (
    Bench(
        "forgeries-mechanisms",
        2_000,
        "certificates about mechanisms that prove nothing, handed to both checkers (none may be accepted)",
        mechanism_rows,
    ),
)
