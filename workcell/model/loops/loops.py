"""`Loops`: which of a robot's joints nothing drives, what determines them, and where they are.

A joint that nothing drives is passive. Connects, welds and equalities of fixed tendons may determine it: then it is
found by `close` from the joints that are given, so that bodies on it are where the model really has them. Who finds
the loops is `workcell.model.loading.passive_joints`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workcell.model.loops.closing import TOLERANCE, LoopSystem
from workcell.model.loops.elements import TendonLimit
from workcell.model.robot import LIMIT_SLACK
from workcell.pose import Array


@dataclass(frozen=True, slots=True)
class Loop:
    """Passive joints that hang together, and the elements that determine them.

    Attributes:
        names: of its elements, for messages.
        joints: ids of the k passive joints; joint_names: their names.
        system: its equations.
        lower, upper: (k,) the joints' limits, infinite where they have none.
    """

    names: tuple[str, ...]
    joints: tuple[int, ...]
    joint_names: tuple[str, ...]
    system: LoopSystem
    lower: Array
    upper: Array

    @property
    def name(self) -> str:
        """Its elements in words."""
        return " and ".join(self.names)


@dataclass(frozen=True, slots=True)
class Loops:
    """The passive joints of one robot.

    Attributes:
        loops: those that elements of the model determine, by driven joints among others.
        inner: those that are determined without driven joints, such as a gripper's linkages, by its fingers.
        limits: of fixed tendons over driven joints, with the addresses of those in qpos.
        bodies: ids of the bodies that the passive joints of `loops` move.
        undetermined: names of the joints that nothing drives and nothing determines: they stay where they begin.
        refusals: what can't be honoured, in words with the elements' names; empty where there is nothing.
    """

    loops: tuple[Loop, ...]
    inner: tuple[Loop, ...]
    limits: tuple[tuple[TendonLimit, NDArray[np.int64]], ...]
    bodies: frozenset[int]
    undetermined: tuple[str, ...]
    refusals: tuple[str, ...]

    @property
    def passive(self) -> tuple[str, ...]:
        """Names of the joints that loops determine."""
        return tuple(name for loop in (*self.loops, *self.inner) for name in loop.joint_names)

    @property
    def joints(self) -> tuple[int, ...]:
        """Ids of the joints that loops determine by driven ones."""
        return tuple(joint for loop in self.loops for joint in loop.joints)

    def close(self, qpos: Array) -> str:
        """Write into raw positions (nq,) where the passive joints are with all others there.

        Returns:
            why that is no configuration of the mechanism, in words; empty where it is one.
        """
        reasons = [_closed(self.loops, qpos)]
        for limit, addresses in self.limits:
            assert limit.multiples is not None
            length = float(limit.multiples @ qpos[addresses])
            if not limit.lower - LIMIT_SLACK <= length <= limit.upper + LIMIT_SLACK:
                reasons.append(
                    f"{limit.name} is {length:.6g} long, outside [{limit.lower:.6g}, {limit.upper:.6g}]"
                )
        return "; ".join(filter(None, reasons))

    def settle(self, qpos: Array) -> str:
        """The same for the loops that no driven joint moves."""
        return _closed(self.inner, qpos)

    def move(self, qpos: Array, qvel: Array, qacc: Array) -> None:
        """Write into velocities and accelerations (nv,) those of the passive joints, by those of all others.

        Args:
            qpos: (nq,) raw positions, with the loops closed.
        """
        for loop in self.loops:
            system = loop.system
            ratios = system.ratios(qpos)
            qvel[system.passive_dofs] = ratios @ qvel[system.given_dofs]
            qacc[system.passive_dofs] = ratios @ qacc[system.given_dofs] + system.drift(qpos, qvel)

    def transmitted(self, qpos: Array, forces: Array) -> Array:
        """Forces on all joints (nv,) or rows of them, those on passive joints moved to the joints that move them.

        What loops transmit does no work; their passive joints are left without force.

        Args:
            qpos: (nq,) raw positions, with the loops closed.
        """
        moved = np.array(forces)
        for loop in self.loops:
            ratios, system = loop.system.ratios(qpos), loop.system
            moved[..., system.given_dofs] += moved[..., system.passive_dofs] @ ratios
            moved[..., system.passive_dofs] = 0.0
        return moved

    def torn(self, one: Array, two: Array) -> str:
        """Why the passive joints can't go from raw positions (nq,) to others on a straight line of the driven ones.

        Loops that are closed at both ends may be so in different ways. An empty text where they can.
        """
        apart = [loop.name for loop in self.loops if not loop.system.follows(one, two)]
        return f"{' and '.join(apart)} would have to be assembled in another way on the way" if apart else ""


def _closed(loops: tuple[Loop, ...], qpos: Array) -> str:
    reasons = []
    for loop in loops:
        found = loop.system.close(qpos)
        qpos[loop.system.passive_qpos] = found.values
        if found.missed > TOLERANCE:
            reasons.append(f"{loop.name} can't be closed: {1e3 * found.missed:.3g} mm (mrad) are missing")
            continue
        outside = (found.values < loop.lower - LIMIT_SLACK) | (found.values > loop.upper + LIMIT_SLACK)
        reasons += [
            f"joint {loop.joint_names[k]} = {found.values[k]:.6g}, which {loop.name} determines, "
            f"is outside [{loop.lower[k]:.6g}, {loop.upper[k]:.6g}]"
            for k in np.flatnonzero(outside)
        ]
    return "; ".join(reasons)
