"""IKSPARK's relaxation written plainly in cvxpy: to read, to test the fast path against, and to extend.

    problem, model = relaxation(ik_problem)
    higher = model.point(4, np.zeros(3))[2] >= 0.5          # the elbow at least half a metre up
    cvxpy.Problem(cvxpy.Minimize(0), problem.constraints + [higher]).solve(solver="CLARABEL")

If that is infeasible, no configuration that reaches the target keeps the added (convex) constraint. cvxpy takes
seconds to import and a hundred times longer per solve than `workcell.ik.ikspark.solver`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from workcell.errors import InputError
from workcell.ik.ikspark.lift import frame_with_z
from workcell.ik.ikspark.obstacles.pairs import reachable_pairs, region_pairs
from workcell.ik.ikspark.obstacles.regions import Regions
from workcell.ik.problem import IKProblem
from workcell.ik.shared.limits import Interval
from workcell.pose import Array

if TYPE_CHECKING:
    import cvxpy

Expression = Any
"""A cvxpy expression; cvxpy carries no types."""


@dataclass(frozen=True, slots=True)
class PlainModel:
    """The relaxation's expressions, in the world frame.

    Attributes:
        rotations: n + 1 expressions (3, 3), the links' rotations; constants for the base and the last link.
        origins: n + 1 expressions (3,), the links' origins.
        blocks: by link, the 4x4 matrix that stands for its quaternion's outer product.
        discs: by link, the pair (cosine, sine) of a planar link.
        inside: by (sphere, region), how far the sphere counts as inside the cuboid, or after those the polytope, from
            0 to 1.
    """

    rotations: list[Expression]
    origins: list[Expression]
    blocks: dict[int, Expression]
    discs: dict[int, Expression]
    inside: dict[tuple[int, int], Expression]

    def point(self, link: int, position: Array) -> Expression:
        """World place (3,) of a point of a link, given in the link's frame."""
        return self.origins[link] + self.rotations[link] @ np.asarray(position, dtype=float)


def relaxation(problem: IKProblem) -> tuple[cvxpy.Problem, PlainModel]:
    """A feasibility problem over all lifted configurations that reach the target, and the expressions in it.

    With `free_space` and `cover`, every moving sphere is also inside a cuboid or polytope, relaxed by perspectives.

    Raises:
        InputError: a prismatic joint, or a chain of fewer than two joints.
    """
    import cvxpy as cp

    robot = problem.robot
    if np.any(robot.prismatic) or robot.dof < 2:
        raise InputError("the plain relaxation takes two or more revolute joints", where=robot.name)
    model = _variables(problem)
    constraints = [block >> 0 for block in model.blocks.values()]
    constraints += [cp.trace(block) == 1 for block in model.blocks.values()]
    constraints += [cp.norm(disc) <= 1 for disc in model.discs.values()]
    constraints += _joints(problem, model)
    tool = robot.tool().T_link_tool
    constraints.append(model.point(robot.dof, tool.position) == problem.target.position)
    if problem.max_link_rotation is not None:
        constraints += _continuity(problem, model)
    if problem.free_space is not None and problem.cover is not None:
        constraints += _cuboids(problem, model)
    return cp.Problem(cp.Minimize(0), constraints), model


def _variables(problem: IKProblem) -> PlainModel:
    """A rotation for every link: known, planar (next to base or target) or from a quaternion block."""
    import cvxpy as cp

    robot, n = problem.robot, problem.robot.dof
    base = problem.robot.T_world_base
    last = problem.target.rotation @ robot.tool().T_link_tool.rotation.T
    rotations: list[Expression] = [cp.Constant(base.rotation), *([None] * (n - 1)), cp.Constant(last)]
    blocks: dict[int, Expression] = {}
    discs = {1: cp.Variable(2)}
    F = frame_with_z(robot.axis[0])
    rotations[1] = base.rotation @ robot.joint_rotation[0] @ F @ _about_z(discs[1]) @ F.T
    if n > 2:
        # R_n = R_(n-1) J Rot(a, q), so that R_(n-1) = R_n Rot(a, q)^T J^T
        discs[n - 1] = cp.Variable(2)
        F = frame_with_z(robot.axis[-1])
        rotations[n - 1] = last @ F @ _about_z(discs[n - 1]).T @ F.T @ robot.joint_rotation[-1].T
    for link in range(2, n - 1):
        blocks[link] = cp.Variable((4, 4), symmetric=True)
        rotations[link] = _rotation(blocks[link])
    origins: list[Expression] = [cp.Constant(base.position)]
    for k in range(n):
        origins.append(origins[k] + rotations[k] @ robot.joint_xyz[k])
    return PlainModel(rotations, origins, blocks, discs, {})


