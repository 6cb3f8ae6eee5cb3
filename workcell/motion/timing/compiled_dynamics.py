"""Torques by the compiled model itself: springs, dry friction, compensated weight, tendons, drag.

Pinocchio's chain knows masses, rotors and viscous damping. `lacks` looks through the arrays of the compiled model for
what acts on a robot beside these; where there is any, the torques are those of `mj_inverse`, on a copy without
contacts, limits and equalities, whose forces would be counted into the torques. Dry friction remains: MuJoCo has it
among its constraints, but it is the motor that has to overcome it.
"""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING

import numpy as np

from workcell.errors import ModelError
from workcell.model.loading.actuators import actuator_of_joint
from workcell.model.scene import Scene
from workcell.model.scene_parts import SceneObject, SceneRobot
from workcell.pose import Array, Pose

if TYPE_CHECKING:
    import mujoco

_SLIDING = 1e8
"""Acceleration of the fastest joint at which dry friction has its full size, in joints that hardly move too."""


class CompiledDynamics:
    """Inverse dynamics of one robot by MuJoCo, the rest of the scene standing as it begins.

    Args:
        scene: the scene; its model is copied.
        robot: the robot.
        attached: (object name, T_tool_object) that the hand carries, moved along with all that acts on it.
        share: of what acts on it that this robot carries.

    Raises:
        ModelError: a spring that yields: its torque depends on the past.
    """

    def __init__(
        self,
        scene: Scene,
        robot: SceneRobot,
        attached: tuple[str, Pose] | None = None,
        share: float = 1.0,
    ) -> None:
        import mujoco

        refuse_yielding(scene, robot)
        self._mujoco, self._robot, self._share = mujoco, robot, share
        self._dofs = robot.joint_dof_addresses
        self._model = copy.copy(scene.model)
        self._fluid = float(self._model.opt.density), float(self._model.opt.viscosity)
        bits = mujoco.mjtDisableBit
        self._flags = int(self._model.opt.disableflags) | int(
            bits.mjDSBL_CONTACT | bits.mjDSBL_EQUALITY | bits.mjDSBL_LIMIT
        )
        self._model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_INVDISCRETE)
        self._data = mujoco.MjData(self._model)
        self._rest = np.array(scene.initial_qpos())
        self._held: SceneObject | None = None
        if attached is not None:
            tool, thing = robot.robot.tool(), scene.object(attached[0])
            self._held = None if thing.qpos_address is None else thing
            self._T_link_object = tool.T_link_tool @ attached[1]
            self._hand = robot.link_body_ids[tool.link][0]

    def at(self, q: Array, qd: Array, qdd: Array) -> Array:
        """(T, n) torques for rows of positions, velocities and accelerations (T, n) each."""
        return self._inverse(q, qd, qdd, dry=True, viscous=True)

    def rigid(self, q: Array, qd: Array, qdd: Array) -> Array:
        """The same without what speeds alone resist: neither damping nor drag nor dry friction."""
        return self._inverse(q, qd, qdd, dry=False, viscous=False)

    def viscous(self, q: Array, qd: Array) -> Array:
        """(T, n) torques against damping and drag."""
        still = np.zeros_like(q)
        resisted = self._inverse(q, qd, still, dry=False, viscous=True)
        return resisted - self._inverse(q, qd, still, dry=False, viscous=False)

    def dry(self, q: Array, qd: Array) -> Array:
        """(T, n) torques against dry friction, of joints and tendons, in the directions of `qd`; 0 for what rests."""
        speed = self._robot.robot.joint_motion(q, qd, np.zeros_like(q))[1]
        fastest = np.abs(speed).max(axis=1, keepdims=True)
        sliding = np.divide(_SLIDING * speed, fastest, out=np.zeros_like(speed), where=fastest > 0)
        self._set(dry=True, viscous=False)
        found = []
        for here, direction in zip(q, sliding, strict=True):
            self._move(here, np.zeros_like(direction), direction)
            self._mujoco.mj_inverse(self._model, self._data)
            found.append(-self._transmitted(self._data.qfrc_constraint)[self._dofs])
        return self._robot.robot.variable_forces(q, np.array(found))

    def _inverse(self, q: Array, qd: Array, qdd: Array, *, dry: bool, viscous: bool) -> Array:
        self._set(dry, viscous)
        rows = []
        for row in zip(q, qd, qdd, strict=True):
            _, speed, push = self._robot.robot.joint_motion(*row)
            self._move(row[0], speed, push)
            jacobian = None if self._held is None else self._carry(self._held, speed, push)
            self._mujoco.mj_inverse(self._model, self._data)
            torque = self._transmitted(self._data.qfrc_inverse)[self._dofs]
            if jacobian is not None and self._held is not None:
                torque = torque + self._share * jacobian.T @ self._data.qfrc_inverse[self._free(self._held)]
            rows.append(np.array(torque))
        return self._robot.robot.variable_forces(q, np.array(rows))

    def _set(self, dry: bool, viscous: bool) -> None:
        bits, option = self._mujoco.mjtDisableBit, self._model.opt
        option.disableflags = (
            self._flags
            | (0 if dry else int(bits.mjDSBL_FRICTIONLOSS))
            | (0 if viscous else int(bits.mjDSBL_DAMPER))
        )
        option.density, option.viscosity = self._fluid if viscous else (0.0, 0.0)

    def _move(self, q: Array, qd: Array, qdd: Array) -> None:
        """The robot moves, and nothing else: variables q (n,), joint velocities and accelerations (m,)."""
        data = self._data
        data.qpos[:], data.qvel[:], data.qacc[:] = self._rest, 0.0, 0.0
        self._robot.place(data.qpos, q)
        data.qvel[self._dofs], data.qacc[self._dofs] = qd, qdd
        if self._robot.loops is not None:
            self._robot.loops.move(data.qpos, data.qvel, data.qacc)

    def _transmitted(self, forces: Array) -> Array:
        """Forces (nv,) with those on passive joints where loops transmit them to."""
        loops = self._robot.loops
        return forces if loops is None else loops.transmitted(self._data.qpos, forces)

    def _carry(self, held: SceneObject, qd: Array, qdd: Array) -> Array:
        """Move the object in the hand along; (6, n) its own velocities for those of the joints.

        MuJoCo has a free body's velocity in the world's axes, its turning in its own.
        """
        mj, model, data = self._mujoco, self._model, self._data
        q, dofs = data.qpos[self._robot.qpos_addresses], self._dofs
        link = self._robot.robot.tool().link
        T = Pose.from_matrix(self._robot.robot.link_transforms(np.array(q))[link]) @ self._T_link_object
        mj.mj_kinematics(model, data)
        mj.mj_comPos(model, data)
        mj.mj_comVel(model, data)
        whole, change = np.zeros((6, model.nv)), np.zeros((6, model.nv))
        mj.mj_jac(model, data, whole[:3], whole[3:], T.position, self._hand)
        mj.mj_jacDot(model, data, change[:3], change[3:], T.position, self._hand)
        into = np.eye(6)
        into[3:, 3:] = T.rotation.T
        jacobian: Array = into @ whole[:, dofs]
        held.place(data.qpos, T)
        free = self._free(held)
        data.qvel[free] = jacobian @ qd
        data.qacc[free] = jacobian @ qdd + into @ change[:, dofs] @ qd
        return jacobian

    def _free(self, held: SceneObject) -> slice:
        first = int(self._model.body_dofadr[held.body_id])
        return slice(first, first + 6)


