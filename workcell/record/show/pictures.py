"""Pictures of a recording drawn from the file alone: a contact sheet of key frames, the planner's view, plots."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

from workcell.errors import OutputError
from workcell.record.show.cameras import choose_cameras
from workcell.record.show.canvas import Sheet, shortened
from workcell.record.show.moments import key_moments
from workcell.record.show.planner_view import has_planner_view, planner_view
from workcell.record.show.plots import plot_metrics
from workcell.record.show.studio import Studio

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from workcell.record.read.review import Review

_COLUMNS = 3
_TILE, _ALONE = (480, 360), (726, 544)


def contact_sheet(review: Review) -> Figure:
    """Key frames in the order of time, each from two sides.

    One side is above the other, or beside it where there is a single frame; the verdict is above, and the
    colours are explained below.
    """
    moments = key_moments(review)
    rows, alone = -(-len(moments) // _COLUMNS), len(moments) == 1
    width, height = tile = _ALONE if alone else _TILE
    studios = [Studio(review.stage, camera) for camera in choose_cameras(review.stage, width, height)]
    tall = height + 54 if alone else 2 * height + 54
    columns = len(studios) if alone else _COLUMNS
    sheet = Sheet(columns * width + (columns + 1) * 12, 96 + rows * tall + 40)
    sheet.banner(review)
    for index, moment in enumerate(moments):
        left = 12 + (index % _COLUMNS) * (width + 12)
        top = 96 + (index // _COLUMNS) * tall
        sheet.text(left, top + 14, f"{moment.time:.2f} s", size=12, weight="bold")
        sheet.text(left + 74, top + 14, shortened(moment.caption, 52), size=12)
        for second, studio in enumerate(studios):
            aside, below = (second, 0) if alone else (0, second)
            corner = (left + aside * (width + 12), top + 28 + below * (height + 4))
            sheet.tile(studio.picture(moment.time, ("why",)), corner)
            for k, (name, path) in enumerate(review.stage.object_paths().items()):
                place = studio.place(review.stage.pose(path, moment.time).position)
                sheet.label(name, place, corner, k, tile)
    sheet.legend(any(thing.kind == "why" for thing in review.stage.things), bool(review.stage.targets))
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
