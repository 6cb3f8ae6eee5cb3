"""A task that can't be begun is refused with one message; what a script calls is what the parts of its job do."""

import inspect
import json
import shutil

import pytest

from workcell.errors import InputError, ModelError, OutputError, UnknownNameError
from workcell.model.loading.assets import find_task
from workcell.record.read.review import review
from workcell.task.job import Job
from workcell.task.run import run_task


@pytest.fixture
def altered(tmp_path):
    """A copy of the task with one line of its TOML replaced."""

    def change(key: str, line: str):
        source = find_task("shelf_grasp")
        lines = source.read_text().splitlines()
        assert any(old.startswith(f"{key} = ") for old in lines)
        changed = [line if old.startswith(f"{key} = ") else old for old in lines]
        path = tmp_path / "altered.toml"
        path.write_text("\n".join(changed))
        shutil.copy(source.with_suffix(".py"), path.with_suffix(".py"))
        return path

    return change


def test_a_start_in_collision_names_the_pair_and_the_depth(altered, tmp_path):
    path = altered("start", "start = [0.0, 0.9, -0.1, 0.4, -0.6, 0.8, -1.25]")
    with pytest.raises(InputError, match=r"robot 'sawyer' start.*sawyer/\S+ and \S+ overlap by [\d.]+ mm"):
        run_task(path, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_start_outside_the_limits_names_the_joint(altered, tmp_path):
    path = altered("start", "start = [9.0, -0.9, -0.1, 2.4, -0.6, -0.8, -1.25]")
    with pytest.raises(InputError, match=r"right_j0 = 9\.0000 outside"):
        run_task(path, out=tmp_path / "out")


def test_a_key_that_the_task_table_lacks_is_named(altered, tmp_path):
    path = altered("hold_s", "hold = 0.5")
    path.with_suffix(".py").write_text("def run(job):\n    job.scene.task['hold_s']\n")
    with pytest.raises(UnknownNameError, match=r"\[task\].*'hold_s'.*did you mean hold"):
        run_task(path, out=tmp_path / "out", say=lambda _: None)


def test_a_script_that_is_not_python_or_not_there(altered, tmp_path):
    path = altered("hold_s", "hold_s = 0.5")
    path.with_suffix(".py").write_text("def run(job:\n")
    with pytest.raises(ModelError, match=r"altered\.py:1.*not valid Python"):
        run_task(path, out=tmp_path / "out")
    path.with_suffix(".py").write_text("import nothere_at_all\n")
    with pytest.raises(ModelError, match=r"altered\.py.*can't import.*nothere_at_all"):
        run_task(path, out=tmp_path / "out")
    path.with_suffix(".py").unlink()
    with pytest.raises(ModelError, match="no script beside it"):
        run_task(path, out=tmp_path / "out")


def test_an_interrupted_run_keeps_what_was_there(altered, tmp_path):
    path = altered("hold_s", "hold_s = 0.5")
    path.with_suffix(".py").write_text("def run(job):\n    job.say('begun')\n    raise KeyboardInterrupt\n")
    out = tmp_path / "out"
    out.mkdir()
    for name in ("shelf_grasp.rrd", "shelf_grasp.json"):
        (out / name).write_text("an earlier run")
    with pytest.raises(KeyboardInterrupt):
        run_task(path, out=out, say=lambda _: None)
    assert (out / "shelf_grasp.rrd").read_text() == (out / "shelf_grasp.json").read_text() == "an earlier run"
    assert (out / "shelf_grasp.partial.rrd").stat().st_size > 0


def test_a_task_that_fails_early_leaves_a_whole_summary(altered, tmp_path):
    path = altered("hold_s", "hold_s = 0.5")
    path.with_suffix(".py").write_text("def run(job):\n    job.fail('NOT_FOUND', 'No way was found.')\n")
    result = run_task(path, out=tmp_path / "out", say=lambda _: None)
    assert not result.achieved and not result.impossible
    written = json.loads(result.summary_path.read_text())
    promised = (
        "task robot planner seed achieved status planning_s wall_s min_clearance_m max_tracking_error_m"
    )
    assert set(promised.split()) <= set(written)
    assert written["status"] == "NOT_FOUND" and written["min_clearance_m"] is None
    assert not review(result.recording).achieved


def test_an_unknown_controller_is_named_before_anything_is_written(tmp_path):
    with pytest.raises(UnknownNameError, match=r"controller named 'serwo'.*did you mean servo"):
        run_task("shelf_grasp", controller="serwo", out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_try_is_quiet_and_ends_nothing():
    told = []
    job = Job(None, "auto", "computed_torque", 0, None, told.append, {}, 0.0)

    def fails():
        job.say("looking")
        job.fail("NOT_FOUND", "there is no way")

    def collides():
        raise InputError("the goal collides", where="q_goals")

    def looks_further(found):
        job.say("quiet")
        return job.can(found)

    assert not job.can(fails) and not job.can(collides)
    assert job.can(looks_further, fails) and job.can(looks_further, dict)
    assert not told and not job.trying


def test_a_script_calls_the_parts_by_the_job_s_own_methods():
    """Public methods of a part are the job's, called the same way, but for those that parts use between them."""
    between = {"quietly", "asking", "log_way", "log_frame_way", "log_chunk"}
    job = Job(None, "auto", "computed_torque", 0, None, print, {}, 0.0)
    offered = set()
    for part in (job.story, job.planning, job.timing, job.mechanisms):
        names = {name for name, _ in inspect.getmembers(part, inspect.ismethod) if not name.startswith("_")}
        for name in names - between:
            mine, its = (inspect.signature(getattr(it, name)).parameters for it in (job, part))
            assert list(mine.values()) == list(its.values()), name
        offered |= names
    assert between < offered
    mine = {name for name, _ in inspect.getmembers(job, inspect.ismethod) if not name.startswith("_")}
    assert mine == offered - between | {"simulation", "follow_goals", "mechanism_simulation"}


def test_a_script_adds_to_the_summary():
    summary = {"task": "bench"}
    job = Job(None, "auto", "computed_torque", 0, None, print, summary, 0.0)
    job.summary |= {"off_m": 0.1}
    job.summary["turned_rad"] = 0.2
    assert summary == job.story.summary == {"task": "bench", "off_m": 0.1, "turned_rad": 0.2}


@pytest.mark.parametrize("name", ["shelf_grasp.rrd", "shelf_grasp.json"])
def test_a_run_that_could_not_be_written_is_not_begun(tmp_path, name):
    (tmp_path / name).mkdir()
    said = []
    with pytest.raises(OutputError, match=rf"{name}: the file can't be written: Is a directory"):
        run_task("shelf_grasp", out=tmp_path, say=said.append)
    assert not said and [path.name for path in tmp_path.iterdir()] == [name]


def test_a_planner_that_only_answers_poses_or_is_unknown_is_refused_before_anything_is_written(tmp_path):
    with pytest.raises(
        InputError, match=r"branch answers single poses \(plan with ikspark, cidgik or auto\)"
    ):
        run_task("shelf_grasp", planner="branch", out=tmp_path / "out")
    with pytest.raises(UnknownNameError, match="no planner named 'rrt'"):
        run_task("shelf_grasp", planner="rrt", out=tmp_path / "out")
    assert not (tmp_path / "out").exists()
