"""Model files to `MjSpec` and to `Robot`: one door for our own robots, and for any MJCF or URDF of users."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np

from workcell.errors import ModelError
from workcell.model.loading.asset_files import refuse_what_is_no_file
from workcell.model.loading.assets import MODEL_SUFFIXES, AssetKind, find_asset
from workcell.model.loading.compiled import VELOCITY, robot_from_model
from workcell.model.loading.field_sizes import check_field_sizes, refuse_large_grids
from workcell.model.loading.labels import label
from workcell.model.loading.limits import lock_equal_limits, marked_source, set_urdf_limits
from workcell.model.loading.tool_link import tool_link
from workcell.model.loading.warnings import quiet_mujoco
from workcell.model.robot import Robot

if TYPE_CHECKING:
    import mujoco


def load_spec(
    name: str | Path,
    *,
    kind: AssetKind = "robots",
    relative_to: Path | None = None,
    where: str | None = None,
    root: str = "",
) -> mujoco.MjSpec:
    """The editable MuJoCo model of an asset name, an MJCF file or a URDF file.

    A URDF gets a torque actuator on every moving joint, since URDF has none, and keeps its velocity limits; its
    `package://` references are looked for in the folders above the file. What the file leaves without a name gets a
    label (`workcell.model.loading.labels`).

    Args:
        name: of an asset, or the path of a file.
        kind: of asset.
        relative_to: folder that relative paths start from; the working directory otherwise.
        where: what names the model, for messages.
        root: what a root body without a name is called, where it is the only one.

    Raises:
        ModelError: missing or malformed file, with MuJoCo's own message; UnknownNameError: no asset of that name.
    """
    import mujoco

    path = find_asset(kind, name, relative_to=relative_to, where=where)
    if path.suffix.lower() not in MODEL_SUFFIXES:
        raise ModelError(
            "this is not the name of a model file",
            where=path,
            remedy=f"it ends in {', '.join(MODEL_SUFFIXES)}",
        )
    try:
        with quiet_mujoco(path):
            if path.suffix.lower() == ".urdf" or "<robot" in path.read_text(errors="replace")[:2000]:
                spec = _load_urdf(path)
                refuse_what_is_no_file(spec, path)
                label(spec, root)
            else:
                refuse_large_grids(path)
                spec = _mjcf(path)
                refuse_what_is_no_file(spec, path)
                label(spec, root)
                lock_equal_limits(spec)
    except UnicodeDecodeError:
        raise ModelError(
            "this is not a text file", where=path, remedy="an MJCF or URDF file is one"
        ) from None
    except ElementTree.ParseError as error:
        raise ModelError(f"this is not XML: {error}", where=path) from None
    except (ValueError, OSError, mujoco.FatalError) as error:
        raise ModelError(
            f"MuJoCo can't read this file: {_one_line(error)}", where=path, remedy="mend the file"
        ) from None
    spec.compiler.fusestatic = False  # every body of the file is one of the model
    return spec


def compile_spec(spec: mujoco.MjSpec, where: str | Path) -> mujoco.MjModel:
    """Compile, turning MuJoCo's error into a ModelError that names `where`; too large height fields are refused."""
    import mujoco

    check_field_sizes(spec, where)
    try:
        with quiet_mujoco(where):
            model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise ModelError(f"MuJoCo can't compile this model: {_one_line(error)}", where=where) from None
    for kind in ("body", "geom", "site"):
        places = np.hstack([getattr(model, f"{kind}_pos"), getattr(model, f"{kind}_quat")])
        for index in np.flatnonzero(~np.isfinite(places).all(axis=1)):
            name = getattr(model, kind)(int(index)).name or f"number {index}"
            raise ModelError(f"the pose of {kind} {name!r} is not finite", where=where)
    return model


def load_robot(name: str | Path, tool: str | None = None) -> Robot:
    """The kinematics of a robot file: base at the world's origin, as the file has it.

    Raises:
        ModelError, UnknownNameError: as `load_spec` and `robot_from_model`.
    """
    return load_compiled(name, tool)[1]


def load_compiled(name: str | Path, tool: str | None = None) -> tuple[mujoco.MjModel, Robot]:
    """A robot file compiled by itself, and its kinematics; raises as `load_robot`."""
    path = find_asset("robots", name)
    model = compile_spec(load_spec(path), path)
    return model, robot_from_model(model, name=path.stem, tool=tool, where=path)


def _mjcf(path: Path) -> mujoco.MjSpec:
    import mujoco

    try:
        marked = marked_source(path)
    except ElementTree.ParseError:
        marked = None  # MuJoCo says better what is wrong with it
    if marked is not None:
        spec = mujoco.MjSpec.from_string(marked)
    elif path.suffix.lower() == ".xml":
        spec = mujoco.MjSpec.from_file(str(path))
    else:
        spec = mujoco.MjSpec.from_string(path.read_text(encoding="utf-8"))
    _make_asset_paths_absolute(spec, path)
    return spec


def _make_asset_paths_absolute(spec: mujoco.MjSpec, path: Path) -> None:
    """Mesh files stay findable after the spec is attached to a model that lives in another folder."""
    for attribute in ("meshdir", "texturedir"):
        folder = Path(getattr(spec, attribute) or ".")
        setattr(spec, attribute, str(folder if folder.is_absolute() else path.parent / folder))


def _load_urdf(path: Path) -> mujoco.MjSpec:
    import mujoco

    text = re.sub(
        r"package://[^/\"']+/([^\"']+)", lambda m: str(_find_package_file(path, m.group(1))), path.read_text()
    )
    spec = mujoco.MjSpec.from_string(text)
    robot = ElementTree.fromstring(text)
    set_urdf_limits(spec, robot, path)
    spec.compiler.discardvisual = False
    spec.meshdir = spec.texturedir = str(path.parent)
    for joint in spec.joints:
        if joint.type in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
            spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    for name, velocity in _velocity_limits(robot, path).items():
        spec.add_numeric(name=name + VELOCITY, data=[velocity])
    if not list(spec.sites):
        tool_link(spec).add_site(name="tool")
    return spec


def _velocity_limits(urdf: ElementTree.Element, path: Path) -> dict[str, float]:
    """The velocity limits of a URDF's joints by name, where it gives them; MuJoCo leaves them out."""
    limits = {}
    for joint in urdf.findall("joint"):
        limit = joint.find("limit")
        text = None if limit is None else limit.get("velocity")
        if text is None or joint.get("type") not in ("revolute", "continuous", "prismatic"):
            continue
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not 0 <= value < math.inf:
            raise ModelError(
                f"joint {joint.get('name')!r} has the velocity limit {text!r}", where=path, remedy="a number"
            )
        if value > 0:  # exporters write 0 where they know none
            limits[str(joint.get("name"))] = value
    return limits


def _find_package_file(urdf: Path, relative: str) -> Path:
    for folder in urdf.parents:
        for candidate in (folder / relative, folder / Path(relative).name):
            if candidate.is_file():
                return candidate
    raise ModelError(
        f"the file package://.../{relative} is not to be found", where=urdf, remedy="put it beside the URDF"
    )


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
