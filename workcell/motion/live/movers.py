"""`MovingObstacles`: where what moves by itself is, and how fast, as the kernels take it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from workcell.errors import InputError, UnknownNameError
from workcell.model.scene import Scene
from workcell.model.scene_parts import body_pose
from workcell.motion.live.packing import pack_movers
from workcell.motion.live.surroundings import Mover, Obstacles
from workcell.pose import Array, Pose, axis_angle_to_matrix, rotation_vector


class MovingObstacles:
    """The movers of a scene. Their motion goes on at the velocity last known until they are placed again.

    Args:
        scene: the scene; they begin where it has them, at rest.
        obstacles: what moves.

    Attributes:
        packed: for the kernels.
    """

    def __init__(self, scene: Scene, obstacles: Obstacles) -> None:
        pieces = [piece for part in obstacles.moving.values() for piece in part]
        self.packed = pack_movers(pieces)
        self._movers: dict[str, Mover] = {}
        first, qpos = 0, scene.initial_qpos()
        for name, part in obstacles.moving.items():
            rows = slice(first, first + len(part))
            first += len(part)
            pose = body_pose(scene.model, obstacles.bodies[name], qpos)
            R, p = pose.rotation, pose.position
            local = np.empty((len(part), 12))
            for k, row in enumerate(self.packed.rows[rows]):
                local[k, :9] = (R.T @ row[4:13].reshape(3, 3)).ravel()
                local[k, 9:] = R.T @ (row[1:4] - p)
            self._movers[name] = Mover(rows, local, pose)
            self.packed.moves[rows, 6:] = p

    @property
    def names(self) -> tuple[str, ...]:
        """Who moves."""
        return tuple(self._movers)

    def place(
        self, name: str, pose: Pose, velocity: ArrayLike | None, angular: ArrayLike | None, period: float
    ) -> None:
        """See `LiveIK.place`."""
        if name not in self._movers:
            raise UnknownNameError("moving obstacle", name, list(self._movers))
        mover = self._movers[name]
        v, w = _vector(velocity, "velocity"), _vector(angular, "angular_velocity")
        before = mover.told or pose
        if v is None:
            v = (pose.position - before.position) / period
        if w is None:
            w = rotation_vector(pose.rotation @ before.rotation.T) / period
        mover.told, mover.ahead = pose, 0.0
        self.packed.moves[mover.rows, :3], self.packed.moves[mover.rows, 3:6] = v, w
        self._put(mover, pose)

    def _put(self, mover: Mover, pose: Pose) -> None:
        mover.pose = pose
        self.packed.moves[mover.rows, 6:] = pose.position
        for k, row in enumerate(self.packed.rows[mover.rows]):
            row[4:13] = (pose.rotation @ mover.local[k, :9].reshape(3, 3)).ravel()
            row[1:4] = pose.rotation @ mover.local[k, 9:] + pose.position

    def advance(self, period: float) -> None:
        """A tick goes by: what is not placed again moves on as it was said to move (see `catch_up`)."""
        for mover in self._movers.values():
            mover.ahead += period

    def catch_up(self) -> None:
        """Bring what was not placed again to where it has moved."""
        for mover in self._movers.values():
            period, mover.ahead = mover.ahead, 0.0
            if period == 0.0 or mover.rows.start == mover.rows.stop:
                continue
            v, w = self.packed.moves[mover.rows.start, :3], self.packed.moves[mover.rows.start, 3:6]
            if not (v.any() or w.any()):
                continue
            angle = float(np.linalg.norm(w))
            turn = axis_angle_to_matrix(w / angle, angle * period) if angle > 0 else np.eye(3)
            self._put(mover, Pose.from_rotation(mover.pose.position + period * v, turn @ mover.pose.rotation))


def _vector(values: ArrayLike | None, where: str) -> Array | None:
    if values is None:
        return None
    try:
        vector = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        vector = np.zeros(0)
    if vector.shape != (3,) or not np.all(np.isfinite(vector)):
        raise InputError("a velocity is not three finite numbers", where=where, remedy="(3,) in the world")
    return vector
