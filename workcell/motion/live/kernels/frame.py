"""`Frame`: all that a frame's kernels need, as one argument."""

from __future__ import annotations

from workcell.jit import Bundle, BundleType, bundled, kernel
from workcell.motion.live.kernels.desk import Desk, Surroundings
from workcell.motion.live.kernels.limbs import Limbs
from workcell.motion.live.kernels.motion import Motion
from workcell.motion.live.kernels.terms import Wish


class FrameType(BundleType):
    """The type of `Frame`."""


class Frame(Bundle):
    """All that a frame's kernels need.

    Attributes:
        limbs: the robots; around: what they must keep off.
        wish: what is asked of the relaxed solution; mine: the same goals with the arm's own past.
        desk: scratch; motion: the arm's state.
    """

    limbs: Limbs
    around: Surroundings
    wish: Wish
    mine: Wish
    desk: Desk
    motion: Motion


bundled(FrameType, Frame)


@kernel
def make_frame(
    limbs: Limbs, around: Surroundings, wish: Wish, mine: Wish, desk: Desk, motion: Motion
) -> Frame:
    """A frame of these arrays, which stay shared."""
    return Frame(limbs, around, wish, mine, desk, motion)
