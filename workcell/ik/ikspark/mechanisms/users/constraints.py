"""Users' own convex constraints, written in cvxpy: as rows of the solver's cone program, and asked of an answer.

A constraint is a function that takes `Expressions` and returns cvxpy constraints. What is not convex, or can be kept
by no point at all, is refused by the constraint's name.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from workcell.errors import InputError, WorkcellError
from workcell.ik.ikspark.mechanisms.users.canonical import canonical, contradictory, without_bare_rows
from workcell.ik.ikspark.mechanisms.users.expressions import AffineModel, Expression, Expressions
from workcell.ik.mechanisms.problem import MechanismProblem, UserConstraint
from workcell.ik.shared.conic import Cones
from workcell.model.mechanism.placing import place
from workcell.pose import Array

_TIGHT = {"tol_gap_abs": 1e-9, "tol_gap_rel": 1e-9, "tol_feas": 1e-9}


@dataclass(frozen=True, slots=True)
class UserRows:
    """All of a problem's constraints as `A (x, auxiliaries) + s = b`, s in the cones.

    Attributes:
        A: scipy CSC matrix (rows, N + auxiliaries); rows or cones are scaled to entries of at most one.
        b: (rows,).
        cones: in the order of `workcell.ik.shared.conic`.
        auxiliaries: how many variables stand behind x.
    """

    A: Any
    b: Array
    cones: Cones
    auxiliaries: int


def conic_rows(constraints: Sequence[UserConstraint], affine: AffineModel) -> UserRows:
    """The rows of all constraints over (x, auxiliaries).

    Raises:
        InputError: a constraint is not convex, does not depend on the configuration, contradicts itself or the others,
            has parameters without values or whole-number variables, or could not be built; it is named.
    """
    import cvxpy as cp

    x = cp.Variable(affine.size)
    expressions = Expressions.of(affine, x)
    every: list[Any] = []
    for constraint in constraints:
        built = _built(constraint, expressions)
        where = _where(constraint)
        if not any(x.id == variable.id for one in built for variable in one.variables()):
            raise InputError("it does not depend on the configuration", where=where)
        if contradictory(*canonical(built, x, where=where)):
            raise InputError("nothing satisfies it: it contradicts itself", where=where)
        every += built
    A, b, cones = canonical(every, x, where="constraints")
    if len(constraints) > 1 and contradictory(A, b, cones):
        names = ", ".join(repr(constraint.name) for constraint in constraints)
        raise InputError(
            "nothing satisfies all of them: they contradict each other", where=f"constraints {names}"
        )
    A, b, cones = without_bare_rows(A, b, cones)
    return UserRows(A, b, cones, A.shape[1] - affine.size)


def violations(problem: MechanismProblem, q: Array) -> list[str]:
    """Which of a problem's constraints a configuration (size,) breaks by more than their tolerance, in words.

    A constraint's own variables are chosen as well as can be.

    Raises:
        InputError: a constraint can't be built or is not convex.
    """
    expressions = Expressions.at(place(problem.mechanism, problem.mechanism.configuration(q)))
    reasons = []
    for constraint in problem.constraints:
        excess = _excess(_built(constraint, expressions), _where(constraint))
        if not excess <= constraint.tolerance:
            by = f"by {excess:.3g}" if np.isfinite(excess) else "whatever its own variables are"
            reasons.append(f"constraint {constraint.name!r} is broken {by}")
    return reasons


def _where(constraint: UserConstraint) -> str:
    return f"constraint {constraint.name!r}"


def _built(constraint: UserConstraint, expressions: Expressions) -> list[Any]:
    """What a constraint's function returns, looked at."""
    import cvxpy as cp

    where = _where(constraint)
    if not (np.isfinite(constraint.tolerance) and constraint.tolerance > 0):
        raise InputError(f"its tolerance is {constraint.tolerance}", where=where, remedy="more than zero")
    try:
        built = constraint.build(expressions)
    except WorkcellError as error:
        raise InputError(str(error), where=where) from error
    except Exception as error:  # whatever the user's function does
        raise InputError(f"{type(error).__name__}: {error}", where=where) from error
    if not isinstance(built, list | tuple) or not built:
        raise InputError(f"its function returned {built!r:.80}", where=where, remedy="a list of constraints")
    for i, one in enumerate(built):
        _look_at(one, f"{where}, number {i}", cp)
    return list(built)


def _look_at(one: Any, where: str, cp: Any) -> None:
    if not isinstance(one, cp.constraints.constraint.Constraint):
        raise InputError(f"{one!r:.80} is no cvxpy constraint", where=where)
    if any(parameter.value is None for parameter in one.parameters()):
        raise InputError("a parameter has no value", where=where)
    if any(variable.attributes["integer"] or variable.attributes["boolean"] for variable in one.variables()):
        raise InputError("whole-number variables are not convex", where=where)
    if not all(np.all(np.isfinite(_numbers(constant))) for constant in one.constants()):
        raise InputError("a number in it is not finite", where=where)
    if not one.is_dcp():
        raise InputError(
            f"this {type(one).__name__.lower()} is not convex by cvxpy's rules",
            where=where,
            remedy="convex <= concave, affine == affine, a matrix >> 0",
        )


def _numbers(constant: Any) -> Array:
    value = constant.value
    found: Array = np.asarray(value.data if hasattr(value, "indptr") else value)
    return found


def _excess(built: list[Any], where: str) -> float:
    """By how much constraints are broken, as cvxpy measures it; at the least over variables of their own."""
    import cvxpy as cp

    alone = [one for one in built if not one.variables()]
    worst = max((float(np.max(one.violation(), initial=0.0)) for one in alone), default=0.0)
    if len(alone) == len(built):
        return worst
    slack = cp.Variable(nonneg=True)
    relaxed: list[Expression] = []
    for one in built:
        relaxed += _relaxed(one, slack) if one.variables() else []
    question = cp.Problem(cp.Minimize(slack), relaxed)
    try:
        question.solve(solver="CLARABEL", **_TIGHT)
    except cp.error.SolverError as error:
        raise InputError(f"its own variables could not be found: {error}", where=where) from error
    if question.status not in ("optimal", "optimal_inaccurate"):
        return np.inf
    return max(worst, float(slack.value))


def _relaxed(one: Any, slack: Expression) -> list[Any]:
    """A constraint that may be broken by a slack."""
    import cvxpy as cp

    if isinstance(one, cp.constraints.Inequality | cp.constraints.NonPos):
        return [one.expr <= slack]
    if isinstance(one, cp.constraints.Equality | cp.constraints.Zero):
        return [cp.abs(one.expr) <= slack]
    if isinstance(one, cp.constraints.NonNeg):
        return [one.expr >= -slack]
    if isinstance(one, cp.constraints.PSD):
        return [one.expr + slack * np.eye(one.expr.shape[0]) >> 0]
    return [one]
