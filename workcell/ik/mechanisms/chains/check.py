"""Certificates that a serial chain of a mechanism can't do what is asked, and their checker.

The checker makes the chain's question from the mechanism itself, and has the tree of boxes checked by who checks those
of serial robots (`workcell.ik.branch.checker`), which shares nothing with the search that made it.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from workcell.ik.certificate import Certificate, Scope, problem_hash
from workcell.ik.claims.form import Shape, wrong_form
from workcell.ik.mechanisms.chains.query import ChainQuery, NoChainError, chain_query
from workcell.ik.mechanisms.chains.ways import LONGEST_WAY, Way
from workcell.ik.mechanisms.hashing import mechanism_hash
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.registry import PROOFS, load
from workcell.pose import Array

KIND = "mechanism_chain/1"
SCOPE: Scope = "kinematics"
_TREE: Mapping[str, Shape] = {
    "tree": (None,),
    "splits": (None,),
    "blocked": (2, 0),
    "root": (2, None),
    "inflation": (2,),
    "clearance": (1,),
    "seal": (8,),
}
"""Arrays of the tree, without collisions."""


def chain_certificate(problem: MechanismProblem, way: Way, proof: Certificate) -> Certificate:
    """A certificate about a mechanism, from one of kind `branch` about `chain_query(problem, way).problem`."""
    data = {**proof.data, "way": np.array(way.edges, dtype=float), "goal": np.array([way.goal], dtype=float)}
    return Certificate(KIND, SCOPE, statement(problem, way), proof.margin, mechanism_hash(problem), data)


def check_chain(problem: MechanismProblem, certificate: Certificate) -> str | None:
    """Why a certificate of kind `mechanism_chain/1` proves nothing about `problem`, or None when it holds."""
    if certificate.kind != KIND:
        return f"it is of kind {certificate.kind!r}, not {KIND!r}"
    if certificate.problem_hash != mechanism_hash(problem):
        return "it belongs to another problem"
    refusal = wrong_form(certificate, {**_TREE, "way": (None,), "goal": (1,)})
    if refusal is not None:
        return refusal
    numbers = np.concatenate([certificate.data["way"], certificate.data["goal"]])
    if len(numbers) > LONGEST_WAY + 1 or not bool(np.all(np.floor(numbers) == numbers)):
        return "the way is none"
    way = Way(tuple(int(k) for k in numbers[:-1]), int(numbers[-1]))
    try:
        query = chain_query(problem, way)
    except NoChainError as error:
        return f"the way is none: {error}"
    if certificate.scope != SCOPE:
        return f"the scope {certificate.scope!r} is not what it proves: that is of the scope {SCOPE!r}"
    if certificate.statement != (words := statement(problem, way)):
        return f"the statement is not what is proved, which is: {words}"
    return _refusal_of_tree(query, certificate)


def _refusal_of_tree(query: ChainQuery, certificate: Certificate) -> str | None:
    data: dict[str, Array] = {name: certificate.data[name] for name in _TREE}
    words: str = load("workcell.ik.branch.checker.check:statement")(data)
    tree = Certificate("branch", SCOPE, words, certificate.margin, problem_hash(query.problem), data)
    refusal: str | None = load(PROOFS["branch"].check)(query.problem, tree)
    return refusal


def statement(problem: MechanismProblem, way: Way) -> str:
    """The claim in words."""
    allowed, joints = problem.tolerances, len(problem.mechanism.joints)
    step = "" if problem.max_step is None else " and within max_step of q_reference"
    passed = ", ".join(str(edge) for edge in way.edges if edge < joints)
    ties = [str(edge - joints) for edge in way.edges if edge >= joints]
    through = f" and ties {', '.join(ties)}" if ties else ""
    kept = (
        f" keeps the ties within {1e3 * allowed.closure:g} mm and {allowed.closure:g} rad and" if ties else ""
    )
    return (
        f"No configuration within the joint limits{step}{kept} reaches goal {way.goal} within "
        f"{1e3 * allowed.position:g} mm and {allowed.rotation:g} rad, obstacles aside: the chain of joints {passed}"
        f"{through} alone can't."
    )
