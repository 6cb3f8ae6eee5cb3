"""Reviews of tools that followed goals: what is counted follows from the file alone, and fails the verdict."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from tests.record.conftest import RESULT
from tests.record.live_frames import LIMITS, PERIOD, fill, frames, record_live, smooth, together
from tests.record.read.test_review import text_of
from workcell.motion.live.limits import LiveLimits
from workcell.record.read.review import review
from workcell.record.write.recording import Recording


def test_what_kept_its_limits_is_clean_and_counted(tmp_path: Path, toy: mujoco.MjModel) -> None:
    claims = {**RESULT, "live_frames": 100}
    found = review(record_live(tmp_path / "live.rrd", toy, [frames(smooth())], result=claims))
    assert found.achieved, found.reason
    assert found.live is not None and found.live.clean
    (arm,) = found.live.robots
    assert (arm.robot, arm.frames, arm.jumps) == ("arm", 100, 0)
    assert dict(arm.beyond) == {"velocity": 0, "acceleration": 0, "jerk": 0, "range": 0}
    assert arm.largest["velocity"] == pytest.approx(0.5 * 15 / 8 / 2.0, rel=1e-2)
    assert arm.position_mean == pytest.approx(0.005, rel=0.02) and arm.rotation_max == pytest.approx(
        0.0198, rel=1e-3
    )
    assert dict(arm.statuses) == {"MOVING": 90, "ON_GOAL": 10}
    document = json.loads(json.dumps(found.to_json()))["live"]
    assert document["robots"][0]["frames"] == 100 and document["in_contact"] == 0
    text = text_of(found)
    assert "arm: 100 frames (MOVING 90, ON_GOAL 10), 0 jumps" in text


def test_goals_move_in_the_pictures(tmp_path: Path, toy: mujoco.MjModel) -> None:
    found = review(record_live(tmp_path / "live.rrd", toy, [frames(smooth())]))
    target = found.stage.targets["arm"]
    assert target.at(1.0).position == pytest.approx([0.5, 0.2, 0.5], abs=1e-6)
    assert not found.stage.goals and len(found.stage.lines(1.0)) == len(found.stage.lines(-1.0)) + 4


def shaken(count: int = 101) -> np.ndarray:
    turn = smooth(count)
    turn[50] += 0.0005
    return turn


@pytest.mark.parametrize(
    ("turn", "counted"),
    [
        (smooth() + 0.1 * (np.arange(101) >= 50), {"jumps": 1, "velocity": 1, "acceleration": 2}),
        (np.linspace(0.0, 1.0, 101), {"acceleration": 1, "velocity": 0, "jumps": 0}),
        (shaken(), {"jerk": 2, "velocity": 0}),
    ],
)
def test_what_exceeds_a_limit_fails(
    tmp_path: Path, toy: mujoco.MjModel, turn: np.ndarray, counted: dict[str, int]
) -> None:
    limits = LiveLimits.of([1.0], [4.0], [100.0])
    found = review(record_live(tmp_path / "live.rrd", toy, [frames(turn, limits=limits)]))
    assert found.live is not None and found.verdict == "not achieved" and "arm: 100 frames" in found.reason
    (arm,) = found.live.robots
    assert {key: {"jumps": arm.jumps, **arm.beyond}[key] for key in counted} == counted


def test_an_executed_jump_is_one_though_the_frames_know_nothing(tmp_path: Path, toy: mujoco.MjModel) -> None:
    jumped = smooth() + 0.1 * (np.arange(101) >= 50)
    found = review(record_live(tmp_path / "live.rrd", toy, [frames(smooth())], executed=jumped))
    assert found.live is not None and not found.achieved
    (arm,) = found.live.robots
    assert arm.jumps == 1 and arm.astray == 51 and arm.beyond["velocity"] == 0


def test_frames_that_were_not_executed_are_found_out(tmp_path: Path, toy: mujoco.MjModel) -> None:
    """A run that moved otherwise, however smoothly, than the frames say."""
    found = review(record_live(tmp_path / "live.rrd", toy, [frames(smooth())], executed=0.9 * smooth()))
    assert not found.achieved and "are not where the frames lead" in found.reason


def test_rows_in_contact_fail(tmp_path: Path, toy: mujoco.MjModel) -> None:
    found = review(record_live(tmp_path / "live.rrd", toy, [frames(smooth())], clearance=-1e-3))
    assert found.live is not None and found.live.in_contact == 101 and not found.achieved


def test_orders_apart_begin_at_rest_each_within_its_limits(tmp_path: Path, toy: mujoco.MjModel) -> None:
    first = frames(smooth())
    second = frames(first.q[-1, 0] + smooth(), begin=first.time[-1] + 1.0)
    tight = frames(
        first.q[-1, 0] + smooth(), begin=first.time[-1] + PERIOD, limits=LiveLimits.of([0.3], [4.0])
    )
    found = review(record_live(tmp_path / "live.rrd", toy, [first, second]))
    assert found.achieved and found.live is not None and found.live.robots[0].frames == 200
    found = review(record_live(tmp_path / "tight.rrd", toy, [first, tight]))
    assert found.live is not None and found.live.robots[0].beyond["velocity"] > 10
    assert found.live.robots[0].largest["velocity"] > 1.4


def test_limits_without_an_end_are_never_exceeded(tmp_path: Path, toy: mujoco.MjModel) -> None:
    limits = LiveLimits(LIMITS.velocity, np.array([np.inf]), np.array([np.inf]))
    found = review(record_live(tmp_path / "live.rrd", toy, [frames(shaken(), limits=limits)]))
    assert found.live is not None and found.live.robots[0].clean


def test_claimed_frames_must_be_there(tmp_path: Path, toy: mujoco.MjModel, toy_file: Path) -> None:
    claims = {**RESULT, "live_frames": 7}
    path = record_live(tmp_path / "live.rrd", toy, [frames(smooth())], result=claims)
    assert "claims 7 frames, the recording has 100" in review(path).reason
    path = record_live(tmp_path / "none.rrd", toy, [], result=claims)
    assert not review(path).achieved
    claims = {**RESULT, "goal_error_mean_m": 0.004}
    path = record_live(tmp_path / "errors.rrd", toy, [frames(smooth())], result=claims)
    assert "claims 4.000 mm off on average" in review(path).reason
    assert review(toy_file).live is None


class Forged(Recording):
    """A recording whose writer leaves out, or changes, what goes to an entity: its seals vouch for the forgery."""

    def __init__(self, path: Path, forge: Forge) -> None:
        super().__init__(path, task="toy", seed=3)
        for method in ("send_scalars", "send_documents"):
            setattr(self._writer, method, forging(getattr(self._writer, method), forge))


Forge = Callable[[str, Any, Any], tuple[Any, Any] | None]


def forging(send: Callable[..., None], forge: Forge) -> Callable[..., None]:
    def forged(path: str, indexes: Any, values: Any) -> None:
        changed = forge(path, indexes, values)
        if changed is not None:
            send(path, *changed)

    return forged


def without(entity: str, rows: slice = slice(None)) -> Forge:
    """Rows of an entity are left out."""

    def forge(path: str, indexes: Any, values: Any) -> tuple[Any, Any] | None:
        if path != entity:
            return indexes, values
        kept = np.ones(len(values), dtype=bool)
        kept[rows] = False
        return (tuple(one[kept] for one in indexes), values[kept]) if kept.any() else None

    return forge


def changed(entity: str, change: Callable[[Any], Any]) -> Forge:
    """What goes to an entity is another."""
    return lambda path, indexes, values: (indexes, change(values) if path == entity else values)


def uneven(values: np.ndarray) -> np.ndarray:
    """Three columns where one is meant: more numbers than anybody looks at."""
    return np.column_stack([values, -np.ones((len(values), 2))])


def limits_with(**entries: Any) -> Forge:
    return changed("live/arm/limits", lambda texts: [json.dumps({**json.loads(texts[0]), **entries})])


def with_nan(values: np.ndarray) -> np.ndarray:
    copy = np.array(values, dtype=float)
    copy[40] = np.nan
    return copy


@pytest.mark.parametrize(
    ("forge", "reason"),
    [
        (without("live/arm/joints"), "its frames are missing"),
        (without("live/arm/joints", slice(40, 60)), "frames are missing, or there twice, at 0.78"),
        (changed("live/arm/joints", with_nan), "frames that are no numbers"),
        (changed("live/arm/joints", lambda values: np.hstack([values, values])), "its limits make no sense"),
        (without("live/arm/limits"), "does not say within what limits"),
        (changed("live/arm/limits", lambda texts: ["{"]), "its limits can't be read"),
        (changed("live/arm/limits", lambda texts: ["[1]"]), "its limits can't be read"),
        (limits_with(velocity=[None]), "its limits make no sense"),
        (limits_with(jerk=[-1.0]), "its limits make no sense"),
        (limits_with(velocity=[1.0, 1.0]), "its limits can't be read"),
        (limits_with(period=0.2), "frames are missing, or there twice"),
        (limits_with(period="fast"), "its limits can't be read"),
        (limits_with(upper=[0.4]), "beyond range"),
        (limits_with(upper=None), "its limits can't be read"),
        (without("live/arm/status"), "not one status"),
        (without("live/arm/status", slice(0, 5)), "not one status for each frame"),
        (changed("live/arm/status", with_nan), "not one status"),
        (without("metrics/clearance"), "the clearance is not told all the time"),
        (without("metrics/clearance", slice(40, 60)), "the clearance is not told all the time"),
        (changed("metrics/clearance", with_nan), "1 rows in contact"),
        (changed("metrics/clearance", uneven), "101 rows in contact"),
        (changed("live/arm/status", uneven), "not one status for each frame"),
        (changed("metrics/live/position_error/arm", uneven), "errors are not told in every frame"),
        (without("metrics/joint_positions/arm"), "what it did is not recorded"),
        (without("metrics/joint_positions/arm", slice(40, 60)), "what it did is not told all the time"),
        (changed("metrics/joint_positions/arm", with_nan), "jumps"),
        (without("metrics/live/position_error/arm", slice(0, 1)), "errors are not told in every frame"),
    ],
)
def test_forged_and_broken_recordings_fail(
    tmp_path: Path, toy: mujoco.MjModel, forge: Forge, reason: str
) -> None:
    part = frames(smooth())
    with Forged(tmp_path / "forged.rrd", forge) as recording:
        fill(recording, toy, [part])
    found = review(tmp_path / "forged.rrd")
    assert found.verdict == "not achieved" and reason in found.reason
    json.dumps(found.to_json(), allow_nan=False)


def test_a_jump_does_not_hide_behind_another_order(tmp_path: Path, toy: mujoco.MjModel) -> None:
    first = frames(smooth(51))
    at_once = frames(0.9 + smooth(51), begin=first.time[-1])
    found = review(record_live(tmp_path / "at_once.rrd", toy, [first, at_once]))
    assert found.live is not None and found.live.robots[0].jumps == 1 and not found.achieved
    later = frames(0.9 + smooth(51), begin=first.time[-1] + 0.1)
    found = review(record_live(tmp_path / "later.rrd", toy, [first, later]))
    assert found.live is not None and found.live.robots[0].jumps == 1 and not found.achieved


def test_rows_of_different_lengths_are_found_out(tmp_path: Path, toy: mujoco.MjModel) -> None:
    """What is longer in one part of the file than in another is neither cut nor shifted, and ends in no traceback."""
    for entity in ("metrics/clearance", "live/arm/joints", "live/arm/status", "metrics/joint_positions/arm"):
        seen: list[int] = []

        def forge(
            path: str, indexes: Any, values: Any, entity: str = entity, seen: list[int] = seen
        ) -> tuple[Any, Any]:
            if path != entity:
                return indexes, values
            seen.append(len(values))
            return indexes, uneven(values.reshape(len(values), -1)) if len(seen) == 2 else values

        first = frames(smooth())
        with Forged(tmp_path / "forged.rrd", forge) as recording:
            fill(recording, toy, [first, frames(first.q[-1, 0] + smooth(), begin=first.time[-1] + 1.0)])
        assert len(seen) == 2 and not review(tmp_path / "forged.rrd").achieved, entity


def test_two_robots_are_counted_each_by_itself(tmp_path: Path, toy: mujoco.MjModel) -> None:
    """One follows alone, then both: frames and statuses are each robot's, and so is a jump."""
    alone = frames(smooth())
    turns = np.column_stack([alone.q[-1, 0] + smooth(), -smooth() - 0.1 * (np.arange(101) >= 50)])
    both = together(turns, begin=alone.time[-1] + 0.5)
    with Recording(tmp_path / "two.rrd", task="toy") as recording:
        fill(recording, toy, [alone, both])
        recording.log_states(both.time, np.tile(toy.qpos0, (101, 1)), {"joint_positions/other": turns[:, 1]})
        recording.set_result({**RESULT, "live_frames": 200})
    found = review(tmp_path / "two.rrd")
    assert found.live is not None and not found.achieved
    arm, other = found.live.robots
    assert (arm.robot, arm.frames, arm.jumps) == ("arm", 200, 0) and arm.clean
    assert (other.robot, other.frames, other.jumps) == ("other", 100, 1) and not other.clean
    assert sum(arm.statuses.values()) == 200 and sum(other.statuses.values()) == 100
    assert "1 beyond velocity" in found.reason
