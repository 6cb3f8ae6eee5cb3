"""The compiled kernels without obstacles against the plain robot, and what they take."""

from __future__ import annotations

import numpy as np
import pytest

from tests.ik.arms import planar, random_arm, seven
from workcell.errors import InputError
from workcell.ik.hjcd.batch import polish_seeds, solve_batch, solve_two_phase
from workcell.pose import Pose


@pytest.mark.parametrize("dof", [6, 7, 9, 14, 24])
@pytest.mark.parametrize("sliding", [False, True])
def test_targets_are_reached_by_any_chain(dof, sliding):
    rng = np.random.default_rng(100 * dof + sliding)
    for _ in range(4):
        robot = random_arm(rng, dof, sliding)
        if np.sum(~robot.prismatic) < 5:
            continue
        targets = [robot.fk(q) for q in robot.random_configuration(rng, 20)]
        solution = solve_batch(robot, targets, seed=1, restarts=2000)
        errors = np.array([robot.fk(q).error_to(t) for q, t in zip(solution.q, targets, strict=True)])
        assert errors.max() < 1e-6
        assert np.all(robot.within_limits(solution.q))
        assert np.all(solution.residual < 1e-7)


@pytest.mark.parametrize("links", [(0.4,), (0.5, 0.4), (0.4, 0.3, 0.2), (0.3, 0.3, 0.2, 0.2, 0.1)])
def test_chains_that_cannot_reach_every_pose(links):
    robot = planar(links)
    rng = np.random.default_rng(len(links))
    targets = [robot.fk(q) for q in robot.random_configuration(rng, 20)]
    solution = solve_batch(robot, targets)
    assert max(robot.fk(q).error_to(t)[0] for q, t in zip(solution.q, targets, strict=True)) < 1e-6


def test_singular_and_half_turn_targets():
    robot = seven()
    stretched = robot.fk(np.zeros(7))
    solution = solve_batch(robot, [stretched], restarts=2000, accuracy=1e-6)
    assert max(robot.fk(solution.q[0]).error_to(stretched)) < 1e-5
    start = np.array([0.3, 0.4, 0.2, -0.9, 0.1, 0.6, -np.pi / 2])
    turned = start + np.array([0, 0, 0, 0, 0, 0, np.pi])
    assert robot.fk(start).error_to(robot.fk(turned))[1] == pytest.approx(np.pi)
    assert solve_batch(robot, [robot.fk(turned)], first=[start], restarts=20).residual[0] < 1e-7


def test_a_start_near_the_target_is_kept():
    robot = seven()
    q = np.array([0.3, 0.4, 0.2, -0.9, 0.1, 0.6, 0.2])
    solution = solve_batch(robot, [robot.fk(q)], first=[q + 0.01])
    assert np.abs(solution.q[0] - q).max() < 0.05
    assert solution.restarts == 1


def test_threads_and_seeds_repeat():
    robot = seven()
    targets = [robot.fk(q) for q in robot.random_configuration(np.random.default_rng(3), 30)]
    for threads in (1, 2):
        one, two = (solve_batch(robot, targets, seed=5, threads=threads) for _ in range(2))
        assert np.array_equal(one.q, two.q)
    assert not np.array_equal(solve_batch(robot, targets, seed=6).q, one.q)


@pytest.mark.parametrize("batch", [1, 8, 12, 100, 2500])
def test_two_phases_over_a_batch(batch):
    robot = seven()
    rng = np.random.default_rng(batch)
    for k in range(5):
        target = robot.fk(robot.random_configuration(rng))
        solution = solve_two_phase(robot, target, batch, seed=k, threads=1 + k % 2)
        assert np.all(np.diff(solution.residual) >= 0)
        assert np.all(robot.within_limits(solution.q))
        position, rotation = robot.fk(solution.q[0]).error_to(target)
        assert solution.residual[0] == pytest.approx(np.hypot(position, 0.3 * rotation), rel=1e-3, abs=1e-9)
        if batch >= 100:
            assert solution.residual[0] < 1e-9


def test_bad_batches():
    robot = seven()
    with pytest.raises(InputError, match="shape"):
        solve_batch(robot, np.zeros((2, 6)))
    with pytest.raises(InputError, match="not finite"):
        solve_batch(robot, np.full((1, 7), np.nan))
    with pytest.raises(InputError, match="length"):
        solve_batch(robot, np.array([[0.3, 0, 0.5, 2.0, 0, 0, 0]]))
    with pytest.raises(InputError, match="2 configurations for 1"):
        solve_batch(robot, [Pose.identity()], first=np.zeros((2, 7)))
    with pytest.raises(InputError, match="at least 1"):
        solve_two_phase(robot, Pose.identity(), 0)
    with pytest.raises(InputError, match=r"\(k, 7\)"):
        polish_seeds(robot, Pose.identity(), np.zeros(7))
    assert solve_batch(robot, []).q.shape == (0, 7)
