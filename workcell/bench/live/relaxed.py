"""RelaxedIK's Tables 1 to 4 (Rakita et al. 2020): its five tasks on its seven arms, with random starts each.

Rows `reached/METHOD` are over the cases that point IK can follow without an event, and are the ones to compare with the
paper's; `all/METHOD` are over all, and a row for each case says what keeps its arm from its path, if anything does.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from workcell.bench.live import paper
from workcell.bench.live.cases import Maker, table
from workcell.bench.live.followers import Live, PointIK
from workcell.bench.live.measures import Paper
from workcell.bench.rows import Bench, Row

_RESTARTS = 10
"""Random starts of point IK in a frame whose pose its first descent misses."""


def live(**settings: Any) -> Maker:
    """`LiveIK` with settings of its own."""
    return partial(Live, settings=settings)


def point_ik() -> Maker:
    """Point IK in every frame for itself, as TRAC-IK is in the paper."""
    return partial(PointIK, tries=_RESTARTS)


def table1(n: int, seed: int, sets: Path | None) -> list[Row]:
    """`LiveIK` with both sets of weights, and point IK."""
    from workcell.motion.live.weights import WEIGHTS_A, WEIGHTS_B

    makers = {"A": live(weights=WEIGHTS_A), "B": live(weights=WEIGHTS_B), "point-ik": point_ik()}
    papers = {"A": paper.GROOVE_A, "B": paper.GROOVE_B, "point-ik": paper.TRAC_IK}
    return table(makers, papers, n, seed)


def table2(n: int, seed: int, sets: Path | None) -> list[Row]:
    """Optimisers of the frame's objective: the compiled one, and the paper's."""
    makers = {name: live(solver=name) for name in ("compiled", *paper.OPTIMISERS)}
    return table(makers, paper.OPTIMISERS, n, seed)


def table3(n: int, seed: int, sets: Path | None) -> list[Row]:
    """The paper's optimisers with gradients of our own (the paper differentiates automatically), and by differences."""
    makers: dict[str, Maker] = {}
    papers: dict[str, Paper] = {}
    for name in paper.DIFFERENCES:
        makers |= {
            f"{name}/{gradient}": live(solver=name, gradient=gradient)
            for gradient in ("analytic", "differences")
        }
        papers |= {f"{name}/analytic": paper.OPTIMISERS[name]}
        papers |= {f"{name}/differences": paper.DIFFERENCES[name]}
    return table(makers, papers, n, seed)


def table4(n: int, seed: int, sets: Path | None) -> list[Row]:
    """The groove loss against the quadratic one, with both sets of weights."""
    from workcell.motion.live.weights import WEIGHTS_A, WEIGHTS_B

    makers = {
        f"{loss}/{letter}": live(loss=loss, weights=weights)
        for loss in ("groove", "quadratic")
        for letter, weights in (("A", WEIGHTS_A), ("B", WEIGHTS_B))
    }
    papers = {
        "groove/A": paper.GROOVE_A,
        "groove/B": paper.GROOVE_B,
        "quadratic/A": paper.QUADRATIC_A,
        "quadratic/B": paper.QUADRATIC_B,
    }
    return table(makers, papers, n, seed)


BENCHES = [
    Bench(
        "relaxedik-table1",
        100,
        "live IK at RelaxedIK's tasks, beside point IK; n random starts a case",
        table1,
    ),
    Bench(
        "relaxedik-table2",
        100,
        "live IK at RelaxedIK's tasks by the paper's optimisers (workcell[live])",
        table2,
    ),
    Bench("relaxedik-table3", 100, "the same with analytic gradients, and with differences", table3),
    Bench("relaxedik-table4", 100, "groove and quadratic losses, accurate and smooth weights", table4),
]
