"""Two recordings side by side: what differs in verdict, numbers, motion and story."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from workcell.record.read.metrics import Series, label_of, unit_of
from workcell.record.read.queries import stage_rows
from workcell.record.read.review import Review
from workcell.record.write.scene_log import JOINT_POSITIONS

if TYPE_CHECKING:
    from rich.console import Group

_IGNORED = (
    "wall_s",
    "planning_s",
    "execution_s",
    "compiling_s",
    "sentence",
    "min_clearance_pair",
    "conditions",
)


@dataclass(frozen=True, slots=True)
class MetricDifference:
    """A metric of both recordings: the value that a reader looks for, its smallest or its largest, in SI units."""

    name: str
    first: tuple[float, float] | None
    second: tuple[float, float] | None

    @property
    def change(self) -> tuple[float, float] | None:
        """Second minus first of (minimum, maximum); None where one lacks it."""
        if self.first is None or self.second is None:
            return None
        return self.second[0] - self.first[0], self.second[1] - self.first[1]


@dataclass(frozen=True, slots=True)
class MotionDifference:
    """How far the joints of one robot are apart over the time that both recordings cover.

    Attributes:
        robot: its name.
        largest: radians (metres for sliding joints), the largest difference of one joint.
        joint: which joint.
        at: simulated seconds of it.
    """

    robot: str
    largest: float
    joint: str
    at: float


@dataclass(frozen=True, slots=True)
class Comparison:
    """What differs between two reviews.

    Attributes:
        first, second: the reviews.
        facts: result and manifest entries that differ: name, first, second.
        metrics: of both, in the order of names.
        motions: robots in both.
        cuboids: what the cuboids in use are, and links in other ones: robot/link, first, second.
        ways: where others answered their queries: what was asked, by whom in the first, in the second.
        stages: of the solvers, where their numbers differ: what was asked, solver, stage, times in the first, in the
            second.
        events: lines of the log, `-` only in the first, `+` only in the second, without their times.
    """

    first: Review
    second: Review
    facts: tuple[tuple[str, str, str], ...]
    metrics: tuple[MetricDifference, ...]
    motions: tuple[MotionDifference, ...]
    cuboids: tuple[tuple[str, str, str], ...]
    ways: tuple[tuple[str, str, str], ...]
    stages: tuple[tuple[str, str, str, int, int], ...]
    events: tuple[str, ...]

    @property
    def same(self) -> bool:
        """Whether both runs ended alike, moved alike (1e-9) and tell the same story."""
        still = all(motion.largest <= 1e-9 for motion in self.motions)
        return self.first.verdict == self.second.verdict and still and not self.events and not self.facts

    def to_json(self) -> dict[str, Any]:
        """Plain values for `--json`."""
        return {
            "files": [str(self.first.path), str(self.second.path)],
            "verdicts": [self.first.verdict, self.second.verdict],
            "durations_s": [self.first.duration, self.second.duration],
            "same": self.same,
            "facts": [{"name": name, "first": a, "second": b} for name, a, b in self.facts],
            "metrics": [asdict(row) | {"change": row.change} for row in self.metrics],
            "motions": [asdict(row) for row in self.motions],
            "cuboids": [{"link": link, "first": a, "second": b} for link, a, b in self.cuboids],
            "ways": [{"what": what, "first": a, "second": b} for what, a, b in self.ways],
            "stages": [
                {"what": what, "solver": solver, "stage": stage, "first": a, "second": b}
                for what, solver, stage, a, b in self.stages
            ],
            "events": list(self.events),
        }

    def table(self) -> Group:
        """The comparison for a terminal (rich)."""
        from rich.console import Group
        from rich.text import Text

        a, b = self.first, self.second
        head = "the same run" if self.same else "the runs differ"
        parts: list[Any] = [Text(head, style="bold"), *_heads(a, b)]
        if self.facts:
            parts.append(_grid(("", "first", "second"), self.facts))
        parts.append(_grid(("metric", "min", "min 2nd", "max", "max 2nd"), map(_cells, self.metrics)))
        for motion in self.motions:
            words = f"{motion.robot}: joints at most {motion.largest:.3g} apart ({motion.joint}, {motion.at:.2f} s)"
            parts.append(Text(words))
        if self.cuboids:
            parts.append(_grid(("link in cuboids", "first", "second"), self.cuboids))
        if self.ways:
            parts.append(_grid(("way planned by", "first", "second"), self.ways))
        if self.stages:
            rows = [(what, solver, stage, str(a), str(b)) for what, solver, stage, a, b in self.stages]
            parts.append(_grid(("solver stages", "solver", "stage", "first", "second"), rows))
        if self.events:
            parts.append(Text("Events (- only in the first, + only in the second)", style="bold"))
            parts += [Text("  " + line, style="red" if line[0] == "-" else "green") for line in self.events]
        return Group(*parts)


def compare(first: Review, second: Review) -> Comparison:
    """Compares two reviews."""
    return Comparison(
        first,
        second,
        tuple(_facts(first, second)),
        tuple(_metrics(first, second)),
        tuple(_motions(first, second)),
        tuple(_cuboids(first, second)),
        tuple(_ways(first, second)),
        tuple(_stages(first, second)),
        tuple(_events(first, second)),
    )


def _facts(first: Review, second: Review) -> list[tuple[str, str, str]]:
    a, b = (_flat({**review.manifest, **review.result}) for review in (first, second))
    told = [(name, _short(a.get(name)), _short(b.get(name))) for name in {**a, **b}]
    return [row for row in told if row[1] != row[2]]


def _flat(values: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Nested entries under one name each, `robots.sawyer.dof`; what is ignored is left out."""
    found: dict[str, Any] = {}
    for name, value in values.items():
        if name not in _IGNORED:
            found |= (
                _flat(value, f"{before}{name}.") if isinstance(value, Mapping) else {before + name: value}
            )
    return found


