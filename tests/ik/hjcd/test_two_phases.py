"""The paper's two phases: each update and each step against plain numpy, and what the phases come to."""

from __future__ import annotations

import numpy as np
import pytest

from tests.ik.arms import random_arm, seven
from workcell.bench.ik.hjcd import halton_targets, panda
from workcell.geometry.packing import pack_arm
from workcell.ik.hjcd.batch import solve_two_phase
from workcell.ik.hjcd.kernels.greedy import COARSE_POSITION, KICK, LEAST, SWEEPS, sweep_seeds
from workcell.ik.hjcd.kernels.weighted import LEAST_SHARE, apply_weights, damped_step, dogleg, weigh
from workcell.ik.hjcd.kernels.weighted_polish import polish_copies
from workcell.model.robot import Robot
from workcell.pose import Array, Pose, rotation_vector


def _row(target: Pose) -> Array:
    return np.concatenate([target.position, target.quat_wxyz])


def _states(count: int) -> np.ndarray:
    return np.arange(1, count + 1, dtype=np.uint64).reshape(-1, 1)


def _errors(robot: Robot, target: Pose, q: Array) -> Array:
    return np.array(robot.fk(q).error_to(target))


def _motions(robot: Robot, target: Pose, q: Array, k: int, anneal: float) -> tuple[float, float]:
    """Joint k's positional and orientational motion by Eqs. 8-11, from the robot's own frames."""
    frame, tool = robot.link_transforms(q)[k + 1], robot.fk(q)
    z, low, high = frame[:3, :3] @ robot.axis[k], robot.lower[k] - q[k], robot.upper[k] - q[k]
    if robot.prismatic[k]:
        return float(np.clip(z @ (target.position - tool.position), low, high)), 0.0
    u, v = tool.position - frame[:3, 3], target.position - frame[:3, 3]
    u, v = u - z * (z @ u), v - z * (z @ v)
    move = np.arctan2(z @ np.cross(u, v), u @ v)
    missing = rotation_vector(target.rotation @ tool.rotation.T)
    return float(np.clip(move, low, high)), float(np.clip(anneal * (missing @ z), low, high))


def _greedy(robot: Robot, target: Pose, q: Array, sweep: int) -> Array | None:
    """The update of Alg. 3 by trying every joint; None where neither error falls."""
    before, anneal = _errors(robot, target, q), 0.75 + 0.25 * (1 - sweep / SWEEPS)
    tried = []
    for k in range(robot.dof):
        for which, motion in enumerate(_motions(robot, target, q, k, anneal)):
            there = q.copy()
            there[k] += motion
            tried.append((_errors(robot, target, there)[which], which, k, motion))
    best = [min(entry for entry in tried if entry[1] == which) for which in (0, 1)]
    helpful = [entry for entry in best if entry[0] < before[entry[1]] - LEAST]
    after = q.copy()
    if len(helpful) == 2 and helpful[0][2] == helpful[1][2]:
        helpful = [max(helpful, key=lambda entry: abs(entry[3]))]
    for _, _, k, motion in helpful:
        after[k] += motion
    fell = _errors(robot, target, after) < before - LEAST
    return after if helpful and np.any(fell) else None


@pytest.mark.parametrize(("dof", "sliding"), [(6, False), (7, True), (12, False)])
def test_an_update_is_the_best_of_all_joints_and_kinds(dof: int, sliding: bool) -> None:
    rng = np.random.default_rng(dof)
    robot = random_arm(rng, dof, sliding)
    kicked = 0
    for _ in range(8):
        target = robot.fk(robot.random_configuration(rng))
        q, errors = robot.random_configuration(rng, 1), np.empty((1, 2))
        for sweep in range(SWEEPS):
            expected = _greedy(robot, target, q[0], sweep)
            before = q.copy()
            sweep_seeds(pack_arm(robot), _row(target), sweep, sweep + 1, _states(1), q, errors)
            np.testing.assert_allclose(errors[0], _errors(robot, target, q[0]), atol=1e-9)
            if expected is None:
                kicked += 1
                assert np.all(np.abs(q - before) <= KICK * (robot.upper - robot.lower) + 1e-12)
                assert np.all(robot.within_limits(q))
            else:
                np.testing.assert_allclose(q[0], expected, atol=1e-7)
    assert kicked > 0 or sliding


