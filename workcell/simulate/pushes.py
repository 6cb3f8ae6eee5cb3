"""Pushes applied to the bodies of a running simulation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from workcell.errors import UnknownNameError
from workcell.simulate.imperfections import Pulse

if TYPE_CHECKING:
    import mujoco


class Pushes:
    """The external forces of a simulation.

    Args:
        model: the simulated model.
        pulses: what is to be applied.

    Raises:
        UnknownNameError: a body that the model doesn't have.
    """

    def __init__(self, model: mujoco.MjModel, pulses: Sequence[Pulse]) -> None:
        names = [model.body(b).name for b in range(model.nbody)]
        for pulse in pulses:
            if pulse.body not in names:
                raise UnknownNameError("body", pulse.body, names, where="pulse")
        self._pulses = [(names.index(pulse.body), np.array(pulse.force), pulse) for pulse in pulses]

    def apply(self, data: mujoco.MjData) -> None:
        """Set the forces of this moment."""
        if not self._pulses:
            return
        data.xfrc_applied[:] = 0.0
        for body, force, pulse in self._pulses:
            if pulse.start <= data.time < pulse.start + pulse.duration:
                data.xfrc_applied[body, :3] += force
