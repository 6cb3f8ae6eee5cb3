"""Labels for what a model file leaves without a name: readable, unique in their kind, given at the door.

Names are for people. What belongs to what is known by subtree and id (`workcell.model.loading.subtrees`).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from workcell.errors import ModelError

if TYPE_CHECKING:
    import mujoco

KINDS = {
    "body": "bodies",
    "geom": "geoms",
    "site": "sites",
    "joint": "joints",
    "tendon": "tendons",
    "actuator": "actuators",
    "equality": "equalities",
}
"""Kinds of elements, each with names of its own, and where a `MjSpec` lists them."""

_LABEL = re.compile(
    r"(.*/)?(body|geom|site|tendon|actuator|equality) \d+( \(\w+\)| of .*)?( ~\d+)?|(free joint|joint \d+) of .*"
)


def geom_label(body: str, number: int, shape: str) -> str:
    """The label of a geom without a name: the `number`-th (from 1) of its body."""
    return f"{body}/geom {number} ({shape})"


def shape_name(kind: mujoco.mjtGeom) -> str:
    """A geom's kind in a word: box, sphere, mesh."""
    return str(kind.name).removeprefix("mjGEOM_").lower()


def label(spec: mujoco.MjSpec, root: str = "") -> None:
    """Give every body, geom, site, joint, tendon, actuator and equality without a name a label.

    A nameless body is called after the nearest body with a name above it, everything in a body after that body. No
    name that the file gives is changed, and no label is one of them.

    Args:
        spec: the file's model, changed.
        root: the label of a root body, where it is the only one; empty: one like any other's.
    """
    roots = list(spec.worldbody.bodies)
    if root and len(roots) == 1 and not roots[0].name:
        roots[0].name = root
    taken = {kind: {one.name for one in getattr(spec, several)} for kind, several in KINDS.items()}

    def give(kind: str, element: Any, wanted: str) -> None:
        if not element.name:
            element.name = _free(wanted, taken[kind])
            taken[kind].add(element.name)

    for body, wanted in _bodies(spec):
        give("body", body, wanted)
        for k, geom in enumerate(body.geoms, start=1):
            give("geom", geom, geom_label(body.name, k, shape_name(geom.type)))
        for k, site in enumerate(body.sites, start=1):
            give("site", site, f"{body.name}/site {k}")
        for k, joint in enumerate(body.joints, start=1):
            free = joint.type.name == "mjJNT_FREE"
            give("joint", joint, f"free joint of {body.name}" if free else f"joint {k} of {body.name}")
    for k, tendon in enumerate(spec.tendons, start=1):
        give("tendon", tendon, f"tendon {k}")
    for k, actuator in enumerate(spec.actuators, start=1):
        give(
            "actuator", actuator, f"actuator {k} of {actuator.target}" if actuator.target else f"actuator {k}"
        )
    for k, equality in enumerate(spec.equalities, start=1):
        kind = equality.type.name.removeprefix("mjEQ_").lower()
        give("equality", equality, f"equality {k} ({kind})")


def keep_apart(parent: mujoco.MjSpec, child: mujoco.MjSpec, prefix: str, where: str) -> None:
    """Make sure that nothing of a model to be attached gets a name that is there already.

    A label gives way to what is there; a name that a file gives is not changed.

    Raises:
        ModelError: both have an element of one name.
    """
    for kind, several in KINDS.items():
        taken = {one.name for one in getattr(parent, several)}
        own = {one.name for one in getattr(child, several)}
        for element in getattr(child, several):
            name = str(element.name)
            if (kind == "body" and name == "world") or prefix + name not in taken:
                continue
            if not _LABEL.fullmatch(name):
                raise ModelError(
                    f"there is a {kind} {prefix + name!r} already, which is what the {kind} {name!r} "
                    "of this model would be called",
                    where=where,
                    remedy="another name in the task file, or another in the model",
                )
            element.name = _free(name, own | {one.removeprefix(prefix) for one in taken})
            own.add(element.name)


def _bodies(spec: mujoco.MjSpec) -> Iterator[tuple[Any, str]]:
    """Every body, parents first, with the label that it has where it has no name."""
    counts: dict[str, int] = {}

    def below(body: Any, named: str) -> Iterator[tuple[Any, str]]:
        for child in body.bodies:
            above = str(child.name) or named
            wanted = ""
            if not child.name:
                counts[named] = counts.get(named, 0) + 1
                wanted = f"{named}/body {counts[named]}" if named else f"body {counts[named]}"
            yield child, wanted
            yield from below(child, above)

    yield spec.worldbody, "world"
    yield from below(spec.worldbody, "")


def _free(wanted: str, taken: set[str]) -> str:
    """The wanted label, or one like it that is not taken."""
    found, number = wanted, 2
    while found in taken:
        found, number = f"{wanted} ~{number}", number + 1
    return found
