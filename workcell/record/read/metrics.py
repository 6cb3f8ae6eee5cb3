"""What the numbers of a recording say: a row for each metric, and how far each object went."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workcell.pose import Array
from workcell.record.read.paths import names_of
from workcell.record.read.reader import Contents
from workcell.record.read.stage import Stage
from workcell.record.write.cuboid_use import BY
from workcell.record.write.live_log import CLEARANCE, ERROR, SECONDS, TURNED

_SCALARS, _NAMES = "Scalars:scalars", "SeriesLines:names"


def unit_of(name: str) -> tuple[float, str]:
    """What a metric in SI units is multiplied with to be read, and its unit then; names without their column."""
    lengths = ("clearance", "tracking_error", "closure_error", CLEARANCE)
    if name in lengths or name.startswith((BY, ERROR)):
        return 1e3, "mm"
    if name.endswith("_rad") or name.startswith(TURNED):
        return 1e3, "mrad"
    if name == SECONDS:
        return 1e3, "ms"
    return 1.0, "rad" if name.startswith("joint_positions") else ""


def label_of(name: str) -> str:
    """A metric's name as it is read: the unit stands beside it."""
    return name.removesuffix("_rad").replace("_rad/", "/")


@dataclass(frozen=True, slots=True)
class Series:
    """One metric over time: times (T,), values (T, k), and the names of its k columns."""

    name: str
    times: Array
    values: Array
    columns: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class MetricRow:
    """A metric in numbers, in SI units."""

    name: str
    samples: int
    minimum: float
    time_of_minimum: float
    maximum: float
    time_of_maximum: float
    mean: float
    final: float


@dataclass(frozen=True, slots=True)
class ObjectRow:
    """How far an object was moved (metres, start to end), how high it rose, and where it ended (3,)."""

    name: str
    moved: float
    rose: float
    final_position: tuple[float, float, float]


def metric_series(contents: Contents) -> dict[str, Series]:
    """All metrics of a recording by name."""
    found = {}
    for path, entity in contents.below("metrics").items():
        name = "/".join(names_of(path)[1:])
        times, values = entity.numbers(_SCALARS)
        if len(times):
            given = tuple(str(label) for label in entity.static.get(_NAMES, ()))
            columns = (
                given if len(given) == values.shape[1] else tuple(str(k) for k in range(values.shape[1]))
            )
            found[name] = Series(name, times, values.astype(float), columns)
    return dict(sorted(found.items()))


def metric_rows(series: dict[str, Series]) -> tuple[MetricRow, ...]:
    """One row for each column; values that are not finite are left out."""
    rows = []
    for one in series.values():
        for k, column in enumerate(one.columns):
            known = np.isfinite(one.values[:, k])
            if not known.any():
                continue
            times, values = one.times[known], one.values[known, k]
            low, high = int(values.argmin()), int(values.argmax())
            rows.append(
                MetricRow(
                    one.name if one.values.shape[1] == 1 else f"{one.name}/{column}",
                    len(values),
                    float(values[low]),
                    float(times[low]),
                    float(values[high]),
                    float(times[high]),
                    float(values.mean()),
                    float(values[-1]),
                )
            )
    return tuple(rows)


def object_rows(stage: Stage) -> tuple[ObjectRow, ...]:
    """What became of each object that can move."""
    rows = []
    for name, path in sorted(stage.object_paths().items()):
        positions = stage.motions[path].positions
        moved = float(np.linalg.norm(positions[-1] - positions[0]))
        final = (float(positions[-1][0]), float(positions[-1][1]), float(positions[-1][2]))
        rows.append(ObjectRow(name, moved, float(positions[:, 2].max() - positions[0, 2]), final))
    return tuple(rows)
