"""Names of a compiled model's bodies and geoms: what people read and write, and the ids behind them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from workcell.errors import UnknownNameError
from workcell.model.loading.labels import geom_label, shape_name

if TYPE_CHECKING:
    import mujoco


def body_name(model: mujoco.MjModel, body: int) -> str:
    """A body's name, or its number where it has none."""
    return str(model.body(body).name) or f"body {body}"


def geom_name(model: mujoco.MjModel, geom: int) -> str:
    """A geom's name, or its body's and its number in it where it has none."""
    import mujoco

    name = str(model.geom(geom).name)
    if name:
        return name
    body = int(model.geom_bodyid[geom])
    kind = mujoco.mjtGeom(int(model.geom_type[geom]))
    return geom_label(body_name(model, body), geom - int(model.body_geomadr[body]) + 1, shape_name(kind))


def obstacle_label(model: mujoco.MjModel, geom: int) -> str:
    """The name of the obstacle that a geom is part of: its body's, or its own where it belongs to the world.

    No two obstacles of a model have one name, even where a body and a geom of the world do.
    """
    import mujoco

    body = int(model.geom_bodyid[geom])
    if body > 0:
        return body_name(model, body)
    name = found = geom_name(model, geom)
    while mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, found) >= 0 or (
        found != name and mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, found) >= 0
    ):
        found = f"{found} (geom)"
    return found


def bodies_called(model: mujoco.MjModel, names: Iterable[str], where: str | Path) -> list[int]:
    """Ids of the bodies of these names; raises UnknownNameError."""
    known = {body_name(model, body): body for body in range(model.nbody)}
    return _found("body", known, names, where)


def geoms_called(model: mujoco.MjModel, names: Iterable[str], where: str | Path) -> list[int]:
    """Ids of the geoms of these names; raises UnknownNameError."""
    known = {geom_name(model, geom): geom for geom in range(model.ngeom)}
    return _found("geom", known, names, where)


def _found(kind: str, known: dict[str, int], names: Iterable[str], where: str | Path) -> list[int]:
    found = []
    for name in names:
        if name not in known:
            raise UnknownNameError(kind, name, known, where=where)
        found.append(known[name])
    return found
