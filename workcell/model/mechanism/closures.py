"""Connects and welds of a compiled model as ties between links."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from workcell.model.loops.elements import Element
from workcell.model.mechanism.mechanism import Closure
from workcell.pose import Pose


def closure_of(element: Element, link_of_body: Sequence[int], T_link_body: Sequence[Pose]) -> Closure:
    """A tie between two bodies as one between the links that carry them."""
    assert element.points is not None
    links = (link_of_body[element.bodies[0]], link_of_body[element.bodies[1]])
    frames = [
        T_link_body[body] @ _frame(points)
        for body, points in zip(element.bodies, element.points, strict=True)
    ]
    return Closure(
        element.name,
        "weld" if element.points.shape[1] == 3 else "connect",
        links,
        (frames[0], frames[1]),
        element.id,
    )


def _frame(points: np.ndarray) -> Pose:
    """The frame of a weld's points: its origin, one along x, one along y; of a connect its point."""
    if len(points) == 1:
        return Pose.from_xyz(points[0])
    x, y = points[1] - points[0], points[2] - points[0]
    x, y = x / np.linalg.norm(x), y / np.linalg.norm(y)
    return Pose.from_rotation(points[0], np.stack([x, y, np.cross(x, y)], axis=1))
