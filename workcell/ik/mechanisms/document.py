"""A question about a mechanism as a document, for whoever checks proofs about it (docs/proofs.md, 12.1)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.model.mechanism.mechanism import Joint
from workcell.model.mechanism.placing import place
from workcell.pose import Pose

FORMAT = "workcell-mechanism-question/1"


def question_document(problem: MechanismProblem) -> dict[str, Any]:
    """A JSON document of all that certificates about a problem depend on; infinite limits are null."""
    mechanism, tolerances = problem.mechanism, problem.tolerances
    return {
        "format": FORMAT,
        "joints": [_joint(joint) for joint in mechanism.joints],
        "closures": [
            {"kind": tie.kind, "links": list(tie.links), "frames": [_pose(frame) for frame in tie.frames]}
            for tie in mechanism.closures
        ],
        "goals": [
            {
                **_frame(problem, goal.frame),
                **{
                    name: _list(getattr(goal, name)) for name in ("position", "rotation", "axis", "direction")
                },
                "within": float(goal.within),
            }
            for goal in problem.goals
        ],
        "regions": [
            {
                **_frame(problem, region.frame),
                **{name: getattr(region, name).tolist() for name in ("point", "A", "b", "equal")},
            }
            for region in problem.regions
        ],
        "reference": _reference(problem),
        "max_step": None
        if problem.max_step is None
        else [_finite(step) for step in np.asarray(problem.max_step)],
        "max_link_rotation": None
        if problem.max_link_rotation is None
        else _finite(problem.max_link_rotation),
        "tolerances": {
            name: float(getattr(tolerances, name)) for name in ("position", "rotation", "closure", "region")
        },
    }


def _joint(joint: Joint) -> dict[str, Any]:
    return {
        "kind": joint.kind,
        "parent": joint.parent,
        **_pose(joint.T_parent_joint),
        "axis": joint.axis.tolist(),
        "lower": _finite(joint.lower),
        "upper": _finite(joint.upper),
    }


def _pose(pose: Pose) -> dict[str, Any]:
    return {"xyz": pose.position.tolist(), "quat": pose.quat_wxyz.tolist()}


def _frame(problem: MechanismProblem, name: str) -> dict[str, Any]:
    frame = problem.mechanism.frame(name)
    return {"link": frame.link, **_pose(frame.T_link_frame)}


def _reference(problem: MechanismProblem) -> dict[str, Any] | None:
    if problem.q_reference is None:
        return None
    mechanism, q = problem.mechanism, problem.q_reference
    placed = place(mechanism, q)
    values = [
        float(q[at.start]) if joint.kind in ("hinge", "slide") else 0.0
        for joint, at in zip(mechanism.joints, mechanism.value_slices, strict=True)
    ]
    return {"R": placed.R.tolist(), "p": placed.p.tolist(), "values": values}


def _list(array: Any) -> Any:
    return None if array is None else array.tolist()


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
