"""The arms of the live benches: scenes, worlds, kernels' arrays, and what tells a singularity from the rest."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from workcell.bench.live.cells import SIDES, cell
from workcell.bench.live.traces import Setup
from workcell.geometry.packing import pack_arm
from workcell.model.robot import Robot
from workcell.model.scene import Scene
from workcell.pose import Array, axis_angle_to_matrix
from workcell.world.planning_world import PlanningWorld

if TYPE_CHECKING:
    from workcell.kernels.chain import Arm

SETUPS = (
    Setup("fanuc_lrmate200ic", (0.51, 0.0, 0.21), (0.24, 0.0, 0.645), 0.22, in_plane=True),
    Setup("ur5", (0.68, 0.0, 0.09), (0.62, 0.0, 0.15), 0.30, apart=0.9),
    Setup("jaco", (0.68, 0.0, 0.27), (0.31, 0.0, 0.32), 0.28, pace=4.0),
    Setup("sawyer", (0.74, 0.16, 0.48), (0.67, 0.0, -0.02), 0.32, apart=0.9),
    Setup("iiwa7", (0.63, 0.0, 0.25), (0.29, 0.04, 0.78), 0.26),
    Setup("hubo_arm", (0.58, -0.24, 0.56), (0.44, -0.29, 0.37), 0.22, side=-0.24),
    Setup("hubo_waist_arm", (0.77, -0.24, 0.46), (0.52, -0.34, 0.39), 0.32, side=-0.24),
)
"""The paper's seven arms. Centres were looked for with point IK; circles are 3/4 of the largest it follows, or more."""
QUANTILE = 0.025
"""Of random configurations' conditioning, below which one counts as singular."""
_SAMPLES = 100_000
ARM = "arm"
"""Name of an arm that is alone."""


@dataclass(frozen=True, slots=True)
class Arms:
    """One arm, or two of a kind side by side, in a scene.

    Attributes:
        setup: how tasks are laid out for it.
        scene: the compiled scene.
        names: of the arms in it.
        robots: their kinematics, bases in their places.
    """

    setup: Setup
    scene: Scene
    names: tuple[str, ...]
    robots: tuple[Robot, ...]

    @property
    def dof(self) -> int:
        """Number of joints of all arms."""
        return sum(robot.dof for robot in self.robots)

    @property
    def columns(self) -> tuple[slice, ...]:
        """Where each arm's joints are in a configuration of all."""
        ends = np.cumsum([0, *(robot.dof for robot in self.robots)])
        return tuple(slice(int(a), int(b)) for a, b in pairwise(ends))

    @property
    def velocity(self) -> Array:
        """(n,) limits of all joints, radians or metres a second."""
        return np.concatenate([robot.velocity for robot in self.robots])

    def packed(self) -> list[Arm]:
        """The kernels' arrays of each arm."""
        return [pack_arm(robot) for robot in self.robots]

    def worlds(self) -> list[PlanningWorld]:
        """A planning world for each arm, made once."""
        return _worlds(self.setup, len(self.names))


@lru_cache(maxsize=32)
def arms_of(setup: Setup, count: int = 1) -> Arms:
    """One arm, or two."""
    names = (ARM,) if count == 1 else SIDES
    bases = {name: setup.base(k, count).tolist() for k, name in enumerate(names)}
    scene = cell(setup.robot, bases)
    return Arms(setup, scene, names, tuple(scene.robot(name).robot for name in names))


@lru_cache(maxsize=32)
def _worlds(setup: Setup, count: int) -> list[PlanningWorld]:
    arms = arms_of(setup, count)
    return [PlanningWorld.of(arms.scene, name) for name in arms.names]


def rest_rotation(robot: Robot) -> Array:
    """(3, 3) the tool's rotation at rest: as at home, turned the shortest way until the hand points forwards.

    The hand points along the tool's z axis, or against it, whichever leads away from the last link.
    """
    home, offset = robot.fk(robot.home).rotation, robot.tool().T_link_tool
    away = -1.0 if (offset.rotation.T @ offset.position)[2] < -1e-6 else 1.0
    pointing = away * home[:, 2]
    across = np.cross(pointing, [1.0, 0.0, 0.0])
    sine = float(np.linalg.norm(across))
    axis = across / sine if sine > 1e-9 else np.array([0.0, 0.0, 1.0])
    turned: Array = axis_angle_to_matrix(axis, np.arctan2(sine, pointing[0])) @ home
    return turned


def conditioning(robot: Robot, q: Array) -> Array:
    """(...) smallest over largest singular value of the tool's Jacobian at configurations (..., n)."""
    values = np.linalg.svd(robot.jacobian(q), compute_uv=False)
    ratio: Array = values[..., -1] / values[..., 0]
    return ratio


_thresholds: dict[bytes, float] = {}


def threshold(robot: Robot) -> float:
    """The conditioning below which a configuration of the arm counts as singular.

    The paper's mean less two standard deviations stands for the lowest 2.5 % of random configurations, and is below
    zero on some arms: this is the quantile itself.
    """
    # robots of scenes have the scene's names: kinematics tell them apart, wherever they stand
    tool = robot.tool().T_link_tool
    parts = (robot.joint_xyz[1:], robot.joint_rotation[1:], robot.axis, robot.lower, robot.upper, tool.matrix)
    key = b"".join(np.ascontiguousarray(part).tobytes() for part in parts)
    if key not in _thresholds:
        rng = np.random.default_rng(0)
        ratios = [conditioning(robot, robot.random_configuration(rng, _SAMPLES // 10)) for _ in range(10)]
        _thresholds[key] = float(np.quantile(np.concatenate(ratios), QUANTILE))
    return _thresholds[key]
