"""What hands that hold one object do to it: the share that moves it, and the share that only strains it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from workcell.pose import Array
from workcell.simulate.grasp import Weld

if TYPE_CHECKING:
    import mujoco


def weld_force(data: mujoco.MjData, weld: Weld) -> Array:
    """(3,) force of a weld's hand on its object, world frame, newtons; zero while the weld is inactive."""
    import mujoco

    rows = (data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY) & (data.efc_id == weld.equality)
    first = np.flatnonzero(rows)[:3]
    # the constraint's first three rows are the position of the hand's point less that of the object's
    return -np.array(data.efc_force[first]) if len(first) == 3 else np.zeros(3)


def internal_force(data: mujoco.MjData, welds: Sequence[Weld]) -> float:
    """How hard the hands work against each other: largest deviation of a hand's force from the mean of all, newtons.

    The mean moves and carries the object; what remains adds up to zero and strains it, or turns it. Hands that share
    the load equally have none.
    """
    forces = np.array([weld_force(data, weld) for weld in welds])
    return float(np.linalg.norm(forces - forces.mean(axis=0), axis=1).max())
