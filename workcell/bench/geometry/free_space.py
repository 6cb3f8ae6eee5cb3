"""Free space measured: what its cuboids and polytopes cost in the shelf cell, and how much of it they hold."""

from __future__ import annotations

from pathlib import Path

from workcell.bench.rows import Bench, Row
from workcell.geometry.decompose import decompose
from workcell.model.scene import Scene

_FIGURES = (
    "cuboids",
    "polytopes",
    "cuboid_fraction",
    "covered_fraction",
    "cuboid_build_s",
    "polytope_build_s",
)


def free_space(n: int, seed: int, sets: Path | None) -> list[Row]:
    """The shelf cell, decomposed with n seeds, after once that compiles and caches."""
    scene, rows = Scene.load("shelf_grasp"), []
    decompose(scene, seed=seed)
    for each in range(seed, seed + n):
        metrics = decompose(scene, seed=each).metrics
        figures = {name: metrics[name] for name in _FIGURES}
        rows.append({"row": f"sawyer/shelf/seed {each}", "n": 1, "paper": None, **figures})
    return rows


BENCHES = (
    Bench("free-space", 1, "free space of the shelf cell: cuboids, polytopes, share held, time", free_space),
)
