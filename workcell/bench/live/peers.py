"""Other packages beside live IK: the tasks of RelaxedIK's tables, by the same starts and judges, in one run."""

from __future__ import annotations

from pathlib import Path

from workcell.bench.live.cases import Maker, table
from workcell.bench.live.others import Mink, RangedIK, installed
from workcell.bench.live.relaxed import live
from workcell.bench.rows import Bench, Row


def live_peers(n: int, seed: int, sets: Path | None) -> list[Row]:
    """`LiveIK` with both sets of weights, and of mink and RangedIK what is installed; last what is not."""
    from workcell.motion.live.weights import WEIGHTS_A, WEIGHTS_B

    makers: dict[str, Maker] = {"A": live(weights=WEIGHTS_A), "B": live(weights=WEIGHTS_B)}
    packages: dict[str, Maker] = {"mink": Mink, "relaxed_ik_core": RangedIK}
    missing = [name for name in packages if not installed(name)]
    makers |= {name: maker for name, maker in packages.items() if name not in missing}
    absent: list[Row] = [{"row": f"{name} is not installed", "n": 0} for name in missing]
    return [*table(makers, {}, n, seed), *absent]


BENCHES = [
    Bench("live-peers", 10, "live IK beside mink and relaxed_ik_core, where they are installed", live_peers)
]
