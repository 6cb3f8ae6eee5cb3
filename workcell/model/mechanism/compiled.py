"""Where a mechanism lives in its compiled model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from workcell.pose import Array, Pose

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True, slots=True, eq=False)
class CompiledMechanism:
    """A mechanism's place in its compiled model.

    Attributes:
        model: the compiled model: the truth about it.
        start: (nq,) raw positions, of what does not move too.
        addresses: (size,) where each number of a configuration is in raw positions.
        link_of_body: (nbody,) the link that carries each body.
        T_link_body: where on it.
    """

    model: mujoco.MjModel
    start: Array
    addresses: NDArray[np.int64]
    link_of_body: NDArray[np.int64]
    T_link_body: tuple[Pose, ...]

    def qpos(self, q: Array) -> Array:
        """Raw positions (nq,) with the mechanism at a configuration (size,), all else where it begins."""
        qpos = np.array(self.start)
        qpos[self.addresses] = q
        return qpos

    def configuration(self, qpos: Array) -> Array:
        """The configuration (size,) at raw positions (nq,)."""
        return np.array(qpos, dtype=float)[self.addresses]
