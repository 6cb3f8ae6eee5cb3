"""The blocks of lifted variables that have to be of rank 1, and how far from that they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workcell.ik.ikspark.mechanisms.forms import Form
from workcell.pose import Array


@dataclass(frozen=True, slots=True)
class Blocks:
    """Where the blocks are that have to be of rank 1.

    Attributes:
        form: of the PSD blocks.
        full, planar: (k,) the first variable of each PSD block, and of each disc.
        size: number of variables.
    """

    form: Form
    full: NDArray[np.int64]
    planar: NDArray[np.int64]
    size: int

    def among(self, columns: NDArray[np.int64]) -> Blocks:
        """The blocks among some of the variables, by their places there."""
        place = np.full(self.size, -1, dtype=np.int64)
        place[columns] = np.arange(len(columns))
        full, planar = place[self.full], place[self.planar]
        return Blocks(self.form, full[full >= 0], planar[planar >= 0], len(columns))


def linearise(blocks: Blocks, x: Array) -> tuple[Array, Array]:
    """Rank gaps (blocks,) at x (N,), and the gradient (N,) of the sum of largest eigenvalues and disc radii."""
    gradient, gaps = np.zeros(blocks.size), []
    if len(blocks.full):
        places = blocks.full[:, None] + np.arange(blocks.form.size)
        top, slopes = blocks.form.top(x[places])
        gradient[places] = slopes
        gaps.append(blocks.form.trace - top)
    if len(blocks.planar):
        places = blocks.planar[:, None] + np.arange(2)
        radius = np.linalg.norm(x[places], axis=1)
        gradient[places] = x[places] / np.maximum(radius, 1e-9)[:, None]
        gaps.append(1.0 - radius)
    return np.concatenate([np.zeros(0), *gaps]), gradient
