"""What a query asked of continuity, what its answer kept of that, and what it cost: numbers for its document."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.result import MechanismResult
from workcell.ik.problem import IKProblem
from workcell.ik.result import IKResult
from workcell.model.mechanism.placing import difference, place
from workcell.model.robot import Robot
from workcell.pose import Array

Kind = Literal["step", "goal"]
"""A step of a way is asked for within bounds against its reference, a goal configuration anywhere."""


def query_facts(problem: IKProblem, result: IKResult) -> dict[str, Any]:
    """Kind, cone programs, whether it was solved among cuboids, and changes against the reference with their bounds.

    Changes are those of a verified configuration; what does not apply is left out.
    """
    bounded = problem.max_step is not None or problem.max_link_rotation is not None
    kind: Kind = "step" if bounded else "goal"
    facts: dict[str, Any] = {
        "kind": kind,
        "in_cuboids": result.cuboids is not None,
        "sdps": cone_programs(result),
    }
    if bounded and result.q is not None and problem.q_reference is not None:
        moved = np.abs(result.q - problem.q_reference)
        allowed = np.broadcast_to(np.inf if problem.max_step is None else problem.max_step, moved.shape)
        joint = int(np.argmax(moved if problem.max_step is None else moved / allowed))
        facts["step"] = _short(moved[joint])
        facts["link_rotation"] = _short(link_rotations(problem.robot, problem.q_reference, result.q).max())
        if problem.max_step is not None:
            facts["max_step"] = _short(allowed[joint])
    if problem.max_link_rotation is not None:
        facts["max_link_rotation"] = _short(problem.max_link_rotation)
    return facts


def mechanism_facts(problem: MechanismProblem, result: MechanismResult) -> dict[str, Any]:
    """The same of a question about a mechanism: its steps are numbers of the tangent, radians or metres."""
    mechanism, before = problem.mechanism, problem.q_reference
    bounded = problem.max_step is not None or problem.max_link_rotation is not None
    kind: Kind = "step" if bounded else "goal"
    facts: dict[str, Any] = {"kind": kind, "in_cuboids": False, "sdps": cone_programs(result)}
    if bounded and result.q is not None and before is not None:
        moved = np.abs(difference(mechanism, before, result.q))
        allowed = np.broadcast_to(np.inf if problem.max_step is None else problem.max_step, moved.shape)
        number = int(np.argmax(moved if problem.max_step is None else moved / allowed))
        turned = place(mechanism, np.array(result.q)).R - place(mechanism, before).R
        facts["step"] = _short(moved[number])
        facts["link_rotation"] = _short(np.linalg.norm(turned, axis=(1, 2)).max())
        if problem.max_step is not None:
            facts["max_step"] = _short(allowed[number])
    if problem.max_link_rotation is not None:
        facts["max_link_rotation"] = _short(problem.max_link_rotation)
    return facts


def cone_programs(result: IKResult | MechanismResult) -> int:
    """How many cone programs were solved for an answer, by whichever solver of a portfolio."""
    return int(sum(value for name, value in result.stats.items() if name.rpartition(".")[2] == "sdps"))


def link_rotations(robot: Robot, q_before: Array, q: Array) -> Array:
    """(m + 1,) Frobenius norms of the change of each link's world rotation: the left side of Eq. 75 of IKSPARK."""
    before, after = robot.link_transforms(np.stack([q_before, q]))[..., :3, :3]
    norms: Array = np.linalg.norm(after - before, axis=(1, 2))
    return norms


def _short(value: float) -> float:
    return float(f"{float(value):.6g}")
