"""The numbers that boxes are judged by err by less than what is kept back: against extended precision."""

from __future__ import annotations

import numpy as np
import pytest

from tests.ik.arms import beads
from tests.ik.lifted_arms import skew_arm
from workcell.bench.reference.nearly import nearly_arm, planted
from workcell.ik.problem import IKProblem
from workcell.ik.solution.box import Stance
from workcell.model.robot import Robot
from workcell.pose import Array, Pose

LONG = np.longdouble


def turned(quat: Array) -> Array:
    """The rotation of a quaternion divided by its length, in extended precision."""
    w, x, y, z = np.asarray(quat, dtype=LONG) / np.sqrt((np.asarray(quat, dtype=LONG) ** 2).sum())
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows, dtype=LONG)


def nearest_rotation(matrix: Array) -> Array:
    """Newton's iteration to the orthogonal factor."""
    R = np.asarray(matrix, dtype=LONG)
    for _ in range(6):
        R = R - 0.5 * R @ (R.T @ R - np.eye(3))
    return np.asarray(R)


def links(robot: Robot, q: Array) -> list[tuple[Array, Array]]:
    """Rotation and position of every link, and of the tool, in extended precision."""
    base = robot.T_world_base
    found = [(turned(base.quat_wxyz), np.asarray(base.position, dtype=LONG))]
    for k in range(robot.dof):
        R, o = found[-1]
        a = np.asarray(robot.axis[k], dtype=LONG)
        a = a / np.sqrt((a * a).sum())
        K = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]], dtype=LONG)
        angle = LONG(q[k])
        turn = np.eye(3, dtype=LONG) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K
        found.append((R @ nearest_rotation(robot.joint_rotation[k]) @ turn, o + R @ robot.joint_xyz[k]))
    tool = robot.tool().T_link_tool
    R, o = found[-1]
    return [*found, (R @ turned(tool.quat_wxyz), o + R @ np.asarray(tool.position, dtype=LONG))]


@pytest.mark.parametrize("seed", range(10))
def test_equations_slopes_and_centres(seed: int) -> None:
    rng = np.random.default_rng(seed)
    robot = skew_arm(seed, 6 + seed % 4) if seed % 2 else nearly_arm(rng)
    problem, q = planted(robot, rng)
    q = q + 1e-5 * rng.normal(size=robot.dof)
    cover = beads(robot, 0.04)
    stance = Stance.at(IKProblem(robot, problem.target, cover=cover), q)
    assert isinstance(stance, Stance)
    found = links(robot, q)
    R, p = found[-1]
    M = R @ turned(problem.target.quat_wxyz).T
    f = [*(p - problem.target.position), *(0.5 * (M - M.T))[[2, 0, 1], [1, 2, 0]]]
    assert np.abs(stance.equations - np.array(f)).max() < stance.rounding
    assert abs(stance.turned - np.sqrt(((M - np.eye(3)) ** 2).sum())) < 3 * stance.rounding
    for k in range(robot.dof):
        before, (_, o) = found[k], found[k + 1]
        z = before[0] @ nearest_rotation(robot.joint_rotation[k]) @ robot.axis[k]
        column = [*np.cross(z, p - o), *(0.5 * (np.trace(M) * z - M @ z))]
        assert np.abs(stance.slopes[:, k] - np.array(column)).max() < stance.rounding
    for s, (link, centre) in enumerate(zip(cover.link, cover.centre, strict=True)):
        place = found[link][1] + found[link][0] @ centre
        assert np.abs(stance.centres[s] - place).max() < stance.rounding


def test_slopes_are_the_derivatives_of_the_equations() -> None:
    robot, rng = skew_arm(2, 7), np.random.default_rng(2)
    q = robot.random_configuration(rng)
    far = robot.fk(q + 0.1 * rng.normal(size=7))
    problem = IKProblem(robot, Pose(far.position, far.quat_wxyz))
    here = Stance.at(problem, q)
    assert isinstance(here, Stance)
    for k in range(7):
        step = 1e-5 * np.eye(7)[k]
        ahead, behind = Stance.at(problem, q + step), Stance.at(problem, q - step)
        assert isinstance(ahead, Stance) and isinstance(behind, Stance)
        slope = (ahead.equations - behind.equations) / 2e-5
        assert np.abs(slope - here.slopes[:, k]).max() < 1e-8


def test_equations_stay_within_the_remainder_over_a_box() -> None:
    for seed in range(5):
        robot, rng = skew_arm(seed, 6), np.random.default_rng(seed)
        problem, q = planted(robot, rng)
        here = Stance.at(problem, q)
        assert isinstance(here, Stance)
        half = np.full(6, 0.05)
        image = here.image(np.arange(6), np.eye(6), half)
        for _ in range(50):
            step = half * rng.uniform(-1.0, 1.0, 6)
            there = Stance.at(problem, q + step)
            assert isinstance(there, Stance)
            assert np.all(np.abs(step - there.equations) <= image + 1e-12)
