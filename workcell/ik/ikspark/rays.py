"""Farkas rays of the relaxation as `farkas/2` certificates: the solver's rows translated into the chain's own.

Every configuration that reaches the goal gives a lifted x with `S(goal) (x, 1)` in the cone K. For z in the dual
cone K*, `z . S(goal) (x, 1) >= 0` at such an x. What the checker bounds from above is the same sum, written with the
links' rotations; it takes its multipliers from any source, so nothing here needs to be exact.
"""

from __future__ import annotations

import numpy as np

from workcell.ik.certificate import Certificate, problem_hash
from workcell.ik.claims.chain import Chain, unsuited
from workcell.ik.ikspark.bound import Multipliers
from workcell.ik.ikspark.check import KIND, margin, scope_of, statement
from workcell.ik.ikspark.cuboid_proof import moving_spheres
from workcell.ik.ikspark.instance import relaxation_of
from workcell.ik.ikspark.lift import Lift
from workcell.ik.ikspark.relaxation import Relaxation
from workcell.ik.problem import IKProblem
from workcell.pose import Array


def certify_kinematics(problem: IKProblem, z: Array) -> Certificate | None:
    """A certificate of scope `kinematics` from a ray over the rows of `relaxation_of(problem)`, None if too weak.

    Args:
        problem: the problem; its obstacles play no part.
        z: (rows,) as a solver returns it; it need not be exact.
    """
    return _issue(problem, multipliers(problem, relaxation_of(problem), z))


def certify_model(problem: IKProblem, z: Array) -> Certificate | None:
    """A certificate of scope `model` from a ray as `CuboidSet.solve` returns it, or None if it is too weak."""
    relaxation = relaxation_of(problem)
    rows = relaxation.cones.rows
    # Clarabel's rows say A x + s = b: the multiplier of an equality `value = 0` enters with its sign turned
    return _issue(problem, multipliers(problem, relaxation, z[:rows], -z[rows:].reshape(-1, 3)))


def certify_homeless(problem: IKProblem) -> Certificate | None:
    """A certificate of scope `model` where some sphere can reach no cuboid at all, or None."""
    if problem.cover is None:
        return None
    relaxation = relaxation_of(problem)
    nothing = np.zeros((len(moving_spheres(problem)), 3))
    return _issue(problem, multipliers(problem, relaxation, np.zeros(relaxation.cones.rows), nothing))


def _issue(problem: IKProblem, m: Multipliers) -> Certificate | None:
    if unsuited(problem) is not None:
        return None
    covered = np.array([problem.tolerances.position, problem.tolerances.rotation])
    m = _best_of_one(problem, covered) if problem.robot.dof == 1 and m.places is None else m
    found = margin(problem, m, covered)
    if not found > 0.0:
        return None
    data = {
        "tolerances": covered,
        "planar": np.array(m.planar, dtype=float),
        "axes": m.axes,
        "position": m.position,
        "limits": m.limits,
        "chords": m.chords,
    }
    for name in ("links", "places"):
        if getattr(m, name) is not None:
            data[name] = getattr(m, name)
    words = statement(problem, m, covered)
    return Certificate(KIND, scope_of(problem, m), words, found, problem_hash(problem), data)


def multipliers(
    problem: IKProblem, relaxation: Relaxation, z: Array, places: Array | None = None
) -> Multipliers:
    """A ray z (rows,) by the rows of the chain; its part outside the dual cone is cut off.

    Args:
        problem: whose spheres are meant by `places`.
        relaxation: whose rows these are.
        z: the ray.
        places: (m, 3) multipliers of the moving spheres' places in the world.
    """
    lift, n = relaxation.lift, relaxation.lift.robot.dof
    equalities = np.zeros(lift.kept.shape)
    equalities[lift.kept] = z[: relaxation.cones.zero]
    shared = equalities[len(lift.balls) :]
    at = relaxation.cones.zero
    chords, limits = np.zeros(2), np.zeros((n, 3))
    for k in relaxation.chords:
        chords[0 if k == 0 else 1] = max(float(z[at]), 0.0)
        at += 1
    links = None
    if relaxation.rotated:
        links = np.zeros(n - 1)
        links[np.array(relaxation.rotated) - 1] = np.maximum(z[at : at + len(relaxation.rotated)], 0.0)
        at += len(relaxation.rotated)
    at += relaxation.halfspaces
    for k in relaxation.coned:
        limits[k] = z[at + 1 : at + 4]
        at += 4
    position = np.array(shared[-3:])
    if places is not None:
        position -= _counted_from_the_goal(problem, lift, places)
    first = sum(not disc.from_goal for disc in lift.discs)
    planar = (first, len(lift.discs) - first) if n > 1 else (0, 0)
    if n == 1:
        chords = np.zeros(2)
    return Multipliers(planar, shared[: 3 * n].reshape(n, 3), position, limits, chords, links, places)


def _counted_from_the_goal(problem: IKProblem, lift: Lift, places: Array) -> Array:
    """(3,) multipliers of the places of spheres whose links' origins the lift sums up from the goal.

    The checker sums them up from the base: the difference is the closure of the chain.
    """
    assert problem.cover is not None
    from_goal = np.any(lift.origins[..., 1:4] != 0.0, axis=(1, 2, 3))
    chosen = from_goal[problem.cover.link[moving_spheres(problem)]]
    summed: Array = places[chosen].sum(axis=0) @ problem.robot.T_world_base.rotation
    return summed


def _best_of_one(problem: IKProblem, covered: Array) -> Multipliers:
    """For one joint all is known: the axis, the place or the angle that is farthest from what it must be."""
    chain = Chain.of(problem)
    nothing, none = np.zeros((1, 3)), np.zeros(2)
    axis = chain.along - chain.axis @ chain.last.T
    place = chain.xyz[0] + chain.last @ chain.tool - chain.position
    angle = chain.turned - chain.across @ chain.last.T
    choices = [
        Multipliers((0, 0), -axis, np.zeros(3), nothing, none),
        Multipliers((0, 0), nothing, -place, nothing, none),
        Multipliers((0, 0), nothing, np.zeros(3), -angle, none),
    ]
    return max(choices, key=lambda m: margin(problem, m, covered))
