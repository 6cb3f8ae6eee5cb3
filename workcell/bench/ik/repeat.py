"""Whether a seed has one answer: each query twice, in the other order, by the clock of a busy machine."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from workcell import clock
from workcell.bench.reference.generate import KINDS, generate
from workcell.bench.reference.robots import ROBOTS, bench_robot
from workcell.bench.rows import Bench, Row
from workcell.errors import InputError
from workcell.ik.diverse.solutions import solutions
from workcell.ik.problem import Budget
from workcell.ik.solve import solve
from workcell.motion.plans.to_pose import plan_to_pose
from workcell.sets.problems import NamedProblem
from workcell.sets.solving import problem_seed

EFFORT = Budget(1e6, effort=0.5)
"""What ends a query: its work. The clock's jumps are to decide nothing."""
_JUMP = 0.2
"""Seconds that the clock of a busy machine is put on at each look, at most."""

Answers = dict[str, tuple[Any, ...]]


@contextlib.contextmanager
def busy_clock(seed: int) -> Iterator[None]:
    """Seconds pass in jumps, drawn from a seed, whenever anybody looks at the clock."""
    plain, rng, ahead = clock.cpu_seconds, np.random.default_rng(seed), [0.0]

    def jumping() -> float:
        ahead[0] += _JUMP * float(rng.random()) ** 4
        return plain() + ahead[0]

    clock.cpu_seconds = jumping
    try:
        yield
    finally:
        clock.cpu_seconds = plain


def _solved(item: NamedProblem, seed: int) -> tuple[Any, ...]:
    result = solve(item.problem, budget=EFFORT, seed=seed)
    return result.status, result.solver, _bits(result.q)


def _diverse(item: NamedProblem, seed: int) -> tuple[Any, ...]:
    return tuple(_bits(result.q) for result in solutions(item.problem, 3, EFFORT, seed))


def _planned(item: NamedProblem, seed: int) -> tuple[Any, ...]:
    try:
        plan = plan_to_pose(item.problem, item.problem.robot.home, budget=Budget(1e6, effort=0.5), seed=seed)
    except InputError as error:
        # a start in collision: it is refused twice, in the same words
        return (str(error),)
    return plan.status, _bits(plan.path)


def _bits(values: Any) -> bytes | None:
    return None if values is None else np.asarray(values, dtype=float).tobytes()


DOORS: dict[str, tuple[Callable[[NamedProblem, int], tuple[Any, ...]], tuple[str, ...]]] = {
    "auto": (_solved, tuple(KINDS)),
    "several": (_diverse, ("random", "workcell")),
    "plan": (_planned, ("workcell",)),
}
"""What is asked, by its name in the rows, of which kinds of generated problems."""


def differing(first: Sequence[NamedProblem], ask: Callable[[NamedProblem, int], Any], seed: int) -> list[str]:
    """The problems whose answer to the last bit, or whose status, is not the same twice."""
    quiet: Answers = {item.id: ask(item, problem_seed(seed, item.id)) for item in first}
    with busy_clock(seed):
        busy: Answers = {item.id: ask(item, problem_seed(seed, item.id)) for item in reversed(first)}
    return [name for name, answer in quiet.items() if busy[name] != answer]


def _rows(n: int, seed: int, sets: Path | None) -> list[Row]:
    rows = []
    for name in ROBOTS:
        robot, cover = bench_robot(name)
        for door, (ask, kinds) in DOORS.items():
            for kind in kinds:
                problems = generate(robot, cover, kind, n, seed).problems
                found = differing(problems, ask, seed)
                rows.append(
                    {
                        "row": f"{name}/{kind}/{door}",
                        "n": len(problems),
                        "differ": len(found),
                        "first": found[0] if found else None,
                    }
                )
    return rows


BENCHES = (
    Bench(
        "repeat",
        20,
        "generated problems asked twice, the second time backwards and by a busy machine's clock: answers that differ",
        _rows,
    ),
)
