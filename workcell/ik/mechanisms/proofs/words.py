"""What certificates about mechanisms say in words."""

from __future__ import annotations

from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.pose import Array


def nothing_reaches(problem: MechanismProblem, covered: Array) -> str:
    """The claim of a certificate that no configuration answers a question."""
    position, rotation, closure, region = map(float, covered)
    parts = _ties(problem, closure)
    if problem.goals:
        parts.append(f"reaches all goals within {1e3 * position:g} mm and {rotation:g} rad")
    parts += _regions(problem, region)
    return f"No configuration {_bounds(problem)}{_and(parts)}, obstacles aside."


def nothing_is_closer(problem: MechanismProblem, covered: Array, bound: float) -> str:
    """The claim of a certificate that no configuration comes closer to the goals; the bound is rounded down."""
    _, rotation, closure, region = map(float, covered)
    parts = _ties(problem, closure)
    if any(goal.direction is not None for goal in problem.goals):
        parts.append(f"keeps the directions within {rotation:g} rad")
    parts += _regions(problem, region)
    parts.append(
        f"has a sum of squared pose errors (metres, and entries of rotations) below {0.99999 * bound:.6g}"
    )
    return f"No configuration {_bounds(problem)}{_and(parts)}, obstacles aside."


def _bounds(problem: MechanismProblem) -> str:
    names = [name for name in ("max_step", "max_link_rotation") if getattr(problem, name) is not None]
    return f"within the joint limits{f' and within {_and(names)} of q_reference' if names else ''} "


def _ties(problem: MechanismProblem, closure: float) -> list[str]:
    return (
        [f"keeps the ties within {1e3 * closure:g} mm and {closure:g} rad"]
        if problem.mechanism.closures
        else []
    )


def _regions(problem: MechanismProblem, region: float) -> list[str]:
    return [f"has all points within {1e3 * region:g} mm of their regions"] if problem.regions else []


def _and(parts: list[str]) -> str:
    if not parts:
        return "is there"
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
