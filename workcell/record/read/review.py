"""Reviewing a recording from the file alone: verdict, metrics, events and what the file holds."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from workcell.errors import RecordingError
from workcell.record.read.checks import Check, execution_checks, live_checks, planning_checks
from workcell.record.read.cuboids import CuboidRow, cuboid_rows, deciding_cuboids
from workcell.record.read.live import LiveReview, live_review
from workcell.record.read.log import LogLine, log_lines
from workcell.record.read.metrics import MetricRow, ObjectRow, Series, metric_rows, metric_series, object_rows
from workcell.record.read.places import Places, robot_places, shares_of_ways
from workcell.record.read.queries import Query, lost_queries, recorded_queries, stage_rows, summary
from workcell.record.read.reader import Contents, read
from workcell.record.read.stage import Stage
from workcell.record.read.ways import WayRow, way_rows
from workcell.record.write.rrd import APPLICATION
from workcell.record.write.scene_log import FORMAT

ACHIEVED, NOT_ACHIEVED, INCOMPLETE = "achieved", "not achieved", "incomplete"

_UNSEALED = 1
"""The layout that had no seals."""
_GEOMETRIC = 2
"""The last layout whose cuboids in use had decided nothing."""
_LAYOUTS = range(_UNSEALED, FORMAT + 1)
"""Layouts that are understood: what an older one does not tell is not known."""
_STOPPED = ("INTERRUPTED", "ERROR")


@dataclass(frozen=True, slots=True)
class Review:
    """What a recording shows.

    Attributes:
        path: the file.
        verdict: `achieved`, `not achieved`, or `incomplete` when the run did not come to its end.
        reason: one sentence.
        checks: the reviewer's own.
        result, manifest: what the run wrote about itself; empty when missing.
        metrics, objects, events: in the order of names and of time.
        cuboids: those that decided where each link could be; empty where none did, or the recording does not tell.
        queries: of inverse kinematics, with the solvers' stages; empty where the recording does not tell.
        places: which ways the robots were on; empty where the recording does not tell.
        live: of tools that followed goals, what was counted; None: there are none.
        duration: simulated seconds.
        inventory: entity path to (components, rows over time).
        missing: what the file lacks or could not be read.
        checked: whether seals vouch for all that the file holds; False for the first layout, which had none.
        series, stage: the numbers and the geometry, for plots and pictures.
    """

    path: Path
    verdict: str
    reason: str
    checks: tuple[Check, ...]
    result: Mapping[str, Any]
    manifest: Mapping[str, Any]
    metrics: tuple[MetricRow, ...]
    objects: tuple[ObjectRow, ...]
    events: tuple[LogLine, ...]
    cuboids: tuple[CuboidRow, ...]
    queries: tuple[Query, ...]
    places: tuple[Places, ...]
    live: LiveReview | None
    duration: float
    inventory: Mapping[str, tuple[tuple[str, ...], int]]
    missing: tuple[str, ...]
    checked: bool
    series: Mapping[str, Series]
    stage: Stage

    @property
    def achieved(self) -> bool:
        """Whether the task was done."""
        return self.verdict == ACHIEVED

    @property
    def ways(self) -> tuple[WayRow, ...]:
        """Who answered the queries of each way."""
        return way_rows(self.queries, shares_of_ways(self.places, self.duration))

    @property
    def no_way_share(self) -> float | None:
        """Share of the time in which no robot was on a way that anybody was asked for; None: not told."""
        shares = shares_of_ways(self.places, self.duration)
        return shares.get(None, 0.0) if shares else None

    @property
    def ways_said(self) -> str:
        """How many queries were answered by whom, and how much of the motion is not on their ways."""
        share = self.no_way_share
        rest = f"; {share:.0%} of the time on no way that was asked for" if share else ""
        return summary(self.queries) + rest

    @property
    def free_cuboids(self) -> int:
        """How many free-space cuboids and polytopes were recorded."""
        return sum(thing.kind == "free_space" for thing in self.stage.things)

    @property
    def by_geometry(self) -> bool:
        """Whether the cuboids in use are those that links were in, whatever the planner was: an older layout's."""
        layout = self.manifest.get("format")
        return isinstance(layout, int) and layout <= _GEOMETRIC

    @property
    def planner(self) -> str:
        """The planner's name; empty where the recording does not say."""
        return str(self.manifest.get("planner") or self.result.get("planner") or "")

    @property
    def cuboid_words(self) -> str:
        """What the cuboids in use are, or that none decided anything; empty where there is nothing to tell of them."""
        if self.by_geometry:
            return "cuboids that links were in, by geometry alone" if self.cuboids else ""
        if self.queries:
            return deciding_cuboids(self.queries, self.planner)
        return ""

    @property
    def task(self) -> str:
        """The task's name; the file's where the recording does not say."""
        return str(self.manifest.get("task") or self.result.get("task") or self.path.stem)

    def to_json(self) -> dict[str, Any]:
        """Everything but the arrays, ready for `write_json_atomic`."""
        listed = {path: {"components": list(c), "rows": rows} for path, (c, rows) in self.inventory.items()}
        return {
            "file": str(self.path),
            "task": self.task,
            "verdict": self.verdict,
            "reason": self.reason,
            "checked": self.checked,
            "duration_s": self.duration,
            "checks": [asdict(check) for check in self.checks],
            "metrics": [asdict(row) for row in self.metrics],
            "objects": [asdict(row) for row in self.objects],
            "events": [asdict(line) for line in self.events],
            "cuboids_in_use": [row.to_json() for row in self.cuboids],
            "cuboids_said": self.cuboid_words,
            "no_way_share": self.no_way_share,
            "ways": [row.to_json() for row in self.ways],
            "solver_stages": [_finite(asdict(row)) for row in stage_rows(self.queries)],
            "queries": len(self.queries),
            "live": None if self.live is None else self.live.to_json(),
            "result": dict(self.result),
            "manifest": dict(self.manifest),
            "missing": list(self.missing),
            "entities": listed,
        }


