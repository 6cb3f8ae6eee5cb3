"""Checks `cidgik/2` certificates: form, margin and claim, from the chain itself and without a solver."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from workcell.ik.certificate import Certificate, Scope, proof_scope
from workcell.ik.cidgik.gram import Multipliers, margin
from workcell.ik.claims.chain import unsuited
from workcell.ik.claims.form import (
    Shape,
    overclaims,
    whole_numbers,
    wrong_form,
    wrong_subject,
    wrong_tolerances,
)
from workcell.ik.problem import IKProblem
from workcell.pose import Array

KIND = "cidgik/2"
MOST_ROWS = 4096
"""Rows of spheres that are read at most; each is one product of vectors."""


def check_cidgik(problem: IKProblem, certificate: Certificate) -> str | None:
    """Why a certificate of kind `cidgik/2` proves nothing about `problem`, or None when it holds."""
    data = certificate.data
    refusal = (
        wrong_subject(problem, certificate, KIND)
        or unsuited(problem)
        or wrong_form(certificate, _shapes(problem, data))
        or wrong_tolerances(problem, data["tolerances"])
        or _wrong_numbers(problem, data)
    )
    if refusal is not None:
        return refusal
    m = multipliers(problem, data)
    found = margin(problem, m, data["tolerances"])
    if not found > 0.0:
        return f"its multipliers do not prove the claim: margin {found:.3g}"
    return overclaims(certificate, scope_of(problem, m), found, statement(m, data["tolerances"]))


def old_cidgik(problem: IKProblem, certificate: Certificate) -> str | None:
    """Refuses what was written before `cidgik/2`."""
    return (
        "proofs of kind 'cidgik' rest on vectors that their solver had chosen, and can't be checked from the chain; "
        f"ask cidgik again for one of kind {KIND!r}"
    )


def scope_of(problem: IKProblem, m: Multipliers) -> Scope:
    """What a proof is about."""
    return proof_scope(problem, "spheres" if len(m.keys) or len(m.pairs) else "chain")


def statement(m: Multipliers, covered: Array) -> str:
    """The claim in words."""
    tolerances = f"{1e3 * float(covered[0]):g} mm and {float(covered[1]):g} rad"
    begin = f"No configuration within the joint limits brings the tool within {tolerances} of the target"
    kept = []
    if len(m.keys):
        kept.append(f"of {len(np.unique(m.keys[:, 1]))} of the obstacles")
    if len(m.pairs):
        kept.append(f"in {len(m.pairs)} pairs of each other")
    if not kept:
        return f"{begin}, obstacles aside."
    allowed = f"{1e3 * float(covered[2]):g} mm of penetration allowed."
    return f"{begin} with all spheres clear {' and '.join(kept)}, {allowed}"


def multipliers(problem: IKProblem, data: Mapping[str, Array]) -> Multipliers:
    """The numbers of a certificate whose form is right."""
    return Multipliers(
        data["facts"],
        data["hands"],
        data["turned"],
        data["limits"],
        data["keys"].astype(np.int64),
        data["rows"],
        data.get("pairs", np.zeros((0, 2))).astype(np.int64),
        data.get("own", np.zeros(0)),
        data["S"],
        data["frames"],
    )


def _shapes(problem: IKProblem, data: Mapping[str, Array]) -> dict[str, Shape]:
    n = problem.robot.dof
    links = n - 1 if problem.goal == "pose" else n
    u = 3 * links + 3
    shapes: dict[str, Shape] = {
        "tolerances": (3,),
        "facts": (n + 2 if problem.goal == "axis" else n + 1, u),
        "hands": (n, 2),
        "turned": (2, 3),
        "limits": (n,),
        "keys": (None, 2),
        "rows": (len(data["keys"]) if "keys" in data and data["keys"].ndim else None,),
        "S": (u, None),
        "frames": (links, 4, 4),
    }
    if "pairs" in data and problem.self_collision is not None:
        shapes |= {"pairs": (None, 2), "own": (len(data["pairs"]) if data["pairs"].ndim else None,)}
    return shapes


def _wrong_numbers(problem: IKProblem, data: Mapping[str, Array]) -> str | None:
    if any(not bool(np.all(data[name] >= 0.0)) for name in ("limits", "rows", "own") if name in data):
        return "a multiplier of an inequality is negative"
    if data["S"].shape[1] > data["S"].shape[0]:
        return "the factor of the positive semidefinite matrix has more columns than rows"
    if max(len(data[name]) for name in ("keys", "pairs") if name in data) > MOST_ROWS:
        return f"it has more than {MOST_ROWS} rows of spheres"
    keys, spheres = data["keys"], 0 if problem.cover is None else len(problem.cover)
    if not whole_numbers(keys[:, 0], spheres) or not whole_numbers(keys[:, 1], len(problem.obstacles)):
        return "it names a sphere or an obstacle that isn't there"
    if any(problem.obstacles[int(o)].kind != "sphere" for o in keys[:, 1]):
        return "it names an obstacle that is no sphere"
    if "pairs" in data:
        known = {frozenset(pair) for pair in np.asarray(problem.self_collision).tolist()}
        if any(frozenset(pair) not in known for pair in data["pairs"].tolist()):
            return "it names a pair of spheres that may touch"
    return None
