"""Re-checks certificates without any solver: a "no" is only as good as this."""

from __future__ import annotations

from workcell.ik.certificate import Certificate, problem_hash
from workcell.ik.elementary.bounds import check_last_link, check_reach
from workcell.ik.problem import IKProblem
from workcell.ik.result import Status

STATUS_OF_SCOPE = {
    "kinematics": Status.UNREACHABLE,
    "geometry": Status.BLOCKED,
    "model": Status.BLOCKED_IN_MODEL,
}
"""What a valid certificate of each scope awards."""


def check_certificate(problem: IKProblem, certificate: Certificate) -> str | None:
    """None when the certificate proves that `problem` has no solution in its scope, else why it doesn't."""
    if certificate.scope not in STATUS_OF_SCOPE:
        return f"the scope {certificate.scope!r} is unknown"
    if problem.inner is not None and certificate.problem_hash != problem_hash(problem):
        # what is impossible for something inside the real geometry is impossible for the real geometry
        problem = problem.inside() or problem
    if problem.goal != "pose" and certificate.kind not in ("branch", "cidgik"):
        return (
            f"proofs of kind {certificate.kind!r} are about whole poses, the problem about the {problem.goal}"
        )
    if certificate.kind == "farkas":
        from workcell.ik.ikspark.check import check_farkas

        return check_farkas(problem, certificate)
    if certificate.kind == "branch":
        from workcell.ik.branch.checker.check import check_branch

        return check_branch(problem, certificate)
    if certificate.kind == "cidgik":
        from workcell.ik.cidgik.check import check_cidgik

        return check_cidgik(problem, certificate)
    if certificate.kind not in ("reach", "last_link"):
        return f"proofs of kind {certificate.kind!r} are unknown (known: branch, cidgik, farkas, last_link, reach)"
    if certificate.problem_hash != problem_hash(problem):
        return "the certificate belongs to another problem"
    if certificate.kind == "last_link":
        return check_last_link(problem, certificate)
    if certificate.scope != "kinematics":
        return f"a reach bound is about the kinematics, not {certificate.scope!r}"
    return check_reach(problem, certificate)
