"""Table VII of IKSPARK: in how many random cells every sphere gets a region, by seeds and shapes of regions."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from workcell.bench.ik.ikspark_tables.building import SEEDS, Building, build
from workcell.bench.ik.ikspark_tables.cells import ROBOT, Cell, cells
from workcell.bench.rows import Bench, Row
from workcell.sets.solving import problem_seed

DENSITY = "mid"


@dataclass(frozen=True, slots=True)
class Way:
    """A way of building, with the paper's share of cells built, regions a cell and seconds; None: it is not theirs."""

    name: str
    biased: bool
    polytopes: bool
    seeds: int = SEEDS
    paper: float | None = None
    paper_regions: float | None = None
    paper_s: float | None = None


WAYS = (
    Way("seeds anywhere, polytopes", False, True, SEEDS, 0.56, 10, 19.70),
    Way("biased seeds, polytopes", True, True, SEEDS, 0.854, 10, 17.50),
    Way("biased seeds, cuboids", True, False, SEEDS, 0.98, 3.98, 7.88),
    Way(f"{4 * SEEDS} biased seeds, cuboids", True, False, 4 * SEEDS),
)


def table7(n: int, seed: int, sets: Path | None = None) -> list[Row]:
    """A row for each way of building the first n random cells of a seed."""
    drawn = cells("random", DENSITY, n, seed)
    return [_row(way, drawn, seed) for way in WAYS]


def _row(way: Way, drawn: list[Cell], seed: int) -> Row:
    _built(way, drawn[0], seed)  # compiles what is compiled, outside the times
    made = [_built(way, cell, problem_seed(seed, str(k))) for k, cell in enumerate(drawn)]
    inflating, pruning = 1e3 * np.array([(m.inflate_s, m.prune_s) for m in made]).T
    return {
        "row": f"{ROBOT}/random/{DENSITY}/{way.name}",
        "n": len(made),
        "built": float(np.mean([m.built for m in made])),
        "regions_mean": float(np.mean([m.allowed.shape[1] for m in made])),
        "pairs_kept": float(np.mean([m.allowed.mean() if m.allowed.size else 0.0 for m in made])),
        "inflate_ms_mean": float(inflating.mean()),
        "prune_ms_mean": float(pruning.mean()),
        "build_ms_mean": float((inflating + pruning).mean()),
        "build_ms_p95": float(np.percentile(inflating + pruning, 95)),
        "paper": way.paper,
        "paper_regions": way.paper_regions,
        "paper_build_s": way.paper_s,
    }


def _built(way: Way, cell: Cell, seed: int) -> Building:
    return build(cell.problem, biased=way.biased, polytopes=way.polytopes, seed=seed, seeds=way.seeds)


BENCHES = (
    Bench(
        "ikspark-table7",
        100,
        "random cells in which every sphere gets a region of free space, by ways of building (IKSPARK, Table VII)",
        table7,
    ),
)
