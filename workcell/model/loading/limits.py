"""Joint limits as a model's file means them, where MuJoCo would take the joint for unlimited without a word.

MuJoCo has no limits of zero width: it ignores a range whose ends are equal, in an MJCF file and in a URDF. Such a joint
is locked, here by an equality constraint in the model, so that whoever looks at the compiled model sees it too.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from workcell.errors import ModelError
from workcell.model.loading.couplings import HARD

if TYPE_CHECKING:
    import mujoco

LOCK = "lock:{joint}"
"""Name of the equality constraint that locks a joint."""
_MARK = 1e-300
"""Upper end of a range that stands for an explicit `range="0 0"`: MuJoCo's parser doesn't tell it from none."""
_ZERO_RANGE = re.compile(
    r"<joint\b[^>]*\brange\s*=\s*([\"'])\s*[-+]?0*\.?0*(?:e[-+]?\d+)?\s+[-+]?0*\.?0*(?:e[-+]?\d+)?\s*\1", re.I
)


def marked_source(path: Path) -> str | None:
    """The text of an MJCF file, its includes put in, with every explicit `range="0 0"` of a joint marked.

    None where there is none, and the file can be read as it is.

    Raises:
        ModelError: an included file that is missing or includes itself; ParseError: malformed XML.
    """
    if not any(_ZERO_RANGE.search(text) for text in texts_of(path)):
        return None
    root = _with_includes(path, path.parent, (path,))
    for joint in root.iter("joint"):
        if _numbers(joint.get("range")) == (0.0, 0.0):
            joint.set("range", f"0 {_MARK}")
    return ElementTree.tostring(root, encoding="unicode")


def lock_equal_limits(spec: mujoco.MjSpec) -> None:
    """Lock the joints of an MJCF model whose range has equal ends, which MuJoCo would take for unlimited.

    With `limited="true"` MuJoCo itself refuses such a range when it compiles; with `limited="false"` and zeros it is
    none. A range that stands in the file beside `limited="false"` is left, in radians, for whoever reads the model.
    """
    import mujoco

    hinge, slide = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
    for joint in spec.joints:
        low, high = map(float, joint.range)
        marked = low == 0.0 and 0.0 < high <= _MARK
        if marked:
            high = 0.0
            joint.range = [0.0, 0.0]
        if joint.type not in (hinge, slide) or joint.limited == mujoco.mjtLimited.mjLIMITED_TRUE:
            continue
        auto = joint.limited == mujoco.mjtLimited.mjLIMITED_AUTO
        equal = low == high and (low != 0.0 or (marked and auto))
        if auto and not equal:
            continue
        turn = math.pi / 180 if spec.compiler.degree and joint.type == hinge else 1.0
        joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE
        joint.range = [turn * low, turn * high]  # MuJoCo turns degrees into radians for limited joints alone
        if equal:
            _lock(spec, joint, turn * (low - float(joint.ref)))


def set_urdf_limits(spec: mujoco.MjSpec, urdf: ElementTree.Element, path: Path) -> None:
    """Give a URDF's joints the limits that its rules say: a missing `lower` or `upper` is 0, equal ones lock.

    `continuous` joints have none, whatever stands in their `<limit>`.

    Raises:
        ModelError: a revolute or prismatic joint without `<limit>` (the format asks for it), limits that are no finite
            numbers, or the wrong way round.
    """
    import mujoco

    for element in urdf.findall("joint"):
        kind, name = element.get("type"), str(element.get("name"))
        joint = spec.joint(name)
        if joint is None or kind not in ("revolute", "continuous", "prismatic"):
            continue
        if kind == "continuous":
            joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE
            joint.range = [0.0, 0.0]
            continue
        where = f"{path}: joint {name!r}"
        limit = element.find("limit")
        if limit is None:
            raise ModelError(
                f"a {kind} joint has no <limit>, which the format asks for",
                where=where,
                remedy='add <limit lower="..." upper="..." effort="..." velocity="..."/>'
                + (', or make it type="continuous"' if kind == "revolute" else ""),
            )
        low, high = _end(limit, "lower", where), _end(limit, "upper", where)
        if low > high:
            raise ModelError(f"its limits are [{low:g}, {high:g}]", where=where, remedy="lower <= upper")
        joint.range = [low, high]
        equal = low == high
        joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE if equal else mujoco.mjtLimited.mjLIMITED_TRUE
        if equal:
            _lock(spec, joint, low)


def _end(limit: ElementTree.Element, name: str, where: str) -> float:
    text = limit.get(name, "0")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ModelError(f"its {name} limit is {text!r}", where=where, remedy="a finite number")
    return value


def _lock(spec: mujoco.MjSpec, joint: mujoco.MjsJoint, deviation: float) -> None:
    """Hold a joint at a deviation (radians, metres) from its reference."""
    import mujoco

    lock = spec.add_equality(
        name=LOCK.format(joint=joint.name),
        type=mujoco.mjtEq.mjEQ_JOINT,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        name1=joint.name,
    )
    lock.data[:5] = [deviation, 0.0, 0.0, 0.0, 0.0]
    lock.solref, lock.solimp = HARD


def texts_of(path: Path, inside: tuple[Path, ...] = ()) -> list[str]:
    """The text of an MJCF file, and those of its includes; raises as `marked_source`."""
    inside, text = inside or (path,), path.read_text(encoding="utf-8")
    if "<include" not in text:
        return [text]
    found = [text]
    for element in ElementTree.fromstring(text).iter("include"):
        found += texts_of(_included(element, path, inside), (*inside, _included(element, path, inside)))
    return found


def _with_includes(path: Path, folder: Path, inside: tuple[Path, ...]) -> ElementTree.Element:
    root = ElementTree.fromstring(path.read_text(encoding="utf-8"))
    for parent in list(root.iter()):
        for element in list(parent):
            if element.tag == "include":
                place, file = list(parent).index(element), _included(element, path, inside)
                parent.remove(element)
                for k, child in enumerate(_with_includes(file, folder, (*inside, file))):
                    parent.insert(place + k, child)
    return root


def _included(element: ElementTree.Element, path: Path, inside: tuple[Path, ...]) -> Path:
    """An included file; MuJoCo looks for it from the model's own folder, then from the including file's."""
    name = element.get("file", "")
    for folder in (inside[0].parent, path.parent):
        file = folder / name
        if file.is_file():
            if file in inside:
                raise ModelError(f"the file includes itself by {name!r}", where=path)
            return file
    raise ModelError(f"the included file {name!r} is not to be found", where=path)


def _numbers(text: str | None) -> tuple[float, ...]:
    try:
        return tuple(map(float, (text or "").split()))
    except ValueError:
        return ()
