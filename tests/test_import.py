"""What a user pays before anything runs: imports are lazy, and the layers keep to their libraries."""

import importlib
import subprocess
import sys

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


@pytest.mark.parametrize("name", workcell.__all__)
def test_every_public_name_exists(name):
    home = importlib.import_module(f"workcell.{workcell._HOMES[name]}")
    assert getattr(workcell, name) is getattr(home, name)
