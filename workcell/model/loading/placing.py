"""Objects in a cell: attached where a site stands, free or fixed, moved a little by a seed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from workcell.errors import ModelError, UnknownNameError
from workcell.model.loading.labels import keep_apart
from workcell.model.loading.load import load_spec
from workcell.model.loading.taskfile import ObjectEntry, TaskFile
from workcell.pose import Pose

if TYPE_CHECKING:
    import mujoco


def cell_site(spec: mujoco.MjSpec, name: str, where: str) -> mujoco.MjsSite:
    """The site of that name; raises UnknownNameError with the sites that are there."""
    site = spec.site(name)
    if site is None:
        raise UnknownNameError("site", name, [s.name for s in spec.sites], where=where)
    return site


def variation(entry: ObjectEntry, index: int, seed: int | None) -> Pose:
    """By how much a seed moves an object in its place; an object's draw does not depend on the others'."""
    if seed is None:
        return Pose.identity()
    rng = np.random.default_rng([seed, index])
    half = np.array(entry.vary_xyz)
    yaw = rng.uniform(-entry.vary_yaw, entry.vary_yaw)
    quat = np.array([np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])
    return Pose(rng.uniform(-half, half), quat)


def attach_object(
    spec: mujoco.MjSpec, entry: ObjectEntry, task: TaskFile, moved: Pose, places: mujoco.MjModel | None
) -> mujoco.MjsBody:
    """Attach an object to a cell at its site.

    Args:
        spec: the cell.
        entry, task: the object, and the file that names it.
        moved: by how much it stands elsewhere, in the site's frame.
        places: the cell compiled by itself, where sites stand as their angles and frames say; None: nothing is free.

    Returns:
        The object's root body.

    Raises:
        ModelError: no single root body, geometry beside it, a site on a body, a free object's root with a joint of its
            own, or a name that is there already; UnknownNameError: no such site.
    """
    where = f"{task.path}: object {entry.name!r}"
    model = load_spec(
        entry.model, kind="objects", relative_to=task.path.parent, where=f"{where} model", root=entry.name
    )
    roots = list(model.worldbody.bodies)
    if len(roots) != 1:
        raise ModelError(f"an object file holds one root body, not {len(roots)}", where=where)
    beside = list(model.worldbody.geoms)
    if beside and not entry.fixed:
        raise ModelError(
            f"the geom {beside[0].name!r} of an object that moves lies beside its body {roots[0].name!r}",
            where=where,
            remedy="put it into the body, or the object with fixed = true",
        )
    root, prefix = roots[0], f"{entry.name}/"
    keep_apart(spec, model, prefix, where)
    place = cell_site(spec, entry.place, f"{where} place")
    if entry.fixed or places is None:
        _without_free_joint(model)
        spec.attach(model, site=place, prefix=prefix)
        return root
    if place.parent.name != "world" or place.name not in {places.site(k).name for k in range(places.nsite)}:
        raise ModelError(f"the site {place.name!r} must belong to the cell's world body", where=where)
    _without_free_joint(model)
    if list(root.joints):
        raise ModelError(
            f"the root body {root.name!r} has the joint {root.joints[0].name!r}",
            where=where,
            remedy="fixed = true, or the joint on a body of its own, inside of one that moves freely",
        )
    site = places.site(entry.place)
    stands = Pose(site.pos, site.quat) @ moved
    frame = spec.worldbody.add_frame(pos=stands.position, quat=stands.quat_wxyz)
    spec.attach(model, frame=frame, prefix=prefix)
    root.add_freejoint(name=prefix + "free")
    return root


def _without_free_joint(model: mujoco.MjSpec) -> None:
    """Take away the free joint that an object's file may give its root: the task says whether it is free."""
    import mujoco

    for joint in list(model.worldbody.bodies[0].joints):
        if joint.type == mujoco.mjtJoint.mjJNT_FREE:
            model.delete(joint)
