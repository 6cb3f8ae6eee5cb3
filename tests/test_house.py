"""The house rules: folders are small, tests stand beside what they test, docstrings begin with one short line."""

import ast
import subprocess
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
MOST_MODULES = 20
LONGEST_FIRST_LINE = 110
ALIKE = 3
"""Files of a folder that may not share the first word of their names: they are a folder of that name."""
OF_THE_TESTS_ALONE = {"assets", "whole_tasks"}
"""Folders of tests of what lies outside the package."""
AT_THE_TOP = {
    *(
        ".ci",
        ".gitignore",
        "CHANGELOG.md",
        "CONTRIBUTING.md",
        "LICENSE",
        "README.md",
        "assets",
        "docs",
        "examples",
    ),
    *("pyproject.toml", "tasks", "tests", "workcell"),
}

PACKAGE = sorted({file.parent for file in (ROOT / "workcell").rglob("*.py")})
TESTS = sorted({file.parent for file in (ROOT / "tests").rglob("*.py")})


def place(path):
    return path.relative_to(ROOT).as_posix()


def modules(folder):
    return sorted(file.stem for file in folder.glob("*.py") if file.stem != "__init__")


def first_word(name):
    """The first of several words of a module's name, `test` left out; None where it is but one word."""
    word, several, _ = name.removeprefix("test_").partition("_")
    return word if several else None


def first_lines_too_long(text):
    """Names of what in a module's text has a docstring whose first line is too long, with the line's number."""
    if not any(
        len(line.strip().strip('"')) > LONGEST_FIRST_LINE for line in text.splitlines() if '"""' in line
    ):
        return []
    with_docstrings = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    documented = [node for node in ast.walk(ast.parse(text)) if isinstance(node, with_docstrings)]
    return [
        (getattr(node, "name", "the module"), node.body[0].lineno)
        for node in documented
        if len((ast.get_docstring(node) or "").partition("\n")[0]) > LONGEST_FIRST_LINE
    ]


@pytest.mark.parametrize("folder", PACKAGE + TESTS, ids=place)
def test_a_folder_is_small_and_its_names_say_what_is_special(folder):
    names = modules(folder)
    assert len(names) <= MOST_MODULES, f"{place(folder)} has {len(names)} modules: give a part its own folder"
    words = Counter(word for name in names if (word := first_word(name)))
    crowds = [word for word, count in words.items() if count >= ALIKE]
    assert not crowds, f"{place(folder)}: the files {crowds[0]}_* are a folder {crowds[0]}/"


@pytest.mark.parametrize("folder", PACKAGE, ids=place)
def test_a_folder_of_the_package_says_what_it_is(folder):
    init = folder / "__init__.py"
    assert init.is_file(), f"{place(folder)} has no __init__.py"
    assert ast.get_docstring(ast.parse(init.read_text())), f"{place(init)} has no docstring"


@pytest.mark.parametrize("folder", TESTS, ids=place)
def test_tests_stand_where_what_they_test_stands(folder):
    assert (folder / "__init__.py").is_file(), f"{place(folder)} has no __init__.py: names of tests may clash"
    inner = folder.relative_to(ROOT / "tests").as_posix()
    assert inner in OF_THE_TESTS_ALONE or (ROOT / "workcell" / inner).is_dir(), (
        f"there is no workcell/{inner} that {place(folder)} could test"
    )


def test_docstrings_begin_with_one_short_line():
    tops = ("workcell", "tests", "tasks", "assets", "examples")
    files = [file for top in tops for file in (ROOT / top).rglob("*.py")]
    assert len(files) > 400
    too_long = {place(file): found for file in files if (found := first_lines_too_long(file.read_text()))}
    assert not too_long, "a shorter first sentence, and the rest after a blank line"


def test_a_long_first_line_is_found():
    text = f'def long():\n    """{"a" * 111}"""\n\n\ndef short():\n    """{"a" * 110}"""\n'
    assert first_lines_too_long(text) == [("long", 2)]


def test_nothing_strays_at_the_top():
    try:
        command = ["git", "-C", str(ROOT), "ls-files", "-z"]
        listed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a git checkout")
    assert {name.partition("/")[0] for name in listed.split("\0") if name} <= AT_THE_TOP
