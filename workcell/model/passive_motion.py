"""What passive bodies of a robot lose of their distances while its driven joints stay within an interval."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from workcell.model.coupling import value_range
from workcell.model.loops.motion import LoopBounds, seen_motion
from workcell.model.scene_parts import SceneRobot
from workcell.pose import Array

if TYPE_CHECKING:
    import mujoco


class PassiveMotion:
    """Bounds on how far geoms on passive bodies of a robot move.

    Args:
        model: compiled model.
        robot: with its loops.

    Attributes:
        geoms: ids of the geoms that are on such bodies.
    """

    def __init__(self, model: mujoco.MjModel, robot: SceneRobot) -> None:
        import mujoco

        assert robot.loops is not None
        self._mujoco, self._model, self._robot, self._data = mujoco, model, robot, mujoco.MjData(model)
        self._loops = [(loop, LoopBounds(model, loop.system)) for loop in robot.loops.loops]
        self.geoms = np.flatnonzero(np.isin(model.geom_bodyid, list(robot.loops.bodies))).tolist()
        addresses = np.asarray(model.jnt_qposadr)
        self._joints = [int(np.flatnonzero(addresses == a)[0]) for a in robot.joint_qpos_addresses]

    def seen(self, qpos: Array, widths: Array) -> dict[int, Array] | None:
        """For each geom, metres by which its points can move as seen from each link (m + 1,) that carries it.

        Infinite as seen from the others. None: it is not known.

        Args:
            qpos: (nq,) raw positions, with the loops closed.
            widths: (m,) how far each joint of the robot, those that follow included, may be from its value there.
        """
        away = dict(zip(self._joints, widths.tolist(), strict=True))
        for loop, bounds in self._loops:
            given = np.array([away.get(joint, 0.0) for joint in loop.system.given.tolist()])
            radii = bounds.radii(qpos, given)
            if radii is None:
                return None
            values = qpos[loop.system.passive_qpos]
            if np.any(values - radii < loop.lower) or np.any(values + radii > loop.upper):
                return None
            away |= dict(zip(loop.joints, radii.tolist(), strict=True))
        self._data.qpos[:] = qpos
        self._mujoco.mj_kinematics(self._model, self._data)
        links = {joint: k + 1 for k, joint in enumerate(self._joints)}
        count = len(links) + 1
        return {geom: seen_motion(self._model, self._data, geom, away, links, count) for geom in self.geoms}


class PassivePairs:
    """What pairs of geoms lose of their distance, of which some are on passive bodies.

    Args:
        model: compiled model.
        robot: with its loops.
        pairs: (p, 2) geoms that are looked at.
        links: (g,) the link that carries each geom of the model, 0 for what stands in the world.
    """

    def __init__(
        self, model: mujoco.MjModel, robot: SceneRobot, pairs: NDArray[np.int64], links: NDArray[np.int64]
    ) -> None:
        self._bodies, self._robot, self._links, self._pairs = PassiveMotion(model, robot), robot, links, pairs
        self._rows = np.flatnonzero(np.isin(pairs, self._bodies.geoms).any(axis=1))

    def lose(self, qpos: Array, q: Array, half: Array, moved: Array, motion: Array) -> bool:
        """Write into `motion` (p,) what the pairs of passive geoms lose; whether that is known.

        Args:
            qpos: (nq,) raw positions at `q`, with the loops closed.
            q, half: (n,) configuration, and how far each variable may be from it.
            moved: (m + 1, m + 1) how far links move as seen from each other.
            motion: (p,) changed.
        """
        seen = self._bodies.seen(qpos, joint_widths(self._robot, q, half))
        if seen is None:
            return False
        for row in self._rows:
            motion[row] = _loss(self._pairs[row].tolist(), seen, self._links, moved)
        return True


def _loss(pair: list[int], seen: dict[int, Array], links: NDArray[np.int64], moved: Array) -> float:
    """Metres that two geoms may come closer, at least one of which is on a passive body."""
    levels = [int(np.flatnonzero(np.isfinite(seen[g])).max()) if g in seen else int(links[g]) for g in pair]
    common = min(levels)
    lost = 0.0
    for geom, level in zip(pair, levels, strict=True):
        lost += float(seen[geom][common]) if geom in seen else float(moved[common, level])
    return lost


def joint_widths(robot: SceneRobot, q: Array, half: Array) -> Array:
    """(m,) how far each joint of a robot may be from where it is at q (n,), with its variables within `half` of it."""
    coupling = robot.robot.coupling
    if coupling is None:
        return half
    widths = np.empty(len(coupling.variable))
    for k, (variable, row) in enumerate(zip(coupling.variable, coupling.coefficients, strict=True)):
        at, by = float(q[variable]), float(half[variable])
        low, high = value_range(row, at - by, at + by)
        value = float(np.polynomial.polynomial.polyval(at, row))
        widths[k] = max(high - value, value - low)
    return widths
