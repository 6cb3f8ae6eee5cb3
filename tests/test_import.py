"""What a user pays before anything runs: imports are lazy, and the layers keep to their libraries."""

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import workcell

HEAVY = ("mujoco", "cvxpy", "rerun", "trimesh", "matplotlib", "scipy", "clarabel", "pinocchio", "coacd")


def loaded_by(statement: str) -> set[str]:
    code = f"import sys; {statement}; print(*[m for m in {HEAVY!r} if m in sys.modules])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(result.stdout.split())


def test_importing_workcell_loads_no_heavy_library():
    assert loaded_by("import workcell") == set()


def test_building_the_command_line_loads_no_heavy_library():
    assert loaded_by("from workcell.cli.parser import build_parser; build_parser()") == set()


def test_planning_layers_do_not_load_rerun():
    assert "rerun" not in loaded_by(
        "import workcell.world.planning_world, workcell.motion.tool_paths.follow, workcell.ik.solve"
    )


def names_for_type_checkers():
    """The module of each name that the package imports for type checkers alone."""
    tree = ast.parse(Path(workcell.__file__).read_text())
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    return {alias.name: node.module for node in block.body for alias in node.names}


@pytest.mark.parametrize("name", workcell.__all__)
def test_every_public_name_exists(name):
    """What is imported when it is first used is what type checkers take the name for."""
    home = importlib.import_module(names_for_type_checkers()[name])
    assert getattr(workcell, name) is getattr(home, name)
