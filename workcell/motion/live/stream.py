"""`GoalStream`: a recorded stream of poses, as a tracker or a hand controller sends them, gaps included.

What a live stream may well say (a pose that is no number, a clock that runs backwards) stays in it as a row without a
goal, with its reason. Files are read by `workcell.motion.live.stream_file`.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from workcell.errors import InputError, UnknownNameError
from workcell.pose import Array, Pose, read_only

COLUMNS = ("t", "x", "y", "z", "qw", "qx", "qy", "qz")
"""What every row has: seconds of the stream's own clock, metres, quaternion wxyz."""
TOOL = "tool"
"""The column that names the robot whose tool is meant, where there are several."""
LONGEST_BRIDGED_S = 0.1
"""Seconds between two rows up to which poses between them may be interpolated: what is longer is a gap."""
STALE_S = 0.5
"""Seconds for which nothing may be said of one tool while others are told where to go."""


@dataclass(frozen=True, slots=True)
class Stamped:
    """A goal, and when it was one.

    Attributes:
        goal: a pose, or one for each named tool (None: it has none); None: there is no goal.
        stamp: seconds of the stream's clock at which it was said; None: it has no clock.
        reason: why there is no goal; else empty.
    """

    goal: Pose | Mapping[str, Pose | None] | None
    stamp: float | None = None
    reason: str = ""


@dataclass(frozen=True, slots=True)
class StreamRow:
    """What a stream said once: its stamp (seconds, nan where it is none), for whom, and the pose or why it is none."""

    stamp: float
    tool: str
    pose: Pose | None
    fault: str = ""


@dataclass(frozen=True, slots=True)
class GoalStream:
    """Rows in the order in which they came.

    A row whose clock does not run forwards came with the row before it; it is none to go to.

    Attributes:
        where: the file, or what made the rows.
        rows: at least one with a stamp.
        arrivals: (r,) seconds at which each came: the largest stamp until then.

    Raises:
        InputError: no row with a stamp, or rows with and without a tool.
    """

    where: str
    rows: tuple[StreamRow, ...]
    arrivals: Array = field(init=False)
    _of: Mapping[str, list[int]] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        stamps = np.array([row.stamp for row in self.rows], dtype=float)
        if not np.isfinite(stamps).any():
            raise InputError("no row has a time", where=self.where, remedy="one row at least")
        if len({bool(row.tool) for row in self.rows}) > 1:
            raise InputError("some rows name a tool, some don't", where=self.where, remedy="all, or none")
        first = stamps[np.isfinite(stamps)][0]
        held = np.where(np.isfinite(stamps), stamps, -np.inf)
        object.__setattr__(self, "arrivals", read_only(np.maximum(np.maximum.accumulate(held), first)))
        object.__setattr__(self, "rows", _with_clock_faults(self.rows))
        rows_of: dict[str, list[int]] = {}
        for k, row in enumerate(self.rows):
            rows_of.setdefault(row.tool, []).append(k)
        object.__setattr__(self, "_of", rows_of)

    @property
    def tools(self) -> tuple[str, ...]:
        """The tools that are named, in the order in which they come; empty: none is."""
        return tuple(tool for tool in self._of if tool)

    @property
    def begin(self) -> float:
        """Seconds at which the first row came."""
        return float(self.arrivals[0])

    @property
    def end(self) -> float:
        """Seconds at which the last row came."""
        return float(self.arrivals[-1])

    @property
    def faults(self) -> tuple[str, ...]:
        """What is wrong with rows that are no goals, in their order."""
        return tuple(row.fault for row in self.rows if row.fault)

    def from_zero(self) -> GoalStream:
        """The same stream on a clock that is 0 at its first row."""
        shift = self.begin
        return GoalStream(self.where, tuple(replace(row, stamp=row.stamp - shift) for row in self.rows))

    def check_tools(self, names: Sequence[str]) -> None:
        """Raise UnknownNameError for a tool that is none of `names`, InputError where several need names."""
        for tool in self.tools:
            if tool not in names:
                raise UnknownNameError("tool", tool, names, where=self.where)
        if not self.tools and len(names) > 1:
            raise InputError(
                f"no row says which of {len(names)} tools it is for",
                where=self.where,
                remedy=f"a column {TOOL!r}: {', '.join(names)}",
            )

    def at(self, t: float, *, interpolate: bool = False) -> Stamped:
        """The newest goal that came at `t` seconds or before, with its stamp; before the first there is none.

        Args:
            t: seconds of the stream's clock.
            interpolate: between the newest row and the next, where they are at most `LONGEST_BRIDGED_S` apart, in
                place of the newest: smoother, but no live stream knows what comes next.
        """
        known = int(np.searchsorted(self.arrivals, t + 1e-9, side="right"))
        if known == 0:
            return Stamped(None, None, "the stream has not begun")
        if not self.tools:
            return self._one(t, known, "", interpolate)
        said = {tool: self._one(t, known, tool, interpolate) for tool in self.tools}
        stamps = [one.stamp for one in said.values() if one.stamp is not None]
        said = {tool: _fresh(one, max(stamps, default=t)) for tool, one in said.items()}
        reasons = [f"{tool}: {one.reason}" for tool, one in said.items() if one.reason]
        if all(one.goal is None for one in said.values()):
            return Stamped(None, max(stamps, default=None), "; ".join(reasons))
        goals = {tool: one.goal if isinstance(one.goal, Pose) else None for tool, one in said.items()}
        return Stamped(goals, max(stamps), "; ".join(reasons))

    def _one(self, t: float, known: int, tool: str, interpolate: bool) -> Stamped:
        """What was last said for one tool among the first `known` rows."""
        mine = self._of[tool]
        newest = bisect.bisect_left(mine, known) - 1
        if newest < 0:
            return Stamped(None, None, "the stream has not begun")
        row = self.rows[mine[newest]]
        if row.pose is None or row.fault:
            return Stamped(None, row.stamp if math.isfinite(row.stamp) else None, row.fault)
        last = newest + 1 == len(mine)
        later = None if last or not interpolate else _bridged(row, self.rows[mine[newest + 1]])
        if later is None or later.pose is None:
            return Stamped(row.pose, row.stamp)
        share = min(max(t - row.stamp, 0.0) / (later.stamp - row.stamp), 1.0)
        return Stamped(row.pose.interpolate(later.pose, share), max(t, row.stamp))


