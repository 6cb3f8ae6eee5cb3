"""The published rows of RelaxedIK's Tables 1 to 4 (Rakita et al. 2020).

Table 1 is recovered from the text and from Tables 2 and 4.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from workcell.bench.live.measures import Paper

GROOVE_A = Paper(0.0047, 0.0029, 0.0118, 0.0004, 0.0002, seconds=0.0046)
GROOVE_B = Paper(0.0118, 0.0284, 0.0101, 0.0001, 0.0001, seconds=0.0046)
QUADRATIC_A = Paper(0.0884, 0.1361, 0.0359, 0.0182, 0.0229, discontinuities=79, seconds=0.0067)
QUADRATIC_B = Paper(0.1001, 0.0168, 0.0114, 0.0018, 0.0020, seconds=0.0071)
TRAC_IK = Paper(discontinuities=2260, singularities=633, collisions=1350, seconds=0.0029)
"""Its errors and rates are in an image; its counts are of 1,535,500 frames."""
OPTIMISERS: Mapping[str, Paper] = MappingProxyType(
    {
        "slsqp": GROOVE_A,
        "mma": Paper(0.0044, 0.0016, 0.0108, 0.0004, 0.0002, seconds=0.0089),
        "ccsaq": Paper(0.0043, 0.0016, 0.0110, 0.0004, 0.0002, seconds=0.0092),
        "cobyla": Paper(0.0138, 0.0100, 0.0107, 0.0028, 0.0041, seconds=0.0111),
        "bobyqa": Paper(0.0080, 0.0026, 0.0111, 0.0014, 0.0019, seconds=0.0113),
    }
)
DIFFERENCES: Mapping[str, Paper] = MappingProxyType(
    {
        "slsqp": Paper(0.0047, 0.0029, 0.0114, 0.0004, 0.0002, seconds=0.0126),
        "mma": Paper(0.0045, 0.0016, 0.0108, 0.0004, 0.0002, seconds=0.0290),
        "ccsaq": Paper(0.0044, 0.0017, 0.0110, 0.0004, 0.0002, seconds=0.0279),
    }
)
"""With gradients by finite differences."""
