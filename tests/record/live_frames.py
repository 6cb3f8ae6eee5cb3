"""A recording of a tool that followed goals live, made without a simulation: one joint turns, a box stands."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from tests.record.conftest import RESULT
from workcell.motion.live.limits import LiveLimits
from workcell.record.write.recording import Recording
from workcell.simulate.execution import Event, Execution
from workcell.simulate.frames import LiveFacts, LiveFrames

PERIOD = 0.02
LIMITS = LiveLimits.of([1.0], [4.0], [100.0])
RANGES = np.array([-2.0]), np.array([2.0])


def smooth(count: int = 101) -> np.ndarray:
    """(count,) a joint that turns by half a radian and comes to rest, well within `LIMITS`."""
    u = np.linspace(0.0, 1.0, count)
    return 0.5 * (10 * u**3 - 15 * u**4 + 6 * u**5)


def frames(turn: np.ndarray, begin: float = 0.0, limits: LiveLimits = LIMITS) -> LiveFrames:
    """Frames of an order in which the joint is at `turn` (F,)."""
    count, facts = len(turn), LiveFacts(("arm",), (1,), PERIOD, limits, ("turn",), *RANGES)
    goal = np.tile([0.5, 0.1, 0.5, 1.0, 0, 0, 0], (count, 1, 1))
    goal[:, 0, 1] += np.linspace(0.0, 0.2, count)
    goal[0] = np.nan
    status = ("", *("MOVING" if k < count - 10 else "ON_GOAL" for k in range(1, count)))
    error = np.linspace(0.01, 0.0, count)[:, None]
    return LiveFrames(
        facts=facts,
        time=begin + PERIOD * np.arange(count),
        q=turn[:, None],
        goal=goal,
        status=status,
        position_error=error,
        rotation_error=2 * error,
        terms=np.tile(np.arange(7.0), (count, 1)),
        clearance=np.full(count, np.inf),
        conditioning=np.full((count, 1), 0.3),
        seconds=np.full(count, 1e-4),
        braked=np.zeros(count, dtype=bool),
        timed_out=np.zeros(count, dtype=bool),
    )


def together(turns: np.ndarray, begin: float = 0.0) -> LiveFrames:
    """Frames of `arm` and of `other`, a joint each, at turns (F, 2)."""
    one, limits = frames(turns[:, 0], begin), LiveLimits.of([1.0] * 2, [4.0] * 2, [100.0] * 2)
    facts = LiveFacts(
        ("arm", "other"), (1, 1), PERIOD, limits, ("turn", "swing"), *(np.tile(end, 2) for end in RANGES)
    )
    doubled = {
        name: np.concatenate([getattr(one, name)] * 2, axis=1)
        for name in ("goal", "position_error", "rotation_error", "conditioning")
    }
    return replace(one, facts=facts, q=turns, **doubled)


def record_live(
    path: Path,
    model: mujoco.MjModel,
    parts: list[LiveFrames],
    *,
    clearance: float = 0.05,
    executed: np.ndarray | None = None,
    result: dict[str, Any] | None = None,
) -> Path:
    """A finished recording: joints as commanded, or as `executed` (F,) of the first part says."""
    with Recording(path, task="toy", seed=3) as recording:
        fill(recording, model, parts, clearance=clearance, executed=executed, result=result)
    return path


def fill(
    recording: Recording,
    model: mujoco.MjModel,
    parts: list[LiveFrames],
    *,
    clearance: float = 0.05,
    executed: np.ndarray | None = None,
    result: dict[str, Any] | None = None,
) -> None:
    """What `record_live` writes."""
    recording.log_model(model, {1: "robots/arm", 2: "objects/box"}, model.qpos0)
    for part in parts:
        turn = part.q[:, 0] if executed is None else executed
        done = _execution(model, part, turn, clearance)
        recording.log_execution(done)
        recording.log_states(done.time, done.qpos, {"joint_positions/arm": turn})
    recording.set_result(RESULT if result is None else result)


def _execution(model: mujoco.MjModel, part: LiveFrames, turn: np.ndarray, clearance: float) -> Execution:
    count = len(part)
    qpos = np.tile(model.qpos0, (count, 1))
    qpos[:, 0] = turn
    return Execution(
        time=part.time,
        qpos=qpos,
        q=turn[:, None],
        q_reference=part.q[:, :1],
        torque=np.zeros((count, 1)),
        tool_position=np.zeros((count, 3)),
        tracking_error_m=np.zeros(count),
        tracking_error_rad=np.zeros(count),
        clearance=np.full(count, clearance),
        clearance_pair=(("arm", "box"),) * count,
        clearance_points=np.full((count, 2, 3), np.nan),
        internal_force=np.zeros(count),
        events=(Event(part.time[0], "INFO", "guard on: obstacle: hand and box (0.01)"),),
        live=(part,),
    )
