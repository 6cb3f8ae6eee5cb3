"""Where robots, objects, cells and tasks are found: one lookup for an editable install and for a wheel."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Literal

from workcell.errors import ModelError, UnknownNameError
from workcell.files import expanded

AssetKind = Literal["robots", "objects", "cells"]

_SINGULAR = {"robots": "robot", "objects": "object", "cells": "cell"}
MODEL_SUFFIXES = (".xml", ".mjcf", ".urdf")


@cache
def data_root() -> Path:
    """The folder that holds `assets/` and `tasks/`: inside the package in a wheel, the repository otherwise."""
    package = Path(__file__).resolve().parents[2]
    for root in (package / "_data", package.parent):
        if (root / "assets").is_dir() and (root / "tasks").is_dir():
            return root
    raise ModelError("the assets of workcell are missing", where=package, remedy="reinstall the package")


def list_assets(kind: AssetKind) -> list[str]:
    """Names of the robots, objects or cells that travel with workcell."""
    return sorted(path.stem for path in (data_root() / "assets" / kind).glob("*.xml"))


def is_path(name: str | Path) -> bool:
    """Whether a model's name is a path: anything with a separator or the suffix of a model file."""
    text = str(name)
    return Path(text).suffix.lower() in MODEL_SUFFIXES or "/" in text or "\\" in text


def find_asset(
    kind: AssetKind, name: str | Path, *, relative_to: Path | None = None, where: str | None = None
) -> Path:
    """The model file of a name (`assets/<kind>/<name>.xml`) or of a path.

    Args:
        kind: robots, objects or cells.
        name: a bare name, or a path (anything with a separator or a model suffix).
        relative_to: folder that relative paths start from; the working directory otherwise.
        where: what gives the name, for messages.

    Raises:
        ModelError: the path does not exist; UnknownNameError: no asset of that name.
    """
    text = str(name)
    if is_path(text):
        path = expanded(Path(text))
        path = path if path.is_absolute() or relative_to is None else relative_to / path
        if not path.is_file():
            raise ModelError(
                "there is no such file" if not path.is_dir() else "this is a folder, not a model file",
                where=path if where is None else f"{where}: {path}",
                remedy=f"give an MJCF or URDF file, or one of: {', '.join(list_assets(kind))}",
            )
        return path.resolve()
    path = data_root() / "assets" / kind / f"{text}.xml"
    if not path.is_file():
        raise UnknownNameError(_SINGULAR[kind], text, list_assets(kind), where=where)
    return path


def list_tasks() -> list[str]:
    """Names of the tasks that travel with workcell."""
    return sorted(path.stem for path in (data_root() / "tasks").glob("*.toml"))


def find_task(name: str | Path) -> Path:
    """The TOML file of a task name or path (`.py` and `.toml` both name the pair).

    Raises:
        ModelError: the path does not exist; UnknownNameError: no task of that name.
    """
    text = str(name)
    if text.endswith((".toml", ".py")) or "/" in text:
        path = expanded(Path(text)).with_suffix(".toml")
        if not path.is_file():
            raise ModelError(
                "this is a folder, not a task file" if path.is_dir() else "there is no such task file",
                where=path,
                remedy=f"a TOML file, or one of: {', '.join(list_tasks())}",
            )
        return path.resolve()
    path = data_root() / "tasks" / f"{text}.toml"
    if not path.is_file():
        raise UnknownNameError("task", text, list_tasks())
    return path