def _short(value: Any) -> str:
    text = f"{value:.6g}" if isinstance(value, float) else "-" if value is None else str(value)
    return text if len(text) <= 60 else text[:59] + "…"


def _metrics(first: Review, second: Review) -> list[MetricDifference]:
    ranges = [{row.name: (row.minimum, row.maximum) for row in review.metrics} for review in (first, second)]
    return [
        MetricDifference(name, ranges[0].get(name), ranges[1].get(name))
        for name in sorted({*ranges[0], *ranges[1]})
    ]


def _motions(first: Review, second: Review) -> list[MotionDifference]:
    rows = []
    for name in sorted({*first.series} & {*second.series}):
        a, b = first.series[name], second.series[name]
        if name.startswith(JOINT_POSITIONS) and a.columns == b.columns:
            rows.append(_motion(name.rpartition("/")[2], a, b))
    return rows


def _motion(robot: str, a: Series, b: Series) -> MotionDifference:
    shared = a.times[a.times <= b.times[-1]]
    there = np.stack([np.interp(shared, b.times, b.values[:, k]) for k in range(len(b.columns))], axis=1)
    apart = np.abs(a.values[: len(shared)] - there)
    when, joint = np.unravel_index(int(apart.argmax()), apart.shape)
    return MotionDifference(robot, float(apart.max()), a.columns[joint], float(shared[when]))


def _cuboids(first: Review, second: Review) -> list[tuple[str, str, str]]:
    """What the cuboids in use are, where that differs, and links in other cuboids or for other shares of the time.

    Those that decided are not compared with those that links were in by geometry alone, as older recordings tell.
    """
    said = first.cuboid_words, second.cuboid_words
    rows = [("cuboids in use", said[0] or "-", said[1] or "-")] if said[0] != said[1] else []
    if first.by_geometry != second.by_geometry:
        return rows
    a, b = ({f"{row.robot}/{row.link}": row.words for row in review.cuboids} for review in (first, second))
    return rows + [(link, a[link], b[link]) for link in a if link in b and a[link] != b[link]]


def _ways(first: Review, second: Review) -> list[tuple[str, str, str]]:
    """By whom each way's queries were answered, where that differs and both recordings tell."""
    if not first.queries or not second.queries:
        return []
    a, b = ({row.what: row.answered for row in review.ways} for review in (first, second))
    return [(what, a.get(what, "-"), b.get(what, "-")) for what in {**a, **b} if a.get(what) != b.get(what)]


def _stages(first: Review, second: Review) -> list[tuple[str, str, str, int, int]]:
    """How often the solvers went through each stage, where that differs and both recordings tell."""
    if not first.queries or not second.queries:
        return []
    counts = [
        {(row.what, row.solver, row.stage): row.count for row in stage_rows(review.queries)}
        for review in (first, second)
    ]
    keys = list(dict.fromkeys([*counts[0], *counts[1]]))
    rows = [(*key, counts[0].get(key, 0), counts[1].get(key, 0)) for key in keys]
    return [row for row in rows if row[3] != row[4]]


def _events(first: Review, second: Review) -> list[str]:
    before, after = ([line.text for line in review.events] for review in (first, second))
    return [line for line in difflib.ndiff(before, after) if line[0] in "+-"]


def _heads(first: Review, second: Review) -> list[Any]:
    from rich.text import Text

    words = [f"{r.path}: {r.verdict}, {r.duration:.2f} s simulated" for r in (first, second)]
    return [Text(f"  first   {words[0]}"), Text(f"  second  {words[1]}")]


def _cells(row: MetricDifference) -> tuple[str, ...]:
    scale, unit = unit_of(row.name)
    pairs = [
        ("-", "-") if r is None else (f"{scale * r[0]:.3f}", f"{scale * r[1]:.3f}")
        for r in (row.first, row.second)
    ]
    return (f"{label_of(row.name)} {unit}".rstrip(), pairs[0][0], pairs[1][0], pairs[0][1], pairs[1][1])


def _grid(head: tuple[str, ...], rows: Any) -> Any:
    from rich.table import Table

    table = Table(box=None, pad_edge=True, header_style="bold")
    for k, name in enumerate(head):
        table.add_column(name, justify="right" if k and head[0] else "left", overflow="fold")
    for row in rows:
        table.add_row(*row)
    return table
