"""Other packages that follow poses frame by frame, where installed: mink, RangedIK (`relaxed_ik_core`).

Neither is needed, nor an extra of workcell: `pip install mink relaxed_ik_core`.
"""

from __future__ import annotations

import contextlib
import importlib.util
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from workcell.bench.live.arms import Arms
from workcell.bench.live.traces import PERIOD
from workcell.bench.live.urdf import ROOT, tool_link, urdf_of
from workcell.model.collision_model import CollisionModel
from workcell.model.robot import Robot
from workcell.pose import Array, Pose

_REACTS, _KEEPS = 0.05, 0.005
"""Metres at which mink's collision limit begins, and that it keeps."""
_POSTURE = 1e-3
"""What mink's task to stay where it began costs, beside 1 of the pose."""


def installed(package: str) -> bool:
    """Whether `mink` or `relaxed_ik_core` is there."""
    module = {"relaxed_ik_core": "relaxed_ik_lib"}.get(package, package)
    return importlib.util.find_spec(module) is not None


class Mink:
    """A frame task for each tool, with mink's limits of velocities, configurations and collisions.

    Its program may have no solution; then there is none for that frame.

    Args:
        arms: who follows.
        collisions: whether distances between the arms' own geoms limit velocities.
    """

    def __init__(self, arms: Arms, collisions: bool = True) -> None:
        import mink

        self._mink, self._arms = mink, arms
        model = arms.scene.model
        self._configuration: Any = mink.Configuration(model)
        actors = [arms.scene.robot(name) for name in arms.names]
        self._addresses = np.concatenate([actor.qpos_addresses for actor in actors])
        sites = [model.site(actor.site_ids[actor.robot.default_tool]).name for actor in actors]
        self._frames = [mink.FrameTask(site, "site", 1.0, 1.0, lm_damping=1e-3) for site in sites]
        self._posture = mink.PostureTask(model, _POSTURE)
        speeds = dict(zip(_joint_names(arms), arms.velocity, strict=True))
        self._limits: list[Any] = [mink.ConfigurationLimit(model), mink.VelocityLimit(model, speeds)]
        if collisions:
            pairs = {
                tuple(pair)
                for name in arms.names
                for pair in CollisionModel(arms.scene, name).pair_geoms.tolist()
            }
            groups = [([a], [b]) for a, b in sorted(pairs)]
            if groups:
                limit = mink.CollisionAvoidanceLimit(
                    model,
                    groups,
                    minimum_distance_from_collisions=_KEEPS,
                    collision_detection_distance=_REACTS,
                )
                self._limits.append(limit)

    def reset(self, q: Array) -> None:
        """Stand at q (n,), which it is to stay near to."""
        qpos = np.array(self._arms.scene.initial_qpos())
        qpos[self._addresses] = q
        self._configuration.update(qpos)
        self._posture.set_target(qpos)

    def step(self, goals: Sequence[Pose]) -> Array | None:
        """One program, integrated over a period; None: it has no solution."""
        mink, configuration = self._mink, self._configuration
        for task, goal in zip(self._frames, goals, strict=True):
            task.set_target(mink.SE3(np.concatenate([goal.quat_wxyz, goal.position])))
        try:
            rates = mink.solve_ik(
                configuration, [*self._frames, self._posture], PERIOD, "daqp", limits=self._limits
            )
        except (mink.NoSolutionFound, mink.NotWithinConfigurationLimits):
            return None
        configuration.integrate_inplace(rates, PERIOD)
        q: Array = np.array(configuration.q[self._addresses])
        return q


class RangedIK:
    """RangedIK with no ranges, which makes it RelaxedIK, from a URDF and settings that are written for it.

    Its Python door takes one goal: two arms have a solver each, which don't know of each other. Velocity limits are a
    cost, and the robot itself is balls around its joints.
    """

    def __init__(self, arms: Arms) -> None:
        self._arms = arms
        self._solvers: list[Any] = []

    def reset(self, q: Array) -> None:
        """Made anew: there is no other way to let it begin elsewhere."""
        arms = self._arms
        self._solvers = [
            _ranged_ik(name, robot, q[columns])
            for name, robot, columns in zip(arms.names, arms.robots, arms.columns, strict=True)
        ]

    def step(self, goals: Sequence[Pose]) -> Array | None:
        """One optimisation an arm; None where one says that it failed."""
        found: list[Array] = []
        for solver, goal in zip(self._solvers, goals, strict=True):
            q, said = solver.solve(np.array(goal.position), np.array(goal.quat_wxyz))
            if said != "Success" or not np.all(np.isfinite(q)):
                return None
            found.append(q)
        return np.concatenate(found)


def _ranged_ik(name: str, robot: Robot, q: Array) -> Any:
    """A solver that begins at q (n,)."""
    import relaxed_ik_lib

    lines = ["urdf: arm.urdf", "link_radius: 0.05", "base_links:", f"  - {ROOT}"]
    lines += ["ee_links:", f"  - {tool_link(name)}"]
    lines += [f"starting_config: {[float(value) for value in q]}", "obstacles:"]
    with TemporaryDirectory() as made, _silently_in(Path(made)) as folder:
        robots = folder / "configs" / "urdfs"
        robots.mkdir(parents=True)
        (robots / "arm.urdf").write_text(urdf_of([name], [robot]), encoding="utf-8")
        settings = folder / "settings.yaml"
        settings.write_text("\n".join(lines), encoding="utf-8")
        return relaxed_ik_lib.RelaxedIK(str(settings))


def _joint_names(arms: Arms) -> list[str]:
    """Names in the compiled model of all arms' joints."""
    found: list[str] = []
    for name in arms.names:
        actor = arms.scene.robot(name)
        found += [f"{actor.prefix}{joint}" for joint in actor.robot.joint_names]
    return found


@contextlib.contextmanager
def _silently_in(folder: Path) -> Iterator[Path]:
    """In a folder, with what is printed below Python thrown away."""
    here, shown = Path.cwd(), os.dup(1)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.chdir(folder)
    try:
        yield folder
    finally:
        os.chdir(here)
        os.dup2(shown, 1)
        os.close(shown)
        os.close(nowhere)
