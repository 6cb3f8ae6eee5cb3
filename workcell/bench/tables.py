"""The benches by name: a paper's table, or our own, measured again."""

from __future__ import annotations

import importlib
from pathlib import Path

from workcell.bench.rows import Bench, Row
from workcell.errors import InputError, UnknownNameError

_PROVIDERS = (
    "workcell.bench.ik.sets",
    "workcell.bench.ik.ikspark",
    "workcell.bench.ik.entangled",
    "workcell.bench.ik.restarts",
    "workcell.bench.ik.ikspark_tables.table6",
    "workcell.bench.ik.ikspark_tables.table7",
    "workcell.bench.ik.mechanisms.table2",
    "workcell.bench.ik.mechanisms.table3",
    "workcell.bench.ik.mechanisms.table4",
    "workcell.bench.ik.mechanisms.table5",
    "workcell.bench.ik.mechanisms.hand",
    "workcell.bench.ik.mechanisms.loops",
    "workcell.bench.ik.mechanisms.restarts",
    "workcell.bench.ik.cidgik",
    "workcell.bench.ik.cidgik_scaling",
    "workcell.bench.ik.cidgik_supplement",
    "workcell.bench.ik.hjcd",
    "workcell.bench.ik.hjcd_mmd",
    "workcell.bench.ik.branch",
    "workcell.bench.ik.nearly",
    "workcell.bench.ik.repeat",
    "workcell.bench.motion.plans",
    "workcell.bench.motion.plans_optimal",
    "workcell.bench.motion.proofs",
    "workcell.bench.motion.timing",
    "workcell.bench.runs.tasks",
    "workcell.bench.motion.tool_paths",
    "workcell.bench.live.relaxed",
    "workcell.bench.live.guards",
    "workcell.bench.live.peers",
    "workcell.bench.live.timing",
    "workcell.bench.geometry.clearance",
    "workcell.bench.geometry.covers",
    "workcell.bench.geometry.free_space",
    "workcell.bench.strangers.table",
    "workcell.bench.forgeries.table",
    "workcell.bench.forgeries.mechanisms",
)


def list_benches() -> tuple[Bench, ...]:
    """All benches, by name."""
    found: list[Bench] = []
    for provider in _PROVIDERS:
        found += importlib.import_module(provider).BENCHES
    return tuple(sorted(found, key=lambda bench: bench.name))


def run_bench(
    name: str,
    *,
    n: int | None = None,
    seed: int = 0,
    sets: Path | None = None,
    seeds: int = 1,
    jobs: int = 1,
) -> Row:
    """Measure a bench.

    Args:
        name: as `list_benches` names it.
        n: problems a row; None: the bench's own.
        seed: of problems and solvers.
        sets: folder of problem-set files, for the benches that need one.
        seeds: runs with as many seeds from `seed` on, of which the worst is reported; where the bench can.
        jobs: processes, where the bench can.

    Returns:
        `{"bench", "n", "seed", "rows"}`, ready for JSON.

    Raises:
        UnknownNameError: no such bench. InputError: `n`, `seeds` or `jobs` below 1, or more than the bench can; a
            folder is missing.
    """
    benches = {bench.name: bench for bench in list_benches()}
    if name not in benches:
        raise UnknownNameError("bench", name, benches, where="bench")
    bench = benches[name]
    count = bench.n if n is None else n
    if count < 1:
        raise InputError(f"{count} problems a row make no table", where="n", remedy="at least 1")
    if min(seeds, jobs) < 1:
        raise InputError(
            f"{seeds} seeds in {jobs} processes make no table", where="seeds", remedy="at least 1"
        )
    if bench.repeats:
        rows = bench.run(count, seed, sets, seeds, jobs)
    elif max(seeds, jobs) == 1:
        rows = bench.run(count, seed, sets)
    else:
        able = ", ".join(entry.name for entry in benches.values() if entry.repeats)
        raise InputError(f"{name} runs once, in one process", where="bench", remedy=f"several: {able}")
    return {"bench": name, "n": count, "seed": seed, "rows": rows}
