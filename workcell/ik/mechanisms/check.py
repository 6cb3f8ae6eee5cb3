"""Checks certificates about mechanisms: form, bound and claim, from the mechanism itself and without a solver."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from workcell.ik.certificate import Certificate, Scope
from workcell.ik.claims.form import WIDEST, overclaims, wrong_form
from workcell.ik.mechanisms.chains.check import KIND as CHAIN_KIND
from workcell.ik.mechanisms.chains.check import check_chain
from workcell.ik.mechanisms.hashing import mechanism_hash
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.proofs.bound import ROUNDING, upper_bound
from workcell.ik.mechanisms.proofs.graph import Graph, unsuited
from workcell.ik.mechanisms.proofs.hangs import Hangs
from workcell.ik.mechanisms.proofs.multipliers import Multipliers, misplaced, shapes
from workcell.ik.mechanisms.proofs.sums import Sum
from workcell.ik.mechanisms.proofs.words import nothing_is_closer, nothing_reaches
from workcell.pose import Array

KIND = "mechanism/1"
COST_KIND = "mechanism_cost/1"
SCOPE: Scope = "kinematics"


def check_mechanism(problem: MechanismProblem, certificate: Certificate) -> str | None:
    """Why a certificate of kind `mechanism/1` or `mechanism_chain/1` proves nothing about `problem`; None: it holds."""
    if certificate.kind == CHAIN_KIND:
        return check_chain(problem, certificate)
    refusal = _wrong(problem, certificate, KIND, None)
    if refusal is not None:
        return refusal
    covered, m, by = _numbers(certificate)
    try:
        found = margin(problem, m, by, covered)
    except ValueError as error:
        return str(error)
    if not found > 0.0:
        return f"its multipliers do not prove the claim: margin {found:.3g}"
    return overclaims(certificate, SCOPE, found, nothing_reaches(problem, covered))


def check_cost(problem: MechanismProblem, certificate: Certificate) -> float | None:
    """The bound that a certificate of kind `mechanism_cost/1` proves, or None when it proves none."""
    return certificate.margin if why_no_bound(problem, certificate) is None else None


def why_no_bound(problem: MechanismProblem, certificate: Certificate) -> str | None:
    """Why a certificate of kind `mechanism_cost/1` proves nothing about `problem`, or None when its bound holds."""
    if not certificate.margin > 0.0:
        return f"a bound of {certificate.margin:.6g} says nothing"
    # what would be closer than it says has its frames that near to their goals
    near = math.sqrt(certificate.margin)
    refusal = _wrong(problem, certificate, COST_KIND, near)
    if refusal is not None:
        return refusal
    covered, m, by = _numbers(certificate)
    try:
        found = cost_bound(problem, m, by, covered, near)
    except ValueError as error:
        return str(error)
    if not certificate.margin <= found:
        return f"its multipliers prove a bound of {found:.6g}, not of {certificate.margin:.6g} as it says"
    if certificate.scope != SCOPE:
        return f"the scope {certificate.scope!r} is not what it proves: that is of the scope {SCOPE!r}"
    words = nothing_is_closer(problem, covered, certificate.margin)
    return (
        None if certificate.statement == words else f"the statement is not what is proved, which is: {words}"
    )


def margin(problem: MechanismProblem, m: Multipliers, by: NDArray[np.int64], covered: Array) -> float:
    """By how much multipliers prove that nothing answers the question; they prove nothing where it is not positive.

    Raises:
        ValueError: a node hangs by what does not hold it.
    """
    scaled = m.scaled()
    if scaled is None:
        return -math.inf
    graph = Graph.of(problem, covered)
    total, hangs = Sum(problem, graph, scaled, covered), Hangs(problem, graph, by, float(covered[2]))
    return -upper_bound(graph, scaled, total, hangs, covered) / scaled.length() - ROUNDING


def cost_bound(
    problem: MechanismProblem, m: Multipliers, by: NDArray[np.int64], covered: Array, near: float
) -> float:
    """What the sum of squared errors is never below where no position is off by more than `near` metres.

    With e the errors and g half the multipliers of positions and rotations, their signs turned:
    `|e|^2 >= 2 <g, e> - |g|^2`, and F is `-2 <g, e>` and what is zero or more at every configuration.

    Raises:
        ValueError: a node hangs by what does not hold it.
    """
    graph = Graph.of(problem, covered, near=near)
    total = Sum(problem, graph, m, covered, reached=False)
    hangs = Hangs(problem, graph, by, float(covered[2]), reached=False)
    squared = 0.25 * float(np.sum(m.positions**2) + np.sum(m.rotations**2))
    value = upper_bound(graph, m, total, hangs, covered)
    return -squared - value - ROUNDING * m.length() - 1e-12 * squared


def _wrong(problem: MechanismProblem, certificate: Certificate, kind: str, near: float | None) -> str | None:
    """Why a certificate is not one of a kind about a problem, each number of it in its place; None if it is."""
    if certificate.kind != kind:
        return f"it is of kind {certificate.kind!r}, not {kind!r}"
    if certificate.problem_hash != mechanism_hash(problem):
        return "it belongs to another problem"
    refusal = wrong_form(certificate, shapes(problem)) or _wrong_tolerances(problem, certificate)
    if refusal is not None:
        return refusal
    by = certificate.data["hangs"]
    most = 2 * len(problem.mechanism.joints) + len(problem.mechanism.closures) + len(problem.goals)
    if not bool(np.all((by >= -1) & (by < most) & (np.floor(by) == by))):
        return "what nodes hang by is no whole number in range"
    covered, m, _ = _numbers(certificate)
    return unsuited(problem, covered, near=near) or misplaced(problem, m)


def _wrong_tolerances(problem: MechanismProblem, certificate: Certificate) -> str | None:
    covered, asked = certificate.data["tolerances"], asked_for(problem)
    if not bool(np.all(covered >= asked)):
        return "the covered tolerances are narrower than those of the problem"
    if not bool(np.all(covered <= WIDEST)):
        return f"the covered tolerances exceed {WIDEST:g} m or rad"
    return None


def asked_for(problem: MechanismProblem) -> Array:
    """(4,) the tolerances that a proof has to cover: positions, rotations, ties, regions."""
    allowed = problem.tolerances
    return np.array([allowed.position, allowed.rotation, allowed.closure, allowed.region])


def _numbers(certificate: Certificate) -> tuple[Array, Multipliers, NDArray[np.int64]]:
    data = certificate.data
    return data["tolerances"], Multipliers.of(data), np.asarray(data["hangs"]).astype(np.int64)
