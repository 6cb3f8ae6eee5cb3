"""Random cells as MJCF: an arm among obstacles of every kind, under a stranger's options and contact rules."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from workcell.bench.strangers.arms import Arm, add_arm
from workcell.bench.strangers.elements import Draft, add_geom, numbers, turned, unit_quat

if TYPE_CHECKING:
    import mujoco

OBSTACLES = ("in the world", "fixed", "mocap", "free", "hinged")


@dataclass(frozen=True, slots=True)
class Cell:
    """A stranger's cell.

    Attributes:
        seed: that it was made from.
        files: texts by file name.
        source: the file that is opened.
        arms: by the prefix of their elements in the compiled model.
        features: what occurs in it, for people who look for the cause of a failure.
        assemble: the whole, put together by MuJoCo alone, every arm's bodies named with its prefix.
        moved: values of the cell's own joints, each driven there by an actuator of its name.
    """

    seed: int
    files: Mapping[str, str]
    source: str
    arms: Mapping[str, Arm]
    features: tuple[str, ...]
    assemble: Callable[[], mujoco.MjSpec]
    moved: Mapping[str, float] = field(default_factory=dict)


@dataclass
class Sheet:
    """An MJCF file being made, by its sections."""

    root: Element
    option: Element
    asset: Element
    world: Element
    contact: Element
    equality: Element
    actuator: Element

    @staticmethod
    def blank(name: str, rng: np.random.Generator) -> Sheet:
        """A file without elements, in radians or degrees."""
        root = Element("mujoco", model=name)
        angle = "radian" if rng.random() < 0.7 else "degree"
        SubElement(root, "compiler", angle=angle, autolimits="true", boundmass="0.01", boundinertia="0.0001")
        sections = ("option", "asset", "worldbody", "contact", "equality", "actuator")
        return Sheet(root, *(SubElement(root, section) for section in sections))

    def text(self) -> str:
        """The file; angles so far were radians, except those of frames."""
        if self.root[0].get("angle") == "degree":
            _in_degrees(self.root)
        else:
            for frame in self.root.iter("frame"):
                frame.set("euler", numbers(np.deg2rad([float(v) for v in frame.get("euler", "").split()])))
        for section in list(self.root)[1:]:
            if len(section) == 0 and not section.attrib:
                self.root.remove(section)
        indent(self.root)
        return tostring(self.root, encoding="unicode")


def random_cell(seed: int) -> Cell:
    """A cell file that holds its arm; the same seed, the same cell."""
    rng = np.random.default_rng([seed, 20261201])
    sheet = Sheet.blank(f"stranger{seed}", rng)
    draft = Draft(rng, sheet.asset, float(rng.choice([0.0, 0.3, 0.7, 1.0])))
    first = int(rng.integers(0, 3))
    total = first + int(rng.integers(1, 6))
    for _ in range(first):
        add_obstacle(draft, sheet.world)
    arm = add_arm(draft, sheet.world, sheet.actuator, sheet.equality)
    for _ in range(total - first):
        add_obstacle(draft, sheet.world)
    add_grounds(draft, sheet.world)
    set_options(draft, sheet.option)
    exclude(draft, sheet.root, sheet.contact)
    text = sheet.text()

    def assemble() -> mujoco.MjSpec:
        import mujoco

        return mujoco.MjSpec.from_string(text)

    return Cell(seed, {"cell.xml": text}, "cell.xml", {"": arm}, tuple(sorted(draft.features)), assemble)


def add_obstacle(draft: Draft, world: Element) -> None:
    """A geom in the world, or a body of it that is fixed, free, hinged or moved by the user (mocap)."""
    rng = draft.rng
    kind = str(rng.choice(OBSTACLES))
    draft.features.add(f"obstacle {kind}")
    place = rng.normal(size=3)
    place *= rng.uniform(0.25, 0.8) / np.linalg.norm(place)
    size = float(rng.uniform(0.05, 0.2))
    if kind == "in the world":
        add_geom(draft, turned(draft, world, 0.2), place, size, "block")
        return
    body = SubElement(turned(draft, world, 0.2) if kind == "fixed" else world, "body", pos=numbers(place))
    body.set("quat", numbers(unit_quat(rng)))
    draft.name(body, "thing")
    if kind == "mocap":
        body.set("mocap", "true")
    elif kind == "free":
        SubElement(body, "freejoint")
    elif kind == "hinged":
        SubElement(body, "joint", type="hinge", axis=numbers(rng.normal(size=3)), range="-1 1")
    for _ in range(int(rng.integers(1, 3))):
        add_geom(draft, body, 0.5 * size * rng.normal(size=3), size, "part")
    if kind != "mocap" and draft.chance(0.3, "obstacle in parts"):
        child = SubElement(body, "body", pos=numbers(size * rng.normal(size=3)))
        draft.name(child, "piece")
        add_geom(draft, child, np.zeros(3), 0.5 * size, "part")


def add_grounds(draft: Draft, world: Element) -> None:
    """Perhaps a plane, perhaps a height field."""
    rng = draft.rng
    if draft.chance(0.3, "plane"):
        height = -rng.uniform(0.2, 0.7)
        plane = SubElement(world, "geom", type="plane", size="2 2 0.1", pos=numbers([0, 0, height]))
        draft.name(plane, "floor")
    if draft.chance(0.15, "hfield"):
        rows, columns = (int(k) for k in rng.integers(3, 9, 2))
        field = SubElement(
            draft.asset, "hfield", name=f"hill{draft.number()}", nrow=str(rows), ncol=str(columns)
        )
        field.set("size", numbers([0.5, 0.5, rng.uniform(0.05, 0.3), 0.05]))
        field.set("elevation", numbers(rng.random(rows * columns)))
        place = [*rng.uniform(-0.4, 0.4, 2), -rng.uniform(0.1, 0.6)]
        hill = SubElement(world, "geom", type="hfield", hfield=str(field.get("name")), pos=numbers(place))
        draft.name(hill, "hill")


def set_options(draft: Draft, option: Element) -> None:
    """Options that a user may have for a simulation, and that distances must not depend on."""
    rng = draft.rng
    if draft.chance(0.15, "few ccd iterations"):
        option.set("ccd_iterations", str(rng.integers(1, 6)))
    if draft.chance(0.1, "coarse ccd"):
        option.set("ccd_tolerance", "1e-2")
    flags = {
        "nativeccd": draft.chance(0.1, "nativeccd off"),
        "filterparent": draft.chance(0.1, "filterparent off"),
        "midphase": draft.chance(0.1, "midphase off"),
    }
    off = {name: "disable" for name, is_off in flags.items() if is_off}
    if off:
        SubElement(option, "flag", off)


def exclude(draft: Draft, root: Element, contact: Element) -> None:
    """`<exclude>` for some bodies and `<pair>` for some geoms that have names."""
    rng = draft.rng
    bodies = [str(body.get("name")) for body in root.iter("body") if body.get("name")]
    geoms = [str(geom.get("name")) for geom in root.iter("geom") if geom.get("name")]
    if len(bodies) > 2 and draft.chance(0.3, "exclude"):
        first, second = rng.choice(bodies, 2, replace=False)
        SubElement(contact, "exclude", body1=str(first), body2=str(second))
    if len(geoms) > 2 and draft.chance(0.15, "pair"):
        first, second = rng.choice(geoms, 2, replace=False)
        pair = SubElement(contact, "pair", geom1=str(first), geom2=str(second))
        pair.set("margin", numbers([rng.uniform(0.0, 0.01)]))


def _in_degrees(root: Element) -> None:
    """Say in degrees what the file has said in radians: ranges and refs of hinges."""
    for joint in root.iter("joint"):
        if joint.get("type") != "hinge":
            continue
        for key in ("range", "ref"):
            value = joint.get(key)
            if value is not None:
                joint.set(key, numbers(np.rad2deg([float(v) for v in value.split()])))
