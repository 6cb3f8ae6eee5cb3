"""A review as one HTML page that needs no other file, no server and no network."""

from __future__ import annotations

import base64
import io
import json
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from workcell.files import check_writable
from workcell.record.read.metrics import label_of, unit_of
from workcell.record.show.cameras import choose_cameras
from workcell.record.show.moments import key_moments
from workcell.record.show.page_tables import cuboid_section, solver_section, table, way_section
from workcell.record.show.pictures import contact_sheet
from workcell.record.show.planner_view import has_planner_view, planner_view
from workcell.record.show.plots import plot_metrics
from workcell.record.show.studio import Studio

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from workcell.record.read.review import Review

_FRAMES = 24
_FRAME = (640, 480)
_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; color: #222; margin: 0 auto; max-width: 1280px; padding: 0 20px 40px }
header { color: #fff; margin: 0 -20px 18px; padding: 14px 20px }
header h1 { font-size: 24px; margin: 0 } header p { margin: 4px 0 0 }
.achieved { background: #2e7d32 } .not-achieved { background: #b3261e } .incomplete { background: #b7791f }
h2 { font-size: 17px; margin: 26px 0 8px } table { border-collapse: collapse }
td, th { border-bottom: 1px solid #ddd; padding: 3px 12px 3px 0; text-align: left; vertical-align: top }
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums }
.ok { color: #2e7d32 } .failed, .ERROR { color: #b3261e } .WARN, .missing { color: #9a6200 }
img { max-width: 100% } .film { display: flex; gap: 24px } .film img { width: 640px }
.film ol { list-style: none; margin: 0; padding: 0; font-size: 14px }
@media (max-width: 1000px) { .film { flex-wrap: wrap } }
.film li { cursor: pointer; padding: 2px 8px; border-left: 4px solid transparent }
.film li.now { border-color: #1f6fb4 }
input[type=range] { width: 640px; max-width: 100% } details { margin-top: 8px }
"""
_SCRIPT = """
const film = JSON.parse(document.getElementById("film").textContent);
const picture = document.getElementById("frame"), slider = document.getElementById("time");
const label = document.getElementById("when"), lines = [...document.querySelectorAll(".film li")];
function show(k) {
  picture.src = film.frames[k]; slider.value = k; label.textContent = film.times[k].toFixed(2) + " s";
  let now = -1;
  lines.forEach((line, i) => { if (Number(line.dataset.time) <= film.times[k] + 1e-6) now = i; });
  lines.forEach((line, i) => line.classList.toggle("now", i === now));
}
slider.addEventListener("input", () => show(Number(slider.value)));
lines.forEach(line => line.addEventListener("click", () => {
  const later = film.times.findIndex(t => t >= Number(line.dataset.time) - 1e-6);
  show(later < 0 ? film.times.length - 1 : later);
}));
show(0);
"""


def write_page(review: Review, path: str | Path) -> Path:
    """Writes the page: verdict, a film to scroll through with its events, checks, metrics, pictures and contents.

    Raises:
        OutputError: the file can't be written.
    """
    check_writable(path)
    Path(path).write_text(page(review), encoding="utf-8")
    return Path(path)


def page(review: Review) -> str:
    """The page's HTML."""
    kind = review.verdict.replace(" ", "-")
    parts = [
        f'<header class="{kind}"><h1>{escape(review.task)}: {escape(review.verdict)}</h1>',
        f"<p>{escape(review.reason)}</p></header>",
        *(f'<p class="missing">missing: {escape(item)}</p>' for item in review.missing),
        *_film(review),
        "<h2>Checks of the reviewer</h2>",
        table(("", "", ""), [_check_cells(c.name, c.passed, c.finding) for c in review.checks]),
        "<h2>What the run says</h2>",
        table(("", ""), [(escape(k), escape(v)) for k, v in _facts(review)]),
        "<h2>Metrics</h2>",
        _metrics(review),
        *_objects(review),
        *cuboid_section(review),
        *way_section(review),
        *solver_section(review),
        "<h2>Key moments</h2>",
        _image(contact_sheet(review), "key moments, each from two sides"),
    ]
    if has_planner_view(review):
        parts += ["<h2>What the planner sees</h2>", _image(planner_view(review), "spheres and free cuboids")]
    parts += ["<h2>Over time</h2>", _image(plot_metrics(review), "metrics over time"), _inventory(review)]
    title = f"<title>{escape(review.task)}: {escape(review.verdict)}</title>"
    head = f'<meta charset="utf-8">{title}<style>{_STYLE}</style>'
    body = "\n".join(parts)
    return f'<!doctype html>\n<html lang="en"><head>{head}</head>\n<body>\n{body}\n</body></html>\n'


def _facts(review: Review) -> list[tuple[str, str]]:
    simple = (bool, int, float, str)
    shown = [(k, v) for k, v in review.result.items() if isinstance(v, simple) and k != "sentence"]
    told = [(k, f"{v:.4g}" if isinstance(v, float) else str(v)) for k, v in shown]
    return [("file", review.path.name), ("simulated", f"{review.duration:.2f} s"), *told]


def _check_cells(name: str, passed: bool, finding: str) -> tuple[str, str, str]:
    mark = '<b class="ok">ok</b>' if passed else '<b class="failed">FAILED</b>'
    return (mark, escape(name), escape(finding))


def _film(review: Review) -> list[str]:
    """Frames with a slider, the events beside them: a click goes there."""
    if not review.stage.things:
        return []
    times = np.unique(
        np.concatenate([np.linspace(0.0, review.duration, _FRAMES), [m.time for m in key_moments(review)]])
    )
    times = times if review.duration > 0 else times[:1]
    studio = Studio(review.stage, choose_cameras(review.stage, *_FRAME)[0], smooth=False)
    frames = [_jpeg(studio.picture(float(time), ("why",))) for time in times]
    data = json.dumps({"times": [round(float(t), 4) for t in times], "frames": frames})
    lines = [
        f'<li class="{line.level}" data-time="{line.time:.4f}">{line.time:.2f} s&ensp;{escape(line.text)}</li>'
        for line in review.events
    ]
    return [
        "<h2>The run</h2>",
        '<div class="film"><div><img id="frame" alt="the cell at the chosen time"><br>',
        f'<input id="time" type="range" min="0" max="{len(times) - 1}" value="0"> <span id="when"></span></div>',
        f"<ol>{''.join(lines)}</ol></div>",
        f'<script type="application/json" id="film">{data}</script><script>{_SCRIPT}</script>',
    ]


def _metrics(review: Review) -> str:
    rows = []
    for row in review.metrics:
        scale, unit = unit_of(row.name)
        values = (row.minimum, row.maximum, row.mean, row.final)
        low, high, mean, final = (f"{scale * value:.3f}" for value in values)
        at = f"{row.time_of_minimum:.2f}", f"{row.time_of_maximum:.2f}"
        rows.append((escape(f"{label_of(row.name)} {unit}".rstrip()), low, at[0], high, at[1], mean, final))
    return table(("metric", "min", "at s", "max", "at s", "mean", "final"), rows, numbers_from=1)


def _objects(review: Review) -> list[str]:
    rows = [
        (escape(row.name), f"{row.moved:.3f}", f"{row.rose:.3f}", ", ".join(f"{x:.3f}" for x in row.final_position))
        for row in review.objects
    ]  # fmt: skip
    head = ("object", "moved m", "rose m", "ends at m")
    return ["<h2>Objects</h2>", table(head, rows, numbers_from=1)] if rows else []


def _inventory(review: Review) -> str:
    rows = [
        (escape(path), escape(", ".join(parts)), str(count))
        for path, (parts, count) in review.inventory.items()
    ]
    listed = table(("entity", "components", "rows"), rows)
    return f"<details><summary>Contents of the recording ({len(rows)} entities)</summary>{listed}</details>"


def _image(figure: Figure, words: str) -> str:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return f'<img alt="{escape(words)}" src="{_uri("png", buffer.getvalue())}">'


def _jpeg(picture: np.ndarray) -> str:
    from PIL import Image

    buffer = io.BytesIO()
    pixels = np.clip(np.round(255.0 * picture), 0, 255).astype(np.uint8)
    Image.fromarray(pixels).save(buffer, format="JPEG", quality=80)
    return _uri("jpeg", buffer.getvalue())


def _uri(kind: str, data: bytes) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(data).decode('ascii')}"