def _bridged(row: StreamRow, later: StreamRow) -> StreamRow | None:
    """The next row of the same tool, where it is a goal, later, and no gap lies before it."""
    return None if later.fault or not 0 < later.stamp - row.stamp <= LONGEST_BRIDGED_S else later


def _fresh(said: Stamped, newest: float) -> Stamped:
    """What was said for one tool; none where others were told of since, and it was not."""
    if said.stamp is None or newest - said.stamp <= STALE_S:
        return said
    return Stamped(None, said.stamp, f"nothing was said for {newest - said.stamp:.2f} s")


def _with_clock_faults(rows: Sequence[StreamRow]) -> tuple[StreamRow, ...]:
    """The rows, with a fault where a tool's clock runs backwards or is no number."""
    newest: dict[str, float] = {}
    found = []
    for row in rows:
        before = newest.get(row.tool, -math.inf)
        fault = row.fault
        if not math.isfinite(row.stamp):
            fault = fault or f"its time is {row.stamp}"
        elif row.stamp < before:
            fault = fault or f"its clock runs backwards: {row.stamp:.6g} s after {before:.6g} s"
        else:
            newest[row.tool] = row.stamp
        found.append(replace(row, fault=fault))
    return tuple(found)


def stream_of(values: Sequence[Sequence[float]], where: str = "stream") -> GoalStream:
    """A stream of rows of eight numbers in the order of `COLUMNS`, for one tool."""
    return GoalStream(where, tuple(row_of(dict(zip(COLUMNS, row, strict=True))) for row in values))


def row_of(values: Mapping[str, float], tool: str = "") -> StreamRow:
    """A row of a number for each of `COLUMNS`; where they are no pose it says why."""
    position = np.array([values[name] for name in ("x", "y", "z")])
    quat = np.array([values[name] for name in ("qw", "qx", "qy", "qz")])
    try:
        return StreamRow(values["t"], tool, Pose(position, quat))
    except InputError as error:
        return StreamRow(values["t"], tool, None, error.message)
