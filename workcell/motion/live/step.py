"""`Step`: what a live frame answers, and why."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from workcell.pose import Array


class LiveStatus(enum.Enum):
    """How the frame went. There is a safe step in every one of them."""

    ON_GOAL = "ON_GOAL"
    MOVING = "MOVING"
    HELD = "HELD"
    NO_GOAL = "NO_GOAL"
    IN_CONTACT = "IN_CONTACT"

    @property
    def sentence(self) -> str:
        """The status in words, with its remedy."""
        return _SENTENCES[self]


_SENTENCES = {
    LiveStatus.ON_GOAL: "Every tool is within its goal's tolerance.",
    LiveStatus.MOVING: "The tools are on their way; limits or smoothness keep them off their goals in this frame.",
    LiveStatus.HELD: (
        "A guard keeps a tool off its goal, and the arm rests before it. Move the goal, or what is in the way."
    ),
    LiveStatus.NO_GOAL: "There is no goal to go to: the arm slows down and holds. Send a finite, fresh pose.",
    LiveStatus.IN_CONTACT: (
        "The arm is in contact, or can't get out of the way of what moves. It takes the step that leaves most room; "
        "clear it by hand, or take away what it touches."
    ),
}


class GuardKind(enum.Enum):
    """What may hold an arm."""

    POSITION = "joint limit"
    VELOCITY = "velocity limit"
    ACCELERATION = "acceleration or jerk limit"
    SINGULARITY = "singularity"
    OBSTACLE = "obstacle"
    SELF = "self-collision"
    BRAKING = "braking"


@dataclass(frozen=True, slots=True)
class Guard:
    """A guard that shaped the frame's step.

    Attributes:
        kind: what it guards.
        who: the joint; the geoms that come near each other, `A and B`; the tool near a singularity.
        value: how near it is: radians or metres to a joint limit, metres of clearance, share of the limit of a
            velocity, conditioning of a singularity.
    """

    kind: GuardKind
    who: str
    value: float

    def __str__(self) -> str:
        return f"{self.kind.value}: {self.who} ({self.value:.4g})"


@dataclass(frozen=True, slots=True)
class Step:
    """One frame of live inverse kinematics.

    Attributes:
        q, qd: (n,) where the joints should be at the end of the frame, and how fast they move in it.
        status: how it went.
        reason: why there is no goal, or what is in contact; else empty.
        position_error, rotation_error: (k,) by which each tool is outside of its goal's bands at q: metres, radians.
        terms: (7,) the terms before their losses, in the order of `TERMS`: what was given up for what.
        guards: what held the step back.
        clearance: metres, the smallest gap of the guard's spheres at q; inf where nothing is near.
        conditioning: (k,) smallest over largest singular value of each tool's Jacobian.
        braked: whether the step is a braking one that an earlier frame had ready.
        timed_out: whether the deadline ended the search for a better step.
        seconds: that the frame took.
    """

    q: Array
    qd: Array
    status: LiveStatus
    reason: str
    position_error: Array
    rotation_error: Array
    terms: Array
    guards: tuple[Guard, ...]
    clearance: float
    conditioning: Array
    braked: bool
    timed_out: bool
    seconds: float