def test_errors_fall_at_every_update_but_a_kick() -> None:
    # one of the two falls: the paper asks for progress "along either the position or orientation task space"
    robot, rng = seven(), np.random.default_rng(4)
    target = robot.fk(robot.random_configuration(rng))
    seeds, errors, states = robot.random_configuration(rng, 40), np.empty((40, 2)), _states(40)
    fell = kicks = 0
    for sweep in range(SWEEPS):
        before, seen = np.array([_errors(robot, target, q) for q in seeds]), states.copy()
        sweep_seeds(pack_arm(robot), _row(target), sweep, sweep + 1, states, seeds, errors)
        kicked = np.any(states != seen, axis=1)
        lower = np.any(errors < before - 0.99 * LEAST, axis=1)
        assert np.all(lower | kicked)
        fell, kicks = fell + int(lower.sum()), kicks + int(kicked.sum())
    assert fell > 3 * kicks


def test_phase_one_ends_for_all_seeds_when_one_is_near() -> None:
    robot, rng = seven(), np.random.default_rng(5)
    q = robot.random_configuration(rng)
    target = robot.fk(q)
    seeds, errors = robot.random_configuration(rng, 6), np.empty((6, 2))
    seeds[3] = q + 0.003
    apart = seeds.copy()
    assert sweep_seeds(pack_arm(robot), _row(target), 0, SWEEPS, _states(6), seeds, errors) == 1
    assert errors[3, 0] < COARSE_POSITION
    once = np.empty((6, 2))
    sweep_seeds(pack_arm(robot), _row(target), 0, 1, _states(6), apart, once)
    assert np.array_equal(seeds, apart) and np.array_equal(errors, once)
    solution = solve_two_phase(robot, target, 2000)
    assert 1 <= solution.sweeps < SWEEPS
    assert solve_two_phase(robot, Pose.from_xyz([5.0, 0.0, 0.0]), 3, threads=2).sweeps == SWEEPS


def test_weights_make_rows_alike_and_follow_the_larger_error() -> None:
    rng = np.random.default_rng(0)
    for scale in (1e-3, 1.0, 1e3):
        J, e, w = rng.normal(size=(6, 7)), rng.normal(size=6), np.empty(6)
        J[:3] *= 0.01
        e[3:] *= scale
        weigh(J, e, w)
        lengths = np.linalg.norm(w[:, None] * J, axis=1)
        assert np.ptp(lengths[:3]) < 1e-12 and np.ptp(lengths[3:]) < 1e-12
        assert lengths[0] + lengths[3] == pytest.approx(2.0)
        assert LEAST_SHARE - 1e-9 <= lengths[0] <= 2.0 - LEAST_SHARE + 1e-9
        ahead = np.linalg.norm(e[:3]) > np.linalg.norm(e[3:])
        assert (lengths[0] > lengths[3]) == ahead
    # a row without length stays finite
    J[1] = 0.0
    weigh(J, e, w)
    assert np.all(np.isfinite(w))


@pytest.mark.parametrize("n", [3, 6, 7, 24])
@pytest.mark.parametrize("damping", [1e-6, 5e-3, 10.0])
def test_the_weighted_step_solves_equation_12(n: int, damping: float) -> None:
    rng = np.random.default_rng(n)
    J, e, w, step = rng.normal(size=(6, n)), rng.normal(size=6), np.empty(6), np.empty(n)
    weigh(J, e, w)
    Jw, ew = np.diag(w) @ J, w * e
    cost = apply_weights(w, J, e)
    np.testing.assert_allclose(J, Jw)
    assert cost == pytest.approx(ew @ ew)
    assert damped_step(J, e, damping, 1e6, np.empty((6, 6)), np.empty(6), step)
    wanted = np.linalg.solve(Jw.T @ Jw + damping * np.eye(n), Jw.T @ ew)
    np.testing.assert_allclose(step, wanted, rtol=1e-5, atol=1e-7)
    damped_step(J, e, damping, 0.01, np.empty((6, 6)), np.empty(6), step)
    np.testing.assert_allclose(step, wanted * min(1.0, 0.01 / np.linalg.norm(wanted)), rtol=1e-5)


