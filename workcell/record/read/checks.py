"""What a reviewer works out from a recording, against what the run says of itself."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from workcell.record.read.live import LiveReview
from workcell.record.read.log import LogLine
from workcell.record.read.metrics import MetricRow, ObjectRow
from workcell.record.read.queries import Query
from workcell.record.read.ways import kept_bounds, planned_by, way_rows

_GRASP = re.compile(r"\b(grasp|held)", re.IGNORECASE)
_MOVED_M = 0.01
_AGREEMENT_M = 1e-6
MOST_MISSED = 1e-3
"""Metres (radians) by which ties may be missed while a simulation moves a mechanism: its constraints give a little."""


@dataclass(frozen=True, slots=True)
class Check:
    """Something the reviewer worked out from the recording, not from what the run says of itself."""

    name: str
    passed: bool
    finding: str


def execution_checks(
    result: Mapping[str, Any],
    metrics: tuple[MetricRow, ...],
    objects: tuple[ObjectRow, ...],
    events: tuple[LogLine, ...],
) -> tuple[Check, ...]:
    """Of what was executed: clearance, tracking, grasps, errors."""
    rows = {row.name: row for row in metrics}
    checks = []
    for name, claim in (("clearance", "min_clearance_m"), ("tracking_error", "max_tracking_error_m")):
        if result.get(claim) is not None and name not in rows:
            checks.append(Check("evidence", False, f"the run claims a {claim}, the recording has no {name}"))
    if (clearance := rows.get("clearance")) is not None:
        where = f"smallest clearance {1e3 * clearance.minimum:.2f} mm at {clearance.time_of_minimum:.2f} s"
        checks.append(Check("clearance", clearance.minimum >= 0.0, where))
        claimed = result.get("min_clearance_m")
        if isinstance(claimed, (int, float)) and not clearance.minimum >= claimed - _AGREEMENT_M:
            text = (
                f"the run claims {1e3 * claimed:.2f} mm, the recording shows {1e3 * clearance.minimum:.2f} mm"
            )
            checks.append(Check("claimed clearance", False, text))
    if result.get("nothing_checked"):
        text = "not measured: there is no collision geometry that could meet"
        checks.append(Check("clearance", clearance is None, text))
    if (tracking := rows.get("tracking_error")) is not None:
        text = f"largest tracking error {1e3 * tracking.maximum:.3f} mm at {tracking.time_of_maximum:.2f} s"
        limit = result.get("tracking_limit_m")
        bounded = isinstance(limit, (int, float))
        text += f", {1e3 * float(limit or 0.0):.2f} mm allowed" if bounded else ""
        checks.append(Check("tracking", not bounded or tracking.maximum <= float(limit or 0.0), text))
        claimed = result.get("max_tracking_error_m")
        if isinstance(claimed, (int, float)) and not tracking.maximum <= claimed + _AGREEMENT_M:
            text = (
                f"the run claims {1e3 * claimed:.3f} mm, the recording shows {1e3 * tracking.maximum:.3f} mm"
            )
            checks.append(Check("claimed tracking", False, text))
    if (closure := rows.get("closure_error")) is not None:
        checks.append(_closure(closure, result))
    elif result.get("max_closure_error_m") is not None:
        checks.append(
            Check("evidence", False, "the run claims closed loops, the recording has no closure_error")
        )
    # what is said before anything moves is about the plan
    if (
        any(line.time > 0 and line.level == "INFO" and _GRASP.search(line.text) for line in events)
        and objects
    ):
        moved = [row for row in objects if row.moved > _MOVED_M or row.rose > _MOVED_M]
        text = ", ".join(f"the {row.name} went {row.moved:.3f} m" for row in moved) or "no object was moved"
        checks.append(Check("grasp", bool(moved), text))
    errors = [line for line in events if line.level == "ERROR"]
    text = f"{errors[0].text} ({errors[0].time:.2f} s)" if errors else "none in the log"
    checks.append(Check("errors", not errors, text))
    return tuple(checks)


def _closure(row: MetricRow, result: Mapping[str, Any]) -> Check:
    """Whether the ties of a mechanism held all along, and no worse than the run says."""
    text = f"ties missed by {1e3 * row.maximum:.3f} mm (mrad) at most, at {row.time_of_maximum:.2f} s"
    claimed = result.get("max_closure_error_m")
    if isinstance(claimed, (int, float)) and not row.maximum <= claimed + _AGREEMENT_M:
        return Check("closure", False, f"{text}; the run claims {1e3 * claimed:.3f}")
    return Check("closure", row.maximum <= MOST_MISSED, f"{text}, {1e3 * MOST_MISSED:g} allowed")


def planning_checks(
    manifest: Mapping[str, Any], result: Mapping[str, Any], queries: Sequence[Query], lost: int
) -> tuple[Check, ...]:
    """Whether the ways are the planner's that the manifest names, and whether steps kept their bounds.

    Nothing where no planner is named, or nothing was asked.
    """
    checks = []
    planner, said = manifest.get("planner"), result.get("planner")
    if planner is not None and said not in (None, planner):
        checks.append(Check("planner", False, f"the manifest names {planner}, the run says {said}"))
    elif planner is not None and (found := planned_by(queries, lost, str(planner))) is not None:
        checks.append(Check("planner", *found))
    if (found := kept_bounds(way_rows(queries))) is not None:
        checks.append(Check("continuity", *found))
    return tuple(checks)


def live_checks(result: Mapping[str, Any], live: LiveReview | None) -> tuple[Check, ...]:
    """Of tools that followed goals: no jump, no limit and no clearance violated, as many frames as are claimed."""
    claimed = result.get("live_frames")
    if live is None:
        text = f"the run claims {claimed} frames, the recording has none"
        return (Check("live", False, text),) if claimed else ()
    checks = [Check("live", live.clean, live.words)]
    if claimed is not None and claimed != live.frames:
        text = f"the run claims {claimed} frames, the recording has {live.frames}"
        checks.append(Check("claimed frames", False, text))
    claimed = result.get("goal_error_mean_m")
    shown = max((robot.position_mean for robot in live.robots), default=float("nan"))
    if isinstance(claimed, (int, float)) and not abs(shown - claimed) <= _AGREEMENT_M:
        text = (
            f"the run claims {1e3 * claimed:.3f} mm off on average, the recording shows {1e3 * shown:.3f} mm"
        )
        checks.append(Check("claimed errors", False, text))
    return tuple(checks)
