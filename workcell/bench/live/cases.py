"""What the tables run on: every arm at every task, whether it can be followed, and the random starts."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from workcell.bench.live.arms import SETUPS, Arms, arms_of, rest_rotation
from workcell.bench.live.followers import Follower, drive
from workcell.bench.live.measures import Measured, Paper, measure, summary
from workcell.bench.live.starts import Way, best_way, random_starts
from workcell.bench.live.touching import Touching
from workcell.bench.live.traces import TASKS, Setup, Trace, trace
from workcell.bench.rows import Row
from workcell.pose import Array

Maker = Callable[[Arms], Follower]
"""Makes a follower for arms."""


@dataclass(frozen=True, slots=True)
class Case:
    """An arm, or two, at a task.

    Attributes:
        name: robot and task.
        arms: who follows.
        trace: what.
        way: the best way along it that point IK knows.
    """

    name: str
    arms: Arms
    trace: Trace
    way: Way

    def starts(self, n: int, seed: int) -> list[Array]:
        """n random starts, the same for every method."""
        return random_starts(self.arms, self.trace, self.way, n, seed)


@lru_cache(maxsize=64)
def case_of(setup: Setup, task: str, seed: int = 0) -> Case:
    """One case."""
    arms = arms_of(setup, 2 if task == "cooking" else 1)
    path = trace(task, setup, rest_rotation(arms.robots[0]))
    return Case(f"{setup.robot}/{task}", arms, path, best_way(arms, path, seed))


def cases(setups: Sequence[Setup] = SETUPS, tasks: Sequence[str] = tuple(TASKS)) -> Iterator[Case]:
    """All of them, robot by robot."""
    for setup in setups:
        for task in tasks:
            yield case_of(setup, task)


def run_case(case: Case, make: Maker, n: int, seed: int) -> list[Measured]:
    """n runs of a case by one follower, which is asked once before anything is measured."""
    touching, follower = Touching(case.arms.scene, case.arms.names), make(case.arms)
    starts = case.starts(n, seed)
    if starts:
        follower.reset(starts[0])
        follower.step(case.trace.goals(0))
    return [measure(case.arms, case.trace, drive(follower, case.trace, start), touching) for start in starts]


def table(
    makers: Mapping[str, Maker],
    papers: Mapping[str, Paper],
    n: int,
    seed: int,
    chosen: Sequence[Case] | None = None,
) -> list[Row]:
    """Rows of every method over all cases, over those that can be followed, and of every case.

    Args:
        makers: by the methods' names.
        papers: published rows, by the same names.
        n: random starts a case.
        seed: of the starts.
        chosen: the cases; None: all.
    """
    picked = list(cases()) if chosen is None else list(chosen)
    per_case: list[Row] = []
    found: dict[str, list[tuple[Case, list[Measured]]]] = {name: [] for name in makers}
    for case in picked:
        for name, make in makers.items():
            runs = run_case(case, make, n, seed)
            if runs:
                found[name].append((case, runs))
                per_case.append(summary(f"{case.name}/{name}", runs, papers.get(name), **about(case)))
    totals: list[Row] = []
    for name, pairs in found.items():
        everything = [run for _, runs in pairs for run in runs]
        reached = [run for case, runs in pairs if case.way.reached for run in runs]
        for label, runs in (("all", everything), ("reached", reached)):
            if runs:
                totals.append(summary(f"{label}/{name}", runs, papers.get(name)))
    return [*totals, *per_case]


def about(case: Case) -> dict[str, Any]:
    """Columns that say what a case asks for."""
    return {
        "reached": case.way.reached,
        "in_the_way": case.way.obstacle,
        "path_speed": case.way.speed,
        "path_conditioning": case.way.conditioning,
        "path_clearance_m": case.way.clearance,
        "radius_m": case.arms.setup.size,
    }
