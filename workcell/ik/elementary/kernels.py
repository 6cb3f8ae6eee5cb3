"""Quick looks at a target before a search: how far beyond reach it can be, and how deep it puts the hand."""

from __future__ import annotations

import math

import numpy as np

from workcell.jit import kernel
from workcell.kernels.cholesky import factor, solve
from workcell.kernels.distance import signed_distance
from workcell.kernels.pose_error import read_target
from workcell.pose import Array

MOST_SLIDE = 3.0
"""Metres along its axis that a point may be moved."""


@kernel
def stretch_chain(
    pose: Array, offset: Array, slope: Array, first: Array, in_tool: Array, travel: float, iterations: int
) -> float:
    """Metres by which a target may be out of reach: too far, or too near for the joint origins.

    Too far for points on the joint axes that are chosen to make `distance - sum of lengths` large. The lengths are
    majorised by quadratics (Weiszfeld), the distance by its tangent, which never lowers it. The gains shrink from step
    to step, all but a few: where twice the last gain in every step to come would prove nothing, the rest is spared.
    pose (7,) is position and quaternion wxyz; for offset (n - 1, 3), slope (3 n - 3, n), first and in_tool (2, 3) see
    `workcell.ik.elementary.bounds`.
    """
    n = slope.shape[1]
    slides, target, last = np.zeros(n), np.empty(12), np.empty((2, 3))
    read_target(pose, target)
    for r in range(3):
        for a in range(2):
            last[a, r] = target[9 + r] if a == 0 else 0.0
            for k in range(3):
                last[a, r] += target[3 * r + k] * in_tool[a, k]
    H, g, between, span = np.empty((n, n)), np.empty(n), np.empty(3), np.empty(3)
    before, beyond, too_near = -1e300, -1e300, -1e300
    for step in range(iterations + 1):
        for k in range(n):
            g[k] = 0.0
            for j in range(n):
                H[k, j] = 1e-9 if k == j else 0.0
        square = 0.0
        for r in range(3):
            between[r] = last[0, r] + slides[n - 1] * last[1, r] - first[0, r] - slides[0] * first[1, r]
            square += between[r] * between[r]
        distance, total, longest = math.sqrt(square), 0.0, 0.0
        for link in range(n - 1):
            square = 0.0
            for r in range(3):
                span[r] = offset[link, r]
                for k in range(link, link + 2):
                    span[r] += slope[3 * link + r, k] * slides[k]
                square += span[r] * span[r]
            length = math.sqrt(square)
            total += length
            longest = max(longest, length)
            # Of each link only the slides at its two ends count.
            for k in range(link, link + 2):
                for r in range(3):
                    g[k] -= slope[3 * link + r, k] * offset[link, r] / max(length, 1e-6)
                    for j in range(link, link + 2):
                        H[k, j] += slope[3 * link + r, k] * slope[3 * link + r, j] / max(length, 1e-6)
        beyond = distance - total - travel
        if step == 0:
            too_near = 2 * longest - total - travel - distance
        if step == iterations or beyond + 2 * (iterations - step) * max(beyond - before, 0.0) <= 0:
            break
        before = beyond
        for r in range(3):
            g[0] -= between[r] / max(distance, 1e-12) * first[1, r]
            g[n - 1] += between[r] / max(distance, 1e-12) * last[1, r]
        if not factor(H):
            break
        solve(H, g)
        for k in range(n):
            slides[k] = min(max(g[k], -MOST_SLIDE), MOST_SLIDE)
    return max(beyond, too_near)


@kernel
def deepest_at(
    pose: Array, in_tool: Array, slack: Array, obstacles: Array, faces: Array, wanted: float
) -> float:
    """Metres by which some sphere falls short of the clearance `wanted` wherever the tool is at pose (7,).

    Args:
        pose: position and quaternion wxyz.
        in_tool: (s, 3) points in the tool's frame.
        slack: (s,) a sphere's radius, less how far its centre strays from its point.
        obstacles: as in `World`.
        faces: as in `World`.
        wanted: metres.
    """
    target, deepest = np.empty(12), -1e300
    read_target(pose, target)
    for i in range(in_tool.shape[0]):
        a, b, c = in_tool[i, 0], in_tool[i, 1], in_tool[i, 2]
        x = target[9] + target[0] * a + target[1] * b + target[2] * c
        y = target[10] + target[3] * a + target[4] * b + target[5] * c
        z = target[11] + target[6] * a + target[7] * b + target[8] * c
        for j in range(obstacles.shape[0]):
            gap = signed_distance(obstacles, faces, j, x, y, z)[0] - slack[i]
            deepest = max(deepest, wanted - gap)
    return deepest
