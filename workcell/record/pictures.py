"""Pictures of a recording drawn from the file alone: a contact sheet of key frames, the planner's view, plots."""

from __future__ import annotations

import io
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from workcell.errors import OutputError
from workcell.pose import Array
from workcell.record.cameras import choose_cameras
from workcell.record.plots import plot_metrics
from workcell.record.raster import Buffers, Camera, Surface, rasterise
from workcell.record.shade import Light, blend, draw_line, halve, shade
from workcell.record.stage import PLAN_RGB, TRACE_RGB, Stage

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from workcell.record.review import Review

_SOLID = ("robots", "objects", "obstacles")
_OPAQUE = 0.98
_MOMENTS = 6
_COLUMNS = 3
_TILE = (480, 360)
_LABEL_OFFSETS = ((16, 15), (16, -17), (-38, 15), (-38, -17))
_VIEW = (800, 600)
_BLAMED = "#d03030"
_BANNER = {"achieved": "#2e7d32", "not achieved": "#b3261e", "incomplete": "#b7791f"}


@dataclass(frozen=True, slots=True)
class Moment:
    """A time worth a picture, and why."""

    time: float
    caption: str


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
        self.camera = Camera(camera.position, camera.target, width, height, camera.fov_deg)
        still, self._glass = _split(stage.surfaces(0.0, _SOLID, moving=False))
        self._still: Buffers = rasterise(still, self.camera)
        self._light = Light.over(*_ball(stage), still)

    def picture(self, time: float, translucent: Sequence[str] = (), robots: bool = True) -> Array:
        """The picture (h, w, 3) in [0, 1] at a time; `translucent`: `spheres`, `free_space`."""
        kinds = _SOLID if robots else ("objects", "obstacles")
        moving, glass = _split(self.stage.surfaces(time, kinds, moving=True))
        buffers = rasterise(moving, self.camera, onto=self._still)
        picture = shade(buffers, self.camera, self._light.with_more(moving))
        glass += self._glass + self.stage.surfaces(time, tuple(translucent))
        picture = blend(picture, buffers, self.camera, glass)
        for line in self.stage.lines(time):
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


def key_moments(review: Review, count: int = _MOMENTS) -> list[Moment]:
    """The start, the end, and between them the events; gaps are filled with times half-way."""
    end = review.duration
    moments = [Moment(0.0, "start")]
    events = [line for line in review.events if 1e-6 < line.time < end - 1e-6]
    for line in events:
        if line.time - moments[-1].time > 0.02 * end:
            moments.append(Moment(line.time, line.text))
    if end > 0.0:
        moments.append(Moment(end, "end"))
    while len(moments) > count:
        gaps = [moments[k + 1].time - moments[k - 1].time for k in range(1, len(moments) - 1)]
        del moments[1 + int(np.argmin(gaps))]
    while 1 < len(moments) < count:
        gaps = [b.time - a.time for a, b in itertools.pairwise(moments)]
        k = int(np.argmax(gaps))
        moments.insert(k + 1, Moment((moments[k].time + moments[k + 1].time) / 2, ""))
    return moments


