"""Model files to `MjSpec` and to `Robot`: one door for our own robots, and for any MJCF or URDF that users bring."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from workcell.errors import ModelError
from workcell.model.compiled import robot_from_model
from workcell.model.data import AssetKind, find_asset
from workcell.model.robot import Robot

if TYPE_CHECKING:
    import mujoco


def load_spec(
    name: str | Path, *, kind: AssetKind = "robots", relative_to: Path | None = None
) -> mujoco.MjSpec:
    """The editable MuJoCo model of an asset name, an MJCF file or a URDF file.

    A URDF gets a torque actuator on every moving joint, since URDF has none; its `package://` references are
    looked for in the folders above the file.

    Raises:
        ModelError: missing or malformed file, with MuJoCo's own message; UnknownNameError: no asset of that name.
    """
    import mujoco

    path = find_asset(kind, name, relative_to=relative_to)
    try:
        if path.suffix.lower() == ".urdf" or "<robot" in path.read_text(errors="replace")[:2000]:
            return _load_urdf(path)
        spec = mujoco.MjSpec.from_file(str(path))
        _make_asset_paths_absolute(spec, path)
    except (ValueError, OSError, mujoco.FatalError) as error:
        raise ModelError(
            f"MuJoCo can't read this file: {_one_line(error)}", where=path, remedy="mend the file"
        ) from None
    return spec


def compile_spec(spec: mujoco.MjSpec, where: str | Path) -> mujoco.MjModel:
    """Compile, turning MuJoCo's error into a ModelError that names `where`."""
    import mujoco

    try:
        return spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise ModelError(f"MuJoCo can't compile this model: {_one_line(error)}", where=where) from None


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
    spec.compiler.discardvisual = False
    spec.compiler.fusestatic = False
    spec.meshdir = spec.texturedir = str(path.parent)
    for joint in spec.joints:
        if joint.type in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
            spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    if not list(spec.sites):
        leaf = max(spec.bodies, key=lambda body: len(_spec_ancestors(body)))
        leaf.add_site(name="tool")
    return spec


def _spec_ancestors(body: mujoco.MjsBody) -> list[mujoco.MjsBody]:
    ancestors = []
    while body is not None and body.name != "world":
        ancestors.append(body)
        body = body.parent
    return ancestors


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
