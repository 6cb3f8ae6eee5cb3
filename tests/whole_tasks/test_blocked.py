"""The task that can't be done: a proof that is re-checked, what is in the way, and a recording that shows it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.record.sight import around, ball_at, geoms_seen, inside
from workcell.ik.certificate import Certificate, problem_hash
from workcell.ik.check import check_certificate
from workcell.model.loading.assets import find_task
from workcell.model.scene import Scene
from workcell.record.read.review import review
from workcell.record.show.cameras import choose_cameras
from workcell.record.show.pictures import contact_sheet
from workcell.record.show.studio import Studio
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
    assert certificate.kind == "last_link" and "inside beam" in certificate.statement
    open_ = here.relaxed(problem, ["beam"])
    assert check_certificate(open_, certificate) == "the certificate belongs to another problem"
    claimed = replace(certificate, problem_hash=problem_hash(open_.inside()))
    assert "an obstacle that isn't there" in str(check_certificate(open_, claimed))


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


def test_the_picture_shows_the_beam_in_red_and_the_closest_pose_in_orange(
    run: JobResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From both sides; a picture without the reasons differs there and nowhere else."""
    monkeypatch.setattr("workcell.record.show.pictures._ALONE", (240, 180))
    found, here = review(Path(run.recording)), world()
    model, data = here.scene.model, mujoco.MjData(here.scene.model)
    data.qpos[:] = here.scene.initial_qpos()
    mujoco.mj_forward(model, data)
    moving = here.cover.link > 0
    T = here.robot.robot.link_transforms(np.asarray(run.summary["why"]["closest"]["q"]))
    closest = list(zip(here.cover.centres_world(T)[moving], here.cover.radius[moving], strict=True))
    tiles = contact_sheet(found).axes[0].images
    for camera, tile in zip(choose_cameras(found.stage, 240, 180), tiles, strict=True):
        picture, bare = np.asarray(tile.get_array()), Studio(found.stage, camera).picture(0.0)
        geoms, distance = geoms_seen(model, data, camera)
        red = picture[..., 0] > 2.0 * picture[..., 1:].max(axis=2)
        beam = geoms == model.geom("beam").id
        assert inside(beam).sum() > 1000
        assert red[inside(beam)].all() and not red[~around(beam)].any()
        assert not np.any(bare[..., 0] > 2.0 * bare[..., 1:].max(axis=2))
        balls = np.any([ball_at(camera, *ball) < distance for ball in closest], axis=0)
        added = picture - bare
        orange = added[..., 0] - added[..., 2]
        assert orange[inside(balls) & ~around(beam)].min() > 0.1
        assert not added[~around(balls) & ~around(beam)].any()
