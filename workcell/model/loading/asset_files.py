"""Files that a model names: meshes, height fields and textures are plain files, or the model is refused by name."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from workcell.errors import ModelError

if TYPE_CHECKING:
    import mujoco


def refuse_what_is_no_file(spec: mujoco.MjSpec, where: Path) -> None:
    """Raise ModelError where a pipe, a device or a folder stands in place of a file.

    MuJoCo would read it for ever; of what is not there at all it says so itself.
    """
    kinds = (
        ("mesh", spec.meshes, spec.meshdir),
        ("height field", spec.hfields, spec.meshdir),
        ("texture", spec.textures, spec.texturedir),
        ("skin", spec.skins, spec.meshdir),
    )
    for kind, elements, folder in kinds:
        for element in elements:
            if not element.file:
                continue
            path = where.parent / (folder or "") / str(element.file)
            if path.exists() and not path.is_file():
                raise ModelError(
                    f"the file of {kind} {element.name or element.file!r} is a pipe, a device or a folder: {path}",
                    where=where,
                    remedy="a plain file",
                )
