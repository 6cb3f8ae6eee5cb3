"""Random arms as URDF in a cell: limits, mimics and missing attributes mean what the URDF's rules say."""

from __future__ import annotations

from typing import TYPE_CHECKING
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from workcell.bench.strangers.arms import Arm, Follower
from workcell.bench.strangers.cells import Cell, Sheet, add_grounds, add_obstacle, set_options
from workcell.bench.strangers.elements import Draft, numbers
from workcell.pose import Array

if TYPE_CHECKING:
    import mujoco

_TASK = """format = "workcell-task/1"
cell = "cell.xml"
[[robots]]
name = "arm"
model = "arm.urdf"
mount = "mount"
"""


def random_urdf(seed: int) -> Cell:
    """A URDF arm on a site of a cell; the same seed, the same arm."""
    rng = np.random.default_rng([seed, 20261203])
    features = {"urdf"}
    sheet = Sheet.blank("cell", rng)
    draft = Draft(rng, sheet.asset, float(rng.choice([0.0, 1.0])), features)
    SubElement(sheet.world, "site", name="mount", pos=numbers(0.1 * rng.normal(size=3)))
    for _ in range(int(rng.integers(1, 6))):
        add_obstacle(draft, sheet.world)
    add_grounds(draft, sheet.world)
    set_options(draft, sheet.option)
    text, arm = _arm(rng, features)
    files = {"cell.xml": sheet.text(), "arm.urdf": text, "task.toml": _TASK}

    def assemble() -> mujoco.MjSpec:
        import mujoco

        model = mujoco.MjSpec.from_string(text)
        model.compiler.fusestatic = False
        model.body("tool_link").add_site(name="tool")
        spec = mujoco.MjSpec.from_string(files["cell.xml"])
        spec.attach(model, site=spec.site("mount"), prefix="arm/")
        return spec

    return Cell(seed, files, "task.toml", {"arm/": arm}, tuple(sorted(features)), assemble)


def _arm(rng: np.random.Generator, features: set[str]) -> tuple[str, Arm]:
    root = Element("robot", name="stranger")
    parent, bodies = _link(rng, root, "base", np.zeros(3)), 1
    driven: list[str] = []
    limits: dict[str, tuple[float, float]] = {}
    followers: list[Follower] = []
    names = [f"joint{k + 1}" for k in range(int(rng.integers(3, 8)))]
    for k, name in enumerate(names):
        along = np.eye(3)[rng.integers(3)] * rng.uniform(0.12, 0.3)
        kind = str(rng.choice(["revolute", "revolute", "revolute", "continuous", "prismatic"]))
        child = _link(rng, root, f"link{k + 1}", along)
        joint = _joint(rng, root, name, kind, parent, child, along)
        bodies, parent = bodies + 1, child
        limits[name] = _limit(rng, joint, kind, features)
        leaders = [leader for leader in driven if limits[leader][0] < limits[leader][1]]
        if kind == "revolute" and len(leaders) >= 2 and rng.random() < 0.15:
            followers.append(_mimic(rng, joint, name, str(rng.choice(leaders))))
            features.add("mimic")
            limits[name] = (-np.inf, np.inf)
            joint.set("type", "continuous")
        else:
            driven.append(name)
        if rng.random() < 0.3:
            features.add("fixed side link")
            side = _link(rng, root, f"side{k + 1}", 0.05 * rng.normal(size=3))
            _joint(rng, root, f"fixed{k + 1}", "fixed", child, side, 0.05 * rng.normal(size=3))
            bodies += 1
    for name in ("flange", "tool_link"):  # deeper than any side link: the tool is the last link
        SubElement(root, "link", name=name)
        _joint(rng, root, f"to_{name}", "fixed", parent, name, 0.1 * rng.normal(size=3))
        parent = name
    indent(root)
    arm = Arm(tuple(driven), tuple(followers), bodies + 2, "tool", limits)
    return tostring(root, encoding="unicode"), arm


def _link(rng: np.random.Generator, root: Element, name: str, along: Array) -> str:
    link = SubElement(root, "link", name=name)
    inertial = SubElement(link, "inertial")
    SubElement(inertial, "mass", value="1")
    SubElement(inertial, "inertia", ixx="0.01", iyy="0.01", izz="0.01", ixy="0", ixz="0", iyz="0")
    for tag in ("visual", "collision"):
        if rng.random() < 0.2:
            continue
        shape = SubElement(link, tag)
        SubElement(shape, "origin", xyz=numbers(-0.5 * along), rpy=numbers(rng.uniform(-3, 3, 3)))
        geometry = SubElement(shape, "geometry")
        size = rng.uniform(0.02, 0.05)
        kind = rng.integers(3)
        if kind == 0:
            SubElement(geometry, "box", size=numbers(size * rng.uniform(0.3, 1.0, 3)))
        elif kind == 1:
            SubElement(geometry, "cylinder", radius=numbers([0.5 * size]), length=numbers([size]))
        else:
            SubElement(geometry, "sphere", radius=numbers([0.7 * size]))
    return name


def _joint(
    rng: np.random.Generator, root: Element, name: str, kind: str, parent: str, child: str, along: Array
) -> Element:
    joint = SubElement(root, "joint", name=name, type=kind)
    rpy = rng.choice([0.0, np.pi / 2, -np.pi / 2, 1.5708, 3.1416, rng.uniform(-3, 3)], 3)
    SubElement(joint, "origin", xyz=numbers(along), rpy=numbers(rpy))
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    if kind != "fixed" and rng.random() < 0.9:
        axis = np.eye(3)[rng.integers(3)] * rng.choice([-1, 1]) if rng.random() < 0.7 else rng.normal(size=3)
        SubElement(joint, "axis", xyz=numbers(axis))
    return joint


def _limit(rng: np.random.Generator, joint: Element, kind: str, features: set[str]) -> tuple[float, float]:
    """A `<limit>`, perhaps without one of its ends; what it means."""
    if kind == "continuous":
        if rng.random() < 0.5:
            SubElement(joint, "limit", effort="50", velocity="2")
        return -np.inf, np.inf
    scale = 0.06 if kind == "prismatic" else 1.0
    low, high = -scale * rng.uniform(0.3, 3.5), scale * rng.uniform(0.3, 3.5)
    limit = SubElement(joint, "limit", effort="50", velocity="2")
    form = str(rng.choice(["both", "both", "both", "both", "only upper", "only lower", "locked"]))
    features.add(f"limits: {form}")
    if form == "locked":
        low = high
    if form != "only upper":
        limit.set("lower", numbers([low]))
    if form != "only lower":
        limit.set("upper", numbers([high]))
    return (0.0 if form == "only upper" else low), (0.0 if form == "only lower" else high)


def _mimic(rng: np.random.Generator, joint: Element, follower: str, leader: str) -> Follower:
    multiplier, offset = float(rng.choice([1.0, -1.0, 0.5])), float(rng.choice([0.0, 0.2]))
    mimic = SubElement(joint, "mimic", joint=leader)
    if multiplier != 1.0 or rng.random() < 0.5:
        mimic.set("multiplier", numbers([multiplier]))
    if offset != 0.0:
        mimic.set("offset", numbers([offset]))
    return Follower(follower, leader, (offset, multiplier, 0.0, 0.0, 0.0))
