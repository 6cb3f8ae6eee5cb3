"""CIDGIK's proofs as certificates of an `IKProblem`, issued and checked by one arithmetic, without a solver."""

from __future__ import annotations

import numpy as np

from workcell.errors import InputError
from workcell.ik.certificate import Certificate, Scope, problem_hash, proof_scope
from workcell.ik.cidgik.instance import Instance
from workcell.ik.cidgik.model import relaxation_at
from workcell.ik.cidgik.proof import Proof, malformed, margin
from workcell.ik.cidgik.workspace import Keeper
from workcell.ik.elementary.bounds import WIDE
from workcell.ik.problem import IKProblem
from workcell.pose import Array

_PARTS = ("equalities", "limits", "keys", "rows", "S", "frames")


def certify(problem: IKProblem, proof: Proof) -> Certificate | None:
    """A certificate of what the multipliers prove of a problem, or None if that is too weak.

    It covers a millimetre, a hundredth of a radian and a millimetre of penetration where the margin allows, else the
    problem's own tolerances.
    """
    instance, keeper = relaxation_at(problem)
    asked = np.array([problem.tolerances.position, problem.tolerances.rotation, 0.0])
    for covered in (np.maximum(asked, WIDE), asked):
        found = margin(instance, keeper, proof, *map(float, covered))
        if found > 0:
            return _issued(problem, proof, covered, found)
    return None


def _issued(problem: IKProblem, proof: Proof, covered: Array, found: float) -> Certificate:
    tolerances = f"{1e3 * covered[0]:g} mm and {covered[1]:g} rad"
    if len(proof.keys):
        count = len(np.unique(proof.keys[:, 2]))
        statement = (
            f"No configuration within the joint limits brings the tool within {tolerances} of the target with all "
            f"spheres clear of {count} of the obstacles, {1e3 * covered[2]:g} mm of penetration allowed."
        )
    else:
        statement = (
            f"No configuration within the joint limits brings the tool within {tolerances} of the target, "
            "obstacles aside."
        )
    data = {name: getattr(proof, name) for name in _PARTS} | {"tolerances": covered}
    return Certificate("cidgik", _scope(problem, proof), statement, found, problem_hash(problem), data)


def _scope(problem: IKProblem, proof: Proof) -> Scope:
    return proof_scope(problem, "spheres" if len(proof.keys) else "chain")


def check_cidgik(problem: IKProblem, certificate: Certificate) -> str | None:
    """Why a certificate of kind `cidgik` proves nothing about `problem`, or None when it holds."""
    if certificate.kind != "cidgik":
        return f"it is of kind {certificate.kind!r}, not 'cidgik'"
    if certificate.problem_hash != problem_hash(problem):
        return "it belongs to another problem"
    covered = certificate.data.get("tolerances")
    allowed = problem.tolerances
    if covered is None or covered.shape != (3,) or not np.all(np.isfinite(covered)):
        return "the covered tolerances are missing or malformed"
    if covered[0] < allowed.position or covered[1] < allowed.rotation or covered[2] < 0:
        return "it does not cover the problem's tolerances"
    parts = {name: certificate.data.get(name) for name in _PARTS}
    if any(values is None for values in parts.values()):
        return "its multipliers are incomplete"
    try:
        instance, keeper = relaxation_at(problem)
    except InputError as error:
        return str(error)
    proof = Proof(**parts)  # type: ignore[arg-type]
    return _refusal(problem, certificate, instance, keeper, proof)


def _refusal(
    problem: IKProblem, certificate: Certificate, instance: Instance, keeper: Keeper | None, proof: Proof
) -> str | None:
    if proof.keys.ndim != 2 or proof.keys.shape[1] != 3:
        return "its multipliers are damaged or of another relaxation"
    refusal = malformed(instance, keeper, proof)
    if refusal is not None:
        return refusal
    scope = _scope(problem, proof)
    if certificate.scope != scope:
        return f"its scope is {certificate.scope!r}, but it proves something of {scope!r}"
    found = margin(instance, keeper, proof, *map(float, certificate.data["tolerances"]))
    return None if found > 0 else f"its multipliers do not prove the claim: margin {found:.3g}"
