"""Configurations along self-motions, a fixed distance apart: steps that keep the tool in place, and what is new."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from workcell.model.robot import Robot
from workcell.motion.tool_paths.poses import PathTolerance
from workcell.pose import Array, Pose

APART = 0.08
"""Radians, of the joint that moves most, between neighbours along a self-motion."""
SAME = 0.5
"""Share of it within which two nodes are one."""
SINGULAR = 1e-6
"""Singular values of the tool's motion that count as zero."""

Rows = NDArray[np.int64]


def sideways(robot: Robot, tolerance: PathTolerance, pose: Pose, q: Array) -> list[Array]:
    """Steps (k, n), to either side, in each direction that keeps the tool's coordinates without tolerance."""
    if not len(q):
        return []
    J = robot.jacobian(q)
    if tolerance.frame == "tool":
        J = np.concatenate([pose.rotation.T @ J[:, :3], pose.rotation.T @ J[:, 3:]], axis=1)
    _, sizes, along = np.linalg.svd(J[:, tolerance.box == 0.0], full_matrices=True)
    rank = int((sizes > SINGULAR).sum(axis=1).max(initial=0))
    steps = []
    for k in range(rank, robot.dof):
        step = APART * along[:, k] / np.abs(along[:, k]).max(axis=1, keepdims=True)
        steps += [step, -step]
    return steps


def differences(a: Array, b: Array) -> Array:
    """(k, m) radians of the joint that differs most between rows of a (k, n) and b (m, n)."""
    apart = np.zeros((len(a), len(b)))
    for k in range(a.shape[1]):
        np.maximum(apart, np.abs(a[:, k, None] - b[None, :, k]), out=apart)
    return apart


def distinct(q: Array, known: Array) -> Rows:
    """Rows of q (k, n) that are no known (m, n) one again, and no earlier row of q."""
    near = SAME * APART
    fresh = np.flatnonzero(~(differences(q, known) < near).any(axis=1)) if len(known) else np.arange(len(q))
    again = np.tril(differences(q[fresh], q[fresh]) < near, -1)
    kept: list[int] = []
    taken = np.zeros(len(fresh), dtype=bool)
    for k in range(len(fresh)):
        if not (again[k] & taken).any():
            taken[k] = True
            kept.append(int(fresh[k]))
    return np.array(kept, dtype=np.int64)
