"""Sphere covers of the robots, of objects and of a table top: how many, how tight, proved how fast, re-checked.

The re-check shares no code with the covers: points of the geoms are made from MuJoCo's own sizes and poses (mesh
hulls by trimesh), and membership is by definition, without any distance.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from workcell.bench.reference.robots import ROBOTS
from workcell.bench.rows import Bench, Row
from workcell.errors import ModelError
from workcell.pose import Array

if TYPE_CHECKING:
    import mujoco

    from workcell.geometry.types import Piece, SphereCover

OBJECTS = ("mug", "cup")
TABLE = (0.75, 0.4, 0.02)
"""Half sizes in metres of the table top of the figures."""


def covers(n: int, seed: int, sets: Path | None) -> list[Row]:
    """Rows of all covers, each re-checked with n random points."""
    rows = []
    for name in ROBOTS:
        model, links, make, bodies = _robot(name)
        for label, options in _WAYS:
            rows.append(_row(f"{name}/{label}", model, links, partial(make, **options), bodies, n, seed))
    for name, model in [*((name, _object(name)) for name in OBJECTS), ("table_top", _table())]:
        links, make, bodies = _standing(model)
        for label, options in _WAYS[:1] if name == "table_top" else _WAYS[:2]:
            rows.append(_row(f"{name}/{label}", model, links, partial(make, **options), bodies, n, seed))
    return rows


_WAYS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("outer_2cm", {"overshoot": 0.02}),
    ("outer_1cm", {"overshoot": 0.01}),
    ("outer_low", {"count": "low"}),
    ("outer_mid", {"count": "mid"}),
    ("outer_high", {"count": "high"}),
    ("inner_low", {"kind": "inner", "count": "low"}),
    ("inner_mid", {"kind": "inner", "count": "mid"}),
    ("inner_high", {"kind": "inner", "count": "high"}),
)

Made = tuple["mujoco.MjModel", Sequence[Sequence["Piece"]], Callable[..., "SphereCover"], list[list[int]]]


def _robot(name: str) -> Made:
    from workcell.geometry.covers.outer import model_cover
    from workcell.geometry.pieces import model_pieces
    from workcell.model.loading.compiled import link_bodies
    from workcell.model.loading.load import load_compiled

    model, robot = load_compiled(name)[:2]
    links = [(), *model_pieces(model, robot)[1:]]
    bodies = [[], *(list(ids) for ids in list(link_bodies(model, robot))[1:])]
    return model, links, lambda **options: model_cover(model, robot, **options), bodies


def _standing(
    model: mujoco.MjModel,
) -> tuple[Sequence[Sequence[Piece]], Callable[..., SphereCover], list[list[int]]]:
    from workcell.geometry.covers.outer import cover_of
    from workcell.geometry.pieces import pieces_of_bodies

    bodies = [list(range(model.nbody))]
    links = [pieces_of_bodies(model, bodies[0])]
    return links, lambda overshoot: cover_of(links[0], overshoot), bodies


def _object(name: str) -> mujoco.MjModel:
    import mujoco

    from workcell.model.loading.assets import find_asset

    return mujoco.MjModel.from_xml_path(str(find_asset("objects", name)))


def _table() -> mujoco.MjModel:
    import mujoco

    size = " ".join(map(str, TABLE))
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><geom name="top" type="box" size="{size}"/></worldbody></mujoco>'
    )


def _row(
    name: str,
    model: mujoco.MjModel,
    links: Sequence[Sequence[Piece]],
    make: Callable[[], SphereCover],
    bodies: list[list[int]],
    n: int,
    seed: int,
) -> Row:
    from workcell.geometry.covers.by_count import cover_metrics
    from workcell.geometry.covers.proof import prove_cover

    began = time.process_time()
    cover = make()
    made = time.process_time() - began
    began = time.process_time()
    proved = cover.kind == "inner" or all(
        prove_cover(pieces, cover.centre[cover.link == link], cover.radius[cover.link == link]) is None
        for link, pieces in enumerate(links)
    )
    proof = time.process_time() - began
    metrics = cover_metrics(links, cover)
    return {
        "row": name,
        "n": n,
        "spheres": metrics.count,
        "proved": proved,
        "violations": violations(model, bodies, cover, n, np.random.default_rng(seed)),
        "overshoot_max_mm": 1e3 * metrics.overshoot_max,
        "overshoot_mean_mm": 1e3 * metrics.overshoot_mean,
        "volume_l": 1e3 * metrics.volume,
        "sphere_volume_l": 1e3 * metrics.sphere_volume,
        "share": metrics.share,
        "make_s": made,
        "proof_s": proof,
    }


def violations(
    model: mujoco.MjModel,
    bodies: Sequence[Sequence[int]],
    cover: SphereCover,
    n: int,
    rng: np.random.Generator,
) -> int:
    """Random points (n or more) that tell against a cover: of geoms outside all spheres, or of spheres in no geom.

    Args:
        model: compiled model, at its `qpos0`.
        bodies: ids of each link's bodies; the first is the link's own frame.
        cover: outer or inner cover in link frames.
        n: points altogether, shared out among links evenly.
        rng: where they come from.
    """
    import mujoco

    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    wrong = 0
    used = [link for link, ids in enumerate(bodies) if ids]
    for link in used:
        geoms = [
            g
            for g in range(model.ngeom)
            if model.geom_bodyid[g] in bodies[link] and (model.geom_contype[g] or model.geom_conaffinity[g])
        ]
        mine = cover.link == link
        frame = data.body(bodies[link][0])
        centres = cover.centre[mine] @ frame.xmat.reshape(3, 3).T + frame.xpos
        count = -(-n // len(used))
        if cover.kind == "outer":
            share = -(-count // len(geoms))
            points = np.vstack([geom_points(model, data, g, share, rng) for g in geoms])
            gap = np.min(
                [
                    np.linalg.norm(points - c, axis=1) - r
                    for c, r in zip(centres, cover.radius[mine], strict=True)
                ],
                axis=0,
            )
            wrong += int(np.sum(gap > 1e-12))
        elif mine.any():
            points = _ball_points(centres, cover.radius[mine], count, rng)
            wrong += int(np.sum(~np.any([in_geom(model, data, g, points) for g in geoms], axis=0)))
    return wrong


def _ball_points(centres: Array, radii: Array, count: int, rng: np.random.Generator) -> Array:
    """Points (count, 3) on and in balls, half of them on the surface."""
    which = rng.integers(len(radii), size=count)
    away = (
        _directions(count, rng)
        * np.where(rng.uniform(size=count) < 0.5, 1.0, rng.uniform(size=count))[:, None]
    )
    points: Array = centres[which] + radii[which, None] * away
    return points


def _directions(count: int, rng: np.random.Generator) -> Array:
    drawn = rng.normal(size=(count, 3))
    unit: Array = drawn / np.linalg.norm(drawn, axis=1, keepdims=True)
    return unit


def geom_points(
    model: mujoco.MjModel, data: mujoco.MjData, geom: int, count: int, rng: np.random.Generator
) -> Array:
    """Points (count, 3) of a geom in the world, about half of them on its surface."""
    import mujoco

    kind, size = mujoco.mjtGeom(int(model.geom_type[geom])), model.geom_size[geom]
    shell = np.where(rng.uniform(size=count) < 0.5, 1.0, rng.uniform(size=count) ** (1 / 3))[:, None]
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        cube = rng.uniform(-1, 1, (count, 3))
        local = shell * cube / np.abs(cube).max(axis=1, keepdims=True) * size
    elif kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        local = shell * _directions(count, rng) * size[0]
    elif kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        local = shell * _directions(count, rng) * size
    elif kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        local = shell * _directions(count, rng) * size[0]
        local[:, 2] += rng.uniform(-size[1], size[1], count)
    elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        disc = _directions(count, rng)[:, :2]
        disc /= np.linalg.norm(disc, axis=1, keepdims=True)
        drum = np.column_stack([disc, rng.uniform(-1, 1, count)])
        drum[::3, :2] *= np.sqrt(rng.uniform(size=(len(drum[::3]), 1)))
        drum[::3, 2] = np.sign(drum[::3, 2])
        local = shell * drum * [size[0], size[0], size[1]]
    else:
        hull = _hull(model, geom)
        picked = hull.vertices[hull.faces[rng.integers(len(hull.faces), size=count)]]
        on_surface = np.einsum("nk,nki->ni", rng.dirichlet(np.ones(3), count), picked)
        local = hull.center_mass + shell * (on_surface - hull.center_mass)
    moved: Array = local @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
    return moved


def in_geom(model: mujoco.MjModel, data: mujoco.MjData, geom: int, points: Array) -> NDArray[np.bool_]:
    """Whether points (k, 3) in the world belong to a geom, to a thousandth of a micrometre."""
    import mujoco

    kind = mujoco.mjtGeom(int(model.geom_type[geom]))
    size = model.geom_size[geom] + 1e-9
    x = (points - data.geom_xpos[geom]) @ data.geom_xmat[geom].reshape(3, 3)
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        inside = np.all(np.abs(x) <= size, axis=1)
    elif kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        inside = np.sum(x**2, axis=1) <= size[0] ** 2
    elif kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        inside = np.sum((x / size) ** 2, axis=1) <= 1
    elif kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        x[:, 2] -= np.clip(x[:, 2], -size[1], size[1])
        inside = np.sum(x**2, axis=1) <= size[0] ** 2
    elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        inside = (np.sum(x[:, :2] ** 2, axis=1) <= size[0] ** 2) & (np.abs(x[:, 2]) <= size[1])
    else:
        hull = _hull(model, geom)
        heights = x @ hull.face_normals.T - np.sum(hull.face_normals * hull.triangles[:, 0], axis=1)
        inside = np.all(heights <= 1e-9, axis=1)
    belongs: NDArray[np.bool_] = inside
    return belongs


def _hull(model: mujoco.MjModel, geom: int) -> Any:
    import mujoco
    import trimesh

    if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_MESH:
        raise ModelError("a geom of this type can't be re-checked", where=model.geom(geom).name)
    mesh = int(model.geom_dataid[geom])
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    return trimesh.PointCloud(model.mesh_vert[first : first + count].astype(float)).convex_hull


BENCHES = (
    Bench(
        "covers",
        100_000,
        "sphere covers of robots, objects and a table top: counts, overshoots, volumes, proof; "
        "n random points re-check each",
        covers,
    ),
)
