"""Checks `farkas/2` certificates: form, margin and claim, from the chain itself and without a solver."""

from __future__ import annotations

import numpy as np

from workcell.ik.certificate import Certificate, Scope, proof_scope
from workcell.ik.claims.chain import Chain, unsuited
from workcell.ik.claims.form import (
    Shape,
    overclaims,
    whole_numbers,
    wrong_form,
    wrong_subject,
    wrong_tolerances,
)
from workcell.ik.ikspark.bound import ROUNDING, Multipliers, Sum, upper_bound
from workcell.ik.ikspark.cuboid_proof import held_back, moving_spheres
from workcell.ik.problem import STEP_SLACK, IKProblem
from workcell.pose import Array

KIND = "farkas/2"


def check_farkas(problem: IKProblem, certificate: Certificate) -> str | None:
    """Why a certificate of kind `farkas/2` proves nothing about `problem`, or None when it holds."""
    refusal = (
        wrong_subject(problem, certificate, KIND)
        or unsuited(problem)
        or wrong_form(certificate, _shapes(problem, certificate))
    )
    if refusal is not None:
        return refusal
    covered = certificate.data["tolerances"]
    m, refusal = _multipliers(problem, certificate)
    refusal = refusal or wrong_tolerances(problem, covered)
    if refusal is not None:
        return refusal
    assert m is not None
    found = margin(problem, m, covered)
    if not found > 0.0:
        return f"its ray does not prove the claim: margin {found:.3g}"
    return overclaims(certificate, scope_of(problem, m), found, statement(problem, m, covered))


def old_farkas(problem: IKProblem, certificate: Certificate) -> str | None:
    """Refuses what was written before `farkas/2`."""
    return (
        "proofs of kind 'farkas' rest on rows that their solver had reduced, and can't be checked from the chain; "
        f"ask ikspark again for one of kind {KIND!r}"
    )


def margin(problem: IKProblem, m: Multipliers, covered: Array) -> float:
    """By how much the multipliers prove that nothing reaches the target within `covered` (2,).

    Where it is not positive they prove nothing. A sphere that fits in no cuboid within reach is a proof by itself, of
    margin 1.
    """
    scaled = m.scaled() or m
    held = 0.0 if scaled.places is None else held_back(problem, scaled.places, covered)
    if held is None:
        return 1.0
    size, chain = scaled.length(), Chain.of(problem)
    if not size > 0.0:
        return -np.inf
    total = Sum(chain, scaled)
    total.constant += held
    if scaled.links is not None:
        assert problem.max_link_rotation is not None
        most = problem.max_link_rotation + STEP_SLACK
        total.add_references(scaled.links, _references(problem), most)
    if scaled.places is not None:
        assert problem.cover is not None
        chosen = moving_spheres(problem)
        links, centres = problem.cover.link[chosen], problem.cover.centre[chosen]
        total.add_places(chain, problem.robot.T_world_base, scaled.places, links, centres)
    value = upper_bound(chain, scaled, total, float(covered[0]), float(covered[1]))
    return -value / size - ROUNDING


def scope_of(problem: IKProblem, m: Multipliers) -> Scope:
    """What a proof is about."""
    return proof_scope(problem, "chain" if m.places is None else "cuboids")


def statement(problem: IKProblem, m: Multipliers, covered: Array) -> str:
    """The claim in words."""
    tolerances = f"{1e3 * float(covered[0]):g} mm and {float(covered[1]):g} rad"
    if m.places is not None:
        return (
            f"No configuration that brings the tool within {tolerances} of the target has every sphere of the cover "
            "inside one of the free-space cuboids."
        )
    names = [name for name in ("max_step", "max_link_rotation") if getattr(problem, name) is not None]
    bounds = f" and within {' and '.join(names)} of q_reference" if names else ""
    return (
        f"No configuration within the joint limits{bounds} brings the tool within {tolerances} of the target, "
        "obstacles aside."
    )


def _references(problem: IKProblem) -> Array:
    """(n - 1, 3, 3) rotations of links 1 ... n - 1 at the reference, in the base's frame."""
    assert problem.q_reference is not None
    R = problem.robot.link_transforms(problem.q_reference)[:, :3, :3]
    rotations: Array = (R[0].T @ R)[1:-1]
    return rotations


def _shapes(problem: IKProblem, certificate: Certificate) -> dict[str, Shape]:
    n = problem.robot.dof
    shapes: dict[str, Shape] = {
        "tolerances": (2,),
        "planar": (2,),
        "axes": (n, 3),
        "position": (3,),
        "limits": (n, 3),
        "chords": (2,),
    }
    if problem.max_link_rotation is not None and problem.q_reference is not None:
        shapes["links"] = (n - 1,)
    if "places" in certificate.data and problem.free_space is not None and problem.cover is not None:
        shapes["places"] = (len(moving_spheres(problem)), 3)
    return shapes


def _multipliers(problem: IKProblem, certificate: Certificate) -> tuple[Multipliers | None, str | None]:
    data, n = certificate.data, problem.robot.dof
    if not whole_numbers(data["planar"], n):
        return None, "the numbers of planar links are no whole numbers in range"
    first, last = (int(count) for count in data["planar"])
    if first + last > n - 1:
        return None, f"there are {n - 1} links between base and target, not {first + last}"
    chords, links = data["chords"], data.get("links")
    if not bool(np.all(chords >= 0.0)) or (links is not None and not bool(np.all(links >= 0.0))):
        return None, "a multiplier of an inequality is negative"
    if (chords[0] and not first) or (chords[1] and not last):
        return None, "a half-space of a joint's limits belongs to a planar link"
    m = Multipliers(
        (first, last), data["axes"], data["position"], data["limits"], chords, links, data.get("places")
    )
    return m, None
