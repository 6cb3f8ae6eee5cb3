"""Who planned the ways of a run: the queries of each, added up, and whether they were the named planner's."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from workcell.ik.registry import AUTO, is_planned_by
from workcell.record.read.queries import Query

_ROUNDED = 1e-5
"""Share by which what documents tell may be rounded."""


@dataclass(frozen=True, slots=True)
class Change:
    """The change against the reference that came nearest to its bound, and that bound; None: there was none."""

    largest: float
    bound: float | None

    @property
    def words(self) -> str:
        """Both, as `0.12/0.2`."""
        return f"{self.largest:.2g}" + ("" if self.bound is None else f"/{self.bound:.3g}")

    @property
    def share(self) -> float:
        """The change as a share of its bound; 0 without one."""
        return self.largest / self.bound if self.bound else 0.0


@dataclass(frozen=True, slots=True)
class WayRow:
    """The queries of one way: of everything that was asked under one name.

    What older recordings don't tell is None.

    Attributes:
        what: its name.
        queries: how many were asked; `steps` of them with a bound on continuity.
        by: solver and number of the queries that it solved, the busiest first.
        unsolved: how many were not solved.
        in_cuboids: how many were solved among cuboids.
        sdps: cone programs, all together.
        cpu_ms: CPU milliseconds, all together.
        step: of a joint, radians (metres where it slides); None also where no step was solved.
        link_rotation: of a link's world rotation, Frobenius norm (Eq. 75 of IKSPARK).
        time_share: share of the simulated time in which a robot was on it.
    """

    what: str
    queries: int
    steps: int | None
    by: tuple[tuple[str, int], ...]
    unsolved: int
    in_cuboids: int | None
    sdps: int | None
    cpu_ms: float
    step: Change | None
    link_rotation: Change | None
    time_share: float | None = None

    @property
    def answered(self) -> str:
        """By whom, in words."""
        told = [f"{count} {solver}" for solver, count in self.by]
        return ", ".join([*told, *([f"{self.unsolved} unsolved"] if self.unsolved else [])])

    @property
    def cells(self) -> tuple[str, ...]:
        """The row of a table below `WAY_HEAD`."""
        counts = ["?" if count is None else str(count) for count in (self.in_cuboids, self.sdps)]
        changes = ["-" if change is None else change.words for change in (self.step, self.link_rotation)]
        driven = "?" if self.time_share is None else f"{self.time_share:.0%}"
        return (self.what, str(self.queries), self.answered, *counts, f"{self.cpu_ms:.1f}", *changes, driven)

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        by = [{"solver": solver, "solved": count} for solver, count in self.by]
        return {**asdict(self), "by": by}


WAY_HEAD = ("way", "queries", "solved by", "cuboids", "programs", "CPU ms", "step", "turn", "time")
"""In cuboids, cone programs, joint step and link rotation with their bounds, and the share of the time on the way."""


def way_rows(
    queries: Sequence[Query], shares: Mapping[str | None, float] | None = None
) -> tuple[WayRow, ...]:
    """A row for each way, in the order in which they were first asked for; `shares` of the time by way, if known."""
    groups: dict[str, list[Query]] = {}
    for query in queries:
        groups.setdefault(query.what, []).append(query)
    rows = (_row(what, group) for what, group in groups.items())
    return tuple(replace(row, time_share=shares.get(row.what, 0.0) if shares else None) for row in rows)


def _row(what: str, group: Sequence[Query]) -> WayRow:
    solved = [query for query in group if query.solved]
    told = all(query.kind is not None for query in group)
    return WayRow(
        what,
        len(group),
        sum(query.kind == "step" for query in group) if told else None,
        tuple(Counter(query.solver for query in solved).most_common()),
        len(group) - len(solved),
        sum(query.in_cuboids is True for query in solved) if told else None,
        sum(query.sdps or 0 for query in group) if told else None,
        sum(query.cpu_ms for query in group),
        _nearest([(query.step, query.max_step) for query in solved]),
        _nearest([(query.link_rotation, query.max_link_rotation) for query in solved]),
    )


def _nearest(changes: Sequence[tuple[float | None, float | None]]) -> Change | None:
    """The change that is the largest share of its bound; of those without, the largest."""
    known = [Change(change, bound) for change, bound in changes if change is not None]
    return max(
        known,
        key=lambda one: (one.share, one.largest),
        default=None,
    )


def kept_bounds(rows: Sequence[WayRow]) -> tuple[bool, str] | None:
    """Whether every step kept its bounds on continuity, and in words how near the largest came.

    Joints and links' rotations (Eq. 75 of IKSPARK) alike, as the queries' documents tell. None: nothing was bounded.
    """
    found, kept = [], True
    for name in ("step", "link_rotation"):
        changes = [(change, row.what) for row in rows if (change := getattr(row, name)) and change.bound]
        if changes:
            change, way = max(changes, key=lambda one: one[0].share)
            kept &= change.share <= 1.0 + _ROUNDED
            words = "joint step" if name == "step" else "link rotation"
            found.append(f"largest {words} {change.largest:.3g} of {change.bound:.3g} ({way})")
    return (kept, ", ".join(found)) if found else None


def planned_by(queries: Sequence[Query], lost: int, planner: str) -> tuple[bool, str] | None:
    """Whether every configuration that was found is the planner's, and in words who found them.

    All queries count, whoever asked: steps of ways and goal configurations, tries among them. Joint motions are planned
    without any. None: nothing was asked, so that there is nothing to tell.

    Args:
        queries: that can be read.
        lost: how many others there were.
        planner: its name, as of `--planner`.
    """
    solved = [query for query in queries if query.solved]
    if lost:
        return False, f"{lost} of {lost + len(queries)} queries can't be read: nobody knows who answered them"
    if not solved:
        return None
    by = Counter(query.solver for query in solved).most_common()
    others = [row for row in way_rows(solved) if _strangers(row, planner)]
    if others:
        ways = "; ".join(f"{row.what}: {_strangers(row, planner)}" for row in others)
        return False, f"not all is {planner}'s: {ways}"
    if planner == AUTO:
        return True, f"{planner}: of {len(solved)} " + ", ".join(f"{count} by {name}" for name, count in by)
    inside = sum(query.in_cuboids is True for query in solved)
    parts = "".join(f", {count} by {name}" for name, count in by if name != planner)
    among = f", {inside} in cuboids" if inside else ""
    return True, f"all {len(solved)} configurations are {planner}'s{among}{parts}"


def _strangers(row: WayRow, planner: str) -> str:
    """`12 of 12 by local`, for each solver that is not the planner or a part of it; empty without."""
    solved = sum(count for _, count in row.by)
    return ", ".join(
        f"{count} of {solved} by {solver}" for solver, count in row.by if not is_planned_by(planner, solver)
    )
