"""What the convex methods, IKSPARK and CIDGIK, hold themselves to alike."""

from __future__ import annotations

from workcell.geometry.obstacle_arrays import prepare_distances
from workcell.ik.problem import IKProblem

MAX_POLISH = 1e-2
"""Radians by which polish may move a joint for the answer to count as the convex method's own."""
LOCAL_STEPS = 15
"""Levenberg-Marquardt steps from the angles of an iterate (`ikspark+lm`, `cidgik+lm`)."""
LOCAL_DAMPING = 1e-2
"""Their first damping."""
MOST_FAILURES = 3
"""Solves without a point, and without a reason for that, after which a search gives up."""
SLOW = 0.9
"""A climb to low rank is given up when a step leaves more than this share of what is to vanish."""
KEEP_OFF = 1e-4
"""Metres added to what keeps something clear, so that the edge of what is allowed is not a near miss."""


def prepare(problem: IKProblem) -> None:
    """Compile, or load, the distances to obstacles; without obstacles nothing is needed."""
    if problem.obstacles:
        prepare_distances()
