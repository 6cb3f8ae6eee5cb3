"""Random arms as MJCF: several joints in a body, joints off its origin, skew axes, followers, side bodies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from workcell.bench.strangers.elements import Draft, add_geom, numbers, turned, unit_quat
from workcell.pose import Array


@dataclass(frozen=True, slots=True)
class Follower:
    """A joint that an equality makes a polynomial of another's value (both without their `ref`)."""

    name: str
    leader: str
    polycoef: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Arm:
    """What the file says about an arm.

    Attributes:
        driven: its actuated joints, base first.
        followers: joints that follow others.
        bodies: how many bodies it has, the root among them.
        tool: the name of its tool site.
        limits: of joints whose limits the compiled model does not have as the file means them.
    """

    driven: tuple[str, ...]
    followers: tuple[Follower, ...]
    bodies: int
    tool: str
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)


def add_arm(draft: Draft, world: Element, actuators: Element, equalities: Element) -> Arm:
    """An arm of three to seven joints under the world, with its actuators and couplings."""
    rng = draft.rng
    count = int(rng.integers(3, 8))
    root = SubElement(world, "body", pos=numbers([*(0.1 * rng.normal(size=2)), rng.uniform(0.0, 0.4)]))
    draft.name(root, "base")
    if draft.chance(0.5):
        root.set("quat", numbers(unit_quat(rng)))
    if draft.chance(0.7):
        add_geom(draft, root, np.array([0.0, 0.0, -0.02]), 0.06, "foot")
    driven: list[str] = []
    followers: list[Follower] = []
    locked: dict[str, tuple[float, float]] = {}
    body, bodies, left = root, 1, count
    while left > 0:
        reach = _offset(rng)
        body = SubElement(turned(draft, body, 0.15), "body", pos=numbers(reach))
        draft.name(body, "link")
        if draft.chance(0.5):
            body.set("quat", numbers(unit_quat(rng)))
        bodies += 1
        in_body = min(left, int(rng.choice([1, 1, 1, 1, 2])))
        if in_body > 1:
            draft.features.add("several joints in a body")
        for _ in range(in_body):
            name = _add_joint(draft, body, locked)
            left -= 1
            leaders = [leader for leader in driven if leader not in locked]
            if leaders and len(driven) + left >= 3 and draft.chance(0.06, "coupling"):
                followers.append(_follow(draft, equalities, name, str(rng.choice(leaders))))
                continue
            driven.append(name)
        bodies += _add_flesh(draft, body, _offset(rng))
    tool = "tool" if draft.chance(0.7) else "flange"
    SubElement(body, "site", name=tool, pos=numbers(_offset(rng)), quat=numbers(unit_quat(rng)))
    for name in driven:
        kind = "position" if draft.chance(0.2, "position actuator") else "motor"
        actuator = SubElement(actuators, kind, joint=name)
        if kind == "position":
            actuator.set("kp", "200")
        draft.name(actuator, "drive")
    return Arm(tuple(driven), tuple(followers), bodies, tool, locked)


def _offset(rng: np.random.Generator) -> Array:
    """From one joint to the next, mostly along an axis."""
    if rng.random() < 0.6:
        return np.asarray(np.eye(3)[rng.integers(3)] * rng.uniform(0.12, 0.3) * rng.choice([-1.0, 1.0]))
    return np.asarray(0.12 * rng.normal(size=3))


def _add_joint(draft: Draft, body: Element, locked: dict[str, tuple[float, float]]) -> str:
    rng = draft.rng
    slide = draft.chance(0.12, "slide")
    name = f"joint{draft.number()}"
    axis = (
        rng.normal(size=3)
        if draft.chance(0.3, "skew axis")
        else np.eye(3)[rng.integers(3)] * rng.choice([-1, 1])
    )
    joint = SubElement(body, "joint", name=name, type="slide" if slide else "hinge")
    joint.set("axis", numbers(axis * (rng.uniform(0.3, 3.0) if draft.chance(0.3, "scaled axis") else 1.0)))
    if draft.chance(0.25, "joint pos"):
        joint.set("pos", numbers(0.04 * rng.normal(size=3)))
    low, high = -rng.choice([0.6, 1.5, 2.9, np.pi, 5.0]), rng.choice([0.6, 1.5, 2.9, np.pi, 6.2])
    if slide:
        low, high = 0.06 * low, 0.06 * high
    if draft.chance(0.2, "joint ref"):
        joint.set("ref", numbers([rng.uniform(-0.5, 0.5) * (0.1 if slide else 1.0)]))
    if draft.chance(0.1, "range without zero"):
        low = 0.2 * high
    if draft.chance(0.05, "limits: locked"):
        low = high = float(rng.choice([0.0, low, high]))
        locked[name] = (low, high)
    joint.set("range", numbers([low, high]))
    if draft.chance(0.1, "damping"):
        joint.set("damping", "1")
    return name


def _follow(draft: Draft, equalities: Element, follower: str, leader: str) -> Follower:
    rng = draft.rng
    gain = float(rng.choice([1.0, -1.0, 0.5, rng.uniform(-1.0, 1.0)]))
    polycoef = (0.0, gain, 0.0, 0.0, 0.0)
    element = SubElement(equalities, "joint", joint1=follower, joint2=leader)
    element.set("polycoef", numbers(polycoef))
    draft.name(element, "gear")
    return Follower(follower, leader, polycoef)


def _add_flesh(draft: Draft, body: Element, along: Array) -> int:
    """Geoms of a link, some on bodies of their own that are fixed to it; how many bodies those are."""
    more = 0
    for share in (0.8, 0.3):
        if draft.chance(share):
            add_geom(draft, body, 0.5 * along, float(draft.rng.uniform(0.02, 0.05)), "skin")
    if draft.chance(0.3, "side body"):
        bracket = SubElement(turned(draft, body, 0.2), "body", pos=numbers(0.6 * along))
        draft.name(bracket, "bracket")
        add_geom(
            draft, bracket, 0.04 * draft.rng.normal(size=3), float(draft.rng.uniform(0.02, 0.06)), "blade"
        )
        more += 1
        if draft.chance(0.3):
            deeper = SubElement(bracket, "body", pos=numbers(0.03 * draft.rng.normal(size=3)))
            draft.name(deeper, "tip")
            add_geom(draft, deeper, np.zeros(3), 0.03, "blade")
            more += 1
    return more
