"""HJCD-IK on Warp, run on its CPU device: the numbers of the numba kernels, phase by phase, and their solutions."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from tests.ik.arms import planar, random_arm, seven
from workcell.errors import InputError
from workcell.geometry.packing import pack_arm
from workcell.ik.hjcd.batch import solve_batch, solve_two_phase
from workcell.ik.hjcd.memory import kernels
from workcell.pose import Pose

needs_warp = pytest.mark.skipif(
    importlib.util.find_spec("warp") is None, reason="NVIDIA Warp (the extra workcell[gpu]) is not installed"
)


@pytest.fixture(scope="module")
def arm():
    """Seven joints, one of them sliding and one free to turn by more than a turn."""
    robot = seven()
    prismatic, lower, upper = np.zeros(7, bool), np.array(robot.lower), np.array(robot.upper)
    prismatic[1], lower[1], upper[1], lower[5], upper[5] = True, -0.2, 0.3, -4.0, 4.0
    return replace(robot, prismatic=prismatic, lower=lower, upper=upper)


def poses_of(robot, rng, count):
    targets = [robot.fk(q) for q in robot.random_configuration(rng, count)]
    return np.array([[*target.position, *target.quat_wxyz] for target in targets])


@needs_warp
def test_both_phases_compute_what_numba_computes(arm):
    from workcell.ik.hjcd.gpu.solver import WarpSolver

    rng = np.random.default_rng(0)
    poses, seeds = poses_of(arm, rng, 6), arm.random_configuration(rng, 6 * 9).reshape(6, 9, 7)
    solver, chain = WarpSolver(pack_arm(arm), "cpu"), pack_arm(arm)
    descended, polished = seeds.copy(), seeds.copy()
    cost, residual = np.empty((6, 9)), np.empty((6, 9))
    for i, pose in enumerate(poses):
        kernels().polish_batch(chain, pose, 1e-8, polished[i], residual[i])
        for j in range(9):
            kernels().descend_batch(chain, pose, descended[i, j : j + 1], 4, 0.0, cost[i, j : j + 1])
    q, reached = solver.descend(poses, seeds, 4)
    np.testing.assert_allclose(q, descended, atol=1e-9)
    np.testing.assert_allclose(reached, cost, atol=1e-10)
    q, reached = solver.polish(poses, seeds, 1e-8)
    # Where a polish gives up, rounding may send the last steps elsewhere; where it succeeds, it ends at the same place.
    solved = residual < 1e-16
    assert solved.mean() > 0.2
    assert np.array_equal(reached < 1e-16, solved)
    np.testing.assert_allclose(q[solved], polished[solved], atol=1e-6)


@needs_warp
def test_many_targets_are_solved_within_the_limits(arm):
    rng = np.random.default_rng(1)
    poses = poses_of(arm, rng, 200)
    solution = solve_batch(arm, poses, seed=3, device="cpu")
    assert solution.residual.max() < 1e-8
    assert arm.within_limits(solution.q).all()
    targets = [Pose(pose[:3], pose[3:]) for pose in poses]
    errors = [arm.fk(q).error_to(target) for q, target in zip(solution.q, targets, strict=True)]
    assert np.max(errors) < 1e-7
    again = solve_batch(arm, poses, seed=3, device="cpu")
    assert np.array_equal(solution.q, again.q)


@needs_warp
def test_given_configurations_come_first_and_hopeless_targets_end(arm):
    rng = np.random.default_rng(2)
    q = arm.random_configuration(rng, 3)
    targets = [arm.fk(row) for row in q]
    near = solve_batch(arm, targets, first=q + 1e-3, restarts=1, device="cpu")
    assert np.abs(near.q - q).max() < 0.1
    assert near.restarts == 3
    far = solve_batch(arm, [[5.0, 0, 0, 1, 0, 0, 0]], restarts=6, device="cpu")
    assert far.restarts == 6
    assert far.residual[0] > 1.0
    assert len(solve_batch(arm, np.empty((0, 7)), device="cpu").q) == 0


@needs_warp
@pytest.mark.parametrize("sampling", ["uniform", "halton"])
def test_two_phases_over_one_batch(arm, sampling):
    target = arm.fk(arm.random_configuration(np.random.default_rng(4)))
    ours = solve_two_phase(arm, target, 200, seed=1, sampling=sampling, device="cpu")
    numba = solve_two_phase(arm, target, 200, seed=1, sampling=sampling)
    assert len(ours.q) == len(numba.q)
    for solution in (ours, numba):
        assert solution.residual[0] < 1e-8
        assert np.all(np.diff(solution.residual) >= 0)
        assert max(arm.fk(solution.q[0]).error_to(target)) < 1e-6


@needs_warp
def test_equal_costs_rank_by_index():
    import warp

    from workcell.ik.hjcd.gpu.programs import rank

    cost = warp.array(np.array([[3.0, 1.0, 1.0, 0.5, 1e300]]), dtype=warp.float64, device="cpu")
    kept = warp.empty((1, 3), dtype=int, device="cpu")
    warp.launch(rank, dim=cost.shape, inputs=[cost, kept], device="cpu")
    assert kept.numpy().tolist() == [[3, 1, 2]]


@needs_warp
def test_unknown_devices_are_named(arm):
    with pytest.raises(InputError, match=r"no device 'tpu:0'.*cpu"):
        solve_batch(arm, np.empty((0, 7)), device="tpu:0")


def test_without_warp_the_extra_is_named(monkeypatch):
    from workcell.ik.hjcd.gpu import solver

    monkeypatch.setitem(sys.modules, "warp", None)
    solver.load_warp.cache_clear()
    with pytest.raises(InputError, match=r"workcell\[gpu\]"):
        solve_batch(random_arm(np.random.default_rng(0)), np.empty((0, 7)), device="cuda:0")
    solver.load_warp.cache_clear()


def test_the_solver_on_numba_does_not_import_warp():
    code = "import sys, workcell.ik.hjcd.batch, workcell.ik.hjcd.gpu.solver; sys.exit('warp' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@needs_warp
def test_a_single_joint():
    robot = planar((0.3,))
    solution = solve_batch(robot, [robot.fk(np.array([0.4]))], device="cpu")
    assert solution.q[0] == pytest.approx([0.4], abs=1e-7)
