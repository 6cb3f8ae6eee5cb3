"""Random tasks: arms mounted in a cell or on each other, on fixed and moving parts, with tools fixed to them."""

from __future__ import annotations

from typing import TYPE_CHECKING
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from workcell.bench.strangers.arms import Arm, add_arm
from workcell.bench.strangers.cells import (
    Cell,
    Sheet,
    add_grounds,
    add_obstacle,
    exclude,
    set_options,
)
from workcell.bench.strangers.elements import Draft, add_geom, numbers, unit_quat

if TYPE_CHECKING:
    import mujoco


TRAVEL = 0.5
"""Radians or metres that a cell's carriage and lift go either way."""


def random_task(seed: int) -> Cell:
    """A task file with a cell, arms and objects in files of their own; the same seed, the same task."""
    rng = np.random.default_rng([seed, 20261202])
    anonymous = float(rng.choice([0.0, 0.3, 0.7, 1.0]))
    features: set[str] = {"task"}
    sites = _places(rng, features)
    files: dict[str, str] = {}
    arms: dict[str, Arm] = {}
    mounts: dict[str, str] = {}
    for k in range(int(rng.choice([1, 1, 2]))):
        name = ("arm", "arm2")[k]
        files[f"{name}.xml"], arms[f"{name}/"] = _arm_file(rng, name, anonymous, features)
        on_other = k == 1 and rng.random() < 0.4
        mounts[name] = f"arm/{arms['arm/'].tool}" if on_other else str(rng.choice(list(sites)))
        features |= {"arm on arm"} if on_other else set()
    files["cell.xml"] = _cell_file(rng, sites, anonymous, features)
    objects: dict[str, tuple[str, bool]] = {}
    if rng.random() < 0.5:
        features.add("object fixed to a hand")
        last = list(arms)[-1]
        objects["drill"] = (last + arms[last].tool, True)
    if rng.random() < 0.5:
        features.add("object")
        objects["cup"] = ("on_ground", bool(rng.random() < 0.3))
    for name in objects:
        files[f"{name}.xml"] = _object_file(rng, anonymous, features)
    files["task.toml"] = _task_text(mounts, objects)
    moved: dict[str, float] = {}
    if all(fixed for _, fixed in objects.values()) and rng.random() < 0.5:  # a free one could stop it
        features.add("carriage moved")
        moved = {name: float(rng.uniform(-TRAVEL, TRAVEL)) for name in ("carriage", "lift")}

    def assemble() -> mujoco.MjSpec:
        return _assemble(files, mounts, objects)

    return Cell(seed, files, "task.toml", arms, tuple(sorted(features)), assemble, moved)


def _places(rng: np.random.Generator, features: set[str]) -> dict[str, Element]:
    """Bodies (or the world, for None) with a site where an arm may be mounted."""
    sites: dict[str, Element] = {}
    for k, kind in enumerate(("world", "fixed", "carriage", "lift", "mocap")):
        site = Element(
            "site", name=f"on_{kind}", pos=numbers(0.1 * rng.normal(size=3)), quat=numbers(unit_quat(rng))
        )
        if kind == "world":
            sites["on_world"] = site
            continue
        body = Element(
            "body", pos=numbers([0.6 * (k - 2), 0.5 * rng.normal(), 0.3]), quat=numbers(unit_quat(rng))
        )
        if kind == "mocap":
            body.set("mocap", "true")
        elif kind in ("carriage", "lift"):
            joint = SubElement(
                body, "joint", type="slide" if kind == "lift" else "hinge", axis=numbers(rng.normal(size=3))
            )
            joint.set("name", kind)
            joint.set("range", numbers([-TRAVEL, TRAVEL]))
            joint.set("ref", numbers([rng.uniform(-0.4, 0.4)]))
            SubElement(body, "geom", type="sphere", size="0.01", contype="0", conaffinity="0")
        body.append(site)
        sites[f"on_{kind}"] = body
    return sites


