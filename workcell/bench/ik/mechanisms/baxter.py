"""Baxter with both hands on one bar: the closed chain of IKSPARK's section X-A, and its goals.

The paper states neither the grasp nor the separation. Ours: the hands (sites `endpoint`) hold a bar that floats, 0.3 m
apart along its z axis, the left one at +0.15 m; both approach along -y of the bar, their x along its z. The bar's
frame, in the middle, is the end effector; with it there are 15 links that move, as in the paper. The torso's frame is
the world's. No collisions, as in the paper.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from workcell.bench.ik.mechanisms.answers import TIGHT
from workcell.ik.mechanisms.goals import FrameGoal
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.result import Status
from workcell.ik.solve import solve
from workcell.model.loading.load import compile_spec, load_robot, load_spec
from workcell.model.mechanism.from_model import mechanism_of
from workcell.model.mechanism.mechanism import Mechanism
from workcell.model.robot import Robot
from workcell.pose import Array, Pose, axis_angle_to_matrix
from workcell.sets.solving import problem_seed

ROBOT, BAR = "baxter", "bar"
SIDES = ("left", "right")
SEPARATION = 0.3
LOWER, UPPER = (0.4, -0.2, 0.2), (0.75, 0.2, 0.7)
"""Metres that goals are within."""
LEAST, MOST = (0.0, 0.0, -0.5 * np.pi), (0.5 * np.pi, np.pi, 0.0)
"""Angles about z, y and x that make their rotations."""
FARTHER = 2.0
"""Metres along x that put them out of reach."""
_ENOUGH = Budget(10.0)
"""For what is to be known about one arm."""


def T_bar_hand(side: str) -> Pose:
    """Where a hand holds the bar."""
    x, z = np.array([0.0, 0.0, 1.0]), np.array([0.0, -1.0, 0.0])
    along = 0.5 * SEPARATION if side == "left" else -0.5 * SEPARATION
    return Pose.from_rotation(along * x, np.stack([x, np.cross(z, x), z], axis=1))


@lru_cache(maxsize=1)
def carrying_baxter() -> Mechanism:
    """Both arms, and the bar that they hold."""
    import mujoco

    spec = load_spec(ROBOT)
    bar = spec.worldbody.add_body(name=BAR, pos=[0.6, 0.0, 0.4])
    bar.add_freejoint(name=BAR)
    bar.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.02, 0.02, 0.13], mass=0.5, contype=0, conaffinity=0)
    for side in SIDES:
        T, held = T_bar_hand(side), f"{side}_grasp"
        bar.add_site(name=held, pos=T.position, quat=T.quat_wxyz)
        tie = spec.add_equality(name=held, type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_SITE)
        tie.name1, tie.name2 = f"{side}/endpoint", held
        tie.data[10] = 1.0  # torquescale: rotations count as positions do
    return mechanism_of(compile_spec(spec, ROBOT), name="baxter with a bar", where=ROBOT)


def goal_poses(n: int, seed: int, *, farther: float = 0.0) -> list[Pose]:
    """Poses of the bar, drawn as in the paper, `farther` metres along x."""
    rng, poses = np.random.default_rng(seed), []
    for _ in range(n):
        position, angles = rng.uniform(LOWER, UPPER), rng.uniform(LEAST, MOST)
        z, y, x = (axis_angle_to_matrix(axis, a) for axis, a in zip(np.eye(3)[::-1], angles, strict=True))
        poses.append(Pose.from_rotation(position + np.array([farther, 0.0, 0.0]), z @ y @ x))
    return poses


def problems_of(poses: Sequence[Pose]) -> list[MechanismProblem]:
    """The questions how both arms bring the bar there."""
    mechanism = carrying_baxter()
    return [
        MechanismProblem(mechanism, (FrameGoal.posed(BAR, pose),), collisions=False, tolerances=TIGHT)
        for pose in poses
    ]


def reachable(poses: Sequence[Pose], seed: int) -> list[bool | None]:
    """Whether each arm reaches its end of the bar by itself, as the solvers of serial chains decide; None: open.

    With the bar's pose given, nothing ties the arms to each other: it can be reached just when both ends can.
    """
    found: list[bool | None] = []
    for k, pose in enumerate(poses):
        told = []
        for side in SIDES:
            problem = IKProblem(_arm(side), pose @ T_bar_hand(side))
            told.append(solve(problem, budget=_ENOUGH, seed=problem_seed(seed, f"{k}/{side}")).status)
        proved = any(status.is_proof for status in told)
        found.append(False if proved else True if all(status is Status.SOLVED for status in told) else None)
    return found


@lru_cache(maxsize=2)
def _arm(side: str) -> Robot:
    """The chain from the torso to a hand."""
    return load_robot(ROBOT, tool=f"{side}/endpoint")


def bar_pose(mechanism: Mechanism, q: Array) -> Pose:
    """Where the bar is at a configuration (size,)."""
    at = mechanism.value_slices[mechanism.joint(BAR)]
    return Pose(q[at][:3], q[at][3:])
