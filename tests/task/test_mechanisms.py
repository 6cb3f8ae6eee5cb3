"""A task whose script moves a linkage: planned, timed, executed, recorded and reviewed like any other."""

import pytest

from tests.simulate.mechanisms.crank import MOTOR, write_task
from workcell.errors import InputError, ModelError
from workcell.record.read.review import review
from workcell.task.run import run_task

SCRIPT = """
from workcell import FrameGoal, FrameWaypoint, MechanismSteps


def run(job):
    question = job.mechanism_problem()
    way = [FrameWaypoint((FrameGoal.at("block", [x, 0.0, 0.3]),)) for x in {places}]
    path = job.follow_frames(question, way, job.mechanism.start, MechanismSteps(0.4, 0.5), "pulling")
    motion = job.time_mechanism(question, path, "motion", frame_speed={{"block": 0.2}})
    simulation = job.mechanism_simulation()
    simulation.execute(motion, "pulling the block")
    simulation.hold(0.2)
    off = float(abs(simulation.frame_pose("block").position[0] - {places}[-1]))
    job.judge(simulation, {{"the block is there": off < 1e-3}})
"""


def ran(folder, places=(0.385, 0.37, 0.355, 0.34), **options):
    task = write_task(folder, start="start = {motor = 0.4}", **options)
    task.with_suffix(".py").write_text(SCRIPT.format(places=list(places)))
    story = []
    return run_task(task, planner="auto", out=folder / "run", say=story.append), "\n".join(story)


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    return ran(tmp_path_factory.mktemp("crank"))


def test_the_block_is_pulled(outcome):
    result, story = outcome
    assert result.achieved, result.sentence
    summary = result.summary
    assert summary["robot"] == "crank" and summary["conditions"]["its ties held"]
    assert summary["max_closure_error_m"] < 1e-3 and summary["max_tracking_error_m"] < 1e-3
    assert summary["unintended_contacts"] == 0 and summary["min_clearance_m"] > 0.0
    for words in (
        "pulling: 5 waypoints, 4 by local",
        "looked at",
        "of the force of drive",
        "at  0.00 s: pulling",
    ):
        assert words in story


def test_its_recording_says_who_planned_and_that_the_loop_held(outcome):
    seen = review(outcome[0].recording)
    assert seen.achieved, seen.reason
    checks = {check.name: check for check in seen.checks}
    assert checks["closure"].passed and "1 allowed" in checks["closure"].finding
    assert checks["planner"].passed and "4 by local" in checks["planner"].finding
    assert checks["continuity"].passed and "pulling" in checks["continuity"].finding
    (way,) = seen.ways
    assert (way.what, way.queries, way.steps, way.by) == ("pulling", 4, 4, (("local", 4),))
    assert way.time_share > 0.3
    assert seen.manifest["robots"]["crank"]["joints"] == ["motor"]
    assert seen.manifest["robots"]["crank"]["passive"] == ["elbow", "rail"]
    assert {"closure_error", "tracking_error", "clearance", "joint_positions/crank"} <= set(seen.series)
    plan, (_, trace) = seen.stage.plans["crank/block"], seen.stage.traces["crank/block"]
    assert plan[-1] == pytest.approx([0.34, 0.0, 0.3], abs=1e-3)
    assert trace[-1] == pytest.approx(plan[-1], abs=2e-3)
    drawn = {thing.kind for thing in seen.stage.things}
    assert {"robots", "obstacles"} <= drawn


def test_a_motor_that_can_t_make_the_motion_is_named(tmp_path):
    result, _ = ran(tmp_path, actuator=MOTOR.replace("-20 20", "-0.05 0.05"))
    assert (result.achieved, result.status) == (False, "TIMING")
    assert "however slow" in result.sentence


def test_a_start_in_collision_and_a_planner_of_arms_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"start is in collision.*(slider|wall).*overlap"):
        ran(tmp_path, wall=0.41)
    task = write_task(tmp_path, start="start = {motor = 0.4}")
    with pytest.raises(InputError, match="plans arms"):
        run_task(task, planner="cidgik", out=tmp_path / "run", say=lambda _: None)


def test_a_task_without_a_mechanism_says_so(tmp_path):
    task = tmp_path / "none.toml"
    task.write_text('format = "workcell-task/1"\nname = "none"\ncell = "two_arms"\n[task]\n')
    task.with_suffix(".py").write_text("def run(job):\n    job.mechanism_simulation()\n")
    with pytest.raises(ModelError, match="no mechanism"):
        run_task(task, planner="auto", out=tmp_path / "run", say=lambda _: None)
