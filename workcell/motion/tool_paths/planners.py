"""Who answers the steps of a tool path: the planner that is named, or local tracking with a solver behind it."""

from __future__ import annotations

from workcell.errors import InputError, UnknownNameError
from workcell.ik.problem import POSE_BUDGET, Budget, IKProblem
from workcell.ik.registry import planner_names, plans_alone, solver_names
from workcell.ik.result import IKResult
from workcell.motion.tool_paths.poses import PathTolerance
from workcell.motion.tool_paths.result import FollowLimits
from workcell.motion.tool_paths.steps import LocalSolver, Solver, Steps, Tolerant

STEP_BUDGET = Budget(60.0, effort=1.0)
"""For one answer of a solver along a path. The effort ends it, which is the same at any load."""
OWN_STEP_BUDGET = Budget(60.0, effort=0.35)
"""For one step of a convex planner: nearly all take one cone program, and halfway to a pose that resists is nearer."""


def check_planner(name: str) -> None:
    """Raise unless paths can be planned with it: UnknownNameError, or InputError for a solver that can't plan."""
    if name in planner_names():
        return
    if name not in solver_names():
        raise UnknownNameError("planner", name, planner_names())
    *others, last = planner_names()
    raise InputError(
        f"{name} answers single poses", where="planner", remedy=f"plan with {', '.join(others)} or {last}"
    )


def steps_of(
    planner: str,
    template: IKProblem,
    *,
    tolerance: PathTolerance | None = None,
    limits: FollowLimits | None = None,
    budget: Budget | None = None,
    seed: int = 0,
) -> Steps:
    """The steps of a planner, for `workcell.motion.tool_paths.follow`.

    A convex planner answers each of them, each an IK problem with its continuity constraint, and nobody else does.
    With `auto` they are local ones, and the portfolio is asked where these fail.

    Args:
        planner: `auto`, or a solver that tasks are planned with.
        template: as of `follow`.
        tolerance, limits: as of `follow`.
        budget: of one answer by a solver; None: enough.
        seed: same seed, same steps.

    Raises:
        UnknownNameError: no such planner. InputError: a solver that tasks are not planned with.
    """
    check_planner(planner)
    if plans_alone(planner):
        return Tolerant(step_solver(planner, budget or OWN_STEP_BUDGET, seed), tolerance or PathTolerance())
    rescue = step_solver(planner, budget or STEP_BUDGET, seed)
    return local_solver(template, tolerance=tolerance, limits=limits, rescue=rescue)


def step_solver(name: str = "ikspark", budget: Budget | None = None, seed: int = 0) -> Solver:
    """A solver of `workcell.ik.solve`, by name, for each step: its answers are verified."""
    from workcell.ik.solve import solve

    def answer(problem: IKProblem) -> IKResult:
        return solve(problem, solver=name, budget=budget or POSE_BUDGET, seed=seed)

    return answer


def local_solver(
    template: IKProblem,
    *,
    tolerance: PathTolerance | None = None,
    limits: FollowLimits | None = None,
    rescue: Solver | None = None,
    seed: int = 0,
) -> LocalSolver:
    """Fast local steps for `follow`, with a solver behind them for those that fail (None: IKSPARK)."""
    limits = limits or FollowLimits()
    return LocalSolver(
        template,
        tolerance,
        max_step=limits.max_step,
        clearance=limits.clearance,
        rescue=rescue or step_solver("ikspark", STEP_BUDGET, seed),
    )
