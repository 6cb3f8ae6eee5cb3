"""Re-checks certificates without any solver: a "no" is only as good as this."""

from __future__ import annotations

from workcell.geometry.types import obstacle_name
from workcell.ik.certificate import Certificate, problem_hash
from workcell.ik.problem import IKProblem
from workcell.ik.registry import PROOFS, load
from workcell.ik.result import Status

STATUS_OF_SCOPE = {
    "kinematics": Status.UNREACHABLE,
    "geometry": Status.BLOCKED,
    "model": Status.BLOCKED_IN_MODEL,
    "solution": Status.SOLVED,
}
"""What a valid certificate of each scope awards."""


def check_certificate(problem: IKProblem, certificate: Certificate) -> str | None:
    """None when the certificate proves that `problem` has no solution in its scope, else why it doesn't.

    One of scope `solution` proves instead that what is in it is one.
    """
    if certificate.scope not in STATUS_OF_SCOPE:
        return f"the scope {certificate.scope!r} is unknown"
    if problem.inner is not None and certificate.problem_hash != problem_hash(problem):
        # what is impossible for something inside the real geometry is impossible for the real geometry
        problem = problem.inside() or problem
    entry = PROOFS.get(certificate.kind)
    if entry is None:
        return f"proofs of kind {certificate.kind!r} are unknown (known: {', '.join(PROOFS)})"
    if problem.goal not in entry.goals:
        return (
            f"proofs of kind {certificate.kind!r} are about whole poses, the problem about the {problem.goal}"
        )
    refusal: str | None = load(entry.check)(problem, certificate)
    return refusal


def obstacles_used(problem: IKProblem, certificate: Certificate) -> set[str] | None:
    """Names of the obstacles that a proof uses; None where it does not say."""
    if certificate.scope == "kinematics":
        return set()
    if problem.inner is not None and certificate.problem_hash != problem_hash(problem):
        problem = problem.inside() or problem
    tells = PROOFS[certificate.kind].obstacles
    return {obstacle_name(problem.obstacles[k]) for k in load(tells)(certificate)} if tells else None
