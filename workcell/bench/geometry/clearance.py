"""The clearance engine: pairs a second for each kind of shape, microseconds for a robot, and what others answer."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from workcell.bench.rows import Bench, Row
from workcell.geometry.engine import ClearanceEngine
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.pieces import pieces_of_bodies
from workcell.geometry.self_collision import self_collision_pairs
from workcell.geometry.types import Piece, SphereCover
from workcell.model.loading.load import load_robot
from workcell.model.robot import Robot
from workcell.pose import Array, Pose

SHAPES = 30
"""Shapes of a row."""
SPHERES = 22
"""Spheres of the robot, as the densest cover of the paper."""
_KINDS = ("box", "turned_box", "sphere", "capsule", "cylinder", "ellipsoid", "halfspace", "hull")
_COMPARED = 2000
"""Pairs of a row that are compared with MuJoCo, coal and finite differences."""
_SEPARATED = 1e-3
"""Metres from which a pair counts as separated."""
_RADIUS = 0.02
_STEP = 1e-6


def clearance(n: int, seed: int, sets: Path | None) -> list[Row]:
    """Rows of single kinds with n points each, then of a robot at n configurations at most."""
    return [_kind_row(kind, n, seed) for kind in _KINDS] + _robot_rows(min(n, 5000), seed)


def _kind_row(kind: str, n: int, seed: int) -> Row:
    rng = np.random.default_rng(seed)
    model, shapes = _world(kind, rng)
    points = rng.uniform(-1.0, 1.0, (n, 3))
    pairs = n * SHAPES
    ask: dict[str, Callable[[], object]] = {
        "distances": lambda: shapes.distances(points),
        "gradients": lambda: shapes.distances_and_gradients(points),
        "nearest": lambda: shapes.nearest(points),
    }
    some = points[: max(1, min(n, _COMPARED // SHAPES))]
    return {
        "row": f"points/{kind}/engine",
        "n": pairs,
        **{f"{name}_m_per_s": 1e-6 * pairs / _seconds(query) for name, query in ask.items()},
        "mujoco_max_m": _worst(shapes, some, _mujoco_distances(model)),
        "coal_max_m": _worst(shapes, some, _coal_distances(shapes)),
        "gradient_max": _gradient_error(shapes, some),
        "paper": None,
    }


def _world(kind: str, rng: np.random.Generator) -> tuple[Any, ObstacleArrays]:
    """A compiled model of shapes of one kind and a probe, and the shapes packed."""
    import mujoco

    types = {
        "turned_box": mujoco.mjtGeom.mjGEOM_BOX,
        "halfspace": mujoco.mjtGeom.mjGEOM_PLANE,
        "hull": mujoco.mjtGeom.mjGEOM_MESH,
    }
    geom_type = types.get(kind) or getattr(mujoco.mjtGeom, f"mjGEOM_{kind.upper()}")
    spec = mujoco.MjSpec()
    for k in range(SHAPES):
        quat = np.array([1.0, 0, 0, 0]) if kind == "box" else rng.normal(size=4)
        place = {"pos": rng.uniform(-1, 1, 3), "quat": quat / np.linalg.norm(quat), "name": f"{kind}{k}"}
        if kind == "hull":
            corners = rng.normal(size=(16, 3))
            corners *= rng.uniform(0.03, 0.2, 3) / np.linalg.norm(corners, axis=1, keepdims=True)
            spec.add_mesh(name=f"m{k}", uservert=corners.ravel())
            spec.worldbody.add_geom(type=geom_type, meshname=f"m{k}", **place)
        else:
            spec.worldbody.add_geom(type=geom_type, size=rng.uniform(0.03, 0.2, 3), **place)
    probe = spec.worldbody.add_body(name="probe")
    probe.add_freejoint()
    probe.add_geom(name="probe", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[_RADIUS, 0, 0])
    model = spec.compile()
    return model, ObstacleArrays(pieces_of_bodies(model, [0]))


def _mujoco_distances(model: Any) -> Callable[[Array, int], float]:
    import mujoco

    data = mujoco.MjData(model)
    probe = model.geom("probe").id

    def distance(point: Array, k: int) -> float:
        data.qpos[:3] = point
        mujoco.mj_kinematics(model, data)
        return float(mujoco.mj_geomDistance(model, data, k, probe, 10.0, None))

    return distance


def _coal_distances(shapes: ObstacleArrays) -> Callable[[Array, int], float]:
    import coal

    solids = [_coal_shape(coal, piece) for piece in shapes.pieces]
    places = [coal.Transform3s(piece.pose.rotation, piece.pose.position) for piece in shapes.pieces]
    ball, request = coal.Sphere(_RADIUS), coal.DistanceRequest()
    request.gjk_tolerance = 1e-12

    def distance(point: Array, k: int) -> float:
        there = coal.Transform3s(np.eye(3), point)
        return float(coal.distance(solids[k], places[k], ball, there, request, coal.DistanceResult()))

    return distance


def _coal_shape(coal: Any, piece: Piece) -> Any:
    if piece.kind == "halfspace":
        return coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)
    if piece.kind == "hull":
        points = coal.StdVec_Vec3s()
        for vertex in np.asarray(piece.vertices):
            points.append(vertex)
        return coal.Convex.convexHull(points, False, "")
    if piece.kind in ("capsule", "cylinder"):
        return getattr(coal, piece.kind.capitalize())(piece.size[0], 2.0 * piece.size[1])
    if piece.kind == "box":
        return coal.Box(*(2.0 * piece.size))
    return getattr(coal, piece.kind.capitalize())(*piece.size)


def _worst(shapes: ObstacleArrays, points: Array, other: Callable[[Array, int], float]) -> float:
    """Largest difference on separated pairs."""
    gaps = shapes.distances(points) - _RADIUS
    rows, columns = np.nonzero(gaps > _SEPARATED)
    theirs = np.array([other(points[i], int(k)) for i, k in zip(rows, columns, strict=True)])
    return float(np.abs(gaps[rows, columns] - theirs).max(initial=0.0))


def _gradient_error(shapes: ObstacleArrays, points: Array) -> float:
    """Largest difference from central differences where the distance has no ridge."""
    here, gradient = shapes.distances_and_gradients(points)
    worst = 0.0
    for axis, step in enumerate(_STEP * np.eye(3)):
        ahead, behind = shapes.distances(points + step), shapes.distances(points - step)
        smooth = np.abs(ahead + behind - 2.0 * here) < 1e-10
        error = np.abs((ahead - behind) / (2.0 * _STEP) - gradient[..., axis])
        worst = max(worst, float(error[smooth].max(initial=0.0)))
    return worst


def _robot_rows(n: int, seed: int) -> list[Row]:
    rng = np.random.default_rng(seed)
    robot = load_robot("iiwa14")
    cover = _strung(robot)
    boxes = [
        Piece(f"box{k}", "box", Pose.from_xyz(rng.uniform(-1, 1, 3)), rng.uniform(0.03, 0.2, 3))
        for k in range(SHAPES)
    ]
    pairs = self_collision_pairs(robot, cover, prove=False)
    among, alone = ClearanceEngine(robot, cover, boxes), ClearanceEngine(robot, cover, (), pairs)
    batch = robot.random_configuration(rng, n)
    size = f"{SPHERES}x{SHAPES}"
    queries: dict[str, tuple[ClearanceEngine, Callable[[Array], object], str]] = {
        f"{size}/smallest": (among, among.clearance_and_gradient, "clearance"),
        f"{size}/each-sphere": (among, among.sphere_clearances_and_gradients, "sphere_clearances"),
        f"{size}/all-pairs": (among, among.pair_distances_and_gradients, ""),
        f"self-{len(pairs)}/smallest": (alone, alone.clearance_and_gradient, "clearance"),
        f"self-{len(pairs)}/all-pairs": (alone, alone.self_clearances_and_gradients, "self_clearances"),
    }
    rows = []
    for name, (engine, query, values) in queries.items():
        spent = _seconds(lambda ask=query: [ask(q) for q in batch])  # type: ignore[misc]
        rows.append(_robot_row(f"iiwa14/{name}/gradients", n, spent / n, engine, query, values, batch))
    spent = _seconds(lambda: among.clearances(batch))
    rows.append(_robot_row(f"iiwa14/{size}/batch", n, spent / n))
    return rows


def _robot_row(
    name: str,
    n: int,
    seconds: float,
    engine: ClearanceEngine | None = None,
    query: Callable[[Array], Any] | None = None,
    values: str = "",
    batch: Array | None = None,
) -> Row:
    row: Row = {"row": name, "n": n, "us_mean": 1e6 * seconds, "gradient_max": None, "paper": None}
    if engine is None or query is None or batch is None:
        return row
    ask = getattr(engine, values) if values else lambda q: engine.pair_distances_and_gradients(q)[0]
    worst = 0.0
    for q in batch[:50]:
        here, gradient = ask(q), query(q)[1]
        for k, step in enumerate(_STEP * np.eye(len(q))):
            ahead, behind = ask(q + step), ask(q - step)
            smooth = np.abs(ahead + behind - 2.0 * here) < 1e-10
            error = np.abs((ahead - behind) / (2.0 * _STEP) - gradient[..., k])
            worst = max(worst, float(np.max(np.where(smooth, error, 0.0))))
    return row | {"gradient_max": worst}


def _strung(robot: Robot) -> SphereCover:
    """Spheres strung along the links, from each joint to the next and to the tool."""
    ahead = [*robot.joint_xyz[1:], robot.tool().T_link_tool.position]
    link = np.linspace(1, robot.dof + 1 - 1e-9, SPHERES).astype(np.int64)
    share = np.linspace(0.0, robot.dof, SPHERES) % 1.0
    centre = np.array([s * ahead[k - 1] for k, s in zip(link, share, strict=True)])
    return SphereCover(link, centre, np.full(SPHERES, 0.07))


def _seconds(query: Callable[[], object], repeats: int = 5) -> float:
    """Median CPU seconds of a query, after one that is not measured."""
    query()
    spent = []
    for _ in range(repeats):
        begun = time.process_time()
        query()
        spent.append(time.process_time() - begun)
    return float(np.median(spent))


BENCHES = (Bench("clearance", 20_000, "the clearance engine: speed, and agreement with others", clearance),)
