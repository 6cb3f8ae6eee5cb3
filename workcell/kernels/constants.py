"""Numbers that kernels share with each other and with those who call them; here without a compiler."""

from __future__ import annotations

import math

TURN = 2 * math.pi
"""Radians of a whole turn."""
ROTATION_WEIGHT = 0.3
"""Metres that a radian weighs where positions and rotations are measured as one."""
FAR = 1e3
"""Metres reported where nothing is near."""
HUGE = 1e300
"""What a smallest number begins with before any was found, and a cost that is no number counts as."""