def _arm_file(rng: np.random.Generator, name: str, anonymous: float, features: set[str]) -> tuple[str, Arm]:
    sheet = Sheet.blank(name, rng)
    draft = Draft(rng, sheet.asset, anonymous, features)
    arm = add_arm(draft, sheet.world, sheet.actuator, sheet.equality)
    exclude(draft, sheet.root, sheet.contact)
    return sheet.text(), arm


def _cell_file(
    rng: np.random.Generator, sites: dict[str, Element], anonymous: float, features: set[str]
) -> str:
    sheet = Sheet.blank("cell", rng)
    sheet.root[0].set("angle", "radian")
    draft = Draft(rng, sheet.asset, anonymous, features)
    for place in sites.values():
        sheet.world.append(place)
    for name in ("carriage", "lift"):
        limits = numbers([-TRAVEL, TRAVEL])
        SubElement(sheet.actuator, "position", name=name, joint=name, kp="100", ctrlrange=limits)
    SubElement(sheet.world, "site", name="on_ground", pos=numbers([0.3, 0.3, 0.0]))
    for _ in range(int(rng.integers(1, 6))):
        add_obstacle(draft, sheet.world)
    if rng.random() < 0.2:
        features.add("body named like an arm's")
        body = SubElement(sheet.world, "body", name="arm/odd", pos=numbers(0.5 * rng.normal(size=3)))
        add_geom(draft, body, np.zeros(3), 0.1, "part")
    add_grounds(draft, sheet.world)
    set_options(draft, sheet.option)
    return sheet.text()


def _object_file(rng: np.random.Generator, anonymous: float, features: set[str]) -> str:
    sheet = Sheet.blank("object", rng)
    draft = Draft(rng, sheet.asset, anonymous, features)
    body = SubElement(sheet.world, "body")
    draft.name(body, "thing")
    add_geom(draft, body, 0.02 * rng.normal(size=3), 0.05, "part")
    if draft.chance(0.5, "object in parts"):
        handle = SubElement(body, "body", pos=numbers(0.05 * rng.normal(size=3)))
        draft.name(handle, "handle")
        add_geom(draft, handle, np.zeros(3), 0.04, "part")
    return sheet.text()


def _task_text(mounts: dict[str, str], objects: dict[str, tuple[str, bool]]) -> str:
    lines = ['format = "workcell-task/1"', 'cell = "cell.xml"']
    for name, mount in mounts.items():
        lines += ["[[robots]]", f'name = "{name}"', f'model = "{name}.xml"', f'mount = "{mount}"']
    for name, (place, fixed) in objects.items():
        lines += ["[[objects]]", f'name = "{name}"', f'model = "{name}.xml"', f'place = "{place}"']
        lines += [f"fixed = {str(fixed).lower()}"]
    return "\n".join(lines) + "\n"


def _assemble(
    files: dict[str, str], mounts: dict[str, str], objects: dict[str, tuple[str, bool]]
) -> mujoco.MjSpec:
    """The task put together by `MjSpec.attach`; all bodies of an arm have names, which begin with its prefix."""
    import mujoco

    spec = mujoco.MjSpec.from_string(files["cell.xml"])
    for name, mount in mounts.items():
        arm = _labelled(mujoco.MjSpec.from_string(files[f"{name}.xml"]))
        spec.attach(arm, site=spec.site(mount), prefix=f"{name}/")
    for name, (place, fixed) in objects.items():
        thing, site = _labelled(mujoco.MjSpec.from_string(files[f"{name}.xml"])), spec.site(place)
        root = str(next(iter(thing.worldbody.bodies)).name)
        if fixed:
            spec.attach(thing, site=site, prefix=f"{name}/")
            continue
        frame = spec.worldbody.add_frame(pos=site.pos, quat=site.quat)
        spec.attach(thing, frame=frame, prefix=f"{name}/")
        spec.body(f"{name}/{root}").add_freejoint()
    return spec


def _labelled(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    for number, body in enumerate(spec.bodies):
        if not body.name:
            body.name = f"nameless body {number}"
    return spec
