"""What solvers call: every compiled entry point, and the structures and constants that go with them."""

from workcell.ik.hjcd.kernels.constrained import refine
from workcell.ik.hjcd.kernels.coupled import search_coupled
from workcell.ik.hjcd.kernels.free import descend_batch, polish_batch, solve_targets
from workcell.ik.hjcd.kernels.greedy import COARSE_POSITION, COARSE_ROTATION, SWEEPS, sweep_seeds
from workcell.ik.hjcd.kernels.search import (
    ARC,
    BEST,
    CURVES,
    EXHAUSTED,
    FOUND,
    MISSES,
    POSES,
    REPEATS,
    RESTARTS,
    SLID,
    SPENT,
    Memory,
    search,
)
from workcell.ik.hjcd.kernels.trace import MEMORY
from workcell.ik.hjcd.kernels.weighted_polish import ITERATIONS, polish_copies

__all__ = [
    "ARC",
    "BEST",
    "COARSE_POSITION",
    "COARSE_ROTATION",
    "CURVES",
    "EXHAUSTED",
    "FOUND",
    "ITERATIONS",
    "MEMORY",
    "MISSES",
    "POSES",
    "REPEATS",
    "RESTARTS",
    "SLID",
    "SPENT",
    "SWEEPS",
    "Memory",
    "descend_batch",
    "polish_batch",
    "polish_copies",
    "refine",
    "search",
    "search_coupled",
    "solve_targets",
    "sweep_seeds",
]
