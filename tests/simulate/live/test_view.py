"""A window on a simulation, without a screen: a stand-in for MuJoCo's viewer, which drags what a test says."""

import contextlib

import numpy as np
import pytest

from tests.simulate.live.stand_in import StandIn
from workcell.cli.main import main
from workcell.errors import InputError, WorkcellError
from workcell.model.loading.assets import find_task
from workcell.model.scene import scene_spec
from workcell.motion.live.stream import Stamped
from workcell.pose import Pose
from workcell.simulate.live.view import LiveView, check_screen, launch_viewer
from workcell.simulate.simulation import Simulation
from workcell.task.run import run_task


class Window:
    """A window whose mouse drags a target at the n-th picture, and which is closed at another."""

    def __init__(self, model, data, drag=None, close=10**9):
        self.model, self.data, self.drag, self.closes = model, data, drag, close
        self.pictures, self.closed = 0, False

    def is_running(self):
        return self.pictures < self.closes

    def lock(self):
        return contextlib.nullcontext()

    def sync(self):
        self.pictures += 1
        if self.drag is not None and self.pictures >= self.drag:
            self.data.mocap_pos[0] = self.to

    def close(self):
        self.closed = True


def view_of(scene, **window):
    made = []

    def launch(model, data):
        made.append(Window(model, data, **window))
        return made[0]

    return LiveView(scene, scene_spec(scene.path), launch), made[0]


def test_targets_are_there_to_be_dragged_and_touch_nothing(scene):
    _, window = view_of(scene)
    body = window.model.body("target of sawyer")
    assert window.model.body_mocapid[body.id] == 0 and window.model.nmocap == 1
    geoms = np.flatnonzero(window.model.geom_bodyid == body.id)
    assert len(geoms) == 4 and not window.model.geom_contype[geoms].any()
    assert window.model.nq == scene.model.nq
    assert np.allclose(window.data.qpos, scene.initial_qpos())


def test_a_target_goes_where_it_is_told_until_it_is_dragged(scene, robot):
    view, window = view_of(scene, drag=3)
    begin = Simulation(scene).tool_pose()
    window.to = np.add(begin.position, [0.0, 0.05, 0.05])
    goals = view.goals(lambda t: begin)
    assert goals(0.0) is begin
    view.show(scene.initial_qpos())
    assert np.allclose(window.data.mocap_pos[0], begin.position)
    for _ in range(3):
        view.show(scene.initial_qpos())
        said = goals(0.1)
    assert isinstance(said, dict) and np.allclose(said["sawyer"].position, window.to)
    assert np.allclose(view.goals(lambda t: None)(0.2)["sawyer"].position, window.to)
    assert np.allclose(window.data.mocap_pos[0], window.to)


def test_what_streams_and_bands_say_is_passed_on(scene):
    view, window = view_of(scene)
    pose = Pose.from_xyz([0.5, 0.1, 0.4])
    said = Stamped({"sawyer": pose}, 3.0)
    assert view.goals(lambda t: said)(0.0) is said
    assert np.allclose(window.data.mocap_pos[0], pose.position)
    nothing = Stamped(None, None, "lost")
    assert view.goals(lambda t: nothing)(0.0) is nothing


def test_the_arm_follows_what_is_dragged_and_a_closed_window_ends_it(scene, robot):
    view, window = view_of(scene, drag=5, close=60)
    simulation, live = Simulation(scene), StandIn("sawyer", robot)
    begin = simulation.tool_pose()
    window.to = np.add(begin.position, [0.0, 0.03, 0.03])
    with view:
        assert simulation.follow(live, view.goals(lambda t: begin), 30.0, each=view.watch(simulation))
    assert window.closed and 0.9 < simulation.time < 3.0
    assert np.linalg.norm(simulation.tool_pose().position - window.to) < 0.01
    assert np.allclose(window.data.qpos[:7], simulation.qpos[scene.robot().qpos_addresses], atol=0.05)


def test_another_scene_is_refused(scene, tmp_path):
    with pytest.raises(InputError, match="of another scene"):
        LiveView(scene, scene_spec("tracing", robot="sawyer"), Window)


def test_without_a_screen_it_is_said(scene, monkeypatch, tmp_path, capsys):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    with pytest.raises(WorkcellError, match="no screen"):
        check_screen({}, "linux")
    check_screen({"DISPLAY": ":0"}, "linux")
    check_screen({}, "darwin")
    with pytest.raises(WorkcellError, match="no screen"):
        launch_viewer(scene.model, None)
    with pytest.raises(SystemExit) as ended:
        main(["run", "follow_target", "--view", "--out", str(tmp_path / "out")])
    assert ended.value.code == 2 and "no screen" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_screen_that_nothing_can_be_shown_on_is_said(scene, monkeypatch):
    """A viewer that does not start would be waited for without an end."""
    monkeypatch.setenv("DISPLAY", ":4711")
    with pytest.raises(WorkcellError, match="--view"):
        launch_viewer(scene.model, None)


def test_a_task_that_follows_nothing_opens_no_window(tmp_path, monkeypatch):
    monkeypatch.setattr("workcell.task.run.check_screen", lambda: None)
    (tmp_path / "idle.toml").write_text(find_task("circle_trace").read_text())
    (tmp_path / "idle.py").write_text("def run(job):\n    job.say('done')\n")
    story = []
    run_task(tmp_path / "idle.toml", out=tmp_path / "out", view=True, say=story.append)
    assert any("no window was opened" in line for line in story)
