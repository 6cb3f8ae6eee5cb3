"""HJCD-IK for many targets at once, and its two phases over a batch of seeds for one target. Kinematics alone."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workcell.errors import InputError
from workcell.geometry.packing import pack_arm, random_state
from workcell.ik.hjcd.memory import kernels
from workcell.kernels.constants import ROTATION_WEIGHT
from workcell.model.robot import Robot
from workcell.pose import Array, Pose, read_only

if TYPE_CHECKING:
    from workcell.kernels.chain import Arm

ACCURACY = 1e-8
"""Metres of residual (a radian weighs 0.3 m) to which poses are polished."""
_COPIES = (
    (8, 1.0, 24, 0.25),
    (16, 0.5, 16, 0.15),
    (128, 0.2, 5, 0.15),
    (1024, 0.02, 5, 0.15),
    (2048, 0.01, 5, 0.15),
)
"""Up to this batch size: share of the seeds that is kept, copies of each, their spread (share of the joints'
ranges)."""
_COPIES_ABOVE = (0.01, 2, 0.15)
Sampling = Literal["uniform", "halton"]


@dataclass(frozen=True, slots=True)
class BatchSolution:
    """Configurations and what they leave of the pose error.

    Attributes:
        q: (k, n) within the joint limits.
        residual: (k,) metres: the root of the squared position error plus the squared rotation error times 0.3 m.
        restarts: configurations polished in total.
        sweeps: updates of each seed in the paper's phase one.
    """

    q: Array
    residual: Array
    restarts: int
    sweeps: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "q", read_only(self.q))
        object.__setattr__(self, "residual", read_only(self.residual))


def solve_batch(
    robot: Robot,
    targets: Sequence[Pose] | ArrayLike,
    *,
    seed: int = 0,
    first: ArrayLike | None = None,
    restarts: int = 200,
    accuracy: float = ACCURACY,
    threads: int = 1,
    device: str | None = None,
) -> BatchSolution:
    """One configuration for each of k targets, restarting until solved; the best found where that fails.

    Args:
        robot: serial; its default tool is placed. Obstacles don't count.
        targets: poses, or rows (k, 7) of position and quaternion wxyz, in the world.
        seed: same seed, same answer (for a number of threads).
        first: (k, n) configurations to begin from, or None.
        restarts: most seeds a target.
        accuracy: residual in metres at which a target counts as solved.
        threads: targets are split among them; the kernels don't hold the interpreter's lock.
        device: a Warp device (`cuda:0`, `cpu`) that solves all targets together, instead of numba's threads; needs
            the extra `workcell[gpu]`. Other random numbers, so other solutions.

    Raises:
        InputError: targets or configurations of the wrong shape, or not finite; no such device, or Warp isn't
            installed.
    """
    _refuse_couplings(robot)
    poses = _target_rows(targets)
    starts = np.empty((0, robot.dof))
    if first is not None:
        starts = np.clip(_configurations(robot, first, "first"), robot.lower, robot.upper)
    if len(starts) not in (0, len(poses)):
        raise InputError(f"{len(starts)} configurations for {len(poses)} targets", where="first")
    if device is not None:
        from workcell.ik.hjcd.gpu.solver import WarpSolver

        outcome = WarpSolver(pack_arm(robot), device).solve(poses, starts, restarts, accuracy, seed)
        return BatchSolution(outcome.q, np.sqrt(outcome.cost), outcome.polished)
    arm, q, cost = pack_arm(robot), np.empty((len(poses), robot.dof)), np.empty(len(poses))

    def solve(part: slice) -> int:
        random = random_state(seed + 7919 * part.start)
        done = kernels().solve_targets(
            arm, poses[part], starts[part], accuracy, restarts, random, q[part], cost[part]
        )
        return int(done)

    done = sum(_in_parts(solve, len(poses), threads))
    return BatchSolution(q, np.sqrt(cost), done)


def solve_two_phase(
    robot: Robot,
    target: Pose,
    batch: int,
    *,
    seed: int = 0,
    threads: int = 1,
    sampling: Sampling = "uniform",
    device: str | None = None,
) -> BatchSolution:
    """The paper's algorithm for one target: descend `batch` seeds, polish perturbed copies of the best.

    Phase one (Alg. 3) updates all seeds in turn, as often each, until one is within 2 cm and a right angle of the
    target; an update that helps neither position nor rotation is exchanged for a random one. Phase two (Alg. 4) takes
    the weighted steps of Eq. 12, and its fallbacks. How many seeds are kept and copied depends on the batch size as in
    the authors' code. The configurations come with the smallest residual first.

    A Warp device does it otherwise: every seed is updated to the end of phase one without random updates, and copies
    are polished by steps without weights, as `solve_batch` does.

    Args:
        robot: serial; its default tool is placed. Obstacles don't count.
        target: in the world.
        batch: seeds.
        seed: same seed, same answer (for any number of threads, and for a device).
        threads: of the numba kernels.
        sampling: seeds uniform in the limits, or from a scrambled Halton sequence.
        device: a Warp device (`cuda:0`, `cpu`), as in `solve_batch`.

    Raises:
        InputError: a batch below 1, unknown sampling; no such device, or Warp isn't installed.
    """
    _refuse_couplings(robot)
    if batch < 1:
        raise InputError(f"a batch of {batch} seeds is empty", where="batch", remedy="at least 1")
    rng = np.random.default_rng(seed)
    arm, pose, seeds = pack_arm(robot), _target_rows([target])[0], _seeds(robot, batch, sampling, rng)
    if device is not None:
        from workcell.ik.hjcd.gpu.solver import WarpSolver

        kept, copies, spread = _copying(batch)
        sweeps = int(kernels().SWEEPS)
        outcome = WarpSolver(arm, device).two_phase(pose, seeds, sweeps, kept, copies, spread, ACCURACY, seed)
        return _sorted(outcome.q, outcome.cost, sweeps)
    errors, sweeps = _descend_all(arm, pose, seeds, rng, threads)
    order = np.argsort(errors[:, 0] ** 2 + (ROTATION_WEIGHT * errors[:, 1]) ** 2, kind="stable")
    q = _perturbed_copies(robot, seeds[order], rng)
    cost, random = np.empty(len(q)), _random_states(rng, len(q))

    def polish(part: slice) -> None:
        entries = kernels()
        entries.polish_copies(arm, pose, ACCURACY, entries.ITERATIONS, random[part], q[part], cost[part])

    _in_parts(polish, len(q), threads)
    return _sorted(q, cost, sweeps)


def _descend_all(
    arm: Arm, pose: Array, seeds: Array, rng: np.random.Generator, threads: int
) -> tuple[Array, int]:
    """Phase one over seeds (b, n), in place; metres and radians (b, 2) that are left, and the sweeps made."""
    entries = kernels()
    errors, random = np.empty((len(seeds), 2)), _random_states(rng, len(seeds))
    coarse = np.array([entries.COARSE_POSITION, entries.COARSE_ROTATION])
    together = (
        1 if threads > 1 else int(entries.SWEEPS)
    )  # threads must know of each other when a seed is near enough
    made = 0
    while made < entries.SWEEPS:

        def sweep(part: slice, first: int = made) -> int:
            last = first + together
            return int(entries.sweep_seeds(arm, pose, first, last, random[part], seeds[part], errors[part]))

        made += max(_in_parts(sweep, len(seeds), threads))
        if np.any(np.all(errors < coarse, axis=1)):
            break
    return errors, made


def _random_states(rng: np.random.Generator, count: int) -> NDArray[np.uint64]:
    """(count, 1) one stream of random numbers for each row, whichever thread works on it."""
    return rng.integers(0, 2**64, size=(count, 1), dtype=np.uint64)


def polish_seeds(robot: Robot, target: Pose, seeds: ArrayLike, accuracy: float = ACCURACY) -> BatchSolution:
    """Damped Newton polish of each configuration of seeds (k, n) by itself, in their order: phase two alone.

    Raises:
        InputError: configurations of the wrong shape, or not finite.
    """
    _refuse_couplings(robot)
    q = np.clip(_configurations(robot, seeds, "seeds"), robot.lower, robot.upper)
    cost = np.empty(len(q))
    kernels().polish_batch(pack_arm(robot), _target_rows([target])[0], accuracy, q, cost)
    return BatchSolution(q, np.sqrt(cost), len(q))


def _refuse_couplings(robot: Robot) -> None:
    if robot.coupling is not None:
        raise InputError(
            f"joint {robot.all_joint_names[robot.coupling.followers[0]]!r} follows another, which batches don't know",
            where=robot.name,
            remedy="ask for each target by `solve`",
        )


def _sorted(q: Array, cost: Array, sweeps: int) -> BatchSolution:
    order = np.argsort(cost, kind="stable")
    return BatchSolution(q[order], np.sqrt(cost[order]), len(q), sweeps)


def _seeds(robot: Robot, batch: int, sampling: Sampling, rng: np.random.Generator) -> Array:
    if sampling == "uniform":
        return robot.random_configuration(rng, batch)
    if sampling != "halton":
        raise InputError(f"unknown sampling {sampling!r}", where="sampling", remedy="uniform or halton")
    from scipy.stats import qmc

    unit: Array = qmc.Halton(robot.dof, seed=rng).random(batch)
    return robot.lower + unit * (robot.upper - robot.lower)


def _copying(batch: int) -> tuple[int, int, float]:
    """Of a batch: how many of the best seeds are kept, copies of each, and their spread."""
    rules = (rule[1:] for rule in _COPIES if batch <= rule[0])
    share, copies, spread = next(rules, _COPIES_ABOVE)
    return max(1, int(np.ceil(share * batch))), copies, spread


def _perturbed_copies(robot: Robot, ranked: Array, rng: np.random.Generator) -> Array:
    """The best of the ranked seeds, each with normally perturbed copies; one copy is the seed itself."""
    count, copies, spread = _copying(len(ranked))
    kept = ranked[:count]
    noise = rng.normal(size=(copies, *kept.shape)) * spread * (robot.upper - robot.lower)
    noise[0] = 0.0
    return np.clip((kept + noise).reshape(-1, robot.dof), robot.lower, robot.upper)


def _in_parts(work: Callable[[slice], object], count: int, threads: int) -> list[int]:
    """Results of `work` on slices of range(count), one a thread."""
    if min(threads, count) <= 1:
        return [work(slice(0, count))]  # type: ignore[list-item]
    edges = np.linspace(0, count, min(threads, count) + 1).astype(int)
    parts = [slice(int(a), int(b)) for a, b in itertools.pairwise(edges)]
    with ThreadPoolExecutor(len(parts)) as pool:
        return list(pool.map(work, parts))  # type: ignore[arg-type]


def _target_rows(targets: Sequence[Pose] | ArrayLike) -> Array:
    if isinstance(targets, Sequence) and all(isinstance(target, Pose) for target in targets):
        parts = [part for target in targets for part in (target.position, target.quat_wxyz)]  # type: ignore[union-attr]
        return np.concatenate(parts).reshape(-1, 7) if parts else np.empty((0, 7))
    rows_array = np.array(targets, dtype=float)
    if rows_array.ndim != 2 or rows_array.shape[1] != 7 or not np.all(np.isfinite(rows_array)):
        raise InputError(
            f"the targets have shape {rows_array.shape}, or are not finite",
            where="targets",
            remedy="poses, or finite rows of position and quaternion wxyz (k, 7)",
        )
    length = np.sqrt(np.einsum("ij,ij->i", rows_array[:, 3:], rows_array[:, 3:]))
    if np.any(np.abs(length - 1.0) > 1e-3):
        row = int(np.argmax(np.abs(length - 1.0)))
        raise InputError(f"the quaternion of target {row} has length {length[row]:.6g}", where="targets")
    rows_array[:, 3:] /= length[:, None]
    return rows_array


def _configurations(robot: Robot, values: ArrayLike, where: str) -> Array:
    rows = np.array(values, dtype=float)
    if rows.ndim != 2 or rows.shape[1] != robot.dof or not np.all(np.isfinite(rows)):
        raise InputError(
            f"configurations of shape {rows.shape}, or not finite",
            where=where,
            remedy=f"(k, {robot.dof}), finite",
        )
    return rows
