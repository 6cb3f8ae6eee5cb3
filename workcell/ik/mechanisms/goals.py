"""What frames of a mechanism are asked for: poses, parts of poses, cones, convex regions, contacts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workcell.errors import InputError
from workcell.pose import UNIT_TOLERANCE, Array, Pose, read_only

Vector = Sequence[float] | Array


@dataclass(frozen=True, slots=True)
class FrameGoal:
    """Where one frame is to be: use `posed`, `at`, `turned` or `pointing`. What is None is left free.

    Attributes:
        frame: its name, see `Mechanism.frames`.
        position: (3,) metres in the world, of the frame's origin.
        rotation: (3, 3) of the frame in the world.
        axis: (3,) unit vector in the frame that is to point along `direction`.
        direction: (3,) unit vector in the world.
        within: radians that the axis may point away from the direction, from 0 to less than a half turn.
    """

    frame: str
    position: Array | None = None
    rotation: Array | None = None
    axis: Array | None = None
    direction: Array | None = None
    within: float = 0.0

    def __post_init__(self) -> None:
        for name in ("position", "rotation", "axis", "direction"):
            if (value := getattr(self, name)) is not None:
                if not np.all(np.isfinite(value)):
                    raise InputError(f"the goal's {name} is not finite", where=f"goal of {self.frame!r}")
                object.__setattr__(self, name, read_only(value))
        if (self.axis is None) != (self.direction is None):
            raise InputError("an axis needs its direction", where=f"goal of {self.frame!r}")
        if not 0.0 <= self.within < np.pi:
            raise InputError(
                f"a cone of {self.within} rad makes no sense",
                where=f"goal of {self.frame!r}",
                remedy="from 0 to less than pi",
            )

    @staticmethod
    def posed(frame: str, T_world_frame: Pose) -> FrameGoal:
        """The whole pose."""
        return FrameGoal(frame, T_world_frame.position, T_world_frame.rotation)

    @staticmethod
    def at(frame: str, position: Vector) -> FrameGoal:
        """The frame's origin at a point (3,)."""
        return FrameGoal(frame, _vector(position, frame))

    @staticmethod
    def turned(frame: str, quat_wxyz: Vector) -> FrameGoal:
        """The frame's rotation."""
        return FrameGoal(frame, None, Pose(np.zeros(3), np.asarray(quat_wxyz, dtype=float)).rotation)

    @staticmethod
    def pointing(
        frame: str,
        direction: Vector,
        axis: Vector = (0.0, 0.0, 1.0),
        *,
        position: Vector | None = None,
        within: float = 0.0,
    ) -> FrameGoal:
        """An axis of the frame along a direction, or at most `within` radians away from it."""
        place = None if position is None else _vector(position, frame)
        return FrameGoal(frame, place, None, _unit(axis, frame), _unit(direction, frame), within)


@dataclass(frozen=True, slots=True)
class InRegion:
    """A point of a frame in a convex region of the world: `A p <= b`, and `A p = b` where `equal`.

    Attributes:
        frame: its name.
        A: (k, 3) outward normals; made units, with b to go with them.
        b: (k,) metres.
        point: (3,) in the frame.
        equal: (k,) which rows hold with equality: the point is in that plane.
        name: for messages.
    """

    frame: str
    A: Array
    b: Array
    point: Array
    equal: NDArray[np.bool_]
    name: str = "region"

    def __post_init__(self) -> None:
        A, b = np.atleast_2d(np.asarray(self.A, dtype=float)), np.atleast_1d(np.asarray(self.b, dtype=float))
        where = f"{self.name} of {self.frame!r}"
        if A.ndim != 2 or A.shape[1] != 3 or b.shape != (len(A),) or not len(A):
            raise InputError("a region takes A (k, 3) and b (k,), k at least one", where=where)
        length = np.linalg.norm(A, axis=1)
        if not (np.all(np.isfinite(A)) and np.all(np.isfinite(b)) and np.all(length > 0)):
            raise InputError("a row of a region is not finite, or its normal is zero", where=where)
        equal = np.broadcast_to(np.asarray(self.equal, dtype=bool), b.shape)
        object.__setattr__(self, "A", read_only(A / length[:, None]))
        object.__setattr__(self, "b", read_only(b / length))
        object.__setattr__(self, "point", read_only(_vector(self.point, self.frame)))
        object.__setattr__(self, "equal", read_only(equal, np.bool_))

    @staticmethod
    def polytope(frame: str, A: Array, b: Array, point: Vector = (0.0, 0.0, 0.0)) -> InRegion:
        """A point (3,) of the frame where `A p <= b`."""
        return InRegion(frame, A, b, _vector(point, frame), np.zeros(0 if b is None else len(b), dtype=bool))

    @staticmethod
    def plane(frame: str, normal: Vector, offset: float, point: Vector = (0.0, 0.0, 0.0)) -> InRegion:
        """A point (3,) of the frame in the plane `normal . p = offset`."""
        row = _vector(normal, frame)[None]
        return InRegion(frame, row, np.array([offset]), _vector(point, frame), np.array([True]), "plane")

    @staticmethod
    def on_face(
        frame: str,
        T_world_box: Pose,
        half: Vector,
        face: str,
        *,
        point: Vector = (0.0, 0.0, 0.0),
        inset: float = 0.0,
        lift: float = 0.0,
    ) -> InRegion:
        """A contact: a point (3,) of the frame on a face of a box, `inset` metres from its edges or more.

        Args:
            frame: the frame's name.
            T_world_box: where the box is; half: (3,) its half sizes.
            face: `+x`, `-x`, `+y`, ... in the box's frame.
            point: in the frame.
            inset: metres.
            lift: metres over the face, such as the radius of a ball around the point.

        Raises:
            InputError: no such face, or nothing is left of it.
        """
        where = f"contact of {frame!r}"
        if face not in [sign + axis for axis in "xyz" for sign in "+-"]:
            raise InputError(f"there is no face {face!r}", where=where, remedy="+x, -x, +y, -y, +z, -z")
        sizes, across = _vector(half, frame), "xyz".index(face[1])
        sides = [k for k in range(3) if k != across]
        if not np.all(sizes > 0) or not np.all(sizes[sides] >= inset):
            raise InputError(
                "nothing is left of the face", where=where, remedy="half sizes > 0, inset smaller"
            )
        R, centre = T_world_box.rotation, T_world_box.position
        normal = R[:, across] * (1.0 if face[0] == "+" else -1.0)
        rows, ends, equal = [normal], [float(normal @ centre) + sizes[across] + lift], [True]
        for k in sides:
            for sign in (1.0, -1.0):
                rows.append(sign * R[:, k])
                ends.append(float(sign * R[:, k] @ centre) + sizes[k] - inset)
                equal.append(False)
        return InRegion(
            frame, np.array(rows), np.array(ends), _vector(point, frame), np.array(equal), "contact"
        )


def _vector(values: Vector, frame: str) -> Array:
    array = np.asarray(values, dtype=float)
    if array.shape != (3,) or not np.all(np.isfinite(array)):
        raise InputError(
            f"a point or direction has 3 finite numbers, not {array.tolist()}", where=f"goal of {frame!r}"
        )
    return array


def _unit(values: Vector, frame: str) -> Array:
    array = _vector(values, frame)
    length = float(np.linalg.norm(array))
    if not abs(length - 1.0) <= UNIT_TOLERANCE:
        raise InputError(
            f"a direction has length {length:g}", where=f"goal of {frame!r}", remedy="a unit vector"
        )
    unit: Array = array / length
    return unit
