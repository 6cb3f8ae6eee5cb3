"""The whole task: the cup stays upright all the way around the pillar, and stands where it should."""

from types import SimpleNamespace

import numpy as np
import pytest

from tests.whole_tasks.planned import check_planned
from workcell.model.scene import Scene
from workcell.record.read.review import review
from workcell.simulate.carried import carried
from workcell.task.run import run_task


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    out = tmp_path_factory.mktemp("keep_upright")
    return run_task("keep_upright", seed=2, out=out, say=lambda _: None)


def test_the_cup_is_carried_upright_around_the_pillar(outcome):
    summary = outcome.summary
    assert outcome.achieved and all(summary["conditions"].values())
    assert summary["max_tilt_rad"] <= np.deg2rad(2) and summary["max_slosh_rad"] <= 0.2
    assert 0.1 < summary["pillar_passed_at_m"] < 0.2 and summary["put_down_off_by_m"] < 3e-3
    assert summary["min_clearance_m"] >= 0 and summary["unintended_contacts"] == 0
    assert summary["max_tracking_error_m"] < 5e-4


def test_the_recording_shows_the_cup_moving(outcome):
    seen = review(outcome.recording)
    check_planned(seen, "ikspark", ["way around the pillar", "way to the cup", "way off"])
    (cup,) = seen.objects
    assert seen.achieved and cup.name == "cup"
    assert cup.moved > 0.6 and cup.rose > 0.05 and cup.final_position[1] > 0.3


def test_tilt_and_slosh_of_a_known_motion():
    """A cup tilted by 0.1 rad that is accelerated by 1 m/s^2 along x: its liquid leans by atan(1 / 9.81) more."""
    scene = Scene.load("keep_upright")
    at = scene.object("cup").qpos_address
    time = 0.01 * np.arange(101)
    qpos = np.tile(scene.initial_qpos(), (101, 1))
    qpos[:, at] = 0.5 * time**2
    qpos[:, at + 3 : at + 7] = [np.cos(0.05), 0.0, np.sin(0.05), 0.0]
    rows = SimpleNamespace(time=time, qpos=qpos)
    moved = carried(scene, rows, "cup", 0.0, 1.0)
    assert np.allclose(moved.tilt, 0.1) and np.allclose(moved.position[:, 0], 0.5 * time**2)
    assert np.allclose(moved.slosh[10:-10], 0.1 + np.arctan(1 / 9.81), atol=1e-6)
