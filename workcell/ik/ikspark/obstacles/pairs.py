"""Which region of free space each sphere can be in at all: bounds along the chain rule pairs out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workcell.geometry.free_space.admissible import check_table
from workcell.geometry.types import FreeSpace
from workcell.ik.ikspark.obstacles.regions import Regions
from workcell.ik.problem import STEP_SLACK, IKProblem
from workcell.ik.shared.limits import Interval
from workcell.model.robot import LIMIT_SLACK
from workcell.pose import Array

_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Pairs:
    """Which cuboids each moving sphere may be in.

    Attributes:
        sphere: (m,) indices into the cover of the spheres that joints move.
        lower, upper: (m, k, 3) where the centre of a sphere is when it lies in a cuboid; world frame.
        allowed: (m, k) pairs that are not ruled out.
    """

    sphere: NDArray[np.int64]
    lower: Array
    upper: Array
    allowed: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Balls:
    """Balls (m,) that the centres of moving spheres stay in, whatever the configuration."""

    centre: Array
    radius: Array


def reachable_pairs(problem: IKProblem, free_space: FreeSpace) -> Pairs:
    """Pairs of sphere and cuboid that the triangle inequality along the chain allows, from the base and the target.

    The target may move by the problem's tolerances, so that a dropped pair is impossible for all that counts as
    reaching it.
    """
    assert problem.cover is not None
    sphere = np.flatnonzero(problem.cover.link > 0)
    needed = (problem.cover.radius[sphere] + problem.tolerances.safety_margin)[:, None, None]
    lower, upper = free_space.lower[None] + needed, free_space.upper[None] - needed
    allowed = np.all(lower <= upper, axis=-1)
    for balls in chain_balls(problem):
        allowed &= _meet(balls, lower, upper)
    if free_space.admissible is not None:
        allowed &= checked_table(problem, free_space)[sphere]
    return Pairs(sphere, lower, upper, allowed)


def region_pairs(problem: IKProblem, regions: Regions, *, steps: bool = True) -> NDArray[np.bool_]:
    """(m, n) which regions, cuboids and polytopes, each moving sphere may be in.

    With `steps`, what the joints' intervals around a reference leave no room for is ruled out too.
    """
    free_space, cuboids = regions.free_space, len(regions.free_space)
    pairs = reachable_pairs(problem, free_space)
    allowed = np.ones((len(pairs.sphere), len(regions)), dtype=bool)
    allowed[:, :cuboids] = pairs.allowed
    balls = list(chain_balls(problem))
    if steps and problem.max_step is not None:
        near = step_balls(problem)
        for ball in near:
            allowed[:, :cuboids] &= _meet(ball, pairs.lower, pairs.upper)
        balls += near
    if len(regions) > cuboids:
        assert problem.cover is not None
        needed = problem.cover.radius[pairs.sphere] + problem.tolerances.safety_margin
        for ball in balls:
            allowed[:, cuboids:] &= (
                regions.depths(ball.centre, needed - ball.radius)[:, cuboids:] <= _ROUNDING
            )
    return allowed


def checked_table(problem: IKProblem, free_space: FreeSpace) -> NDArray[np.bool_]:
    """The free space's table of pairs, if it is of the problem's robot and cover."""
    assert problem.cover is not None and free_space.admissible is not None
    check_table(problem.robot, problem.cover, free_space)
    return free_space.admissible


def _meet(balls: Balls, lower: Array, upper: Array) -> NDArray[np.bool_]:
    """Whether balls (m,) meet the boxes (m, k, 3)."""
    centre = balls.centre[:, None]
    outside = np.maximum(np.maximum(lower - centre, centre - upper), 0.0)
    near: NDArray[np.bool_] = np.linalg.norm(outside, axis=-1) <= balls.radius[:, None] + _ROUNDING
    return near


def chain_balls(problem: IKProblem) -> tuple[Balls, Balls]:
    """Where the triangle inequality along the chain lets moving spheres be, from the base and from the target."""
    cover, robot = problem.cover, problem.robot
    assert cover is not None
    sphere = np.flatnonzero(cover.link > 0)
    link, local = cover.link[sphere], cover.centre[sphere]
    length = np.linalg.norm(robot.joint_xyz, axis=1)
    first = robot.T_world_base.apply(robot.joint_xyz[0])
    along = np.concatenate([[0.0], np.cumsum(length[1:])])
    from_base = along[link - 1] + np.linalg.norm(local, axis=1)
    tool = robot.tool().T_link_tool
    last = (problem.target @ tool.inverse()).position
    next_joint = np.vstack([robot.joint_xyz[1:], np.zeros(3)])[link - 1]
    beyond = np.concatenate([np.cumsum(length[:0:-1])[::-1], [0.0, 0.0]])[link]
    from_goal = np.linalg.norm(next_joint - local, axis=1) + beyond
    from_goal += problem.tolerances.position + problem.tolerances.rotation * float(
        np.linalg.norm(tool.position)
    )
    m = (len(sphere), 3)
    return Balls(np.broadcast_to(first, m), from_base), Balls(np.broadcast_to(last, m), from_goal)


def step_balls(problem: IKProblem) -> list[Balls]:
    """Where the joints' intervals let moving spheres be, from the base and from the target.

    From a sphere's link towards the base (or the target), each joint moves all that is within r of a place by
    2 sin(h / 2) (d + r) at most, h being half its interval, and d the place's distance from its axis.
    """
    cover, robot = problem.cover, problem.robot
    assert cover is not None
    interval = Interval.of(problem, LIMIT_SLACK + STEP_SLACK)
    half = np.maximum(0.5 * (interval.upper - interval.lower), 0.0)
    chord = 2.0 * np.sin(0.5 * np.minimum(half, np.pi))
    sphere = np.flatnonzero(cover.link > 0)
    T = robot.link_transforms(interval.middle)
    link = cover.link[sphere]
    centre = np.einsum("mij,mj->mi", T[link, :3, :3], cover.centre[sphere]) + T[link, :3, 3]
    axes = np.einsum("kij,kj->ki", T[1:, :3, :3], robot.axis)
    aside = np.linalg.norm(np.cross(centre[:, None] - T[None, 1:, :3, 3], axes[None]), axis=-1)
    from_base, from_goal = np.zeros(len(sphere)), np.zeros(len(sphere))
    for k in reversed(range(robot.dof)):
        from_base += np.where(link > k, chord[k] * (aside[:, k] + from_base), 0.0)
    for k in range(robot.dof):
        from_goal += np.where(link <= k, chord[k] * (aside[:, k] + from_goal), 0.0)
    tool = robot.tool().T_link_tool
    last = problem.target @ tool.inverse()
    in_last = (centre - T[-1, :3, 3]) @ T[-1, :3, :3]
    at_goal = in_last @ last.rotation.T + last.position
    reach = np.linalg.norm(in_last - tool.position, axis=1) + from_goal
    from_goal += problem.tolerances.position + problem.tolerances.rotation * reach
    return [Balls(centre, from_base), Balls(at_goal, from_goal)]
