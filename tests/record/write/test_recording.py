"""Recordings: what is written comes back, and what was written survives a failure."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.record.conftest import RESULT, TOY, record_toy, toy_motion
from workcell.errors import InputError, OutputError
from workcell.geometry.types import FreeSpace, SphereCover
from workcell.model.scene import Scene
from workcell.record.read.reader import read
from workcell.record.read.review import review
from workcell.record.read.stage import Stage
from workcell.record.write.recording import Recording


def test_metrics_come_back_as_written(tmp_path: Path, toy: mujoco.MjModel) -> None:
    extra = np.random.default_rng(0).normal(size=(101, 3))
    result = review(record_toy(tmp_path / "toy.rrd", toy, forces=extra))
    times, _ = toy_motion(toy)
    assert np.array_equal(result.series["clearance"].values[:, 0], 0.05 + 0.04 * np.cos(times))
    assert np.array_equal(result.series["forces"].values, extra)
    assert np.allclose(result.series["clearance"].times, times, atol=1e-9)


def test_metrics_keep_their_rate_and_poses_the_frame_rate(tmp_path: Path, toy: mujoco.MjModel) -> None:
    times, qpos = toy_motion(toy, count=1001)
    with Recording(tmp_path / "toy.rrd", task="toy", frame_rate=20.0) as recording:
        recording.log_model(toy, {2: "objects/box"}, toy.qpos0)
        for k in range(len(times)):
            recording.log_states(times[k], qpos[k], {"clearance": times[k]})
    contents = read(tmp_path / "toy.rrd")
    stage = Stage.of(contents)
    assert contents.entities["metrics/clearance"].rows() == 1001
    frames = stage.motions["world/objects/box/visual/box"].times
    assert len(frames) == 41
    assert frames[-1] == pytest.approx(2.0)


def test_last_state_is_recorded_whatever_the_frame_rate(tmp_path: Path, toy: mujoco.MjModel) -> None:
    times, qpos = toy_motion(toy)
    with Recording(tmp_path / "toy.rrd", task="toy", frame_rate=0.7) as recording:
        recording.log_model(toy, {}, toy.qpos0)
        recording.log_states(times, qpos)
    stage = Stage.of(read(tmp_path / "toy.rrd"))
    assert stage.pose("world/obstacles/box", 2.0).position == pytest.approx(qpos[-1, 1:4], abs=1e-6)


def test_rotations_come_back_the_right_way_round(toy: mujoco.MjModel, toy_file: Path) -> None:
    stage = Stage.of(read(toy_file))
    times, qpos = toy_motion(toy)
    for k in (0, 30, 100):
        pose = stage.pose("world/objects/box/visual/box", times[k])
        expected = Rotation.from_rotvec(times[k] / 2.0 * np.array([1.0, 2.0, -2.0]) / 3.0)
        assert pose.rotation == pytest.approx(expected.as_matrix(), abs=1e-6)
        assert pose.position == pytest.approx(qpos[k, 1:4], abs=1e-6)


def test_geometry_comes_back_where_mujoco_has_it(toy: mujoco.MjModel, toy_file: Path) -> None:
    """Bounding boxes of what is drawn agree with MuJoCo's own poses and sizes at the end of the motion."""
    stage = Stage.of(read(toy_file))
    data = mujoco.MjData(toy)
    data.qpos[:] = toy_motion(toy)[1][-1]
    mujoco.mj_forward(toy, data)
    capsule = next(t for t in stage.things if t.path.endswith("arm/upper"))
    pose = stage.pose(capsule.path, 2.0)
    drawn = pose.apply(capsule.parts[0][0].vertices)
    centre = data.geom("upper").xpos
    axis = data.geom("upper").xmat.reshape(3, 3)[:, 2]
    along = (drawn - centre) @ axis
    assert along.max() == pytest.approx(0.2 + 0.05, abs=1e-6)
    assert along.min() == pytest.approx(-0.25, abs=1e-6)
    aside = np.linalg.norm(drawn - centre - along[:, None] * axis, axis=1)
    assert aside.max() == pytest.approx(0.05, abs=1e-6)
    assert capsule.parts[0][1] == pytest.approx([0.8, 0.1, 0.1, 1.0], abs=2e-3)


def test_collision_geometry_is_recorded_but_not_drawn(toy_file: Path) -> None:
    contents = read(toy_file)
    stage = Stage.of(contents)
    assert "world/robots/arm/collision/arm/hull" in contents.entities
    assert not any("hull" in thing.path for thing in stage.things)
    assert stage.pose("world/robots/arm/collision/arm/hull", 2.0).position == pytest.approx(
        [0.2 * np.cos(1), 0.2 * np.sin(1), 0.5], abs=1e-6
    )


