"""Problems with a known solution: random chains, real arms, targets anywhere in the tolerance ball, obstacles.

They are for tests that no proof ever loses a solution. Wrong answers on problems without solution can't show such a
bug.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from workcell.geometry.types import Piece, SphereCover
from workcell.ik.branch.arrays import inflation
from workcell.ik.branch.chain import FREE_JOINTS
from workcell.ik.judge.exact import ExactDistances, ExactKinematics, smallest_clearance
from workcell.ik.problem import Goal, IKProblem, Tolerances
from workcell.model.robot import Robot
from workcell.model.serial import serial_robot
from workcell.pose import Array, Pose, axis_angle_to_matrix

_LEAST_GAP = 2e-5
"""Metres that a planted configuration keeps from everything: more than the overlap that proofs may claim."""


def random_chain(rng: np.random.Generator, dof: int, sliding: float = 0.0) -> Robot:
    """A serial robot with skew, parallel and meeting axes, zero-length links, and limits up to beyond a turn.

    Each joint is prismatic with probability `sliding`.
    """
    joints = []
    for k in range(dof):
        kind = rng.integers(4)
        axis = rng.normal(size=3) if kind == 0 else np.eye(3)[rng.integers(3)] * rng.choice([-1.0, 1.0])
        quat = rng.normal(size=4) if kind <= 1 else np.array([1.0, 0.0, 0.0, 0.0])
        xyz = rng.normal(size=3) * rng.choice([0.0, 0.1, 0.3])
        lower = -rng.choice([0.8, 2.0, 3.0, np.pi, 2 * np.pi])
        upper = rng.choice([0.8, 2.0, 3.0, np.pi, 2 * np.pi])
        joints.append(
            {
                "name": f"j{k}",
                "xyz": xyz,
                "quat": quat / np.linalg.norm(quat),
                "axis": axis / np.linalg.norm(axis),
                "lower": lower,
                "upper": upper,
            }
        )
    robot = serial_robot("random", joints, random_pose(rng, 0.1))
    slides = rng.random(dof) < sliding
    lower, upper = (
        np.where(slides, 0.1 * robot.lower, robot.lower),
        np.where(slides, 0.1 * robot.upper, robot.upper),
    )
    return dataclasses.replace(robot, prismatic=slides, lower=lower, upper=upper)


def random_pose(rng: np.random.Generator, spread: float) -> Pose:
    """A rotation of any kind at a place about `spread` metres from the origin."""
    quat = rng.normal(size=4)
    return Pose(rng.normal(size=3) * spread, quat / np.linalg.norm(quat))


def planted_problem(
    robot: Robot,
    rng: np.random.Generator,
    *,
    edge: float = 1.0,
    goal: Goal = "pose",
    tolerances: Tolerances | None = None,
) -> tuple[IKProblem, Array]:
    """A problem and the configuration that solves it, free joints of the goal appended.

    Its error is `edge` times the inflation that proofs cover; it is often near a singularity or a limit.
    """
    q = rng.uniform(robot.lower, robot.upper)
    if rng.random() < 0.4:
        special = rng.choice([0.0, np.pi / 2, -np.pi / 2, np.pi, 1e-4, -1e-3], size=len(q))
        chosen = rng.random(len(q)) < 0.6
        q = np.where(chosen, np.clip(special, robot.lower, robot.upper), q)
    if rng.random() < 0.2:
        q = np.where(rng.random(len(q)) < 0.3, rng.choice([robot.lower, robot.upper]), q)
    pose = robot.fk(q)
    allowed = tolerances or Tolerances()
    position, rotation = inflation(IKProblem(robot, pose, tolerances=allowed))
    shift, axis = rng.normal(size=3), rng.normal(size=3)
    shift *= edge * 0.999 * position / np.linalg.norm(shift)
    turn = axis_angle_to_matrix(axis / np.linalg.norm(axis), edge * 0.999 * rotation)
    free = _free_angles(goal, rng)
    turned = pose.rotation
    for direction, angle in zip(FREE_JOINTS[goal], free, strict=True):
        turned = turned @ axis_angle_to_matrix(direction, angle)
    target = Pose.from_rotation(pose.position + shift, turn @ turned)
    return IKProblem(robot, target, tolerances=allowed, goal=goal), np.concatenate([q, free])


def _free_angles(goal: Goal, rng: np.random.Generator) -> Array:
    angles = rng.uniform(-np.pi, np.pi, size=len(FREE_JOINTS[goal]))
    if len(angles) == 3:
        angles[1] *= 0.5
    return angles


def surround(
    problem: IKProblem, q: Array, rng: np.random.Generator, count: int = 12, pairs: int = 0
) -> IKProblem:
    """The same problem with spheres on the links, obstacles of every kind and pairs of spheres; `q` is barely free."""
    robot = problem.robot
    link = rng.integers(0, robot.dof + 1, size=10)
    cover = SphereCover(link, rng.normal(size=(10, 3)) * 0.05, rng.uniform(0.02, 0.12, size=10))
    rotation, position = ExactKinematics(robot).links(q[: robot.dof])
    pieces: list[Piece] = []
    while len(pieces) < count:
        s = rng.integers(10)
        near = position[link[s]] + rotation[link[s]] @ cover.centre[s] + rng.normal(size=3) * 0.15
        piece = _random_piece(rng, near)
        gap = smallest_clearance(cover, rotation, position, ExactDistances([piece]))[0]
        if gap > _LEAST_GAP:
            pieces.append(piece)
    centres = np.einsum("mij,mj->mi", rotation[link], cover.centre) + position[link]
    one, two = np.triu_indices(10, 1)
    apart = np.linalg.norm(centres[one] - centres[two], axis=1) - cover.radius[one] - cover.radius[two]
    chosen = rng.permutation(np.flatnonzero(apart > _LEAST_GAP))[:pairs]
    own = np.stack([one[chosen], two[chosen]], axis=1) if len(chosen) else None
    return dataclasses.replace(problem, obstacles=tuple(pieces), cover=cover, self_collision=own)


def _random_piece(rng: np.random.Generator, near: Array) -> Piece:
    kind = rng.choice(["box", "sphere", "capsule", "cylinder", "halfspace", "hull"])
    pose = Pose(near, random_pose(rng, 0.0).quat_wxyz)
    sizes = {"box": 3, "sphere": 1, "capsule": 2, "cylinder": 2}
    size = rng.uniform(0.03, 0.3, size=sizes.get(kind, 0))
    vertices = rng.normal(size=(8, 3)) * 0.15 if kind == "hull" else None
    return Piece(kind, kind, pose, size, vertices)
