"""How an arm's motors are driven: computed torque, or a position servo with feed-forward, as real ones have.

Computed torque: the arm's own dynamics cancel, what remains of the error decays like a damped spring.

    tau = inverse_dynamics(q, qd, qdd_ref + kd (qd_ref - qd) + kp (q_ref - q))

Position servo: each joint has a spring and a damper of its own, fixed once; gravity, velocity and acceleration of the
reference are fed forward, so that the spring works against what the model lacks alone.

    tau = inverse_dynamics(q_ref, qd_ref, qdd_ref) + D (qd_ref - qd) + K (q_ref - q)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol, get_args

import numpy as np

from workcell.errors import InputError, UnknownNameError
from workcell.model.scene_parts import SceneRobot
from workcell.motion.path import Trajectory
from workcell.pose import Array
from workcell.simulate.arm_model import ArmModel
from workcell.simulate.imperfections import Imperfections

if TYPE_CHECKING:
    import mujoco

ControllerName = Literal["computed_torque", "servo"]
CONTROLLERS: tuple[str, ...] = get_args(ControllerName)


@dataclass(frozen=True, slots=True)
class Gains:
    """Feedback per unit of inertia: `kp` in 1/s^2 and `kd` in 1/s, the same for every joint."""

    kp: float = 400.0
    kd: float = 40.0

    def __post_init__(self) -> None:
        if not (self.kp > 0 and self.kd > 0):
            raise InputError(f"gains must be positive, not kp {self.kp}, kd {self.kd}", where="gains")


class Controller(Protocol):
    """Torques for one arm; `arm` is what it believes of the arm's dynamics."""

    arm: ArmModel

    def torque(
        self, qpos: Array, qvel: Array, q_ref: Array, qd_ref: Array, qdd_ref: Array
    ) -> tuple[Array, bool]:
        """Joint torques (n,), clamped at the effort limits, and whether any was clamped.

        Args:
            qpos, qvel: raw state of the whole scene.
            q_ref, qd_ref, qdd_ref: (n,) where the joints should be, and how they should move.
        """
        ...


class ComputedTorque:
    """The controller of one robot in a compiled model, by computed torque.

    Args:
        model: the simulated model; it is copied.
        robot: the robot to control, by actuators that torques can be asked of (`ArmModel`).
        gains: feedback.
        imperfections: what it misjudges and mismeasures; None: nothing.

    Raises:
        ModelError: an actuator that no torque can be asked of.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        robot: SceneRobot,
        gains: Gains | None = None,
        imperfections: Imperfections | None = None,
    ) -> None:
        self.arm = ArmModel(model, robot, imperfections)
        self.gains = gains or Gains()

    def torque(
        self, qpos: Array, qvel: Array, q_ref: Array, qd_ref: Array, qdd_ref: Array
    ) -> tuple[Array, bool]:
        """See `Controller.torque`."""
        q, qd = self.arm.measured(qpos, qvel)
        wanted = qdd_ref + self.gains.kd * (qd_ref - qd) + self.gains.kp * (q_ref - q)
        return self.arm.clamped(self.arm.inverse(qpos, qvel, q, qd, wanted))


SERVO_GAINS = Gains(kp=2500.0, kd=100.0)
"""Critically damped at 50 rad/s about the inertia at the start: stiff, as geared drives are."""


_LARGEST_STEP = 1.3
"""Share of a joint velocity that the dampers may take away in a control step; from 2 on they shake the arm."""


class PositionServo:
    """The controller of one robot in a compiled model: a joint servo with feed-forward.

    The springs and dampers are `gains` times the joints' inertias at the start; they stay as the arm moves. Light links
    that hang on each other feel more of them than their own inertia says: for such an arm the dampers are weaker, as
    much as one control step allows, and the springs with them.

    Args: as `ComputedTorque`, and
        qpos: (nq,) raw positions of the scene at the start.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        robot: SceneRobot,
        qpos: Array,
        gains: Gains | None = None,
        imperfections: Imperfections | None = None,
    ) -> None:
        self.arm = ArmModel(model, robot, imperfections)
        self.gains = gains or SERVO_GAINS
        inertia = self.arm.inertia_at_start(qpos)
        own = np.diag(inertia)
        rate = self.gains.kd * float(np.abs(np.linalg.eigvals(np.linalg.solve(inertia, np.diag(own)))).max())
        softer = min(1.0, _LARGEST_STEP / (rate * model.opt.timestep))
        self.stiffness, self.damping = softer**2 * self.gains.kp * own, softer * self.gains.kd * own

    def torque(
        self, qpos: Array, qvel: Array, q_ref: Array, qd_ref: Array, qdd_ref: Array
    ) -> tuple[Array, bool]:
        """See `Controller.torque`."""
        q, qd = self.arm.measured(qpos, qvel)
        fed = self.arm.inverse(qpos, qvel, q_ref, qd_ref, qdd_ref)
        return self.arm.clamped(fed + self.stiffness * (q_ref - q) + self.damping * (qd_ref - qd))


def make_controller(
    name: str,
    model: mujoco.MjModel,
    robot: SceneRobot,
    qpos: Array,
    gains: Gains | None = None,
    imperfections: Imperfections | None = None,
) -> Controller:
    """A controller by name; raises UnknownNameError for a name that isn't in `CONTROLLERS`."""
    if name == "computed_torque":
        return ComputedTorque(model, robot, gains, imperfections)
    if name == "servo":
        return PositionServo(model, robot, qpos, gains, imperfections)
    raise UnknownNameError("controller", name, CONTROLLERS)


def discrete_reference(trajectory: Trajectory) -> tuple[Array, Array, Array]:
    """q, qd, qdd (T, n) that MuJoCo's semi-implicit integration reproduces at every sample.

    It steps `qd' = qd + h qdd`, then `q' = q + h qd'`: velocities are backward differences of the positions, and
    accelerations forward differences of those. With the true derivatives instead, the feedback would fight an offset
    of `h qdd / 2` in the velocity.
    """
    q, h = trajectory.q, trajectory.dt
    qd = np.vstack([np.zeros_like(q[:1]), np.diff(q, axis=0) / h])
    qdd = np.vstack([np.diff(qd, axis=0) / h, np.zeros_like(q[:1])])
    return q, qd, qdd
