"""A small model and a recording of it: a turning arm, a free box, a floor."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from tests.record.sight import Mask, geoms_seen, inside
from workcell.record.render.raster import Camera
from workcell.record.write.recording import Recording

TOY = """
<mujoco>
  <asset>
    <mesh name="wedge" vertex="0 0 0  0.2 0 0  0 0.2 0  0 0 0.2"/>
  </asset>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 0.1" rgba="0.5 0.5 0.6 1"/>
    <body name="arm" pos="0 0 0.5">
      <joint name="turn" axis="0 0 1"/>
      <geom name="upper" type="capsule" fromto="0 0 0 0.4 0 0" size="0.05" rgba="0.8 0.1 0.1 1"/>
      <geom name="hull" type="box" pos="0.2 0 0" size="0.26 0.06 0.06" group="3"/>
    </body>
    <body name="box" pos="0.5 0.3 0.1">
      <freejoint/>
      <geom name="box" type="box" size="0.1 0.05 0.1" rgba="0.1 0.2 0.8 1"/>
      <geom name="wedge" type="mesh" mesh="wedge" pos="0 0 0.1"/>
    </body>
  </worldbody>
</mujoco>
"""

RESULT = {"task": "toy", "achieved": True, "status": "ACHIEVED", "seed": 3}


@pytest.fixture
def toy() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(TOY)


def toy_motion(
    model: mujoco.MjModel, count: int = 101, seconds: float = 2.0
) -> tuple[np.ndarray, np.ndarray]:
    """The arm turns by 1 rad; the box rises by 0.2 m and turns by 1 rad about a skew axis."""
    times = np.linspace(0.0, seconds, count)
    qpos = np.tile(model.qpos0, (count, 1))
    qpos[:, 0] = times / seconds
    qpos[:, 3] += 0.2 * times / seconds
    angle, axis = times / seconds, np.array([1.0, 2.0, -2.0]) / 3.0
    qpos[:, 4], qpos[:, 5:8] = np.cos(angle / 2), np.sin(angle / 2)[:, None] * axis
    return times, qpos


def record_toy(
    path: Path, model: mujoco.MjModel, result: dict[str, Any] | None = None, **metrics: np.ndarray
) -> Path:
    """A finished recording of `toy_motion` at `path`."""
    times, qpos = toy_motion(model)
    values = {"clearance": 0.05 + 0.04 * np.cos(times), "tracking_error": 1e-4 * times} | metrics
    with Recording(path, task="toy", seed=3) as recording:
        recording.log_model(model, {1: "robots/arm", 2: "objects/box"}, model.qpos0)
        recording.event(0.0, "start")
        recording.log_states(times, qpos, values)
        recording.event(1.0, "the box is held")
        recording.set_result(RESULT if result is None else result)
    return path


@pytest.fixture
def toy_file(tmp_path: Path, toy: mujoco.MjModel) -> Path:
    return record_toy(tmp_path / "toy.rrd", toy)


def toy_seen(toy: mujoco.MjModel, camera: Camera, time: float, edge: int = 2) -> dict[str, Mask]:
    """For each geom in sight, and the `sky`, the pixels (h, w) that look at it, `edge` pixels inside its edges."""
    data = mujoco.MjData(toy)
    times, motion = toy_motion(toy)
    data.qpos[:] = motion[int(np.argmin(np.abs(times - time)))]
    mujoco.mj_forward(toy, data)
    seen, _ = geoms_seen(toy, data, camera)
    names = {-1: "sky"} | {geom: toy.geom(geom).name for geom in range(toy.ngeom)}
    inner = {name: inside(seen == geom, edge) for geom, name in names.items()}
    return {name: pixels for name, pixels in inner.items() if pixels.any()}