def contact_sheet(review: Review) -> Figure:
    """Key frames in the order of time, each from two sides (one above the other, or a single one side by side), with the verdict above and the colours explained below."""
    width, height = _TILE
    cameras = choose_cameras(review.stage, width, height)
    studios = [Studio(review.stage, camera) for camera in cameras]
    moments = key_moments(review)
    rows, alone = -(-len(moments) // _COLUMNS), len(moments) == 1
    tall = height + 54 if alone else 2 * height + 54
    sheet = _Sheet(_COLUMNS * width + (_COLUMNS + 1) * 12, 96 + rows * tall + 40)
    sheet.banner(review)
    for index, moment in enumerate(moments):
        left = 12 + (index % _COLUMNS) * (width + 12)
        top = 96 + (index // _COLUMNS) * tall
        sheet.text(left, top + 14, f"{moment.time:.2f} s", size=12, weight="bold")
        sheet.text(left + 74, top + 14, _shortened(moment.caption, 52), size=12)
        for second, studio in enumerate(studios):
            aside, below = (second, 0) if alone else (0, second)
            corner = (left + aside * (width + 12), top + 28 + below * (height + 4))
            sheet.tile(studio.picture(moment.time, ("why",)), corner)
            for k, (name, path) in enumerate(review.stage.object_paths().items()):
                sheet.label(name, studio.place(review.stage.pose(path, moment.time).position), corner, k)
    sheet.legend(any(thing.kind == "why" for thing in review.stage.things))
    return sheet.figure


def has_planner_view(review: Review) -> bool:
    """Whether spheres or cuboids were recorded."""
    return any(thing.kind in ("spheres", "free_space") for thing in review.stage.things)


def planner_view(review: Review) -> Figure:
    """The robot's spheres and the free cuboids at the start, with the planned path and the goals named."""
    width, height = _VIEW
    studio = Studio(review.stage, choose_cameras(review.stage, width, height)[0])
    sheet = _Sheet(width + 24, height + 84)
    sheet.text(12, 26, f"{review.task}: what the planner sees", size=15, weight="bold")
    sheet.text(
        12,
        52,
        "blue: sphere cover of the robot; green: cuboids and polytopes proved free; blue line: planned path",
        size=11,
    )
    sheet.tile(studio.picture(0.0, ("free_space", "spheres", "obstacle_spheres")), (12, 72))
    for k, (name, pose) in enumerate(review.stage.goals.items()):
        sheet.label(name, studio.place(pose.position), (12, 72), k)
    return sheet.figure


def write_pictures(review: Review, directory: str | Path) -> list[Path]:
    """Writes `contact_sheet.png`, `planner_view.png` (if spheres or cuboids were recorded) and `plots.png`.

    Raises:
        OutputError: the folder can't be written.
    """
    folder = Path(directory)
    makers = {"contact_sheet.png": contact_sheet, "plots.png": plot_metrics}
    if has_planner_view(review):
        makers["planner_view.png"] = planner_view
    written = []
    for name, make in makers.items():
        figure, buffer = make(review), io.BytesIO()
        figure.savefig(buffer, format="png")
        try:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(buffer.getvalue())
        except OSError as error:
            raise OutputError(
                f"the picture can't be written: {error.strerror}",
                where=folder / name,
                remedy="choose another folder",
            ) from None
        written.append(folder / name)
    return written


def _shortened(text: str, length: int) -> str:
    return text if len(text) <= length else text[: length - 1].rstrip() + "…"


class _Sheet:
    """A page measured in pixels, the origin at the top left."""

    def __init__(self, width: int, height: int) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self.width, self.height = width, height
        self.figure = Figure(figsize=(width / 100, height / 100), dpi=100, facecolor="white")
        FigureCanvasAgg(self.figure)
        self._page: Any = self.figure.add_axes((0, 0, 1, 1))
        self._page.set_axis_off()

    def text(
        self, x: float, y: float, words: str, *, size: float, color: str = "#222222", weight: str = "normal"
    ) -> None:
        self._page.text(
            x,
            y,
            words,
            fontsize=0.72 * size,
            color=color,
            weight=weight,
            va="center",
            parse_math=False,
            zorder=5,
        )
        self._fit()

    def tile(self, picture: Array, corner: tuple[float, float]) -> None:
        x, y = corner
        h, w = picture.shape[:2]
        self._page.imshow(
            picture, extent=(x, x + w, y + h, y), interpolation="nearest", aspect="auto", zorder=1
        )
        self._fit()

    def label(self, words: str, place: Array, corner: tuple[float, float], index: int) -> None:
        """A name beside a point of a tile, if the point is in sight of it."""
        x, y = place
        if not (10 < x < _TILE[0] * 2 - 10 and y > 14):
            return
        self._page.annotate(
            words,
            (corner[0] + x, corner[1] + y),
            xytext=_LABEL_OFFSETS[index % len(_LABEL_OFFSETS)],
            textcoords="offset points",
            fontsize=7.5,
            color="#111111",
            bbox={"boxstyle": "round,pad=0.2", "fc": (1, 1, 1, 0.75), "ec": "none"},
            arrowprops={"arrowstyle": "-", "lw": 0.7, "color": "#111111"},
            zorder=6,
        )

    def banner(self, review: Review) -> None:
        """Task, verdict, and the figures that matter."""
        from matplotlib.patches import Rectangle

        self._page.add_patch(Rectangle((0, 0), self.width, 46, color=_BANNER[review.verdict], zorder=2))
        self.text(14, 23, f"{review.task}: {review.verdict}", size=20, color="white", weight="bold")
        facts = [
            f"{key} {review.result[key]}" for key in ("robot", "planner", "seed") if key in review.result
        ]
        facts += [
            f"{review.duration:.1f} s simulated",
            *(c.finding for c in review.checks if c.name != "errors"),
        ]
        self.text(14, 68, _shortened("   ·   ".join(facts), 190), size=12.5)

    def legend(self, blamed: bool) -> None:
        """What the lines mean."""
        y, x = self.height - 20, 14
        for rgb, words in ((PLAN_RGB, "planned path of the tool"), (TRACE_RGB, "executed so far")):
            self._page.plot([x, x + 34], [y, y], color=rgb, lw=3)
            self.text(x + 44, y, words, size=12)
            x += 250
        if blamed:
            self._page.plot([x, x + 34], [y, y], color=_BLAMED, lw=6, alpha=0.6)
            self.text(x + 44, y, "in the way; orange: as near as it gets", size=12)
            x += 330
        self.text(x, y, "faint where something is in front; first: overview, second: close-up", size=12)

    def _fit(self) -> None:
        self._page.set_xlim(0, self.width)
        self._page.set_ylim(self.height, 0)
