"""Re-checks the small proof that goes with a configuration, by kinematics and distances of its own.

What is in `data`, see docs/proofs.md:

    middle      (n,)            the configuration, radians
    half        (n,)            half widths of the box around it
    joints      (6,) or (0,)    joints with which a solution is shown to be in the box; none: only that all of it does
    inverse     (6, 6), (0, 0)  roughly the inverse of the equations' derivatives by them
    tolerances  (3,)            metres and radians within which all of the box reaches the target, and its clearance
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from workcell.ik.certificate import Certificate, Scope
from workcell.ik.claims.form import Shape, overclaims, whole_numbers, wrong_form, wrong_subject
from workcell.ik.problem import IKProblem
from workcell.ik.solution.box import Stance, within_limits
from workcell.pose import Array

KIND: Scope = "solution"
"""Kind and scope."""
MOST_HALF = 1.0
"""Radians that a box may be wide from its middle."""


def check_solution(problem: IKProblem, certificate: Certificate) -> str | None:
    """Why a certificate of kind `solution` does not hold, or None when it does."""
    data = certificate.data
    refusal = (
        wrong_subject(problem, certificate, KIND)
        or _malformed(certificate, problem.robot.dof)
        or _wrong_tolerances(problem, data["tolerances"])
    )
    if refusal is not None:
        return refusal
    covered = float(data["tolerances"][0])
    if certificate.margin != covered:
        return "the margin is not the tolerance that the proof covers"
    stance = Stance.at(problem, data["middle"])
    refusal = stance if isinstance(stance, str) else wrong_box(problem, stance, data)
    return refusal or overclaims(certificate, KIND, covered, statement(data))


def wrong_box(problem: IKProblem, stance: Stance, data: Mapping[str, Array]) -> str | None:
    """Why a well-formed box does not have what is claimed of it, or None; `stance` is at its middle."""
    middle, half = data["middle"], data["half"]
    position, rotation, clearance = (float(value) for value in data["tolerances"])
    if not within_limits(problem, middle, half):
        return "the box lies outside the joint limits"
    away, turned = stance.reached(half)
    if not (away <= position and turned <= rotation):
        return f"the box strays {1e3 * away:.3g} mm and {turned:.3g} rad from the target"
    found = stance.clearance(half, problem.self_collision)
    if not found >= clearance:
        return f"the box has a clearance of {1e3 * found:.3g} mm, not of {1e3 * clearance:g}"
    if len(data["joints"]):
        joints = data["joints"].astype(np.int64)
        if not np.all(stance.image(joints, data["inverse"], half) < half[joints]):
            return "it is not shown that the box holds a solution"
    return None


def statement(data: Mapping[str, Array]) -> str:
    """The claim of a proof in words."""
    position, rotation, clearance = (float(value) for value in data["tolerances"])
    exactly = " One of them has it exactly there." if len(data["joints"]) else ""
    return (
        f"Every configuration within {float(data['half'].max()):.3g} rad of this one has the tool within "
        f"{1e3 * position:g} mm and {rotation:g} rad of the target, all spheres {1e3 * clearance:g} mm or more from "
        f"everything, and keeps the joint limits.{exactly}"
    )


def _malformed(certificate: Certificate, n: int) -> str | None:
    data = certificate.data
    six = 6 if "joints" in data and data["joints"].shape != (0,) else 0
    shapes: dict[str, Shape] = {
        "middle": (n,),
        "half": (n,),
        "joints": (six,),
        "inverse": (six, six),
        "tolerances": (3,),
    }
    refusal = wrong_form(certificate, shapes)
    if refusal is not None:
        return refusal
    if not whole_numbers(data["joints"], n) or len(np.unique(data["joints"])) != six:
        return "it names joints that aren't there, or one twice"
    if not bool(np.all((data["half"] >= 0) & (data["half"] <= MOST_HALF))):
        return f"half widths are from 0 to {MOST_HALF:g}"
    return None


def _wrong_tolerances(problem: IKProblem, tolerances: Array) -> str | None:
    asked = problem.tolerances
    position, rotation, clearance = (float(value) for value in tolerances)
    if not (0 < position <= asked.position and 0 < rotation <= asked.rotation):
        return "its tolerances are wider than those of the problem"
    return None if clearance >= asked.safety_margin else "its clearance is less than the problem asks for"
