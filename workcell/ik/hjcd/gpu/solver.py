"""Launches the Warp kernels: many targets at once, or a large batch of seeds for one."""

from __future__ import annotations

import functools
import importlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from workcell.errors import InputError
from workcell.pose import Array

if TYPE_CHECKING:
    from workcell.kernels.chain import Arm

SEEDS = 16
"""Random configurations a target and round."""
KEPT = 2
"""Of those, how many are polished."""
SWEEPS = 4
"""Coordinate-descent updates of each before it is ranked."""
CHUNK = 1 << 16
"""Targets in flight: their seeds take 60 MB for seven joints."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Configurations (k, n) with their squared residuals (k,), and how many seeds were polished for them."""

    q: Array
    cost: Array
    polished: int


class WarpSolver:
    """HJCD-IK for one chain on one Warp device.

    All arrays are float64; residuals as in `workcell.kernels.pose_error`.

    Raises:
        InputError: Warp is not installed, or knows no such device.
    """

    def __init__(self, arm: Arm, device: str) -> None:
        self._warp = load_warp()
        self._device = _find_device(self._warp, device)
        module = importlib.import_module("workcell.ik.hjcd.gpu.programs")
        self._n = arm.bounds.shape[1]
        self._programs, self._rank = module.programs(self._n), module.rank
        self._lower, self._upper = arm.bounds[0], arm.bounds[1]
        self._frames = self._array(arm.frames, self._warp.float64)
        self._bounds = self._array(arm.bounds, self._warp.float64)

    def descend(self, poses: Array, q: Array, sweeps: int) -> tuple[Array, Array]:
        """Phase one on configurations q (k, b, n) for targets poses (k, 7); new ones and squared residuals (k, b)."""
        seeds, cost = self._configurations(q), self._empty(q.shape[:2])
        self._descend(self._targets(poses), seeds, sweeps, cost)
        return seeds.numpy(), cost.numpy()

    def polish(self, poses: Array, q: Array, accuracy: float) -> tuple[Array, Array]:
        """Phase two, in the same way."""
        starts, cost = self._configurations(q), self._empty(q.shape[:2])
        self._polish(self._targets(poses), starts, accuracy, cost)
        return starts.numpy(), cost.numpy()

    def two_phase(
        self, pose: Array, seeds: Array, sweeps: int, kept: int, copies: int, spread: float, accuracy: float,
        seed: int,
    ) -> Outcome:  # fmt: skip
        """The paper's two phases on seeds (b, n) for one target, without its random updates and its weights.

        Args:
            pose: (7,) position and quaternion wxyz.
            seeds: (b, n).
            sweeps: coordinate-descent updates of each seed.
            kept: how many of the best are copied.
            copies: of each; the first is the seed itself.
            spread: of the perturbation, as a share of the joints' ranges.
            accuracy: residual in metres at which a polish ends.
            seed: of the perturbation.
        """
        targets, q = self._targets(pose[None]), self._configurations(seeds[None])
        cost = self._empty((1, len(seeds)))
        self._descend(targets, q, sweeps, cost)
        copied, cost = self._copies(q, cost, kept, copies, spread, seed)
        self._polish(targets, copied, accuracy, cost)
        return Outcome(copied.numpy()[0], cost.numpy()[0], kept * copies)

    def solve(self, poses: Array, first: Array, restarts: int, accuracy: float, seed: int) -> Outcome:
        """One configuration for each target poses (k, 7), in rounds over those not solved yet; else the best found.

        Args:
            poses: position and quaternion wxyz.
            first: (k, n) configurations to polish before any random one, or none (0, n).
            restarts: seeds polished for a target at most.
            accuracy: residual in metres at which a target counts as solved.
            seed: of the random configurations.
        """
        q, cost = np.zeros((len(poses), self._n)), np.full(len(poses), np.inf)
        rng, done = np.random.default_rng(seed), 0
        for start in range(0, len(poses), CHUNK):
            chunk = slice(start, start + CHUNK)
            done += self._rounds(poses[chunk], first[chunk], restarts, accuracy, rng, q[chunk], cost[chunk])
        return Outcome(q, cost, done)

    def _rounds(
        self, poses: Array, first: Array, restarts: int, accuracy: float, rng: np.random.Generator,
        q: Array, cost: Array,
    ) -> int:  # fmt: skip
        """Rounds over one chunk, into q and cost; returns the seeds polished."""
        left, done, tried = np.arange(len(poses)), 0, 0
        while len(left) and tried < restarts:
            if tried == 0 and len(first):
                best, least, polished = *self._winners(*self._start_from(poses, first, accuracy)), 1
            else:
                polished = min(KEPT, restarts - tried)
                best, least = self._round(poses[left], polished, accuracy, rng)
            better = least < cost[left]
            q[left[better]], cost[left[better]] = best[better], least[better]
            done, tried = done + polished * len(left), tried + polished
            left = np.flatnonzero(cost >= accuracy * accuracy)
        return done

    def _start_from(self, poses: Array, first: Array, accuracy: float) -> tuple[Any, Any]:
        q, cost = self._configurations(first[:, None]), self._empty((len(first), 1))
        self._polish(self._targets(poses), q, accuracy, cost)
        return q, cost

    def _round(
        self, poses: Array, kept: int, accuracy: float, rng: np.random.Generator
    ) -> tuple[Array, Array]:
        """Random seeds for each target, descended; the best of them polished; the better one."""
        seeds = rng.uniform(self._lower, self._upper, (len(poses), SEEDS, self._n))
        targets, q, cost = self._targets(poses), self._configurations(seeds), self._empty(seeds.shape[:2])
        self._descend(targets, q, SWEEPS, cost)
        copied, cost = self._copies(q, cost, kept, 1, 0.0, 0)
        self._polish(targets, copied, accuracy, cost)
        return self._winners(copied, cost)

    def _descend(self, targets: Any, q: Any, sweeps: int, cost: Any) -> None:
        self._launch(self._programs.descend, q.shape, self._frames, self._bounds, targets, sweeps, q, cost)

    def _polish(self, targets: Any, q: Any, accuracy: float, cost: Any) -> None:
        self._launch(self._programs.polish, q.shape, self._frames, self._bounds, targets, accuracy, q, cost)

    def _copies(self, q: Any, cost: Any, kept: int, copies: int, spread: float, seed: int) -> tuple[Any, Any]:
        """Perturbed copies of the best of each target, and room for their costs."""
        shape = (q.shape[0], kept * copies)
        ranked = self._warp.empty((q.shape[0], kept), dtype=int, device=self._device)
        self._launch(self._rank, q.shape, cost, ranked)
        copied = self._warp.empty(shape, dtype=self._programs.Vector, device=self._device)
        self._launch(self._programs.copy, shape, self._bounds, q, ranked, copies, spread, seed, copied)
        return copied, self._empty(shape)

    def _winners(self, q: Any, cost: Any) -> tuple[Array, Array]:
        best = self._warp.empty(q.shape[0], dtype=self._programs.Vector, device=self._device)
        least = self._empty((q.shape[0],))
        self._launch(self._programs.winners, (q.shape[0],), q, cost, best, least)
        return best.numpy(), least.numpy()

    def _launch(self, kernel: Any, dim: tuple[int, ...], *arguments: object) -> None:
        self._warp.launch(kernel, dim=dim, inputs=list(arguments), device=self._device)

    def _targets(self, poses: Array) -> Any:
        return self._array(poses, importlib.import_module("workcell.ik.hjcd.gpu.chain").Target)

    def _configurations(self, q: Array) -> Any:
        return self._array(q, self._programs.Vector)

    def _array(self, values: Array, dtype: Any) -> Any:
        return self._warp.array(np.ascontiguousarray(values), dtype=dtype, device=self._device)

    def _empty(self, shape: tuple[int, ...]) -> Any:
        return self._warp.empty(shape, dtype=self._warp.float64, device=self._device)


@functools.cache
def load_warp() -> Any:
    """The module `warp`, initialised; InputError where the extra is not installed."""
    try:
        warp = importlib.import_module("warp")
    except ImportError:
        raise InputError(
            "solving on a device needs NVIDIA Warp, which is not installed",
            where="device",
            remedy="pip install 'workcell[gpu]', or leave `device` out: numba solves on the CPU",
        ) from None
    warp.config.log_level = warp.LOG_ERROR
    warp.init()
    return warp


def warp_devices() -> tuple[str, ...]:
    """Names of the devices that Warp sees, `cpu` among them; InputError where it is not installed."""
    return tuple(str(device) for device in load_warp().get_devices())


def _find_device(warp: Any, name: str) -> Any:
    known = warp_devices()
    if name not in (*known, "cuda") or (name == "cuda" and not warp.is_cuda_available()):
        raise InputError(f"there is no device {name!r}", where="device", remedy=f"one of: {', '.join(known)}")
    return warp.get_device(name)
