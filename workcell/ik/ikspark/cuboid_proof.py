"""Proofs in IKSPARK's obstacle model: rays of the convex set with cuboids, issued and re-checked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from workcell.errors import InputError
from workcell.ik.certificate import Certificate, problem_hash, proof_scope
from workcell.ik.ikspark.cuboids import reachable_pairs, sphere_maps
from workcell.ik.ikspark.instance import relaxation_of
from workcell.ik.ikspark.lift import goal_vector
from workcell.ik.ikspark.rays import ROUNDING, dual_head, growth, numbers, support
from workcell.ik.problem import IKProblem
from workcell.ik.shared.limits import Interval
from workcell.pose import Array


def certify_model(problem: IKProblem, z: Array) -> Certificate | None:
    """A certificate of scope `model` from a ray as `CuboidSet.solve` returns it, or None if it is too weak."""
    relaxation = relaxation_of(problem)
    rows = relaxation.cones.rows
    head = relaxation.cones.project_dual(z[:rows])[: relaxation.head]
    # Clarabel's rows say A x + s = b: the multiplier of an equality `value = 0` enters with its sign turned
    places = -z[rows:]
    norm = float(np.linalg.norm(np.concatenate([head, places])))
    if norm == 0.0:
        return None
    return _issue(problem, head / norm, (places / norm).reshape(-1, 3))


def certify_homeless(problem: IKProblem) -> Certificate | None:
    """A certificate of scope `model` where some sphere can reach no cuboid at all, or None."""
    relaxation = relaxation_of(problem)
    spheres = int(np.count_nonzero(problem.cover.link > 0)) if problem.cover is not None else 0
    return _issue(problem, np.zeros(relaxation.head), np.zeros((spheres, 3)))


def _issue(problem: IKProblem, ray: Array, places: Array) -> Certificate | None:
    tolerance = np.array([problem.tolerances.position, problem.tolerances.rotation])
    margin = _margin(problem, ray, places, tolerance)
    if not margin > 0.0:
        return None
    statement = (
        f"No configuration that brings the tool within {1e3 * tolerance[0]:g} mm and {tolerance[1]:g} rad of the "
        "target has every sphere of the cover inside one of the free-space cuboids."
    )
    data = {"ray": ray, "places": places, "tolerance": tolerance}
    scope = proof_scope(problem, "cuboids")
    return Certificate("farkas", scope, statement, margin, problem_hash(problem), data)


def check_model(problem: IKProblem, certificate: Certificate, tolerance: Array) -> str | None:
    """Why a `farkas` certificate of scope `model` does not hold, or None when it does."""
    if problem.free_space is None or problem.cover is None:
        return "the problem has no free-space cuboids, or no spheres to be in them"
    try:
        relaxation = relaxation_of(problem)
    except InputError as error:
        return str(error)
    ray, places = numbers(certificate, "ray", relaxation.head), certificate.data.get("places")
    if ray is None or places is None or places.shape != (int(np.count_nonzero(problem.cover.link > 0)), 3):
        return "its ray is missing, damaged or of the wrong length"
    if not np.all(np.isfinite(places)):
        return "its ray is not finite"
    norm = float(np.linalg.norm(ray))
    if (
        norm > 0
        and np.abs(norm * dual_head(relaxation, np.append(ray, np.zeros(len(relaxation.tail_b)))) - ray).max()
        > ROUNDING
    ):
        return "its ray is not in the dual cone"
    margin = _margin(problem, ray, places, tolerance)
    return None if margin > 0.0 else f"its ray does not prove the claim: margin {margin:.3g}"


def _margin(problem: IKProblem, ray: Array, places: Array, tolerance: Array) -> float:
    """By how much `ray . S (x, 1) + sum_j places_j . (c_j(x) - p_j)` stays below zero, p_j in the cuboids of j.

    The value is at least zero at a configuration with every sphere in a cuboid. A sphere with no cuboid in reach is
    a proof by itself: the margin is then 1.
    """
    assert problem.free_space is not None
    allowed_problem = replace(
        problem,
        tolerances=replace(problem.tolerances, position=float(tolerance[0]), rotation=float(tolerance[1])),
    )
    pairs = reachable_pairs(allowed_problem, problem.free_space)
    if not pairs.allowed.any(axis=1).all():
        return 1.0
    relaxation = relaxation_of(problem)
    lift = relaxation.lift
    tensor = relaxation.tensor(Interval.of(problem), problem)
    M = np.einsum("r,rxg->xg", ray, tensor) + np.einsum(
        "ma,maxg->xg", places, sphere_maps(lift, problem, pairs.sphere)
    )
    worst = -np.where(places[:, None, :] > 0, pairs.lower, pairs.upper) * places[:, None, :]
    reach = np.where(pairs.allowed, worst.sum(axis=-1), -np.inf).max(axis=1)
    value = support(lift, M @ goal_vector(problem.T_base_tool)) + float(reach.sum())
    return -value - growth(lift, M, float(tolerance[0]), float(tolerance[1])) - ROUNDING
