"""How the Rerun viewer shows a recording when it is opened: 3D views, time series and the event log."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from workcell.pose import Array
from workcell.record.write.cuboid_use import IN_USE, WAYS
from workcell.record.write.rrd import SOLVER_STEP, TIME, rerun
from workcell.record.write.solver_log import CPU, LOG, RESIDUAL


def make_blueprint(
    robots: Sequence[str],
    objects: Sequence[str],
    metrics: Sequence[str],
    eye: tuple[Array, Array],
    traces: Sequence[str],
) -> Any:
    """The blueprint of a run.

    Left: the run as it happened, a second tab with what the planner saw (spheres, cuboids, those that it had links in
    coloured by link), and a third with what the solvers did. Right: one time series for each metric and for the joints,
    the event log, the result, in how many cuboids the planner had the links, and which ways they are on.

    Args:
        robots, objects: escaped names, as they stand in entity paths.
        metrics: names below `metrics/`.
        eye: camera position and the point it looks at, (3,) each.
        traces: entities of executed ways, which stay in sight.
    """
    rr = rerun()
    import rerun.blueprint as rrb

    collision = [f"- /world/robots/{name}/collision/**" for name in robots]
    collision += [f"- /world/objects/{name}/collision/**" for name in objects]
    planners = [f"- /world/{name}/**" for name in ("obstacle_spheres", "free_space", IN_USE)]
    spheres = [f"- /world/robots/{name}/spheres/**" for name in robots]
    visual = [f"- /world/robots/{name}/visual/**" for name in robots]
    whole_past = rrb.VisibleTimeRanges(
        timeline=TIME,
        start=rrb.TimeRangeBoundary.infinite(),
        end=rrb.TimeRangeBoundary.cursor_relative(seconds=0.0),
    )

    def view(name: str, hidden: list[str]) -> Any:
        return rrb.Spatial3DView(
            origin="/world",
            name=name,
            contents=["+ /world/**", *collision, *hidden],
            overrides={
                f"/{trace}": [rr.LineStrips3D.from_fields().visualizer(), whole_past] for trace in traces
            },
            eye_controls=rrb.EyeControls3D(position=eye[0], look_target=eye[1], eye_up=[0, 0, 1]),
        )

    plots = [rrb.TimeSeriesView(origin=f"/metrics/{name}", name=name.replace("_", " ")) for name in metrics]
    events = rrb.TextLogView(origin="/log", name="events")
    result = rrb.TextDocumentView(origin="/result", name="result")
    in_use = rrb.TimeSeriesView(origin=f"/metrics/{IN_USE}", name="cuboids that decided")
    ways = [rrb.TextDocumentView(origin=f"/{WAYS}/{name}", name=f"way of {name}") for name in robots]
    solvers = rrb.Vertical(
        rrb.TimeSeriesView(
            origin=f"/{RESIDUAL}", name=f"log10 of the rank residual (choose the timeline {SOLVER_STEP})"
        ),
        rrb.TimeSeriesView(origin=f"/{CPU}", name="CPU ms of each stage"),
        rrb.TextLogView(origin=f"/{LOG}", name="stages"),
        name="the solvers",
    )
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Tabs(
                view("the run", [*spheres, *planners]),
                view("what the planner sees", visual),
                solvers,
            ),
            rrb.Vertical(*plots, rrb.Tabs(events, result, in_use, *ways)),
            column_shares=[3, 2],
        ),
        rrb.TimePanel(timeline=TIME, state=rrb.PanelState.Collapsed),
        rrb.BlueprintPanel(state=rrb.PanelState.Collapsed),
        rrb.SelectionPanel(state=rrb.PanelState.Collapsed),
    )