def lacks(scene: Scene, robot: SceneRobot, attached: str | None = None) -> tuple[str, ...]:
    """What of the compiled model acts on a robot, and on what it carries, that a chain of masses lacks: in words.

    Args:
        scene: the scene.
        robot: the robot.
        attached: name of the object in its hand.
    """
    import mujoco

    model, dofs = scene.model, robot.joint_dof_addresses
    joints = np.unique(model.dof_jntid[dofs])
    bodies = sorted(
        robot.body_ids | (scene.object(attached).body_ids if attached is not None else frozenset())
    )
    drives = [a for j in joints if (a := actuator_of_joint(model, int(j))) is not None]
    bits, flags = mujoco.mjtDisableBit, int(model.opt.disableflags)
    switched = bits.mjDSBL_GRAVITY | bits.mjDSBL_SPRING | bits.mjDSBL_DAMPER
    found = {
        "compensated weight": np.any(model.body_gravcomp[bodies] != 0),
        "joint springs": np.any(model.jnt_stiffness[joints] != 0)
        or np.any(model.jnt_stiffnesspoly[joints] != 0),
        "dry friction": np.any(model.dof_frictionloss[dofs] != 0),
        "damping that is not linear": np.any(model.dof_dampingpoly[dofs] != 0),
        "a motor's own inertia or damping": np.any(model.actuator_armature[drives] != 0)
        or np.any(model.actuator_damping[drives] != 0)
        or np.any(model.actuator_dampingpoly[drives] != 0),
        "tendons": any(_acts(model, t, joints) for t in range(model.ntendon)),
        "a fluid": model.opt.density != 0 or model.opt.viscosity != 0,
        "forces that its options switch off": bool(flags & int(switched)),
        "passive loops": robot.loops is not None and len(robot.loops.loops) > 0,
        "plugins": model.nplugin > 0,
        "flexible bodies": model.nflex > 0,
    }
    return tuple(what for what, there in found.items() if there)


def _acts(model: mujoco.MjModel, tendon: int, joints: Array) -> bool:
    """Whether a tendon pulls, resists or weighs, and is not known to run past the joints."""
    import mujoco

    terms = ("stiffness", "stiffnesspoly", "damping", "dampingpoly", "frictionloss", "armature")
    drives = (model.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON) & (model.actuator_trnid[:, 0] == tendon)
    own = any(np.any(getattr(model, f"tendon_{term}")[tendon] != 0) for term in terms)
    motors = any(
        np.any(getattr(model, f"actuator_{t}")[drives] != 0) for t in ("armature", "damping", "dampingpoly")
    )
    first = int(model.tendon_adr[tendon])
    wraps = slice(first, first + int(model.tendon_num[tendon]))
    fixed = np.all(model.wrap_type[wraps] == mujoco.mjtWrap.mjWRAP_JOINT)
    past = fixed and not np.any(np.isin(model.wrap_objid[wraps], joints))
    return bool((own or motors) and not past)


def refuse_yielding(scene: Scene, robot: SceneRobot) -> None:
    """Raise ModelError where a spring yields: what it pulls with depends on how far it was stretched before."""
    model = scene.model
    for joint in np.unique(model.dof_jntid[robot.joint_dof_addresses]):
        if model.jnt_springyield[joint] > 0:
            name = f"joint {model.joint(int(joint)).name!r}"
            break
    else:
        yielding = np.flatnonzero(np.asarray(model.tendon_springyield) > 0)
        if not len(yielding):
            return
        name = f"tendon {model.tendon(int(yielding[0])).name!r}"
    raise ModelError(
        f"the spring of {name} yields: the torques of a motion would depend on the motions before it",
        where=scene.path,
        remedy="a spring without springyield",
    )
