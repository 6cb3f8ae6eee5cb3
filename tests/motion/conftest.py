"""Robots of known geometry, and a collision truth that is exact: spheres against one sphere."""

import numpy as np
import pytest

from workcell.geometry.types import SphereCover
from workcell.ik.problem import Clearance
from workcell.model.serial import serial_robot
from workcell.pose import Pose


def make_arm(axes, lengths, limit=3.0):
    joints = [
        {
            "name": f"j{k}",
            "xyz": [0.0, 0.0, 0.0] if k == 0 else [lengths[k - 1], 0.0, 0.0],
            "quat": [1.0, 0.0, 0.0, 0.0],
            "axis": axis,
            "lower": -limit,
            "upper": limit,
        }
        for k, axis in enumerate(axes)
    ]
    return serial_robot("arm", joints, Pose.from_xyz([lengths[-1], 0.0, 0.0]))


@pytest.fixture(scope="session")
def planar():
    """Three links of 0.4 m in the plane z = 0."""
    return make_arm([[0, 0, 1]] * 3, [0.4, 0.4, 0.4])


@pytest.fixture(scope="session")
def arm7():
    """Seven joints with alternating axes, about as long as a Sawyer."""
    x, y, z = [1, 0, 0], [0, 1, 0], [0, 0, 1]
    return make_arm([z, y, x, y, x, y, x], [0.1, 0.25, 0.15, 0.25, 0.15, 0.1, 0.15])


@pytest.fixture(scope="session")
def planar_cover():
    """Four spheres along each link of the planar arm."""
    x = np.tile([0.05, 0.15, 0.25, 0.35], 3)
    centres = np.stack([x, np.zeros(12), np.zeros(12)], axis=1)
    return SphereCover(np.repeat([1, 2, 3], 4), centres, np.full(12, 0.06))


class SphereTruth:
    """Clearance of a cover to one sphere; counts how often it is asked."""

    def __init__(self, robot, cover, centre, radius):
        self.robot, self.cover = robot, cover
        self.centre, self.radius, self.calls = np.asarray(centre, float), radius, 0

    def __call__(self, q):
        self.calls += 1
        return Clearance(float(self.distances(q)), ("arm", "ball"))

    def distances(self, q):
        """Clearances (...) of configurations (..., n)."""
        centres = self.cover.centres_world(self.robot.link_transforms(q))
        gaps = np.linalg.norm(centres - self.centre, axis=-1) - self.cover.radius - self.radius
        return gaps.min(axis=-1)


@pytest.fixture(scope="session")
def ball(planar, planar_cover):
    """Makes a truth for a ball at a place."""
    return lambda centre, radius: SphereTruth(planar, planar_cover, centre, radius)
