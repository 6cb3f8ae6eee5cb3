"""Tools that follow goals live, in a recording: joints, goals, errors, terms, limits, frame by frame."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from workcell.files import to_json
from workcell.motion.live.step import LiveStatus
from workcell.motion.live.weights import TERMS
from workcell.pose import Array
from workcell.record.write.rrd import RrdWriter, entity

if TYPE_CHECKING:
    from workcell.simulate.frames import LiveFacts, LiveFrames

LIVE = "live"
"""Entity of what a review counts, of each robot: `live/NAME/joints`, `live/NAME/status` and `live/NAME/limits`."""
TARGETS = "targets"
"""Below `world`: the goal of each robot's tool, as it moves."""
ERROR, TURNED = "live/position_error", "live/rotation_error_rad"
"""Metrics, of each robot."""
TERM_METRIC, CLEARANCE, CONDITIONING = "live/terms", "live/clearance", "live/conditioning"
SECONDS, BRAKED = "live/frame_time", "live/braked"
STATUSES = tuple(status.name for status in LiveStatus)
"""What the numbers of `live/NAME/status` mean; `live/about` says so."""


class LiveLog:
    """Writes frames.

    Args:
        writer: of the recording.
        step: numbers of simulation steps at times (T,).
    """

    def __init__(self, writer: RrdWriter, step: Callable[[Array], Any]) -> None:
        self._writer, self._step = writer, step
        self._facts: LiveFacts | None = None

    def log(self, frames: LiveFrames) -> None:
        """Consecutive frames of one order."""
        facts = frames.facts
        if self._facts is None:
            self._name(facts)
        if facts is not self._facts:
            self._facts = facts
            self._send_limits(frames)
        indexes = frames.time, self._step(frames.time)
        for name in facts.names:
            joined = frames.q[:, facts.joints_of(name)]
            self._writer.send_scalars(f"{LIVE}/{entity(name)}/joints", indexes, joined)
        asked = np.array([bool(status) for status in frames.status])
        if asked.any():
            self._send_answers(frames, asked)

    def _name(self, facts: LiveFacts) -> None:
        """What stays true: names of columns, axes of goals."""
        about = {"statuses": STATUSES, "terms": TERMS}
        self._writer.log_document(f"{LIVE}/about", to_json(about))
        self._writer.name_series(f"metrics/{TERM_METRIC}", TERMS)
        for name in facts.names:
            self._writer.log_axes(f"world/{TARGETS}/{entity(name)}", 0.1)

    def _send_limits(self, frames: LiveFrames) -> None:
        """Within what limits the frames that follow were made."""
        facts, begin = frames.facts, frames.time[:1]
        for name in facts.names:
            mine, limits = facts.joints_of(name), facts.limits
            document = {
                "joints": facts.joints[mine],
                "period": facts.period,
                "lower": facts.lower[mine],
                "upper": facts.upper[mine],
                "velocity": limits.velocity[mine],
                "acceleration": limits.acceleration[mine],
                "jerk": limits.jerk[mine],
            }
            path = f"{LIVE}/{entity(name)}/limits"
            self._writer.send_documents(path, (begin, self._step(begin)), [to_json(document)])

    def _send_answers(self, frames: LiveFrames, asked: Array) -> None:
        """What was answered in each frame; the row of an order's beginning is no answer."""
        times = frames.time[asked]
        indexes = times, self._step(times)
        numbers = np.array([STATUSES.index(status) for status in frames.status if status], dtype=float)
        self._send_metric(TERM_METRIC, indexes, frames.terms[asked])
        self._send_metric(CLEARANCE, indexes, frames.clearance[asked])
        self._send_metric(SECONDS, indexes, frames.seconds[asked])
        self._send_metric(BRAKED, indexes, frames.braked[asked].astype(float))
        for k, name in enumerate(frames.facts.names):
            below = entity(name)
            self._writer.send_scalars(f"{LIVE}/{below}/status", indexes, numbers)
            self._send_metric(f"{ERROR}/{below}", indexes, frames.position_error[asked, k])
            self._send_metric(f"{TURNED}/{below}", indexes, frames.rotation_error[asked, k])
            self._send_metric(f"{CONDITIONING}/{below}", indexes, frames.conditioning[asked, k])
            goal = frames.goal[asked, k]
            known = np.isfinite(goal).all(axis=1)
            if known.any():
                when = times[known], self._step(times[known])
                path = f"world/{TARGETS}/{below}"
                self._writer.send_poses(path, when, goal[known, :3], goal[known, 3:])

    def _send_metric(self, name: str, indexes: tuple[Array, Any], values: Array) -> None:
        self._writer.send_scalars(f"metrics/{name}", indexes, values)
