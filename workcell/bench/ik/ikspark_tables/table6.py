"""Table VI of IKSPARK: random obstacles and a fixed workcell, three densities of spheres, several methods."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from workcell.bench.ik.ikspark_tables.answers import (
    ALONE,
    RECIPE,
    UNPRUNED,
    Paper,
    answers,
    cell_row,
)
from workcell.bench.ik.ikspark_tables.cells import DENSITIES, ROBOT, Kind, cells
from workcell.bench.rows import Bench, Row

KINDS: tuple[Kind, ...] = ("random", "workcell")
MIDDLE = "mid"
_EVERYWHERE = (RECIPE, ALONE, "ikspark")
_MIDDLE_ALONE = (UNPRUNED, "ikspark+lm", "multistart", "auto")

PAPER: Mapping[tuple[str, str, str], Paper] = MappingProxyType(
    {
        ("random", "low", RECIPE): Paper(0.758, 0.6512, 0.99, 3.68),
        ("random", "mid", RECIPE): Paper(0.676, 0.9170, 0.98, 7.88),
        ("random", "high", RECIPE): Paper(0.628, 1.1229, 0.946, 17.08),
        ("random", "mid", UNPRUNED): Paper(0.564, 0.7806, None, 0.12),
        ("random", "mid", "ikspark+lm"): Paper(0.966, 0.9263, 0.98, 7.88),
        ("workcell", "low", RECIPE): Paper(0.832, 0.5066, 1.0, 3.49),
        ("workcell", "mid", RECIPE): Paper(0.693, 0.6449, 1.0, 6.74),
        ("workcell", "high", RECIPE): Paper(0.682, 0.8284, 1.0, 18.06),
        ("workcell", "mid", UNPRUNED): Paper(0.477, 0.6384, None, 0.12),
        ("workcell", "mid", "ikspark+lm"): Paper(0.858, 0.6603, 1.0, 6.74),
    }
)
"""500 random cells, 600 targets in the workcell; `ikspark+lm` stands beside the paper's IKSPARK followed by IPOPT."""


def table6(n: int, seed: int, sets: Path | None = None) -> list[Row]:
    """The recipe, and the solver in cuboids alone and with its fallback, at every density; others at the middle one."""
    rows = []
    for kind in KINDS:
        for density in DENSITIES:
            drawn = cells(kind, density, n, seed)
            for method in (*_EVERYWHERE, *(_MIDDLE_ALONE if density == MIDDLE else ())):
                name = f"{ROBOT}/{kind}/{density}/{method}"
                published = PAPER.get((kind, density, method))
                rows.append(cell_row(name, answers(drawn, method, seed), published))
    return rows


BENCHES = (
    Bench(
        "ikspark-table6", 100, "IKSPARK among random obstacles and in a workcell (IKSPARK, Table VI)", table6
    ),
)
