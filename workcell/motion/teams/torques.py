"""Torques of a team of arms that carry one object together: its own share for each."""

from __future__ import annotations

from collections.abc import Mapping
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

    @property
    def damping(self) -> Array:
        """(n,) of all joints, newton metre seconds a radian."""
        return np.concatenate([chain.damping for chain in self.chains.values()])

    def at(self, q: Array, qd: Array, qdd: Array) -> Array:
        """(T, n) torques for rows of positions, velocities and accelerations (T, n) each."""
        ends = np.cumsum([chain.kinematics.dof for chain in self.chains.values()])[:-1]
        parts = (np.split(rows, ends, axis=1) for rows in (q, qd, qdd))
        return np.hstack([chain.at(*part) for chain, *part in zip(self.chains.values(), *parts, strict=True)])