def test_a_scene_with_everything(tmp_path: Path) -> None:
    scene = Scene.load("shelf_grasp")
    arm = scene.robot()
    rng = np.random.default_rng(1)
    links = np.repeat(np.arange(arm.robot.dof + 1), 2)
    cover = SphereCover(
        links, rng.normal(size=(len(links), 3)) * 0.1, rng.uniform(0.02, 0.1, len(links)), "outer"
    )
    qpos = np.tile(scene.initial_qpos(), (3, 1))
    qpos[:, arm.qpos_addresses] += rng.normal(size=(3, arm.robot.dof)) * 0.2
    with Recording(tmp_path / "run.rrd", task="shelf") as recording:
        recording.log_scene(scene)
        recording.log_cover(arm, cover)
        recording.log_free_space(FreeSpace([[0, 0, 0]], [[1, 2, 3]]))
        recording.log_plan(arm.name, [[0, 0, 0], [1, 0, 0]])
        recording.log_nearest([0.1], [[[0, 0, 0], [0, 0, 1]]])
        recording.log_states([0.1, 0.2, 0.3], qpos)
    contents = read(tmp_path / "run.rrd")
    stage = Stage.of(contents)
    assert contents.has_blueprint
    assert set(stage.goals) == set(scene.goals)
    for name, goal in scene.goals.items():
        assert stage.goals[name].error_to(goal.pose) == pytest.approx((0, 0), abs=1e-6)
    q = qpos[-1, arm.qpos_addresses]
    assert stage.traces[arm.name][1][-1] == pytest.approx(arm.robot.fk(q).position, abs=1e-6)
    expected = cover.centres_world(arm.robot.link_transforms(q))
    spheres = stage.surfaces(0.3, ("spheres",))
    centres = np.array([s.triangles.vertices.mean(axis=0) for s in spheres])
    assert len(centres) == len(expected)
    assert np.linalg.norm(centres[:, None] - expected, axis=2).min(axis=0).max() < 1e-3
    for obstacle in scene.obstacles:
        assert contents.below(f"world/obstacles/{obstacle}")
    names = contents.entities[f"metrics/joint_positions/{arm.name}"].static["SeriesLines:names"]
    assert tuple(names) == arm.robot.joint_names
    assert contents.below("world/free_space/0")


def test_states_before_a_scene_are_refused(tmp_path: Path) -> None:
    recording = Recording(tmp_path / "toy.rrd", task="toy")
    with pytest.raises(InputError, match="scene first"):
        recording.log_states([0.0], np.zeros((1, 8)))
    with pytest.raises(InputError, match="INFO, WARN, ERROR"):
        recording.event(0.0, "text", "LOUD")
    recording.close()


def test_a_failed_run_keeps_the_earlier_recording_and_what_it_wrote(
    tmp_path: Path, toy: mujoco.MjModel
) -> None:
    path = record_toy(tmp_path / "toy.rrd", toy)
    before = path.read_bytes()
    with pytest.raises(ZeroDivisionError), Recording(path, task="toy") as recording:
        recording.log_model(toy, {}, toy.qpos0)
        recording.log_states(*toy_motion(toy))
        raise ZeroDivisionError("a bug")
    assert path.read_bytes() == before
    left = review(recording.partial_path)
    assert left.verdict == "incomplete"
    assert "a bug" in left.events[-1].text
    assert left.duration == pytest.approx(2.0)


def test_an_interrupted_run_says_so(tmp_path: Path, toy: mujoco.MjModel) -> None:
    with pytest.raises(KeyboardInterrupt), Recording(tmp_path / "toy.rrd", task="toy") as recording:
        recording.log_model(toy, {}, toy.qpos0)
        raise KeyboardInterrupt
    assert not (tmp_path / "toy.rrd").exists()
    assert review(recording.partial_path).result["status"] == "INTERRUPTED"


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OutputError, match="writable"):
        Recording(tmp_path / "file" / "toy.rrd", task="toy")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_read_only_folder(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(OutputError, match="writable"):
        Recording(tmp_path / "toy.rrd", task="toy")
    tmp_path.chmod(0o700)


WRITER = """
    import signal, sys
    import mujoco, numpy as np
    from pathlib import Path
    from tests.record.conftest import TOY, toy_motion
    from workcell.errors import OutputError
    from workcell.record.write.recording import Recording
    model = mujoco.MjModel.from_xml_string(TOY)
    times, qpos = toy_motion(model, count=2001, seconds=40.0)
"""


def _python(body: str, *arguments: str) -> subprocess.Popen[str]:
    code = textwrap.dedent(WRITER) + textwrap.dedent(body)
    root = Path(__file__).parents[3]
    return subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        cwd=root,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_a_killed_process_leaves_a_readable_file(tmp_path: Path) -> None:
    body = """
    recording = Recording(sys.argv[1], task="toy")
    recording.log_model(model, {}, model.qpos0)
    for k in range(len(times)):
        recording.log_states(times[k], qpos[k], {"clearance": times[k]})
        if k == 1500:
            print(times[k], flush=True)
            signal.pause()
    """
    process = _python(body, str(tmp_path / "toy.rrd"))
    assert process.stdout is not None
    reached = float(process.stdout.readline())
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    left = review(tmp_path / "toy.partial.rrd")
    assert left.verdict == "incomplete"
    assert reached - left.duration <= 1.05
    assert left.series["clearance"].times[-1] == pytest.approx(left.duration, abs=0.05)
    assert any("not finished" in text for text in left.missing)


def test_a_full_disk_gives_one_clear_error_and_a_readable_file(tmp_path: Path) -> None:
    """A limit on the file's size stands for the full disk: the operating system refuses the same way."""
    body = """
    import resource
    resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, resource.RLIM_INFINITY))
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        with Recording(sys.argv[1], task="toy") as recording:
            recording.log_model(model, {}, model.qpos0)
            for k in range(len(times)):
                recording.log_states(times[k], qpos[k], {"noise": np.random.default_rng(k).normal(size=(1, 200))})
    except OutputError as error:
        print(f"refused: {error}")
    """
    process = _python(body, str(tmp_path / "toy.rrd"))
    out, err = process.communicate()
    assert out.startswith("refused: ")
    assert out.count("\n") == 1
    assert err == ""
    assert not (tmp_path / "toy.rrd").exists()
    assert review(tmp_path / "toy.partial.rrd").duration > 0.0


def test_properties_and_result_are_in_the_file(toy_file: Path) -> None:
    contents = read(toy_file)
    run = contents.entities["__properties/run"].static
    assert run["task"] == ["toy"]
    assert list(run["achieved"]) == [True]
    assert review(toy_file).result == RESULT
    assert "<mujoco>" in TOY
