"""The measures of RelaxedIK's section 5.4, of joint values alone: whoever made them is not asked.

Kinematics are those of `Robot` in numpy, contacts those of the compiled MuJoCo model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workcell.bench.live.arms import Arms, conditioning, threshold
from workcell.bench.live.touching import Touching
from workcell.bench.live.traces import PERIOD, Trace
from workcell.bench.rows import Row
from workcell.pose import Array, quat_to_matrix, rotation_vector

_SLACK = 1.0 + 1e-6
"""By which a step may exceed a velocity limit before it is a discontinuity."""
SETTLED = 50
"""Frames after which the way from the displaced start to the path is over: a second."""


@dataclass(frozen=True, slots=True)
class Run:
    """What a follower made of a trace.

    Attributes:
        q: (k + 1, n) configurations: the start, and one for each frame.
        seconds: (k,) CPU time of each frame.
        unanswered: frames for which it had no answer; the arms stood still in them.
    """

    q: Array
    seconds: Array
    unanswered: int = 0


@dataclass(frozen=True, slots=True)
class Measured:
    """A run, measured frame by frame; of two arms the errors and rates are means, an event of either counts once.

    Attributes:
        position, rotation: (k,) errors of the tools, metres and radians.
        velocity, acceleration, jerk: (k,), (k,), (k,) norms of first, second and third differences of joint values,
            per update; the arm stood still before its start.
        discontinuity: (k,) whether a joint moved farther than its velocity limit allows.
        singular: (k,) whether a tool's Jacobian was conditioned worse than the arm's threshold.
        collision: (k,) whether an arm touched itself, or the other.
        seconds: (k,) CPU time.
        unanswered: frames without an answer.
    """

    position: Array
    rotation: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    discontinuity: NDArray[np.bool_]
    singular: NDArray[np.bool_]
    collision: NDArray[np.bool_]
    seconds: Array
    unanswered: int


def measure(arms: Arms, trace: Trace, run: Run, touching: Touching | None = None) -> Measured:
    """All measures of a run; `touching` to be asked, where they have been made already."""
    q, checked = run.q[1:], touching or Touching(arms.scene, arms.names)
    position, rotation, rates = [], [], []
    singular = np.zeros(len(q), dtype=bool)
    for k, (robot, columns) in enumerate(zip(arms.robots, arms.columns, strict=True)):
        mine = q[:, columns]
        T = robot.fk_transform(mine)
        position.append(np.linalg.norm(T[:, :3, 3] - trace.positions[k], axis=1))
        turned = np.swapaxes(T[:, :3, :3], 1, 2) @ quat_to_matrix(trace.quats[k])
        rotation.append(np.linalg.norm(rotation_vector(turned), axis=1))
        singular |= conditioning(robot, mine) < threshold(robot)
        rates.append(differences(run.q[:, columns]))
    steps = np.abs(np.diff(run.q, axis=0))
    velocity, acceleration, jerk = np.mean(rates, axis=0)
    return Measured(
        position=np.mean(position, axis=0),
        rotation=np.mean(rotation, axis=0),
        velocity=velocity,
        acceleration=acceleration,
        jerk=jerk,
        discontinuity=np.any(steps > _SLACK * PERIOD * arms.velocity, axis=1),
        singular=singular,
        collision=np.array([bool(checked.pairs(one)) for one in q]),
        seconds=run.seconds,
        unanswered=run.unanswered,
    )


def differences(q: Array) -> Array:
    """(3, k) norms of the first three backward differences of configurations (k + 1, n), which stood still before."""
    before = np.concatenate([np.repeat(q[:1], 2, axis=0), q])
    norms = [np.linalg.norm(np.diff(before, order, axis=0), axis=1)[-(len(q) - 1) :] for order in (1, 2, 3)]
    return np.array(norms)


@dataclass(frozen=True, slots=True)
class Paper:
    """A published row: errors in metres and radians, joint rates per update, counts of events, seconds a frame."""

    position: float | None = None
    rotation: float | None = None
    velocity: float | None = None
    acceleration: float | None = None
    jerk: float | None = None
    discontinuities: int | None = 0
    singularities: int | None = 0
    collisions: int | None = 0
    seconds: float | None = None


_MEANS = (
    ("position_error_m", "position"),
    ("rotation_error_rad", "rotation"),
    ("joint_velocity", "velocity"),
    ("joint_acceleration", "acceleration"),
    ("joint_jerk", "jerk"),
)
_EVENTS = (
    ("discontinuities", "discontinuity", "discontinuities"),
    ("singularities", "singular", "singularities"),
    ("self_collisions", "collision", "collisions"),
)


def summary(name: str, runs: Sequence[Measured], paper: Paper | None = None, **extra: Any) -> Row:
    """A row: means and deviations over all frames of all runs, events counted, the published ones beside them."""
    row: Row = {"row": name, "n": len(runs), "frames": int(sum(len(run.position) for run in runs))}
    for column, field in _MEANS:
        values = np.concatenate([getattr(run, field) for run in runs])
        row[column], row[f"{column}_std"] = float(values.mean()), float(values.std())
        row[f"paper_{column}"] = None if paper is None else getattr(paper, field)
    for column, field in _MEANS[:2]:
        later = np.concatenate([getattr(run, field)[SETTLED:] for run in runs])
        row[f"{column}_after_1_s"] = float(later.mean()) if len(later) else None
    for column, field, published in _EVENTS:
        row[column] = int(sum(np.count_nonzero(getattr(run, field)) for run in runs))
        row[f"paper_{column}"] = None if paper is None else getattr(paper, published)
    seconds = np.concatenate([run.seconds for run in runs])
    row["worse_than_paper"] = None if paper is None else _worse(row)
    row["unanswered"] = int(sum(run.unanswered for run in runs))
    row["frame_ms_mean"] = 1e3 * float(seconds.mean())
    row["frame_ms_p99.9"] = 1e3 * float(np.quantile(seconds, 0.999))
    row["paper_frame_ms"] = None if paper is None or paper.seconds is None else 1e3 * paper.seconds
    return {**row, **extra}


def _worse(row: Row) -> str:
    """The measures in which a row is worse than the published one beside it."""
    columns = [column for column, _ in _MEANS] + [column for column, _, _ in _EVENTS]
    pairs = ((column, row[column], row[f"paper_{column}"]) for column in columns)
    return ", ".join(column for column, own, published in pairs if published is not None and own > published)
