"""The objective of RelaxedIK (Eqs. 1 to 7) in plain numpy, from the paper: an oracle for the compiled one."""

from __future__ import annotations

import numpy as np


def groove(chi, n=1, s=0.0, c=0.2, r=5.0):
    """Eq. 3."""
    return (-1.0) ** n * np.exp(-((chi - s) ** 2) / (2.0 * c**2)) + r * (chi - s) ** 4


def quadratic(chi):
    """Eq. 11."""
    return chi**2


def displacement(quat_a, quat_b):
    """Length of the rotation vector between two quaternions wxyz, the smaller of both antipodes."""
    cosine = abs(float(np.dot(quat_a, quat_b)))
    return 2.0 * np.arccos(min(1.0, cosine))


def chis(robot, q, history, goal, tool=None):
    """The first six terms before their losses, at q (n,).

    `history` (3, n): the last three configurations, the latest first. Differences are backward, per update.
    """
    here = robot.fk(q, tool)
    one, two, three = history
    return np.array(
        [
            np.linalg.norm(goal.position - here.position),
            displacement(goal.quat_wxyz, here.quat_wxyz),
            np.linalg.norm(q - one),
            np.linalg.norm(q - 2.0 * one + two),
            np.linalg.norm(q - 3.0 * one + 3.0 * two - three),
            np.linalg.norm(here.position - robot.fk(one, tool).position),
        ]
    )


def objective(robot, q, history, goal, weights, loss="groove", tool=None):
    """The weighted sum (Eq. 1) of the first six terms; weights (6,) or more."""
    through = groove if loss == "groove" else quadratic
    return float(
        sum(w * through(chi) for w, chi in zip(weights, chis(robot, q, history, goal, tool), strict=False))
    )


def collision(distances, safe, b=50.0):
    """Eq. 9, with the reading that is dimensionally right: the cost is b at contact and 1e-15 at the safe distance."""
    kept = np.asarray(safe) > 0.0
    d, s = np.asarray(distances)[kept], np.asarray(safe)[kept]
    c2 = -(s**2) / (2.0 * np.log(1e-15 / b))
    return float(np.sum(b * np.exp(-(d**2) / (2.0 * c2))))
