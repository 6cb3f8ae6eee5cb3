"""The times of a recording that are worth a picture."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from workcell.record.read.review import Review

_MOMENTS = 6


@dataclass(frozen=True, slots=True)
class Moment:
    """A time worth a picture, and why."""

    time: float
    caption: str


def key_moments(review: Review, count: int = _MOMENTS) -> list[Moment]:
    """The start, the end, and between them the events; gaps are filled with times half-way."""
    end = review.duration
    moments = [Moment(0.0, "start")]
    events = [line for line in review.events if 1e-6 < line.time < end - 1e-6]
    for line in events:
        if line.time - moments[-1].time > 0.02 * end:
            moments.append(Moment(line.time, line.text))
    if end > 0.0:
        moments.append(Moment(end, "end"))
    while len(moments) > count:
        gaps = [moments[k + 1].time - moments[k - 1].time for k in range(1, len(moments) - 1)]
        del moments[1 + int(np.argmin(gaps))]
    while 1 < len(moments) < count:
        gaps = [b.time - a.time for a, b in itertools.pairwise(moments)]
        k = int(np.argmax(gaps))
        moments.insert(k + 1, Moment((moments[k].time + moments[k + 1].time) / 2, ""))
    return moments
