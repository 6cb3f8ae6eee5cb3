"""Rewrites the inertials of the robot files from their collision geometry.

    python assets/robots/inertials.py

The sources publish masses, but no centres of mass and inertias that belong to our geometry. So each link gets the
inertia of its collision primitives at uniform density, scaled to the published mass that stands in the file. (Where
primitives overlap, the overlap counts twice.)
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np

ROBOTS = Path(__file__).resolve().parent
ARMS = (
    *("sawyer.xml", "ur10.xml", "iiwa14.xml", "baxter_arm.xml", "baxter.xml"),
    *("fanuc_lrmate200ic.xml", "ur5.xml", "jaco.xml", "iiwa7.xml", "hubo_arm.xml", "hubo_waist_arm.xml"),
)
FILES = (*ARMS, "parallel_gripper.xml", "linkage_gripper.xml", "shadow_hand.xml")
GEOMETRY = ("type", "size", "pos", "quat", "fromto")
INERTIAL = re.compile(r"<inertial [^>]*/>")


def uniform_inertial(geoms: list[ET.Element], mass: float) -> dict[str, str]:
    """Attributes of the inertial of solid primitives at uniform density and the given total mass."""
    root = ET.Element("mujoco")
    ET.SubElement(root, "compiler", angle="radian")
    body = ET.SubElement(ET.SubElement(root, "worldbody"), "body")
    for geom in geoms:
        ET.SubElement(body, "geom", {key: geom.attrib[key] for key in GEOMETRY if key in geom.attrib})
    model = mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))
    inertia = model.body_inertia[1] * mass / model.body_mass[1]
    return {
        "pos": _numbers(model.body_ipos[1]),
        "quat": _numbers(model.body_iquat[1]),
        "diaginertia": _numbers(inertia),
    }


def _numbers(values: np.ndarray) -> str:
    return " ".join(f"{value:.6g}" if abs(value) > 1e-13 else "0" for value in values)


def with_inertials(text: str) -> str:
    """The file's text with every inertial (of a body that has collision geometry) computed anew."""
    root = ET.fromstring(text)
    replacements = iter([_inertial(body) for body in root.iter("body") if body.find("inertial") is not None])
    return INERTIAL.sub(lambda found: next(replacements) or found.group(), text)


def _inertial(body: ET.Element) -> str | None:
    mass = body.find("inertial").attrib["mass"]  # type: ignore[union-attr]
    geoms = [geom for geom in body.findall("geom") if geom.get("class") in ("collision", "pad")]
    if not geoms:
        return None
    attributes = {"mass": mass, **uniform_inertial(geoms, float(mass))}
    return "<inertial " + " ".join(f'{key}="{value}"' for key, value in attributes.items()) + "/>"


def main() -> None:
    for name in FILES:
        path = ROBOTS / name
        path.write_text(with_inertials(path.read_text()))


if __name__ == "__main__":
    main()
