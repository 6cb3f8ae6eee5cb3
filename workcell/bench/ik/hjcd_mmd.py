"""HJCD-IK's Table III measured again: how well its solutions of one target cover all of them.

The paper compares 50 solutions with 50 of TRAC-IK from random seeds by the maximum mean discrepancy (MMD, Gretton et
al., A Kernel Two-Sample Test, 2012), and names neither kernel nor bandwidth. Here the kernel is Gaussian; its
bandwidth is the median distance among the reference solutions of the target. The reference are uniform seeds, each
polished by itself and kept if it converges. Two disjoint halves of it against each other give the floor that perfect
sampling reaches.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from workcell.bench.ik.hjcd import fetch, halton_targets, panda
from workcell.bench.rows import Bench, Row
from workcell.ik.hjcd.batch import polish_seeds, solve_batch, solve_two_phase
from workcell.model.robot import Robot
from workcell.pose import Array, Pose

BATCH = 2000
SAMPLES = 50
"""Solutions a target that are compared."""
CONVERGED = 1e-6
"""Metres of residual."""
_PAPER = 0.02983

Sampler = Callable[[Robot, Pose, int], Array]


def mmd_squared(x: Array, y: Array, bandwidth: float) -> float:
    """Biased estimate of the squared MMD of samples x (m, n) and y (k, n) under a Gaussian kernel."""
    within = _kernel(x, x, bandwidth).mean() + _kernel(y, y, bandwidth).mean()
    return float(within - 2 * _kernel(x, y, bandwidth).mean())


def _kernel(x: Array, y: Array, bandwidth: float) -> Array:
    square = ((x[:, None] - y[None]) ** 2).sum(axis=-1)
    k: Array = np.exp(-0.5 * square / bandwidth**2)
    return k


def reference(robot: Robot, target: Pose, count: int, seed: int) -> Array:
    """`count` solutions (count, n) from uniform seeds, in the order of the seeds; fewer only of hopeless targets."""
    rng = np.random.default_rng(seed)
    found = np.empty((0, robot.dof))
    for _ in range(40):
        solution = polish_seeds(robot, target, robot.random_configuration(rng, 2 * count))
        found = np.concatenate([found, solution.q[solution.residual < CONVERGED]])
        if len(found) >= count:
            break
    return found[:count]


def most_accurate(robot: Robot, target: Pose, seed: int) -> Array:
    """The paper's choice: of one batch the solutions with the smallest residuals."""
    return solve_two_phase(robot, target, BATCH, seed=seed).q[:SAMPLES]


def first_converged(robot: Robot, target: Pose, seed: int) -> Array:
    """One solution a batch of ten seeds: the best of each small batch, so that no two are copies of the same seed."""
    batches = (solve_two_phase(robot, target, 10, seed=SAMPLES * seed + k) for k in range(SAMPLES))
    return np.stack([batch.q[0] for batch in batches])


def restarted(robot: Robot, target: Pose, seed: int) -> Array:
    """Ours: `SAMPLES` times restarted until solved."""
    return solve_batch(robot, [target] * SAMPLES, seed=seed).q


def _row(
    name: str, robot: Robot, targets: list[Pose], sample: Sampler, seed: int, paper: float | None
) -> Row:
    squares, floors, cpu_s = [], [], []
    for k, target in enumerate(targets):
        both = reference(robot, target, 2 * SAMPLES, 10**6 + seed + k)
        one, two = both[:SAMPLES], both[SAMPLES:]
        distance = np.linalg.norm(both[:, None] - both[None], axis=-1)
        bandwidth = float(np.median(distance[np.triu_indices(len(both), 1)]))
        begun = time.process_time()
        ours = sample(robot, target, seed + k)
        cpu_s.append(time.process_time() - begun)
        squares.append(mmd_squared(ours, one, bandwidth))
        floors.append(mmd_squared(two, one, bandwidth))
    mmd, floor = (float(np.sqrt(np.maximum(values, 0.0)).mean()) for values in (squares, floors))
    return {
        "row": name,
        "n": len(targets),
        "mmd": mmd,
        "mmd_squared": float(np.mean(squares)),
        "floor": floor,
        "times_floor": mmd / floor,
        "cpu_ms_mean": 1e3 * float(np.mean(cpu_s)),
        "paper_mmd": paper,
    }


_SAMPLERS: tuple[tuple[str, Sampler, float | None], ...] = (
    ("most-accurate-50-of-2000/two phases (paper)", most_accurate, _PAPER),
    ("best-of-10-each/two phases", first_converged, None),
    ("50-times/restart until solved", restarted, None),
)


def _rows(n: int, seed: int, sets: Path | None) -> list[Row]:
    rows = []
    for robot, label in ((panda(), "panda"), (fetch(), "fetch")):
        targets = halton_targets(robot, n, seed)
        for name, sample, paper in _SAMPLERS:
            published = paper if label == "panda" else None
            rows.append(_row(f"{label}/{name}", robot, targets, sample, seed, published))
    return rows


BENCHES = (
    Bench("hjcd-mmd", 100, "HJCD-IK, Table III: how evenly solutions cover the solution set (MMD)", _rows),
)
