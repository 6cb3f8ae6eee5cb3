"""Farkas rays of the relaxation as certificates, made and re-checked without a solver.

Every configuration that reaches the goal gives a lifted x with `S(goal) (x, 1)` in the cone K. For z in the dual
cone K*, `z . S(goal) (x, 1) >= 0` at such an x. But x lies in a product of sets over which a linear function is
maximised in closed form, matrices Q >= 0 of trace 1 (largest eigenvalue) and unit discs (norm), so an upper bound
below zero proves that there is no such x: no residual of a solver enters. S is affine in the goal, which bounds how
much the value can grow when the target moves within a tolerance; a certificate is issued only when it holds there.
"""

from __future__ import annotations

import numpy as np

from workcell.errors import InputError
from workcell.ik.certificate import Certificate, problem_hash, proof_scope
from workcell.ik.ikspark.instance import relaxation_of
from workcell.ik.ikspark.lift import Lift, goal_vector
from workcell.ik.ikspark.relaxation import Relaxation
from workcell.ik.problem import IKProblem
from workcell.ik.shared.conic import smat
from workcell.ik.shared.limits import Interval
from workcell.pose import Array

ROUNDING = 1e-9
"""Part of the value (for |z| = 1) that rounding may account for."""


def ray_value(relaxation: Relaxation, tensor: Array, z: Array, goal: Array) -> tuple[float, Array]:
    """Upper bound of `z . S(goal) (x, 1)` over all lifted x, and z . S as a matrix (N + 1, 13) in (x, 1) and goal."""
    M = np.einsum("r,rxg->xg", z, tensor)
    return support(relaxation.lift, M @ goal), M


def support(lift: Lift, coefficients: Array) -> float:
    """Maximum of a function with coefficients (N + 1,) over (x, 1), blocks of trace 1 and unit discs."""
    balls = 10 * len(lift.balls)
    value = float(coefficients[-1])
    value += float(np.linalg.eigvalsh(smat(coefficients[:balls].reshape(-1, 10), 4))[:, -1].sum())
    return value + float(np.linalg.norm(coefficients[balls:-1].reshape(-1, 2), axis=1).sum())


def growth(lift: Lift, M: Array, position: float, rotation: float) -> float:
    """By how much (x, 1) M goal can grow when the goal moves by `position` metres and turns by `rotation` radians."""
    chord = 2.0 * np.sqrt(2.0) * np.sin(0.5 * min(rotation, np.pi))
    blocks = (
        [M[-1:]]
        + [M[start : start + 10] for start in lift.ball_start]
        + [M[d.start : d.start + 2] for d in lift.discs]
    )
    moved = sum(float(np.linalg.norm(block[:, 1:4])) for block in blocks)
    turned = sum(float(np.linalg.norm(block[:, 4:])) for block in blocks)
    return position * moved + float(chord) * turned


def dual_head(relaxation: Relaxation, z: Array) -> Array:
    """The part of a ray (rows,) on the changing rows, brought into the dual cone and to unit length."""
    projected = relaxation.cones.project_dual(z)[: relaxation.head]
    norm = float(np.linalg.norm(projected))
    scaled: Array = projected / norm if norm > 0 else projected
    return scaled


def certify_kinematics(problem: IKProblem, z: Array) -> Certificate | None:
    """A certificate of scope `kinematics` from a ray over the rows of `relaxation_of(problem)`, None if too weak.

    Args:
        problem: the problem; its obstacles play no part.
        z: (rows,) as a solver returns it; it need not be exact.
    """
    relaxation = relaxation_of(problem)
    ray = dual_head(relaxation, z)
    margin = _margin(problem, relaxation, ray, problem.tolerances.position, problem.tolerances.rotation)
    if margin <= 0.0:
        return None
    position, rotation = problem.tolerances.position, problem.tolerances.rotation
    return Certificate(
        kind="farkas",
        scope=proof_scope(problem, "chain"),
        statement=f"No configuration within the joint limits{_bounds(problem)} brings the tool within "
        f"{1e3 * position:g} mm and {rotation:g} rad of the target, obstacles aside.",
        margin=margin,
        problem_hash=problem_hash(problem),
        data={"ray": ray, "tolerance": np.array([position, rotation])},
    )


def _bounds(problem: IKProblem) -> str:
    """The bounds against the reference that the rows hold beside the limits, in words."""
    names = [name for name in ("max_step", "max_link_rotation") if getattr(problem, name) is not None]
    return f" and within {' and '.join(names)} of q_reference" if names else ""


def _margin(
    problem: IKProblem, relaxation: Relaxation, ray: Array, position: float, rotation: float
) -> float:
    tensor = relaxation.tensor(Interval.of(problem), problem)
    value, M = ray_value(relaxation, tensor, ray, goal_vector(problem.T_base_tool))
    return -value - growth(relaxation.lift, M, position, rotation) - ROUNDING


def _check_kinematics(problem: IKProblem, certificate: Certificate, tolerance: Array) -> str | None:
    try:
        relaxation = relaxation_of(problem)
    except InputError as error:
        return str(error)
    ray = numbers(certificate, "ray", relaxation.head)
    if ray is None:
        return "its ray is missing, damaged or of the wrong length"
    if (
        np.abs(dual_head(relaxation, np.concatenate([ray, np.zeros(len(relaxation.tail_b))])) - ray).max()
        > ROUNDING
    ):
        return "its ray is not in the dual cone"
    margin = _margin(problem, relaxation, ray, float(tolerance[0]), float(tolerance[1]))
    if not margin > 0.0:
        return f"its ray does not prove the claim: margin {margin:.3g}"
    return None


def numbers(certificate: Certificate, name: str, size: int) -> Array | None:
    """A certificate's vector of that name, or None unless it has that size and is finite."""
    values = certificate.data.get(name)
    if values is None or values.shape != (size,) or not np.all(np.isfinite(values)):
        return None
    return values
