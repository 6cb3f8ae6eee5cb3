"""The hash by which a proof names the question about a mechanism that it belongs to."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from typing import Any

from workcell.ik.certificate import as_bytes
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.model.mechanism.mechanism import Mechanism
from workcell.pose import Pose


def mechanism_hash(problem: MechanismProblem) -> str:
    """SHA-256 (hex) of everything that a certificate about a mechanism depends on.

    That is joints, limits, ties, goals, regions, bounds and tolerances. Names are left out, and so are obstacles,
    spheres and the user's own constraints: no proof uses them.
    """
    digest = hashlib.sha256(as_bytes(_of_mechanism(problem.mechanism)))
    digest.update(as_bytes(_of_question(problem)))
    return digest.hexdigest()


def _of_mechanism(mechanism: Mechanism) -> Iterator[Any]:
    for joint in mechanism.joints:
        yield from ("joint", joint.kind, joint.parent, *_pose(joint.T_parent_joint), joint.axis)
        yield from (joint.lower, joint.upper)
    for closure in mechanism.closures:
        yield from ("closure", closure.kind, closure.links)
        yield from (number for frame in closure.frames for number in _pose(frame))
    for follower in mechanism.followers:
        yield from ("follower", follower.joint, follower.leader, follower.coefficients)
    for total in mechanism.sums:
        yield from ("sum", total.joints, total.multiples, total.lower, total.upper)


def _of_question(problem: MechanismProblem) -> Iterator[Any]:
    for goal in problem.goals:
        yield from ("goal", *_of_frame(problem.mechanism, goal.frame), goal.within)
        for name in ("position", "rotation", "axis", "direction"):
            if (value := getattr(goal, name)) is not None:
                yield from (name, value)
    for region in problem.regions:
        yield from ("region", *_of_frame(problem.mechanism, region.frame))
        yield from (region.A, region.b, region.point, region.equal)
    for name in ("q_reference", "max_step", "max_link_rotation"):
        if (value := getattr(problem, name)) is not None:
            yield from (name, value)
    tolerances = problem.tolerances
    yield from ("tolerances", tolerances.position, tolerances.rotation, tolerances.closure, tolerances.region)


def _of_frame(mechanism: Mechanism, name: str) -> Iterator[Any]:
    frame = mechanism.frame(name)
    yield from (frame.link, *_pose(frame.T_link_frame))


def _pose(pose: Pose) -> tuple[Any, Any]:
    return pose.position, pose.quat_wxyz
