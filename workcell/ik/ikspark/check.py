"""Re-checks Farkas rays of IKSPARK's relaxation, without a solver, on the solver's own relaxation."""

from __future__ import annotations

from workcell.ik.certificate import Certificate, problem_hash
from workcell.ik.ikspark.rays import _check_kinematics, numbers
from workcell.ik.problem import IKProblem


def check_farkas(problem: IKProblem, certificate: Certificate) -> str | None:
    """Why a certificate of kind `farkas` proves nothing about `problem`, or None when it holds.

    The rows are rebuilt from the problem; no solver is used.
    """
    if certificate.kind != "farkas":
        return f"it is of kind {certificate.kind!r}, not 'farkas'"
    if certificate.problem_hash != problem_hash(problem):
        return "it belongs to another problem"
    tolerance = numbers(certificate, "tolerance", 2)
    allowed = problem.tolerances
    if tolerance is None or tolerance[0] < allowed.position or tolerance[1] < allowed.rotation:
        return "it does not cover the problem's tolerances"
    if certificate.scope == "kinematics":
        return _check_kinematics(problem, certificate, tolerance)
    if certificate.scope == "model":
        from workcell.ik.ikspark.cuboid_proof import check_model

        return check_model(problem, certificate, tolerance)
    return f"a farkas certificate can't be of scope {certificate.scope!r}"
