"""Pose errors and Jacobians of many configurations at once: the arithmetic of the samplers."""

from __future__ import annotations

import functools
import importlib
from typing import Any

import numpy as np

from workcell.geometry.packing import pack_arm
from workcell.model.robot import Robot
from workcell.pose import Array, Pose, rotation_vector


def pose_errors(robot: Robot, q: Array, target: Pose) -> tuple[Array, Array]:
    """(b, 6) metres and radians from the tool to the target in the world at q (b, n), and Jacobians (b, 6, n).

    The robot is serial, its default tool on its last link.
    """
    tool, J = np.empty((len(q), 12)), np.empty((len(q), 6, robot.joint_count))
    _kernels().tool_motions(pack_arm(robot), np.array(robot.joint_values(q)), tool, J)
    if robot.coupling is not None:
        J = robot.coupling.gathered(J, q)
    turns = target.rotation @ np.swapaxes(tool[:, :9].reshape(-1, 3, 3), 1, 2)
    return np.concatenate([target.position - tool[:, 9:], rotation_vector(turns)], axis=1), J


@functools.cache
def _kernels() -> Any:
    """Compiled kernels, imported on first use: numba takes half a second."""
    return importlib.import_module("workcell.kernels.chain")
