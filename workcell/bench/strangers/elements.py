"""Random parts of an MJCF file: names or none, frames, geoms of every type and their contact settings."""

from __future__ import annotations

from dataclasses import dataclass, field
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from workcell.pose import Array

SHAPES = ("sphere", "capsule", "cylinder", "box", "ellipsoid", "mesh")
"""Types of geoms that stand on a link or an obstacle; planes and height fields stand in the world alone."""


@dataclass
class Draft:
    """A file being made: its random numbers, its assets, what is in it, and how many names it has used.

    Attributes:
        rng: of everything.
        asset: the `<asset>` element.
        anonymous: the share of bodies and geoms without a name.
        features: what occurs in the file, for people who look for the cause of a failure.
    """

    rng: np.random.Generator
    asset: Element
    anonymous: float
    features: set[str] = field(default_factory=set)
    _count: int = 0
    _names: dict[str, set[str]] = field(default_factory=dict)

    def chance(self, probability: float, feature: str = "") -> bool:
        """Whether something that happens with a probability does; then it is a feature of the file."""
        happens = bool(self.rng.random() < probability)
        if happens and feature:
            self.features.add(feature)
        return happens

    def number(self) -> int:
        """A number that no other element has."""
        self._count += 1
        return self._count

    def name(self, element: Element, stem: str) -> None:
        """Give an element a name of its own, or none; sometimes that of an element of another kind, or much like it."""
        if self.chance(self.anonymous, f"nameless {element.tag}"):
            return
        kind = "actuator" if element.tag in ("motor", "position") else element.tag
        mine = self._names.setdefault(kind, set())
        others = sorted(set[str]().union(*self._names.values()) - mine)
        name = f"{stem}{self.number()}"
        if others and self.chance(0.1, "names alike"):
            alike = str(self.rng.choice(others))
            name = str(self.rng.choice([alike, f"{alike}#0", f"{alike}/{name}", f"{alike}{name}"]))
        if name not in mine:
            mine.add(name)
            element.set("name", name)


def numbers(values: Array | list[float] | tuple[float, ...]) -> str:
    """Values as an attribute has them, to the last digit."""
    return " ".join(repr(float(value)) for value in values)


def unit_quat(rng: np.random.Generator) -> Array:
    """A rotation of any kind (w, x, y, z)."""
    quat = rng.normal(size=4)
    return np.asarray(quat / np.linalg.norm(quat))


def turned(draft: Draft, parent: Element, share: float) -> Element:
    """Where an element stands that its parent, or a `<frame>` in its parent, holds."""
    if not draft.chance(share, "frame"):
        return parent
    small = 0.2 * draft.rng.normal(size=3)
    return SubElement(parent, "frame", euler=numbers(np.rad2deg(small)))


def add_geom(draft: Draft, parent: Element, centre: Array, size: float, stem: str) -> Element:
    """A geom of a random type and orientation that lies within `size` metres of `centre`."""
    rng = draft.rng
    shape = str(rng.choice(SHAPES))
    draft.features.add(shape)
    geom = SubElement(parent, "geom", type=shape, pos=numbers(centre), quat=numbers(unit_quat(rng)))
    if shape == "mesh":
        geom.set("mesh", _mesh(draft, size))
    else:
        geom.set("size", numbers(_sizes(rng, shape, size)))
    draft.name(geom, stem)
    _contact_settings(draft, geom)
    return geom


def _sizes(rng: np.random.Generator, shape: str, size: float) -> Array:
    if shape == "sphere":
        return np.array([size * rng.uniform(0.5, 1.0)])
    if shape in ("capsule", "cylinder"):
        radius, half = size * rng.uniform(0.2, 0.5), size * rng.uniform(0.2, 0.5)
        return np.array([radius, half])
    return np.asarray(size / np.sqrt(3.0) * rng.uniform(0.2, 1.0, 3))


def _mesh(draft: Draft, size: float) -> str:
    """A mesh asset of random points, with a scale and a reference pose of its own."""
    rng = draft.rng
    name = f"mesh{draft.number()}"
    points = rng.normal(size=(int(rng.integers(6, 12)), 3))
    points *= 0.6 * size * rng.uniform(0.3, 1.0, 3) / np.linalg.norm(points, axis=1).max()
    mesh = SubElement(draft.asset, "mesh", name=name)
    if draft.chance(0.4, "mesh scale"):
        scale = rng.uniform(0.5, 2.0, 3)
        if draft.chance(0.3, "mirrored mesh"):
            scale[0] *= -1.0
        points /= scale
        mesh.set("scale", numbers(scale))
    if draft.chance(0.4, "mesh refquat"):
        mesh.set("refquat", numbers(unit_quat(rng)))
        mesh.set("refpos", numbers(0.1 * size * rng.normal(size=3)))
    mesh.set("vertex", numbers(points.ravel()))
    return name


def _contact_settings(draft: Draft, geom: Element) -> None:
    rng = draft.rng
    if draft.chance(0.15, "contype"):
        contype, conaffinity = rng.choice([(1, 0), (0, 1), (3, 2), (2, 3), (0, 0)])
        geom.set("contype", str(contype))
        geom.set("conaffinity", str(conaffinity))
    if draft.chance(0.1, "margin"):
        geom.set("margin", numbers([rng.uniform(0.0, 0.02)]))
        geom.set("gap", numbers([rng.uniform(0.0, 0.01)]))
