"""`LiveGoal`: where a tool should be in this frame, and which coordinates may lie in a band."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from workcell.errors import InputError
from workcell.pose import Array, Pose, read_only

_POINT = ((0.0, 0.0),) * 3


@dataclass(frozen=True, slots=True)
class LiveGoal:
    """Where a tool should be in this frame.

    A band lets a coordinate lie anywhere between two offsets from the pose (as RangedIK's ranges do): nothing inside it
    counts as an error. Infinite ends leave the coordinate free.

    Attributes:
        pose: `T_world_tool`.
        position_band: (3, 2) lowest and highest offset of the tool along the pose's axes, metres.
        rotation_band: (3, 2) lowest and highest component of the tool's rotation vector from the pose, along the pose's
            axes, radians.
        weight: of this tool beside the others' goals; 0 leaves the tool without a goal.

    Raises:
        InputError: bands of another shape, not in order or not numbers; a negative or infinite weight.
    """

    pose: Pose
    position_band: Array = field(default_factory=lambda: np.array(_POINT))
    rotation_band: Array = field(default_factory=lambda: np.array(_POINT))
    weight: float = 1.0

    def __post_init__(self) -> None:
        for name in ("position_band", "rotation_band"):
            object.__setattr__(self, name, _band(getattr(self, name), name))
        if not (0.0 <= self.weight < np.inf):
            raise InputError(f"a goal's weight of {self.weight}", where="weight", remedy="0 or more, finite")

    @staticmethod
    def position_only(pose: Pose, weight: float = 1.0) -> LiveGoal:
        """The tool at the pose's position, turned anyhow."""
        return LiveGoal(pose, rotation_band=np.tile([-np.inf, np.inf], (3, 1)), weight=weight)

    @staticmethod
    def about_axis(pose: Pose, axis: int = 2, weight: float = 1.0) -> LiveGoal:
        """The tool at the pose, turned anyhow about one of the pose's axes (0, 1 or 2)."""
        if axis not in (0, 1, 2):
            raise InputError(f"no axis {axis}", where="axis", remedy="0, 1 or 2")
        band = np.zeros((3, 2))
        band[axis] = -np.inf, np.inf
        return LiveGoal(pose, rotation_band=band, weight=weight)


def _band(values: ArrayLike, where: str) -> Array:
    try:
        band = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        band = np.zeros(0)
    if band.shape != (3, 2) or not np.all(band[:, 0] <= band[:, 1]):
        raise InputError(
            "a band is not (3, 2) numbers in order", where=where, remedy="[lowest, highest] of each axis"
        )
    checked: Array = read_only(band)
    return checked
