"""A page of pictures and words, measured in pixels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from workcell.pose import Array
from workcell.record.read.stage import PLAN_RGB, TRACE_RGB

if TYPE_CHECKING:
    from workcell.record.read.review import Review

Colour = tuple[float, float, float]

_LABEL_OFFSETS = ((16, 15), (16, -17), (-38, 15), (-38, -17))
_BLAMED = "#d03030"
_NOT_IN_BANNER = ("errors", "continuity")
_BANNER = {"achieved": "#2e7d32", "not achieved": "#b3261e", "incomplete": "#b7791f"}


def shortened(text: str, length: int) -> str:
    """At most `length` characters of a text."""
    return text if len(text) <= length else text[: length - 1].rstrip() + "…"


class Sheet:
    """A page measured in pixels, the origin at the top left."""

    def __init__(self, width: int, height: int) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self.width, self.height = width, height
        self.figure = Figure(figsize=(width / 100, height / 100), dpi=100, facecolor="white")
        self._renderer = FigureCanvasAgg(self.figure).get_renderer()
        self._page: Any = self.figure.add_axes((0, 0, 1, 1))
        self._page.set_axis_off()

    def text(
        self, x: float, y: float, words: str, *, size: float, color: str = "#222222", weight: str = "normal"
    ) -> None:
        """Words that begin at a point, centred on its height."""
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

    def words(self, x: float, y: float, parts: Sequence[tuple[str, Colour]], *, size: float) -> None:
        """Words one behind the other, each in its colour."""
        for words, colour in parts:
            text = self._page.text(
                x,
                y,
                words,
                fontsize=0.72 * size,
                color=colour,
                weight="bold",
                va="center",
                parse_math=False,
                zorder=5,
            )
            x += text.get_window_extent(self._renderer).width + size
        self._fit()

    def tile(self, picture: Array, corner: tuple[float, float]) -> None:
        """A picture, its upper left corner at a point."""
        x, y = corner
        h, w = picture.shape[:2]
        self._page.imshow(
            picture, extent=(x, x + w, y + h, y), interpolation="nearest", aspect="auto", zorder=1
        )
        self._fit()

    def label(
        self, words: str, place: Array, corner: tuple[float, float], index: int, tile: tuple[int, int]
    ) -> None:
        """A name beside a point of a tile of a size, if the point is in sight of it."""
        x, y = place
        if not (10 < x < tile[0] - 10 and 14 < y < tile[1] - 6):
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

    def badge(self, words: str, place: Array, corner: tuple[float, float], rgb: Colour) -> None:
        """A few letters on a ground of a colour, at a point of a tile."""
        self._page.text(
            corner[0] + place[0],
            corner[1] + place[1],
            words,
            fontsize=8.5,
            color="white",
            weight="bold",
            ha="center",
            va="center",
            bbox={"boxstyle": "round,pad=0.2", "fc": rgb, "ec": "none"},
            zorder=7,
        )

    def banner(self, review: Review) -> None:
        """Task, verdict, and the figures that matter."""
        from matplotlib.patches import Rectangle

        self._page.add_patch(Rectangle((0, 0), self.width, 46, color=_BANNER[review.verdict], zorder=2))
        self.text(14, 23, f"{review.task}: {review.verdict}", size=20, color="white", weight="bold")
        facts = [
            f"{key} {review.result[key]}" for key in ("robot", "planner", "seed") if key in review.result
        ]
        first = sorted(review.checks, key=lambda check: check.name != "planner")
        facts += [
            f"{review.duration:.1f} s simulated",
            *(check.finding for check in first if check.name not in _NOT_IN_BANNER),
        ]
        if review.verdict != "achieved":
            facts.insert(0, review.reason)
        self.text(14, 68, shortened("   ·   ".join(facts), 190), size=12.5)

    def legend(self, blamed: bool, followed: bool = False) -> None:
        """What the lines mean: something is blamed, or goals were followed."""
        y, x = self.height - 20, 14
        way = "goal of the tool so far" if followed else "planned path of the tool"
        for rgb, words in ((PLAN_RGB, way), (TRACE_RGB, "executed so far")):
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
