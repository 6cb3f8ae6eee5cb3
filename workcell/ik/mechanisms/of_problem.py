"""A question about a serial robot as one about a mechanism: slides, joints that follow others, parts of poses.

Solvers of mechanisms answer it, and their certificates are checked against the same translation.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from workcell.geometry.types import SphereCover
from workcell.identity_cache import ByIdentity
from workcell.ik.certificate import Certificate, problem_hash
from workcell.ik.mechanisms.check import check_mechanism
from workcell.ik.mechanisms.goals import FrameGoal
from workcell.ik.mechanisms.hashing import mechanism_hash
from workcell.ik.mechanisms.problem import FARTHEST, MechanismProblem, MechanismTolerances
from workcell.ik.problem import STEP_SLACK, IKProblem
from workcell.model.mechanism.mechanism import WORLD, Mechanism
from workcell.model.mechanism.of_robot import of_robot
from workcell.model.robot import Robot
from workcell.pose import Array

_mechanisms, _problems = ByIdentity(), ByIdentity()


def mechanism_problem(problem: IKProblem) -> MechanismProblem:
    """The question about the robot's m joints; `of_robot.variables_of` leads back to its n variables.

    What no configuration of the mechanism can do, none of the robot can: joints that follow others may move as far as
    the bounds on what they follow let them.
    """
    made: MechanismProblem = _problems.get((problem,), lambda: _translated(problem))
    return made


def check_robot(problem: IKProblem, certificate: Certificate) -> str | None:
    """Why a certificate of kind `mechanism/1` proves nothing about a robot's problem, or None when it holds."""
    if certificate.problem_hash != problem_hash(problem):
        return "the certificate belongs to another problem"
    question = mechanism_problem(problem)
    return check_mechanism(question, replace(certificate, problem_hash=mechanism_hash(question)))


def of_robot_problem(problem: IKProblem, certificate: Certificate) -> Certificate:
    """A certificate about `mechanism_problem(problem)` as one about `problem`."""
    return replace(certificate, problem_hash=problem_hash(problem))


def _translated(problem: IKProblem) -> MechanismProblem:
    robot, tolerances = problem.robot, problem.tolerances
    reference, ahead = problem.q_reference, problem.q_towards
    return MechanismProblem(
        _mechanism_of(robot),
        (_goal(problem),),
        obstacles=tuple(problem.obstacles),
        cover=_cover(robot, problem.cover),
        free_space=problem.free_space,
        grow=problem.grow,
        apart=problem.self_collision,
        q_reference=None if reference is None else robot.joint_values(reference),
        q_towards=None if ahead is None else robot.joint_values(ahead),
        max_step=_steps(problem),
        max_link_rotation=problem.max_link_rotation,
        tolerances=MechanismTolerances(
            min(tolerances.position, FARTHEST),
            min(tolerances.rotation, FARTHEST),
            safety_margin=min(tolerances.safety_margin, FARTHEST),
        ),
    )


def _mechanism_of(robot: Robot) -> Mechanism:
    made: Mechanism = _mechanisms.get((robot,), lambda: of_robot(robot))
    return made


def _goal(problem: IKProblem) -> FrameGoal:
    frame, target = problem.robot.tool().name, problem.target
    if problem.goal == "position":
        return FrameGoal.at(frame, target.position)
    if problem.goal == "axis":
        return FrameGoal.pointing(frame, target.rotation[:, 2], position=target.position)
    return FrameGoal.posed(frame, target)


def _cover(robot: Robot, cover: SphereCover | None) -> SphereCover | None:
    """The robot's spheres; those of its base are where the world has them."""
    if cover is None or not np.any(cover.link == WORLD):
        return cover
    still, T = cover.link == WORLD, robot.T_world_base
    centre = np.where(still[:, None], cover.centre @ T.rotation.T + T.position, cover.centre)
    return replace(cover, centre=centre)


def _steps(problem: IKProblem) -> Array | None:
    """(m,) how far each joint may move from the reference, while the variables stay within `max_step`."""
    robot, reference = problem.robot, problem.q_reference
    if problem.max_step is None or reference is None:
        return None
    step = np.broadcast_to(np.asarray(problem.max_step, dtype=float), (robot.dof,))
    if robot.coupling is None:
        return np.array(step)
    return np.where(
        np.isin(np.arange(robot.joint_count), robot.coupling.own),
        step[robot.coupling.variable],
        robot.coupling.spans(reference, step + STEP_SLACK),
    )
