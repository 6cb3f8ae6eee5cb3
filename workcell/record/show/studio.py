"""Drawing what a recording shows, from one camera, at any time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from workcell.pose import Array
from workcell.record.read.stage import Stage
from workcell.record.render.raster import Buffers, Camera, Surface, rasterise
from workcell.record.render.shade import Light, Line, blend, draw_line, halve, shade

_SOLID = ("robots", "objects", "obstacles")
_OPAQUE = 0.98


class Studio:
    """Draws a stage from one camera; what never moves is drawn once.

    Args:
        stage: what the recording shows.
        camera: from where, and how large the pictures are.
        smooth: draw twice the size and halve it, for smooth edges, at four times the work.
    """

    def __init__(self, stage: Stage, camera: Camera, smooth: bool = True) -> None:
        self.stage, self._scale = stage, 2 if smooth else 1
        width, height = self._scale * camera.width, self._scale * camera.height
        self.camera = replace(camera, width=width, height=height)
        still, self._glass = _split(stage.surfaces(0.0, _SOLID, moving=False))
        self._still: Buffers = rasterise(still, self.camera)
        self._light = Light.over(*_ball(stage), still)

    @property
    def width(self) -> int:
        """Pixels of a picture."""
        return self.camera.width // self._scale

    @property
    def height(self) -> int:
        """Pixels of a picture."""
        return self.camera.height // self._scale

    def picture(
        self,
        time: float,
        translucent: Sequence[str] = (),
        robots: bool = True,
        *,
        lines: Sequence[Line] = (),
    ) -> Array:
        """The picture (h, w, 3) in [0, 1] at a time.

        Args:
            time: simulated seconds.
            translucent: kinds of things to add: `spheres`, `free_space`, ...
            robots: whether to draw the robots.
            lines: what to add besides, in the world.
        """
        kinds = _SOLID if robots else ("objects", "obstacles")
        moving, glass = _split(self.stage.surfaces(time, kinds, moving=True))
        buffers = rasterise(moving, self.camera, onto=self._still)
        picture = shade(buffers, self.camera, self._light.with_more(moving))
        glass += self._glass + self.stage.surfaces(time, tuple(translucent))
        picture = blend(picture, buffers, self.camera, glass)
        for line in [*lines, *self.stage.lines(time)]:
            picture = draw_line(picture, buffers, self.camera, line)
        return halve(picture) if self._scale == 2 else picture

    def place(self, point: Array) -> Array:
        """Where a world point (3,) is in the picture (2,)."""
        return self.camera.project(np.asarray(point)[None])[0, :2] / self._scale


def _split(surfaces: list[Surface]) -> tuple[list[Surface], list[Surface]]:
    """Opaque surfaces, and translucent ones."""
    return [s for s in surfaces if s.rgba[3] > _OPAQUE], [s for s in surfaces if s.rgba[3] <= _OPAQUE]


def _ball(stage: Stage) -> tuple[Array, float]:
    """A ball around what moves, with some surroundings: where shadows are worth their pixels."""
    surfaces: list[Surface] = stage.surfaces(0.0, ("robots", "objects")) or stage.surfaces(0.0, _SOLID)
    if not surfaces:
        return np.zeros(3), 1.0
    points = np.concatenate([surface.triangles.vertices for surface in surfaces])
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    return centre, 1.5 * float(np.linalg.norm(points - centre, axis=1).max()) + 0.2
