"""The whole task, as a user runs it: planned, executed, recorded, and reviewed from the recording alone."""

import json
import shutil

import mujoco
import numpy as np
import pytest

from tests.record.sight import around, coloured, geoms_seen, inside
from tests.whole_tasks.planned import check_planned
from workcell.model.loading.assets import find_task
from workcell.model.scene import Scene
from workcell.record.read.review import review
from workcell.record.shapes import geom_rgba
from workcell.record.show.cameras import choose_cameras
from workcell.record.show.studio import Studio
from workcell.task.planning import Planning
from workcell.task.run import run_task


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    story = []
    result = run_task("shelf_grasp", seed=3, out=tmp_path_factory.mktemp("shelf_grasp"), say=story.append)
    return result, story


def test_the_mug_leaves_the_shelf(outcome):
    result, _ = outcome
    assert result.achieved and result.status == "ACHIEVED"
    conditions = result.summary["conditions"]
    assert conditions["the mug has left the shelf"] and conditions["the mug hangs in the hand alone"]
    assert all(conditions.values())


def test_tracking_and_clearance(outcome):
    summary = outcome[0].summary
    assert summary["max_tracking_error_m"] < 1e-3
    assert summary["min_clearance_m"] >= 0.0
    assert summary["unintended_contacts"] == 0


def test_the_summary_file_says_the_same(outcome):
    result, _ = outcome
    written = json.loads(result.summary_path.read_text())
    assert written["achieved"] is True and written["seed"] == 3 and written["planner"] == "ikspark"
    assert written["planning_s"] > 0 and written["wall_s"] > written["planning_s"]


def test_the_recording_alone_tells_it(outcome):
    result, _ = outcome
    seen = review(result.recording)
    assert seen.achieved and seen.manifest["planner"] == "ikspark"
    check_planned(seen, "ikspark", ["way into the shelf", "way off the board", "way out with the mug"])
    assert all(row.in_cuboids == row.queries for row in seen.ways) and len(seen.ways) == 4
    mug, cup = (next(row for row in seen.objects if row.name == name) for name in ("mug", "cup"))
    assert mug.moved > 0.25 and mug.rose > 0.03 and cup.moved < 1e-4
    assert np.linalg.norm(np.array(mug.final_position) - seen.stage.traces["sawyer"][1][-1]) < 0.06
    assert not result.recording.with_name("shelf_grasp.partial.rrd").exists()


def test_the_pictures_show_the_mug_in_the_shelf_and_then_in_the_hand(outcome):
    """From close by, where MuJoCo's rays meet it: blue there, and nowhere else."""
    seen, scene = review(outcome[0].recording), Scene.load("shelf_grasp", seed=3)
    camera = choose_cameras(seen.stage, 200, 150)[1]
    studio, data = Studio(seen.stage, camera, smooth=False), mujoco.MjData(scene.model)
    for row, time in ((0, 0.0), (-1, seen.duration)):
        qpos = np.array(scene.initial_qpos())
        qpos[scene.robot().qpos_addresses] = seen.series["joint_positions/sawyer"].values[row]
        pose = seen.stage.pose(seen.stage.object_paths()["mug"], time)
        at = scene.object("mug").qpos_address
        qpos[at : at + 7] = [*pose.position, *pose.quat_wxyz]
        data.qpos[:] = qpos
        mujoco.mj_forward(scene.model, data)
        mug = geoms_seen(scene.model, data, camera)[0] == scene.model.geom("mug/mug_visual").id
        blue = coloured(studio.picture(time), geom_rgba(scene.model, scene.model.geom("mug/mug_visual").id))
        assert inside(mug).sum() > 300
        assert blue[inside(mug)].mean() > 0.65  # the tool's way and the rim's edges are drawn over it
        assert not blue[~around(mug, 6)].any()


def test_the_arm_grasps_in_the_grasp_configuration_that_was_found(tmp_path, monkeypatch):
    """The configuration that the planner answers with is where the way into the shelf ends, by either planner."""
    for planner in ("ikspark", "cidgik"):
        goals, ends = [], []
        solve, reach = Planning.solve, Planning.reach

        def solved(self, *arguments, solve=solve, goals=goals, **options):
            goals.append(solve(self, *arguments, **options))
            return goals[-1]

        def reached(self, *arguments, reach=reach, ends=ends, **options):
            ends.append(reach(self, *arguments, **options).end)
            self.story.fail("PLANNED", "as far as this test looks")

        with monkeypatch.context() as patch:
            patch.setattr(Planning, "solve", solved)
            patch.setattr(Planning, "reach", reached)
            result = run_task("shelf_grasp", planner=planner, seed=3, out=tmp_path, say=lambda _: None)
        assert result.status == "PLANNED" and len(goals) == len(ends) == 1
        assert goals[0].solver == planner and np.array_equal(goals[0].q, ends[0])


def test_the_story_names_each_step(outcome):
    text = "\n".join(outcome[1])
    for words in (
        "grasp configuration",
        "way into the shelf",
        "way out with the mug",
        "held by both fingers",
    ):
        assert words in text


def test_the_same_seed_gives_the_same_plan(outcome, tmp_path):
    again = run_task("shelf_grasp", seed=3, out=tmp_path, say=lambda _: None)
    for key in ("simulated_s", "min_clearance_m", "max_tracking_error_m"):
        assert again.summary[key] == outcome[0].summary[key]


def test_a_goal_out_of_reach_ends_with_a_proof(tmp_path):
    source = find_task("shelf_grasp")
    goal = 'name = "grasp"                      # the mug between the fingers\n'
    where = 'robot = "sawyer"\nrelative_to = "mug/grasp"\n'
    above = f'name = "grasp"\n{where}xyz = [0.0, 0.0, 1.5]'
    text = source.read_text().replace(f"{goal}{where}xyz = [0.0, 0.0, 0.0]", above)
    assert text != source.read_text()
    (tmp_path / "far.toml").write_text(text.replace('name = "shelf_grasp"', 'name = "far"'))
    shutil.copy(source.with_suffix(".py"), tmp_path / "far.py")
    result = run_task(tmp_path / "far.toml", out=tmp_path / "out", say=lambda _: None)
    assert not result.achieved and result.impossible and result.status == "UNREACHABLE"
    assert json.loads(result.summary_path.read_text())["status"] == "UNREACHABLE"
    assert not review(result.recording).achieved
    assert np.isfinite(result.summary["wall_s"])
