"""The frames of a mechanism that a run watches: where they are, and how far from where they should be."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from workcell.model.scene_mechanism import SceneMechanism
from workcell.pose import Array, Pose
from workcell.simulate.log_rows import Worst

if TYPE_CHECKING:
    import mujoco


class WatchedFrames:
    """The frames that a task names; where it names none, all bodies of the mechanism, of which errors are told.

    Args:
        moving: the mechanism in its scene.

    Attributes:
        words: what is watched, to begin a sentence.
    """

    def __init__(self, moving: SceneMechanism) -> None:
        self._moving = moving
        self._named = bool(moving.frames)
        bodies = [self.on_body(name) for name in moving.frames]
        bodies = bodies or [(body, Pose.identity()) for body in sorted(moving.body_ids)]
        self._bodies = np.array([body for body, _ in bodies])
        self._local = np.array([offset.position for _, offset in bodies])
        self.words = "a frame is" if self._named else "a body is"

    def on_body(self, name: str) -> tuple[int, Pose]:
        """A body (id) that carries a frame, and where on it; raises UnknownNameError."""
        compiled = self._moving.compiled
        frame = self._moving.mechanism.frame(name)
        body = int(np.flatnonzero(compiled.link_of_body == frame.link)[0])
        return body, compiled.T_link_body[body].inverse() @ frame.T_link_frame

    def pose(self, data: mujoco.MjData, name: str) -> Pose:
        """World pose of a frame where `data` is; raises UnknownNameError."""
        body, offset = self.on_body(name)
        return Pose(data.xpos[body], data.xquat[body]) @ offset

    def positions(self, data: mujoco.MjData) -> Array:
        """(k, 3) of the frames that are named; (0, 3) where none is."""
        return self._at(data)[0] if self._named else np.zeros((0, 3))

    def _at(self, data: mujoco.MjData) -> tuple[Array, Array]:
        R = data.xmat[self._bodies].reshape(-1, 3, 3)
        return data.xpos[self._bodies] + np.einsum("kij,kj->ki", R, self._local), R

    def compare(self, data: mujoco.MjData, wanted: mujoco.MjData, worst: Worst) -> None:
        """Take the errors of one control step into account."""
        (here, R), (there, S) = self._at(data), self._at(wanted)
        away = float(np.linalg.norm(here - there, axis=1).max())
        # The Frobenius distance of two rotations is 2 sqrt(2) sin(angle / 2).
        chord = float(np.linalg.norm(R - S, axis=(1, 2)).max()) / np.sqrt(8.0)
        worst.error_m = max(worst.error_m, away)
        worst.error_rad = max(worst.error_rad, 2.0 * float(np.arcsin(min(chord, 1.0))))
