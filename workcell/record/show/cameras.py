"""Where to look from: the whole robot and its surroundings, and the place where the work is done."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workcell.pose import Array, Pose
from workcell.record.read.stage import Stage, Thing
from workcell.record.render.raster import Camera, Surface, rasterise
from workcell.record.render.tessellate import Triangles, tessellate
from workcell.record.shapes import Shape

_FOV_DEG = 34.0
_LOW_RES = (96, 72)
_HAND_M = 0.16
_GLANCES = 4


@dataclass(frozen=True, slots=True)
class Glance:
    """A moment for choosing a camera: what stands in the way, and the points (k, 3) that should be in sight."""

    blockers: list[Surface]
    points: Array


def choose_cameras(stage: Stage, width: int, height: int) -> tuple[Camera, Camera]:
    """An overview and a close-up from another side, each from where the work is hidden least.

    The work is the tool's way and the objects' ways. A direction is good when much of it is in sight at several
    moments and when it spreads wide in the picture.
    """
    work = work_points(stage)
    arm = _corners(
        stage.surfaces(0.0, ("robots",), moving=True)
        or stage.surfaces(0.0, ("robots", "objects"))
        or stage.surfaces(0.0, ("obstacles",))
    )
    around = np.concatenate([work, arm])
    if not len(around):
        around = np.array([[-0.5, -0.5, 0.0], [0.5, 0.5, 0.5]])
    work = work if len(work) else around
    glances = [_glance(stage, time) for time in np.quantile(stage.times, np.linspace(0.0, 1.0, _GLANCES))]
    wide = _best(around, work, glances, width, height, avoid=None, margin=1.25)
    azimuth = float(np.arctan2(*(wide.position - wide.target)[[1, 0]]))
    return wide, _best(work, work, glances, width, height, avoid=azimuth, margin=1.6)


def work_points(stage: Stage) -> Array:
    """Points (k, 3) along the ways of the tools and of the objects."""
    ways = [points for _, points in stage.traces.values()]
    if not any(len(way) > 1 for way in ways):
        ways += list(stage.plans.values())
    for path in stage.object_paths().values():
        times = stage.motions[path].times
        ways.append(np.array([stage.pose(path, t).position for t in times[:: max(len(times) // 40, 1)]]))
    thinned = [way[:: max(len(way) // 60, 1)] for way in ways if len(way)]
    return np.concatenate(thinned) if thinned else np.zeros((0, 3))


def _glance(stage: Stage, time: float) -> Glance:
    """Boxes around the links and the obstacles at a time, without the hand; the tool and the objects to be seen."""
    tools = [
        points[max(int(np.searchsorted(times, time + 1e-9)) - 1, 0)]
        for times, points in stage.traces.values()
    ]
    seen = [*tools, *(stage.pose(path, time).position for path in stage.object_paths().values())]
    blockers = []
    for thing in stage.things:
        if thing.kind not in ("robots", "obstacles") or all(rgba[3] < 0.5 for _, rgba in thing.parts):
            continue
        box = _bounding_box(thing)
        pose = stage.pose(thing.path, time)
        moved = box.moved(pose.rotation, pose.position)
        near = [np.linalg.norm(moved.vertices.mean(axis=0) - tool) < _HAND_M for tool in tools]
        if thing.kind == "obstacles" or not any(near):
            blockers.append(Surface(moved, np.ones(4)))
    return Glance(blockers, np.array(seen).reshape(-1, 3))


def _bounding_box(thing: Thing) -> Triangles:
    points = np.concatenate([mesh.vertices for mesh, _ in thing.parts])
    low, high = points.min(axis=0), points.max(axis=0)
    half = np.maximum((high - low) / 2, 1e-4)
    return tessellate(Shape("", "box", half, Pose.from_xyz((low + high) / 2), np.ones(4)))


def _corners(surfaces: list[Surface]) -> Array:
    """Corners of the surfaces' bounding boxes."""
    bounds = [(s.triangles.vertices.min(axis=0), s.triangles.vertices.max(axis=0)) for s in surfaces]
    return np.array(bounds).reshape(-1, 3)


def _best(
    frame: Array,
    work: Array,
    glances: list[Glance],
    width: int,
    height: int,
    avoid: float | None,
    margin: float,
) -> Camera:
    """The camera around `frame` that sees the work best; not within 50 degrees of the azimuth `avoid`."""
    best, best_score = None, -np.inf
    for elevation in np.radians([14.0, 30.0]):
        for azimuth in np.radians(np.arange(0, 360, 15) - 160.0):
            turned = np.pi if avoid is None else abs(np.angle(np.exp(1j * (azimuth - avoid))))
            if turned < np.radians(50.0):
                continue
            camera = _framed(frame, azimuth, elevation, width, height, margin)
            score = _score(camera, work, glances)
            if score > best_score:
                best, best_score = camera, score
    assert best is not None
    return best


def _framed(
    points: Array, azimuth: float, elevation: float, width: int, height: int, margin: float
) -> Camera:
    """A camera in a direction, as near as it can be with all points in the picture."""
    away = np.array(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    )
    target = (points.min(axis=0) + points.max(axis=0)) / 2
    probe = Camera(target + away, target, width, height, _FOV_DEG)
    right, up, depth = ((points - target) @ probe.axes.T).T
    tangent = np.tan(np.radians(_FOV_DEG) / 2)
    needed = np.maximum(np.abs(right) / (tangent * width / height), np.abs(up) / tangent) - depth
    distance = max(margin * float(needed.max()), 0.6)
    return Camera(target + distance * away, target, width, height, _FOV_DEG)


def _score(camera: Camera, work: Array, glances: list[Glance]) -> float:
    """Share of what matters that is in sight at the glances, and how wide the work spreads in the picture."""
    small = Camera(camera.position, camera.target, *_LOW_RES, camera.fov_deg)
    shares = []
    for glance in glances:
        seen = rasterise(glance.blockers, small, depth_only=True)
        place = small.project(glance.points)
        column = np.clip(np.nan_to_num(place[:, 0]), 0, _LOW_RES[0] - 1).astype(np.int64)
        row = np.clip(np.nan_to_num(place[:, 1]), 0, _LOW_RES[1] - 1).astype(np.int64)
        shares.append(float(np.mean(place[:, 2] >= seen.nearness[row, column] * 0.98)) if len(place) else 0.0)
    spread = float(np.mean(np.std(small.project(work)[:, :2], axis=0) / np.array(_LOW_RES)))
    return 2.0 * float(np.mean(shares)) + 1.5 * spread