def test_the_dogleg_stays_in_the_trust_region_and_on_its_path() -> None:
    rng = np.random.default_rng(2)
    whole = first = second = 0
    for _ in range(200):
        J, e = rng.normal(size=(6, 7)) * rng.uniform(0.05, 2.0, (6, 1)), rng.normal(size=6)
        g, newton, step = J.T @ e, np.linalg.pinv(J) @ e, np.empty(7)
        image, radius = float(np.sum((J @ g) ** 2)), float(rng.choice([0.05, 0.5, 2.0, 20.0]))
        dogleg(g, image, newton, radius, step)
        length, corner = np.linalg.norm(step), g @ g / image * g
        assert length <= radius * (1 + 1e-9)
        if np.linalg.norm(newton) <= radius:
            whole += 1
            np.testing.assert_allclose(step, newton)
            continue
        assert length == pytest.approx(radius)
        if np.linalg.norm(corner) >= radius:
            first += 1
            np.testing.assert_allclose(step, radius * g / np.linalg.norm(g))
        else:
            second += 1
            share = (step - corner) @ (newton - corner) / np.sum((newton - corner) ** 2)
            assert 0.0 <= share <= 1.0
            np.testing.assert_allclose(step, corner + share * (newton - corner), atol=1e-9)
        assert np.sum((e - J @ step) ** 2) < e @ e
    assert min(whole, first, second) > 5


def test_one_iteration_is_the_weighted_step() -> None:
    robot, rng = panda(), np.random.default_rng(6)
    for _ in range(20):
        start = robot.lower + rng.uniform(0.3, 0.7, 7) * (robot.upper - robot.lower)
        target = robot.fk(start + rng.uniform(-0.02, 0.02, 7))
        tool = robot.fk(start)
        missing = rotation_vector(target.rotation @ tool.rotation.T)
        e, J = np.concatenate([target.position - tool.position, missing]), robot.jacobian(start)
        J[3:], e[3:] = 0.3 * J[3:], 0.3 * e[3:]
        w = np.empty(6)
        weigh(J, e, w)
        J, e = w[:, None] * J, w * e
        step = np.linalg.solve(J.T @ J + 5e-3 * np.eye(7), J.T @ e)
        q, cost = start[None].copy(), np.empty(1)
        polish_copies(pack_arm(robot), _row(target), 1e-8, 1, _states(1), q, cost)
        np.testing.assert_allclose(q[0] - start, step, atol=1e-7)


def test_polish_never_ends_worse_than_it_began() -> None:
    robot, rng = seven(), np.random.default_rng(7)
    target = Pose.from_xyz([5.0, 0.0, 0.0])  # out of reach: fallbacks and kicks
    q = robot.random_configuration(rng, 20)
    before = np.array([np.hypot(p, 0.3 * r) for p, r in (_errors(robot, target, row) for row in q)])
    cost = np.empty(20)
    polish_copies(pack_arm(robot), _row(target), 1e-8, 40, _states(20), q, cost)
    after = np.array([np.hypot(p, 0.3 * r) for p, r in (_errors(robot, target, row) for row in q)])
    assert np.all(after <= before)
    np.testing.assert_allclose(np.sqrt(cost), after, atol=1e-9)
    assert np.all(robot.within_limits(q))


@pytest.mark.parametrize(("batch", "least"), [(1, 0.8), (10, 0.9), (100, 1.0)])
def test_most_targets_of_the_panda_are_reached(batch: int, least: float) -> None:
    robot = panda()
    targets = halton_targets(robot, 40, seed=11)
    best = [solve_two_phase(robot, target, batch, seed=k).q[0] for k, target in enumerate(targets)]
    errors = [max(robot.fk(q).error_to(target)) for q, target in zip(best, targets, strict=True)]
    assert np.mean(np.array(errors) < 1e-6) >= least


def test_a_seed_has_one_answer_for_any_number_of_threads() -> None:
    robot = panda()
    for target in halton_targets(robot, 4, seed=3):
        one, two, three = (solve_two_phase(robot, target, 60, seed=9, threads=k) for k in (1, 2, 3))
        assert np.array_equal(one.q, two.q) and np.array_equal(one.q, three.q)
        assert not np.array_equal(one.q, solve_two_phase(robot, target, 60, seed=10).q)
