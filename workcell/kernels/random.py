"""The kernels' stream of random numbers: SplitMix64, the same on every machine."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from workcell.jit import inner

RandomState = NDArray[np.uint64]

_GAMMA = np.uint64(0x9E3779B97F4A7C15)
_MIX1, _MIX2 = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)

_S30, _S27, _S31, _S11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)


@inner
def uniform(random: RandomState) -> float:
    """The next number in [0, 1) of the splitmix64 stream (Steele, Lea, Flood, OOPSLA 2014) held in `random` (1,)."""
    random[0] += _GAMMA
    z = random[0]
    z = (z ^ (z >> _S30)) * _MIX1
    z = (z ^ (z >> _S27)) * _MIX2
    z = z ^ (z >> _S31)
    return float(z >> _S11) * (1.0 / 9007199254740992.0)
