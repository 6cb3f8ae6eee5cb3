"""Where to look from: the whole robot and its surroundings, and the place where the work is done."""

from __future__ import annotations

import numpy as np

from workcell.pose import Array
from workcell.record.raster import Camera, Surface, rasterise
from workcell.record.stage import Stage

_FOV_DEG = 34.0
_LOW_RES = (96, 72)


def choose_cameras(stage: Stage, width: int, height: int) -> tuple[Camera, Camera]:
    """An overview and a close-up from another side, each from where the work is hidden least.

    The work is the tool's way and the objects' ways. A direction is good when much of it is in sight and when it
    spreads wide in the picture.
    """
    work = work_points(stage)
    solids = stage.surfaces(0.0, ("robots", "objects", "obstacles"))
    static = stage.surfaces(0.0, ("obstacles",), moving=False)
    robot = _corners([s for s in solids if s.ident >= _first_robot_ident(solids, stage)])
    everything = np.concatenate([work, robot]) if len(robot) else work
    if not len(everything):
        everything = _corners(solids) if solids else np.zeros((1, 3))
    work = work if len(work) else everything
    wide = _best(everything, work, static, width, height, avoid=None)
    azimuth = np.arctan2(*(wide.position - wide.target)[[1, 0]])
    close = _best(work, work, static, width, height, avoid=float(azimuth), margin=1.5)
    return wide, close


def work_points(stage: Stage) -> Array:
    """Points (k, 3) along the ways of the tools and of the objects that move."""
    ways = [points for _, points in stage.traces.values()]
    if not any(len(way) > 1 for way in ways):
        ways += list(stage.plans.values())
    times = stage.times
    for path in stage.object_paths().values():
        ways.append(np.array([stage.pose(path, t).position for t in times[:: max(len(times) // 40, 1)]]))
    points = np.concatenate([way[:: max(len(way) // 60, 1)] for way in ways]) if ways else np.zeros((0, 3))
    return points.reshape(-1, 3)


def _first_robot_ident(solids: list[Surface], stage: Stage) -> int:
    return len({(thing.kind, thing.owner) for thing in stage.things})


def _corners(surfaces: list[Surface]) -> Array:
    """Corners of the surfaces' bounding boxes."""
    if not surfaces:
        return np.zeros((0, 3))
    bounds = [(s.triangles.vertices.min(axis=0), s.triangles.vertices.max(axis=0)) for s in surfaces]
    return np.concatenate([np.array(bound) for bound in bounds])


def _best(
    frame: Array,
    work: Array,
    static: list[Surface],
    width: int,
    height: int,
    avoid: float | None,
    margin: float = 1.08,
) -> Camera:
    """The camera around `frame` that sees `work` best; not within 50 degrees of the azimuth `avoid`."""
    best, best_score = None, -np.inf
    for elevation in np.radians([16.0, 30.0]):
        for azimuth in np.radians(np.arange(0, 360, 20) - 170.0):
            turned = np.inf if avoid is None else abs(np.angle(np.exp(1j * (azimuth - avoid))))
            if turned < np.radians(50.0):
                continue
            camera = _framed(frame, azimuth, elevation, width, height, margin)
            score = _score(camera, work, static) - 0.15 * float(elevation)
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
    distance = max(margin * float(needed.max()), 0.45)
    return Camera(target + distance * away, target, width, height, _FOV_DEG)


def _score(camera: Camera, work: Array, static: list[Surface]) -> float:
    """Share of the points in sight, and how wide they spread."""
    small = Camera(camera.position, camera.target, *_LOW_RES, camera.fov_deg)
    seen = rasterise(static, small)
    place = small.project(work)
    column = np.clip(np.nan_to_num(place[:, 0]), 0, _LOW_RES[0] - 1).astype(np.int64)
    row = np.clip(np.nan_to_num(place[:, 1]), 0, _LOW_RES[1] - 1).astype(np.int64)
    visible = place[:, 2] >= seen.nearness[row, column] * 0.995
    spread = float(np.mean(np.std(place[:, :2], axis=0) / np.array(_LOW_RES)))
    return float(np.mean(visible)) + 1.5 * spread
