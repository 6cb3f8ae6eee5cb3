"""Boxes of a scene that stand still, on whose faces contacts can be."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from workcell.errors import InputError, UnknownNameError
from workcell.model.labels import body_name, geom_name
from workcell.model.loading.labels import shape_name
from workcell.model.mechanism.mechanism import WORLD, Mechanism
from workcell.pose import Array, Pose

if TYPE_CHECKING:
    import mujoco


def standing_box(mechanism: Mechanism, name: str, where: str | Path) -> tuple[str, Pose, Array]:
    """A box geom that no joint of the mechanism moves: its name, `T_world_box`, and its half sizes (3,).

    Args:
        mechanism: inside its compiled model.
        name: of the geom, or of a body with one box geom.
        where: for messages.

    Raises:
        UnknownNameError: no such geom or body. InputError: it is no box, or the mechanism moves it.
    """
    import mujoco

    compiled = mechanism.compiled
    if compiled is None:
        raise InputError(f"{mechanism.name} comes from no compiled model, where boxes could be", where=where)
    model = compiled.model
    geom = _box_called(model, name, where)
    if int(compiled.link_of_body[model.geom_bodyid[geom]]) != WORLD:
        raise InputError(
            f"{name!r} moves with the mechanism: a contact on it is not convex",
            where=where,
            remedy="a box that stands still, or a grasp ([[held]])",
        )
    data = mujoco.MjData(model)
    data.qpos[:] = compiled.start
    mujoco.mj_kinematics(model, data)
    T = Pose.from_rotation(np.array(data.geom_xpos[geom]), np.array(data.geom_xmat[geom]).reshape(3, 3))
    return geom_name(model, geom), T, np.array(model.geom_size[geom])


def body_geoms(mechanism: Mechanism, frame: str) -> tuple[str, ...]:
    """Names of the geoms that can collide on the body that carries a frame (a site's body, or the body itself)."""
    compiled = mechanism.compiled
    assert compiled is not None
    model, name = compiled.model, mechanism.frame(frame).name
    sites = [str(model.site(site).name) for site in range(model.nsite)]
    body = int(model.site_bodyid[sites.index(name)]) if name in sites else int(model.body(name).id)
    solid = (np.asarray(model.geom_contype) != 0) | (np.asarray(model.geom_conaffinity) != 0)
    return tuple(geom_name(model, int(g)) for g in np.flatnonzero(solid & (model.geom_bodyid == body)))


def _box_called(model: mujoco.MjModel, name: str, where: str | Path) -> int:
    """The id of the box of that name, or of the one box of the body of that name."""
    import mujoco

    box = int(mujoco.mjtGeom.mjGEOM_BOX)
    geoms = {geom_name(model, geom): geom for geom in range(model.ngeom)}
    if name in geoms:
        kind = int(model.geom_type[geoms[name]])
        if kind != box:
            raise InputError(
                f"{name!r} is a {shape_name(mujoco.mjtGeom(kind))}, not a box",
                where=where,
                remedy="regions ([[region]]) take planes of any kind",
            )
        return geoms[name]
    bodies = {body_name(model, body): body for body in range(model.nbody)}
    if name not in bodies:
        raise UnknownNameError("geom or body", name, {*geoms, *bodies}, where=where)
    inside = [
        geom
        for geom in range(model.ngeom)
        if int(model.geom_bodyid[geom]) == bodies[name] and int(model.geom_type[geom]) == box
    ]
    if len(inside) != 1:
        listed = ", ".join(geom_name(model, geom) for geom in inside)
        raise InputError(
            f"the body {name!r} has {len(inside)} boxes",
            where=where,
            remedy=f"name one of its geoms: {listed}" if inside else "a box geom",
        )
    return inside[0]
