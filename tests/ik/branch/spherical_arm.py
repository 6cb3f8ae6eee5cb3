"""Closed form of arms with a spherical shoulder and wrist (KUKA iiwa), where one joint angle is given.

The other family, and what both are made of, stand in `workcell.bench.reference.closed_forms`.
"""

from __future__ import annotations

import itertools

import numpy as np

from workcell.bench.reference.closed_forms import (
    MEETS,
    Screws,
    roots,
    roots_of_distance,
    transformed,
    turn_between,
)
from workcell.errors import InputError
from workcell.model.robot import Robot
from workcell.pose import Array, Pose


def spherical_arm(robot: Robot, target: Pose, third: float) -> Array:
    """(k, 7) angles in [-pi, pi) of an arm with spherical shoulder and wrist, up to eight.

    Its third joint is at `third`.

    Raises:
        InputError: axes one to three, or five to seven, don't meet in a point.
    """
    s = Screws(robot)
    if robot.dof != 7:
        raise InputError("not an arm with seven joints", where=robot.name)
    shoulder, wrist = s.meeting(0, 1), s.meeting(4, 5)
    if (
        np.abs(np.cross(shoulder - s.o[2], s.z[2])).max() + np.abs(np.cross(wrist - s.o[6], s.z[6])).max()
        > MEETS
    ):
        raise InputError("shoulder or wrist is not spherical", where=robot.name)
    motion = target.matrix @ np.linalg.inv(s.zero)
    there = transformed(motion, wrist) - shoulder
    found: list[Array] = []
    for q4 in roots_of_distance(s.z[3], s.o[3], wrist, shoulder, float(np.linalg.norm(there))):
        bent = transformed(s.turn(2, third) @ s.turn(3, q4), wrist) - shoulder
        for q2 in roots(s.z[1], bent, s.z[0], float(s.z[0] @ there)):
            q1 = turn_between(s.z[0], s.turn(1, q2)[:3, :3] @ bent, there)
            arm = s.turn(0, q1) @ s.turn(1, q2) @ s.turn(2, third) @ s.turn(3, q4)
            R = (np.linalg.inv(arm) @ motion)[:3, :3]
            for q6 in roots(s.z[5], s.z[6], s.z[4], float(s.z[4] @ R @ s.z[6])):
                q5 = turn_between(s.z[4], s.turn(5, q6)[:3, :3] @ s.z[6], R @ s.z[6])
                rest = (s.turn(4, q5) @ s.turn(5, q6))[:3, :3].T @ R
                x = np.cross(s.z[6], s.z[5])
                found.append(np.array([q1, q2, third, q4, q5, q6, turn_between(s.z[6], x, rest @ x)]))
    return s.reaching(found, motion)


def unwrapped(q: Array, robot: Robot) -> Array:
    """(k, n) all the ways to add whole turns to angles (n,) so that they keep the robot's limits."""
    choices = []
    for angle, lower, upper in zip(q, robot.lower, robot.upper, strict=True):
        first, last = np.ceil((lower - angle) / (2 * np.pi)), np.floor((upper - angle) / (2 * np.pi))
        choices.append([angle + 2 * np.pi * turn for turn in np.arange(first, last + 1)])
    return np.array(list(itertools.product(*choices))).reshape(-1, len(q))
