"""Other packages: a URDF that is the arm, follows where they are installed, and a row where they are not."""

import numpy as np
import pytest

import workcell.bench.live.peers as peers
from workcell.bench.live import timing
from workcell.bench.live.arms import SETUPS, arms_of
from workcell.bench.live.cases import case_of, run_case
from workcell.bench.live.others import Mink, RangedIK, installed
from workcell.bench.live.urdf import tool_link, urdf_of

SAWYER = next(setup for setup in SETUPS if setup.robot == "sawyer")


@pytest.mark.parametrize("setup", SETUPS, ids=lambda setup: setup.robot)
def test_the_urdf_is_the_arm(setup):
    pinocchio = pytest.importorskip("pinocchio")
    robot = arms_of(setup).robots[0]
    model = pinocchio.buildModelFromXML(urdf_of(["arm"], [robot]))
    data, frame = model.createData(), model.getFrameId(tool_link("arm"))
    assert model.nq == robot.dof and model.upperPositionLimit == pytest.approx(robot.upper)
    for seed in range(3):
        q = robot.random_configuration(np.random.default_rng(seed))
        pinocchio.framesForwardKinematics(model, data, q)
        T = robot.fk_transform(q)
        assert data.oMf[frame].homogeneous == pytest.approx(T, abs=1e-9)


@pytest.mark.parametrize(("package", "maker"), [("mink", Mink), ("relaxed_ik_core", RangedIK)])
def test_others_follow_where_they_are_installed(package, maker):
    if not installed(package):
        pytest.skip(f"needs {package}")
    (run,) = run_case(case_of(SAWYER, "circle"), maker, 1, 0)
    assert run.unanswered == 0 and run.position[60:].mean() < 5e-3


def test_what_is_not_installed_has_a_row_that_says_so(monkeypatch):
    monkeypatch.setattr(peers, "installed", lambda package: False)
    monkeypatch.setattr(peers, "table", lambda makers, papers, n, seed: [{"row": name} for name in makers])
    rows = [row["row"] for row in peers.live_peers(1, 0, None)]
    assert rows == ["A", "B", "mink is not installed", "relaxed_ik_core is not installed"]


def test_frames_and_preparation_are_timed():
    row = timing.robot_row("hubo_arm", 50, 0)
    assert row["n"] == 50 and row["unanswered"] == 0
    assert 0.0 < row["frame_ms_p50"] <= row["frame_ms_max"]
    assert row["prepare_cached_cpu_s"] > 0.0 and row["prepare_cold_s"] > 0.0
