"""The clock of budgets: CPU seconds of this process, without those that no query pays for.

Seconds end queries and are told to people; nothing else may depend on them. Whose turn it is, how long a search goes on
before another begins, and which of two answers is taken, is counted in work (`workcell.ik.problem.Budget.effort`), so
that a seed has one answer at any load.
"""

from __future__ import annotations

import time

_left_out = 0.0


def cpu_seconds() -> float:
    """CPU seconds of this process, less those that were left out."""
    return time.process_time() - _left_out


def leave_out(seconds: float) -> None:
    """Set the clock back by what was spent on something else than answering, such as compiling a kernel."""
    global _left_out
    _left_out += seconds
