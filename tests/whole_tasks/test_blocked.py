"""The task that can't be done: a proof that is re-checked, what is in the way, and a recording that shows it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from workcell.ik.certificate import Certificate
from workcell.ik.check import check_certificate
from workcell.model.loading.assets import find_task
from workcell.model.scene import Scene
from workcell.record.read.review import review
from workcell.task.run import JobResult, run_task
from workcell.world.planning_world import PlanningWorld


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> JobResult:
    folder = tmp_path_factory.mktemp("blocked")
    return run_task("blocked", planner="auto", out=folder, say=lambda _: None)


def world() -> PlanningWorld:
    scene = Scene.load(find_task("blocked"), seed=0)
    return PlanningWorld.of(scene, overshoot=0.03, approached=["block"], seed=0)


def test_the_run_ends_with_a_proof_about_the_real_geometry(run: JobResult) -> None:
    assert not run.achieved
    assert run.status == "BLOCKED"
    assert run.impossible
    here = world()
    document = json.loads((run.recording.parent / "blocked.certificate.json").read_text())
    certificate = Certificate.from_json(document)
    problem = here.problem(here.scene.goal("grasp").pose)
    assert check_certificate(problem, certificate) is None
    assert check_certificate(replace(problem, obstacles=problem.obstacles[:-1]), certificate) is not None


def test_a_convex_solver_ends_with_a_proof_too(tmp_path: Path) -> None:
    run = run_task("blocked", planner="cidgik", seed=1, out=tmp_path, say=lambda _: None)
    assert run.status == "BLOCKED" and run.impossible and run.summary["planner"] == "cidgik"
    assert run.summary["why"]["without"] == [{"kind": "obstacle", "name": "beam"}]


def test_it_names_the_beam_and_the_closest_pose_is_clear(run: JobResult) -> None:
    why = run.summary["why"]
    assert why["without"] == [{"kind": "obstacle", "name": "beam"}]
    assert "without the obstacle beam" in run.sentence
    assert world().clearance(np.asarray(why["closest"]["q"])).distance >= 0.0


def test_the_recording_shows_what_is_in_the_way(run: JobResult) -> None:
    found = review(Path(run.recording))
    assert found.verdict == "not achieved"
    shown = {thing.path for thing in found.stage.things if thing.kind == "why"}
    assert shown == {"world/why/blocked_by/beam", "world/why/closest/ur10"}
    assert any("proved impossible" in line.text for line in found.events)