def review(path: str | Path) -> Review:
    """Reads a recording and judges it; no server and no screen are needed.

    Raises:
        RecordingError: the file is missing, not an `.rrd`, not one of ours, or nothing in it can be read.
    """
    contents = read(path)
    if contents.application != APPLICATION:
        raise RecordingError(
            f"this recording was written by {contents.application!r}, not by workcell",
            where=path,
            remedy="give a recording made by `workcell run`",
        )
    missing = list(contents.missing)
    result, manifest = _document(contents, "result", missing), _document(contents, "manifest", missing)
    layout = manifest.get("format")
    if not contents.sealed and layout != _UNSEALED:
        missing.insert(0, "no seal in this file is as it was written")
    damaged = bool(contents.missing) or (not contents.sealed and layout != _UNSEALED)
    if layout is not None and layout not in _LAYOUTS:
        missing.append(
            f"the layout of this file is version {manifest['format']}, this reads version {FORMAT}"
        )
    stage, series = Stage.of(contents), metric_series(contents)
    events, metrics, objects = log_lines(contents), metric_rows(series), object_rows(stage)
    if not stage.motions:
        missing.append("no poses")
    if not metrics:
        missing.append("no metrics")
    queries = recorded_queries(contents)
    checks = execution_checks(result, metrics, objects, events)
    checks += planning_checks(manifest, result, queries, lost_queries(contents, queries))
    live = live_review(contents, series, manifest, bool(result.get("nothing_checked")))
    checks += live_checks(result, live)
    verdict, reason = _verdict(result, checks, damaged=damaged)
    if not contents.sealed and not damaged:
        reason += (
            "; unchecked: this is a recording of the first layout, which nothing in the file vouches for"
        )
    last = [float(times[-1]) for times in [stage.times, *(s.times for s in series.values())] if len(times)]
    duration = max(last, default=0.0)
    inventory = {p: (tuple(e.components()), e.rows()) for p, e in sorted(contents.entities.items())}
    return Review(
        path=contents.path,
        verdict=verdict,
        reason=reason,
        checks=checks,
        result=result,
        manifest=manifest,
        metrics=metrics,
        objects=objects,
        events=events,
        cuboids=cuboid_rows(stage.uses, duration),
        queries=queries,
        places=robot_places(contents),
        live=live,
        duration=duration,
        inventory=inventory,
        missing=tuple(missing),
        checked=contents.sealed and not damaged,
        series=series,
        stage=stage,
    )


def _finite(row: dict[str, Any]) -> dict[str, Any]:
    """JSON has no nan."""
    return {key: None if value != value else value for key, value in row.items()}


def _document(contents: Contents, path: str, missing: list[str]) -> dict[str, Any]:
    """A JSON document of the recording; empty, and noted, when it is not there."""
    entity = contents.entities.get(path)
    text = entity.static.get("TextDocument:text") if entity is not None else None
    if not text:
        missing.append(f"no {path}")
        return {}
    try:
        document = json.loads(text[0])
    except ValueError as error:
        missing.append(f"the {path} is not JSON: {error}")
        return {}
    return document if isinstance(document, dict) else {}


def _verdict(result: Mapping[str, Any], checks: tuple[Check, ...], *, damaged: bool) -> tuple[str, str]:
    failed = [check for check in checks if not check.passed]
    if not result:
        return INCOMPLETE, "the recording ends before the run wrote its result"
    if result.get("status") in _STOPPED:
        return INCOMPLETE, str(
            result.get("message") or result.get("sentence") or "the run was stopped before its end"
        )
    if damaged:
        return INCOMPLETE, "part of the recording is missing, so the run can't be judged as a whole"
    if result.get("achieved") is not True:
        why = result.get("sentence") or result.get("message") or result.get("status") or "the run says so"
        return NOT_ACHIEVED, str(why)
    if failed:
        return NOT_ACHIEVED, "the run claims success, but: " + "; ".join(check.finding for check in failed)
    return ACHIEVED, "the run says so, and the recording bears it out"
