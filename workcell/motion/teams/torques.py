"""Torques of a team of arms that carry one object together: its own share for each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from workcell.model.robot import Robot
from workcell.motion.teams.team import Team
from workcell.motion.timing.torques import ChainDynamics
from workcell.pose import Array


@dataclass(frozen=True, slots=True)
class TeamDynamics:
    """Inverse dynamics of all arms of a team, each of which carries its equal share of the object.

    Attributes:
        kinematics: all arms as one kinematic tree, as `Team.robot`.
        chains: of each arm, by the robot's name, in the team's order.
    """

    kinematics: Robot
    chains: Mapping[str, ChainDynamics]

    @staticmethod
    def of(team: Team) -> TeamDynamics:
        """The arms of a team, with the object in their hands."""
        share = 1.0 / len(team.grasps)
        chains = {
            name: ChainDynamics(team.scene, name, world.attached, share)
            for name, world in team.worlds.items()
        }
        return TeamDynamics(team.robot, chains)

    def at(self, q: Array, qd: Array, qdd: Array) -> Array:
        """(T, n) torques for rows of positions, velocities and accelerations (T, n) each."""
        return self._side_by_side(lambda chain, *rows: chain.at(*rows), q, qd, qdd)

    def rigid(self, q: Array, qd: Array, qdd: Array) -> Array:
        """(T, n) the same without damping, drag and dry friction."""
        return self._side_by_side(lambda chain, *rows: chain.rigid(*rows), q, qd, qdd)

    def viscous(self, q: Array, qd: Array) -> Array:
        """(T, n) torques against damping and drag."""
        return self._side_by_side(lambda chain, *rows: chain.viscous(*rows), q, qd)

    def dry(self, q: Array, qd: Array) -> Array:
        """(T, n) torques against dry friction, in the directions of `qd`; 0 for an arm that rests."""
        return self._side_by_side(lambda chain, *rows: chain.dry(*rows), q, qd)

    def _side_by_side(self, torques: Callable[..., Array], *rows: Array) -> Array:
        ends = np.cumsum([chain.kinematics.dof for chain in self.chains.values()])[:-1]
        parts = (np.split(values, ends, axis=1) for values in rows)
        return np.hstack(
            [torques(chain, *part) for chain, *part in zip(self.chains.values(), *parts, strict=True)]
        )
