"""`LiveView`: a window on a simulation as it runs, in which tools' goals can be dragged with the mouse."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from workcell.errors import InputError, WorkcellError
from workcell.model.scene import Scene
from workcell.motion.live.goals import LiveGoal
from workcell.motion.live.stream import Stamped
from workcell.pose import Array, Pose
from workcell.simulate.live.solver import GoalSource

if TYPE_CHECKING:
    import mujoco

HOW = "double-click a target, then Ctrl and drag: right button to move it, left button to turn it"
_FRAME_S = 1.0 / 60.0
_DRAGGED = 1e-9
_AXES = ((0.9, 0.15, 0.1, 0.9), (0.1, 0.65, 0.15, 0.9), (0.15, 0.3, 0.9, 0.9))


class Window(Protocol):
    """What is needed of the handle of MuJoCo's passive viewer."""

    def is_running(self) -> bool:
        """Whether it has not been closed."""
        ...

    def lock(self) -> AbstractContextManager[Any]:
        """While held, nothing is drawn, and no mouse moves anything."""
        ...

    def sync(self) -> None:
        """Show the data, and move what the mouse drags."""
        ...

    def close(self) -> None:
        """End it."""
        ...


class Running(Protocol):
    """What a window shows of a simulation."""

    @property
    def time(self) -> float:
        """Seconds."""
        ...

    @property
    def qpos(self) -> Array:
        """(nq,) where everything is."""
        ...


Launch = Callable[["mujoco.MjModel", "mujoco.MjData"], Window]


def check_screen(environment: Mapping[str, str] = os.environ, platform: str = sys.platform) -> None:
    """Raise WorkcellError where no window can be opened: MuJoCo's viewer would wait for it without an end."""
    if platform.startswith("linux") and not (
        environment.get("DISPLAY") or environment.get("WAYLAND_DISPLAY")
    ):
        raise WorkcellError(
            "there is no screen to open a window on", where="--view", remedy="run it in a desktop session"
        )


def launch_viewer(model: mujoco.MjModel, data: mujoco.MjData) -> Window:
    """MuJoCo's passive viewer; raises WorkcellError where there is no screen, or no viewer."""
    check_screen()
    try:
        import glfw  # type: ignore[import-untyped, import-not-found, unused-ignore]
        import mujoco.viewer
    except (ImportError, RuntimeError, OSError) as error:
        raise WorkcellError(
            f"MuJoCo's viewer can't be used: {error}", where="--view", remedy="pip install glfw"
        ) from None
    if not glfw.init():
        raise WorkcellError(
            "no window can be opened on this screen", where="--view", remedy="check DISPLAY, and its OpenGL"
        )
    try:
        window: Window = mujoco.viewer.launch_passive(model, data)
    except RuntimeError as error:
        raise WorkcellError(f"MuJoCo's viewer can't be used: {error}", where="--view") from None
    return window


class LiveView:
    """The window of one run. Use it as a context manager.

    A goal goes where its source says until somebody drags it; from then on it is where it was dragged to.

    Args:
        scene: that is simulated.
        spec: the same scene before it was compiled; targets are added to it.
        launch: opens the window.

    Raises:
        WorkcellError: there is no screen.
    """

    def __init__(self, scene: Scene, spec: mujoco.MjSpec, launch: Launch = launch_viewer) -> None:
        import mujoco

        self._mujoco, self._names = mujoco, tuple(scene.robots)
        for name in self._names:
            _add_target(spec, name)
        self.model = spec.compile()
        if self.model.nq != scene.model.nq:
            raise InputError("the window is of another scene", where="spec")
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:] = scene.initial_qpos()
        self._mocaps = {
            name: int(self.model.body_mocapid[self.model.body(_target(name)).id]) for name in self._names
        }
        self._shown: dict[str, Array] = {}
        self._dragged: set[str] = set()
        mujoco.mj_forward(self.model, self.data)
        self._window = launch(self.model, self.data)
        self._began: tuple[float, float] | None = None
        self._drawn = -np.inf

    def __enter__(self) -> LiveView:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._window.close()

    def goals(self, source: GoalSource) -> GoalSource:
        """What `source` says, but for the goals that were dragged."""

        def told(t: float) -> Any:
            said = source(t)
            stamped = said if isinstance(said, Stamped) else Stamped(said)  # type: ignore[arg-type]
            poses = _by_name(stamped.goal, self._names)
            for name, pose in poses.items():
                if pose is not None and name not in self._dragged:
                    self._put(name, pose)
            if not self._dragged:
                return said
            return {
                name: self._pose(name) if name in self._dragged else poses.get(name) for name in self._names
            }

        return told

    def watch(self, simulation: Running) -> Callable[[], bool]:
        """What is to be called after every tick: shows it in time, and says whether the window is still open."""

        def tick() -> bool:
            if self._began is None:
                self._began = time.perf_counter(), simulation.time
            ahead = simulation.time - self._began[1] - (time.perf_counter() - self._began[0])
            if ahead > 0:
                time.sleep(ahead)
            if time.perf_counter() - self._drawn >= _FRAME_S:
                self._drawn = time.perf_counter()
                self.show(simulation.qpos)
            return self._window.is_running()

        return tick

    def show(self, qpos: Array) -> None:
        """Draw the scene at raw positions (nq,), and take what the mouse has dragged."""
        with self._window.lock():
            self.data.qpos[:] = qpos
            self._mujoco.mj_forward(self.model, self.data)
        self._window.sync()
        for name, shown in self._shown.items():
            if np.abs(self._mocap(name) - shown).max() > _DRAGGED:
                self._dragged.add(name)

    def _put(self, name: str, pose: Pose) -> None:
        row = np.concatenate([pose.position, pose.quat_wxyz])
        with self._window.lock():
            self.data.mocap_pos[self._mocaps[name]], self.data.mocap_quat[self._mocaps[name]] = (
                row[:3],
                row[3:],
            )
        self._shown[name] = row

    def _mocap(self, name: str) -> Array:
        k = self._mocaps[name]
        return np.concatenate([self.data.mocap_pos[k], self.data.mocap_quat[k]])

    def _pose(self, name: str) -> Pose:
        row = self._mocap(name)
        return Pose(row[:3], row[3:] / np.linalg.norm(row[3:]))


def _by_name(goals: Any, names: tuple[str, ...]) -> dict[str, Pose | None]:
    """The pose of each named robot's goal."""
    if goals is None:
        return {}
    named = goals if isinstance(goals, Mapping) else {names[0]: goals}
    return {name: goal.pose if isinstance(goal, LiveGoal) else goal for name, goal in named.items()}


def _target(name: str) -> str:
    return f"target of {name}"


def _add_target(spec: mujoco.MjSpec, name: str) -> None:
    """A body that the mouse can move: a ball with three axes, which touches nothing."""
    import mujoco

    body = spec.worldbody.add_body(name=_target(name), mocap=True)
    ball, capsule = mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_CAPSULE
    seen: dict[str, Any] = {"contype": 0, "conaffinity": 0, "group": 2}
    body.add_geom(type=ball, size=[0.018, 0, 0], rgba=[1.0, 0.85, 0.2, 0.6], **seen)
    for axis, colour in zip(np.eye(3), _AXES, strict=True):
        ends = [0.0, 0.0, 0.0, *(0.09 * axis)]
        body.add_geom(type=capsule, size=[0.004, 0, 0], fromto=ends, rgba=list(colour), **seen)