def _about_z(disc: Expression) -> Expression:
    import cvxpy as cp

    c, s = disc[0], disc[1]
    return cp.bmat([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def _rotation(Q: Expression) -> Expression:
    """Eq. 77-78: the rotation of a unit quaternion (r, x, y, z), linear in Q = q q^T."""
    import cvxpy as cp

    r, x, y, z = range(4)
    return cp.bmat(
        [
            [1 - 2 * (Q[y, y] + Q[z, z]), 2 * (Q[x, y] - Q[r, z]), 2 * (Q[x, z] + Q[r, y])],
            [2 * (Q[x, y] + Q[r, z]), 1 - 2 * (Q[x, x] + Q[z, z]), 2 * (Q[y, z] - Q[r, x])],
            [2 * (Q[x, z] - Q[r, y]), 2 * (Q[y, z] + Q[r, x]), 1 - 2 * (Q[x, x] + Q[y, y])],
        ]
    )


def _joints(problem: IKProblem, model: PlainModel) -> list[Expression]:
    """Neighbouring links share the joint's axis (5) and keep its limits (8)."""
    import cvxpy as cp

    robot, interval, rows = problem.robot, Interval.of(problem), []
    planar = {0: model.discs[1]} | ({robot.dof - 1: model.discs[robot.dof - 1]} if robot.dof > 2 else {})
    for k in range(robot.dof):
        parent = model.rotations[k] @ robot.joint_rotation[k]
        child = model.rotations[k + 1]
        half, middle = interval.half[k], interval.middle[k]
        if k in planar:
            if half < np.pi:
                rows.append(planar[k] @ np.array([np.cos(middle), np.sin(middle)]) >= np.cos(half))
            continue
        rows.append(parent @ robot.axis[k] == child @ robot.axis[k])
        if half < np.pi:
            frame = frame_with_z(robot.axis[k])
            turned = np.cos(middle) * frame[:, 0] + np.sin(middle) * frame[:, 1]
            rows.append(cp.norm(parent @ turned - child @ frame[:, 0]) <= np.sqrt(2 - 2 * np.cos(half)))
    return rows


def _continuity(problem: IKProblem, model: PlainModel) -> list[Expression]:
    """Eq. 75: no link turns by more than `max_link_rotation` (Frobenius norm); exact at rotations."""
    import cvxpy as cp

    if problem.q_reference is None or problem.max_link_rotation is None:
        raise InputError("max_link_rotation needs q_reference", where="max_link_rotation")
    before = problem.robot.link_transforms(problem.q_reference)[:, :3, :3]
    least = 3.0 - 0.5 * problem.max_link_rotation**2
    return [cp.sum(cp.multiply(before[k], model.rotations[k])) >= least for k in range(1, problem.robot.dof)]


def _cuboids(problem: IKProblem, model: PlainModel) -> list[Expression]:
    """The perspective relaxation (69), (71) over the pairs of sphere and region within reach of each other."""
    import cvxpy as cp

    free_space, cover = problem.free_space, problem.cover
    assert free_space is not None and cover is not None
    pairs = reachable_pairs(problem, free_space)
    allowed = region_pairs(problem, Regions.of(free_space), steps=False)
    rows: list[Expression] = []
    for j, sphere in enumerate(pairs.sphere):
        shares, places = [], []
        needed = float(cover.radius[sphere]) + problem.tolerances.safety_margin
        for i in np.flatnonzero(allowed[j]):
            z, delta = cp.Variable(3), cp.Variable()
            model.inside[int(sphere), int(i)] = delta
            if i < len(free_space):
                rows += [z >= delta * pairs.lower[j, i], z <= delta * pairs.upper[j, i]]
            else:
                polytope = free_space.polytopes[i - len(free_space)]
                rows.append(polytope.A @ z <= delta * (polytope.b - needed))
            shares.append(delta)
            places.append(z)
        if not shares:
            rows.append(cp.Constant(1) <= 0)
            continue
        centre = model.point(int(cover.link[sphere]), cover.centre[sphere])
        rows += [cp.sum(cp.hstack(shares)) == 1, cp.sum(cp.vstack(places), axis=0) == centre]
    return rows
