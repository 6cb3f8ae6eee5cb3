"""Checks `reach` and `last_link` certificates (docs/proofs.md, sections 4 and 5).

Rounding: a length of the bounds is the norm of a sum of at most ten vectors that rotations have turned, and errs by
less than 200 u of what it is made of, u = 2^-53. All of these together stay below `MOST_LENGTH` and twice `MOST_SLIDE`
a joint, so that the bounds err by less than a tenth of the `ROUNDING` that they keep back.
"""

from __future__ import annotations

import numpy as np

from workcell.ik.certificate import Certificate, problem_hash, proof_scope
from workcell.ik.claims.form import overclaims, whole_numbers, wrong_form, wrong_tolerances
from workcell.ik.elementary.bounds import Depth, ReachBound, last_link_statement, reach_statement
from workcell.ik.problem import IKProblem

MOST_LENGTH = 1000.0
"""Metres that offsets, places and radii may have together."""
MOST_SLIDE = 10.0
"""Metres that a point may lie along its joint's axis."""


def check_reach(problem: IKProblem, certificate: Certificate) -> str | None:
    """Why a `reach` certificate does not hold, or None when it does (docs/proofs.md, section 4)."""
    if certificate.problem_hash != problem_hash(problem):
        return "the certificate belongs to another problem"
    n = problem.robot.joint_count
    refusal = wrong_form(certificate, {"tolerances": (3,), "slides": (n,)})
    if refusal is not None:
        return refusal
    covered, slides = certificate.data["tolerances"], certificate.data["slides"]
    refusal = wrong_tolerances(problem, covered) or _too_long(problem)
    if refusal is not None:
        return refusal
    if not bool(np.all(np.abs(slides) <= MOST_SLIDE)):
        return f"a point lies more than {MOST_SLIDE:g} m along its joint's axis"
    margin = ReachBound.of(problem).margin(covered, slides)
    if not margin > 0.0:
        return "the distance to the target lies within the chain's reach"
    said = reach_statement(certificate.margin, covered)
    return overclaims(certificate, proof_scope(problem, "chain"), margin, said)


def check_last_link(problem: IKProblem, certificate: Certificate) -> str | None:
    """Why a `last_link` certificate does not hold, or None when it does (docs/proofs.md, section 5)."""
    if certificate.problem_hash != problem_hash(problem):
        return "the certificate belongs to another problem"
    if problem.cover is None or not problem.obstacles:
        return "the problem has no spheres or no obstacles"
    refusal = wrong_form(certificate, {"tolerances": (3,), "pair": (2,)})
    if refusal is not None:
        return refusal
    covered, pair = certificate.data["tolerances"], certificate.data["pair"]
    refusal = wrong_tolerances(problem, covered) or _too_long(problem)
    if refusal is not None:
        return refusal
    if not whole_numbers(pair[:1], len(problem.cover)) or not whole_numbers(pair[1:], len(problem.obstacles)):
        return "it names a sphere or an obstacle that isn't there"
    sphere, piece = int(pair[0]), int(pair[1])
    margin = Depth.of(problem).depth(covered, sphere, piece)
    if not margin > 0.0:
        return "the sphere need not penetrate the obstacle at the target"
    said = last_link_statement(problem, certificate.margin, covered, sphere, piece)
    return overclaims(certificate, proof_scope(problem, "spheres"), margin, said)


def _too_long(problem: IKProblem) -> str | None:
    """Why `ROUNDING` might not make up for rounding here, or None: lengths err by less than 200 u each."""
    robot, cover = problem.robot, problem.cover
    lengths = [problem.target.position, robot.T_world_base.position, robot.tool().T_link_tool.position]
    lengths += list(robot.joint_xyz)
    spheres = (
        0.0 if cover is None or not len(cover) else float(np.abs(cover.centre).max() + cover.radius.max())
    )
    places = max((float(np.abs(piece.pose.position).max()) for piece in problem.obstacles), default=0.0)
    total = float(np.linalg.norm(np.array(lengths), axis=1).sum()) + spheres + places
    if not total <= MOST_LENGTH:
        return f"the robot and its surroundings reach {total:.3g} m; rounding is accounted for up to {MOST_LENGTH:g}"
    return None


def obstacles_used(certificate: Certificate) -> list[int]:
    """Index of the obstacle that a `last_link` certificate is about."""
    return [int(certificate.data["pair"][1])]
