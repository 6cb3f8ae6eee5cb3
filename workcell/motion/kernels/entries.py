"""What Python calls: every compiled entry point, and the structures and constants that go with them."""

from workcell.kernels.coupling import Couple
from workcell.motion.kernels.body import Body
from workcell.motion.kernels.curve import prove_curves
from workcell.motion.kernels.line import BLOCKED, PROVED, SPENT, TIGHT, gaps, prove_lines
from workcell.motion.kernels.optimise import Costs, improve
from workcell.motion.kernels.shorten import shorten
from workcell.motion.kernels.steps import CONE
from workcell.motion.kernels.tree import (
    EDGES,
    FINEST,
    FULL,
    ITERATIONS,
    JOINED,
    LOOKS,
    MOST,
    OPEN,
    Trees,
    grow,
)

__all__ = [
    "BLOCKED",
    "CONE",
    "EDGES",
    "FINEST",
    "FULL",
    "ITERATIONS",
    "JOINED",
    "LOOKS",
    "MOST",
    "OPEN",
    "PROVED",
    "SPENT",
    "TIGHT",
    "Body",
    "Costs",
    "Couple",
    "Trees",
    "gaps",
    "grow",
    "improve",
    "prove_curves",
    "prove_lines",
    "shorten",
]
