"""Poses of the things that move, computed from raw MuJoCo positions for many times at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from workcell.pose import Array, Pose, quat_to_matrix

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True, slots=True)
class Track:
    """An entity carried by a body: `T_world_entity = T_world_body @ T_body_entity`."""

    path: str
    body: int
    T_body_entity: Pose

    def poses(self, positions: Array, quats: Array) -> tuple[Array, Array]:
        """World positions (T, 3) and quaternions wxyz (T, 4), given those of all bodies (T, nbody, 3 or 4)."""
        position, quat = positions[:, self.body], quats[:, self.body]
        offset = self.T_body_entity
        moved = position + quat_to_matrix(quat) @ offset.position
        return moved, compose_quats(quat, offset.quat_wxyz)


def compose_quats(a: Array, b: Array) -> Array:
    """Hamilton products (..., 4) of quaternions wxyz that broadcast."""
    aw, ax, ay, az = np.moveaxis(np.asarray(a, dtype=float), -1, 0)
    bw, bx, by, bz = np.moveaxis(np.asarray(b, dtype=float), -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


class BodyPoses:
    """World poses of all bodies of a model at raw positions."""

    def __init__(self, model: mujoco.MjModel) -> None:
        import mujoco

        self.model, self._data, self._kinematics = model, mujoco.MjData(model), mujoco.mj_kinematics

    @property
    def qpos0(self) -> Array:
        """The model's reference positions (nq,)."""
        return np.array(self.model.qpos0)

    def __call__(self, qpos: Array) -> tuple[Array, Array]:
        """Positions (T, nbody, 3) and quaternions wxyz (T, nbody, 4) at `qpos` (T, nq)."""
        positions = np.empty((len(qpos), self.model.nbody, 3))
        quats = np.empty((len(qpos), self.model.nbody, 4))
        for k, row in enumerate(qpos):
            self._data.qpos[:] = row
            self._kinematics(self.model, self._data)
            positions[k], quats[k] = self._data.xpos, self._data.xquat
        return positions, quats

    def pose(self, body: int, qpos: Array) -> Pose:
        """World pose of one body at `qpos` (nq,)."""
        positions, quats = self(np.asarray(qpos, dtype=float)[None])
        return Pose(positions[0, body], quats[0, body])
