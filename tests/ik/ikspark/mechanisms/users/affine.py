"""A small mechanism and a model of it that is affine in numbers chosen by hand."""

from __future__ import annotations

import numpy as np

from workcell.model.mechanism.mechanism import Frame, Joint, Mechanism
from workcell.pose import Pose

SLED = Mechanism(
    "sled",
    (
        Joint("floats", "free", 0, Pose.identity(), np.zeros(3)),
        Joint("slides", "slide", 1, Pose.identity(), np.array([0.0, 0.0, 1.0]), 0.0, 1.0),
    ),
    ("world", "base", "sled"),
    frames={
        "tip": Frame("tip", 2, Pose(np.array([0.1, 0.0, 0.2]), np.array([0.5, 0.5, 0.5, 0.5]))),
        "floor": Frame("floor", 0, Pose.identity()),
    },
)
"""A floating body on which another slides along z."""


class ByHand:
    """x is a rotation row by row (9), the sled's origin (3), the slide's value, and one that nothing depends on."""

    mechanism = SLED
    size = 14

    def rotation_rows(self, link: int) -> np.ndarray:
        rows = np.zeros((9, 15))
        if link == 0:
            rows[:, -1] = np.eye(3).ravel()
        else:
            rows[:, :9] = np.eye(9)
        return rows

    def origin_rows(self, link: int) -> np.ndarray:
        rows = np.zeros((3, 15))
        if link == 2:
            rows[:, 9:12] = np.eye(3)
        return rows

    def slide_row(self, joint: int) -> np.ndarray:
        assert joint == 1
        return np.eye(15)[12]

    @staticmethod
    def lifted(rotation: np.ndarray, origin: np.ndarray, value: float) -> np.ndarray:
        return np.concatenate([rotation.ravel(), origin, [value, 0.0]])
