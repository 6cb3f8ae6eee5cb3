"""Soundness of the branch and bound: random descents towards planted solutions must never lose one.

Wrong answers on problems without solution can't show a bug that loses solutions. What can: take a configuration, make
its tool pose the target (anywhere in the tolerance ball), and walk down a random tree of boxes that hold it. Every box
that a contractor excludes, or shrinks off the configuration, is a violation.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from workcell.geometry.types import Piece, SphereCover
from workcell.ik.branch_problem import inflation, problem_arrays
from workcell.ik.exact import ExactDistances, ExactKinematics, smallest_clearance
from workcell.ik.problem import IKProblem
from workcell.model.robot import Robot, serial_robot
from workcell.pose import Array, Pose, axis_angle_to_matrix

EDGE = 1e-9
"""Radians by which a planted angle may stick out of its box: the target of the test is itself rounded."""


@dataclass(frozen=True, slots=True)
class Descent:
    """What a number of descents found: boxes tried, and how many lost their solution, with a description of the first."""

    boxes: int
    violations: int
    first: str = ""


def random_chain(rng: np.random.Generator, dof: int) -> Robot:
    """A serial revolute robot with skew, parallel and meeting axes, zero-length links, and limits up to beyond a turn."""
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
    return serial_robot("random", joints, _random_pose(rng, 0.1))


def planted_problem(robot: Robot, rng: np.random.Generator, *, edge: float = 1.0) -> tuple[IKProblem, Array]:
    """A problem that `q` solves with an error of `edge` times the tolerances, `q` often near a singularity or a limit."""
    q = rng.uniform(robot.lower, robot.upper)
    if rng.random() < 0.4:
        special = rng.choice([0.0, np.pi / 2, -np.pi / 2, np.pi, 1e-4, -1e-3], size=len(q))
        chosen = rng.random(len(q)) < 0.6
        q = np.where(chosen, np.clip(special, robot.lower, robot.upper), q)
    if rng.random() < 0.2:
        q = np.where(rng.random(len(q)) < 0.3, rng.choice([robot.lower, robot.upper]), q)
    pose = robot.fk(q)
    position, rotation = inflation(IKProblem(robot, pose))
    shift, axis = rng.normal(size=3), rng.normal(size=3)
    shift *= edge * 0.999 * position / np.linalg.norm(shift)
    turn = axis_angle_to_matrix(axis / np.linalg.norm(axis), edge * 0.999 * rotation)
    target = Pose.from_rotation(pose.position + shift, turn @ pose.rotation)
    return IKProblem(robot, target), q


def surround(problem: IKProblem, q: Array, rng: np.random.Generator, count: int = 12) -> IKProblem:
    """The same problem with spheres on the links and obstacles of every kind that barely leave `q` free."""
    robot = problem.robot
    link = rng.integers(0, robot.dof + 1, size=10)
    cover = SphereCover(link, rng.normal(size=(10, 3)) * 0.05, rng.uniform(0.02, 0.12, size=10))
    rotation, position = ExactKinematics(robot).links(q)
    pieces: list[Piece] = []
    while len(pieces) < count:
        s = rng.integers(10)
        near = position[link[s]] + rotation[link[s]] @ cover.centre[s] + rng.normal(size=3) * 0.15
        piece = _random_piece(rng, near)
        gap = smallest_clearance(cover, rotation, position, ExactDistances([piece]))[0]
        if gap > 2e-5:
            pieces.append(piece)
    return IKProblem(robot, problem.target, tuple(pieces), cover)


def _random_piece(rng: np.random.Generator, near: Array) -> Piece:
    kind = rng.choice(["box", "sphere", "capsule", "cylinder", "halfspace", "hull"])
    pose = Pose(near, _random_pose(rng, 0.0).quat_wxyz)
    sizes = {"box": 3, "sphere": 1, "capsule": 2, "cylinder": 2}
    size = rng.uniform(0.03, 0.3, size=sizes.get(kind, 0))
    vertices = rng.normal(size=(8, 3)) * 0.15 if kind == "hull" else None
    return Piece(kind, kind, pose, size, vertices)


def _random_pose(rng: np.random.Generator, spread: float) -> Pose:
    quat = rng.normal(size=4)
    return Pose(rng.normal(size=3) * spread, quat / np.linalg.norm(quat))


def contractors() -> dict[str, Callable[[Any, Any], bool]]:
    """Every contractor by name, and all of them together."""
    from workcell.ik.branch_kernels.invariants import contract_invariants, contract_through
    from workcell.ik.branch_kernels.linear import contract_linear
    from workcell.ik.branch_kernels.neighbours import contract_neighbours
    from workcell.ik.branch_kernels.search import contract

    return {
        "C1": contract_neighbours,
        "C2": contract_invariants,
        "C3": contract_through,
        "linear": contract_linear,
        "all": contract,
    }


def descend(problem: IKProblem, q: Array, rng: np.random.Generator, name: str = "all") -> Descent:
    """Walk down towards `q`, applying one contractor (and the obstacles) to every box on the way."""
    from workcell.ik.branch_kernels.obstacles import find_blocked, new_sweep
    from workcell.ik.branch_kernels.state import new_state, recentre

    arrays = problem_arrays(problem)
    contract = contractors()[name]
    joints = arrays.root.shape[1]
    state, sweep = new_state(joints), new_sweep(joints)
    planted = np.concatenate([[0.0], _into(q, arrays.root[:, 1:-1]), [0.0]])
    state.lower[:], state.upper[:] = arrays.root
    boxes = 0
    for lower, upper in _boxes(state, planted, rng):
        state.lower[:], state.upper[:] = lower, upper
        recentre(arrays.chain, state)
        boxes += 1
        kept = contract(arrays.chain, state)
        lost = (planted < state.lower - EDGE) | (planted > state.upper + EDGE)
        if not kept or np.any(lost):
            return Descent(
                boxes, 1, f"{name}: lost {planted.tolist()} in {lower.tolist()} .. {upper.tolist()}"
            )
        blocked = find_blocked(arrays.chain, state, arrays.world, sweep, -1)
        if blocked[0] >= 0:
            return Descent(boxes, 1, f"{name}: sphere {blocked[0]} called blocked by {blocked[1]}")
    return Descent(boxes, 0)


def _boxes(state: Any, planted: Array, rng: np.random.Generator) -> Iterator[tuple[Array, Array]]:
    """Boxes around the planted angles, each cut from what is left of the last at random joints and places."""
    while True:
        lower, upper = np.array(state.lower), np.array(state.upper)
        yield lower, upper
        lower, upper = np.array(state.lower), np.array(state.upper)
        for k in rng.permutation(np.arange(1, len(planted) - 1))[: rng.integers(1, len(planted) - 1)]:
            cut = rng.uniform(lower[k], upper[k])
            if rng.random() < 0.2:
                cut = planted[k]
            if cut < planted[k] or (cut == planted[k] and rng.random() < 0.5):
                lower[k] = cut
            else:
                upper[k] = cut
        state.lower[:], state.upper[:] = lower, upper
        if np.max(upper - lower) < 1e-7:
            return


def _into(q: Array, root: Array) -> Array:
    """Angles moved by whole turns into the root box."""
    turn = 2 * np.pi
    moved: Array = q - turn * np.ceil((q - root[1] - EDGE) / turn) * (q > root[1] + EDGE)
    return moved + turn * np.ceil((root[0] - EDGE - moved) / turn) * (moved < root[0] - EDGE)  # type: ignore[no-any-return]
