"""What solvers call: every compiled entry point, and the structures and constants that go with them."""

from workcell.geometry.kernels.chain import Arm
from workcell.ik.kernels.constrained import refine
from workcell.ik.kernels.contact import smallest_gaps
from workcell.ik.kernels.free import descend_batch, polish_batch, solve_targets
from workcell.ik.kernels.options import World
from workcell.ik.kernels.screen import deepest_at, stretch_chain
from workcell.ik.kernels.search import (
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
from workcell.ik.kernels.trace import MEMORY

__all__ = [
    "ARC",
    "BEST",
    "CURVES",
    "EXHAUSTED",
    "FOUND",
    "MEMORY",
    "MISSES",
    "POSES",
    "REPEATS",
    "RESTARTS",
    "SLID",
    "SPENT",
    "Arm",
    "Memory",
    "World",
    "deepest_at",
    "descend_batch",
    "polish_batch",
    "refine",
    "search",
    "smallest_gaps",
    "solve_targets",
    "stretch_chain",
]
