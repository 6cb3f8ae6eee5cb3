"""What all tests share: compiled kernels, no deadlines on noisy machines, and none touches the user's own cache."""

import subprocess
import sys
from pathlib import Path

import hypothesis
import pytest

hypothesis.settings.register_profile("workcell", deadline=None)
hypothesis.settings.load_profile("workcell")


def pytest_sessionstart(session):
    """Before several processes share the tests: compile side by side what each of them would compile for itself."""
    if not getattr(session.config.option, "numprocesses", None) or hasattr(session.config, "workerinput"):
        return
    command = [sys.executable, "-m", "tests.compile_kernels"]
    root = Path(__file__).parent.parent
    running = [subprocess.Popen([*command, share], cwd=root) for share in ("branch", "sampling", "live")]
    for process in running:
        process.wait()


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("WORKCELL_CACHE_DIR", str(tmp_path_factory.mktemp("cache")))
        yield
