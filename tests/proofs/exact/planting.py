"""Arms of any shape with a target that a known configuration reaches."""

from __future__ import annotations

import math

import numpy as np

from tests.proofs.exact.documents import DOWN, joint, matrix, problem, quaternion

AXES = ([0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0])
QUARTERS = (DOWN, DOWN, [1.0, 1.0, 0.0, 0.0], [1.0, 0.0, 1.0, 0.0])


def planted(folder, rng, n, off=(0.0, 0.0), square=False):
    """A problem and q: the target is off q's tool by a move (metres) and a turn (radians) of that size.

    With `square`, axes are parallel to the frames' and many offsets are zero: lines meet, and are parallel.
    """
    robot = {
        "name": "any",
        "joints": [_joint(rng, square) for _ in range(n)],
        "tool": {"xyz": (0.2 * rng.normal(size=3)).tolist(), "quat": _unit(rng, 4)},
        "spheres": [],
    }
    q = [rng.uniform(j["lower"], j["upper"]) for j in robot["joints"]]
    rotation, place = np.eye(3), np.zeros(3)
    for j, angle in zip(robot["joints"], q, strict=True):
        place = place + rotation @ j["xyz"]
        rotation = rotation @ matrix(j["quat"]) @ _turn(j["axis"], angle)
    xyz = place + rotation @ robot["tool"]["xyz"] + off[0] * np.array(_unit(rng, 3))
    turned = _turn(_unit(rng, 3), off[1]) @ rotation @ matrix(robot["tool"]["quat"])
    return problem(folder, robot, xyz.tolist(), quaternion(turned)), q


def _joint(rng, square):
    limits = np.sort(rng.uniform(-3, 3, 2))
    if square:
        offset = 0.3 * rng.normal(size=3) * (rng.uniform(size=3) < 0.4)
        return joint(offset, AXES[rng.integers(4)], *limits, quat=QUARTERS[rng.integers(4)])
    return joint(0.3 * rng.normal(size=3), _unit(rng, 3), *limits, quat=_unit(rng, 4))


def _unit(rng, size):
    v = rng.normal(size=size)
    return (v / np.linalg.norm(v)).tolist()


def _turn(axis, angle):
    return matrix([math.cos(angle / 2), *(math.sin(angle / 2) * np.array(axis))])
