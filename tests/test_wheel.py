"""The wheel carries assets and tasks, and runs from somewhere else than the repository."""

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Path:
    """A folder with the unpacked installation of a freshly built wheel."""
    work = tmp_path_factory.mktemp("wheel")
    build = [
        sys.executable,
        "-m",
        "build",
        "--wheel",
        "--no-isolation",
        "--outdir",
        str(work),
        str(REPOSITORY),
    ]
    subprocess.run(build, check=True, capture_output=True)
    (wheel,) = work.glob("*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    assert "workcell/_data/tasks/shelf_grasp.toml" in names
    assert not any(name.split("/")[0] in {"assets", "tasks", "tests"} for name in names)
    site = work / "site"
    install = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "--quiet",
        "--no-deps",
        "--target",
        str(site),
        str(wheel),
    ]
    subprocess.run(install, check=True, capture_output=True)
    return site


def test_every_module_of_the_package_is_in_it(installed):
    here, there = (
        {file.relative_to(root) for file in root.rglob("*.py")}
        for root in (REPOSITORY / "workcell", installed / "workcell")
    )
    assert here and here <= there


def run(installed: Path, cwd: Path, *arguments: str) -> subprocess.CompletedProcess:
    code = "import sys; from workcell.cli import main; main(sys.argv[1:])"
    return subprocess.run(
        [sys.executable, "-c", code, *arguments],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": str(installed)},
        capture_output=True,
        text=True,
        check=False,
    )


def test_the_installed_package_is_the_one_that_runs(installed, tmp_path):
    code = (
        "import workcell, workcell.model.loading.assets as d; print(workcell.__file__); print(d.data_root())"
    )
    found = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(installed)},
        capture_output=True,
        text=True,
        check=True,
    )
    package, data = found.stdout.splitlines()
    assert package.startswith(str(installed)) and data.startswith(str(installed))


def test_robots_and_tasks_are_found_there(installed, tmp_path):
    robots = run(installed, tmp_path, "robots", "--json")
    assert robots.returncode == 0, robots.stderr
    listed = json.loads(robots.stdout)
    assert {"sawyer", "ur10", "iiwa14"} <= {row["name"] for row in listed}
    assert all(str(installed) in row["source"] for row in listed)
    check = run(installed, tmp_path, "check", "shelf_grasp", "--json")
    assert check.returncode == 0, check.stderr
    assert json.loads(check.stdout)["problems"] == []


def test_an_inverse_kinematics_query_is_answered_there(installed, tmp_path):
    answer = run(
        installed,
        tmp_path,
        "ik",
        "sawyer",
        "--pose",
        "0.6",
        "0.1",
        "0.4",
        "0",
        "1",
        "0",
        "0",
        "--solver",
        "ikspark",
        "--json",
    )
    assert answer.returncode == 0, answer.stderr
    assert json.loads(answer.stdout)["status"] == "SOLVED"
