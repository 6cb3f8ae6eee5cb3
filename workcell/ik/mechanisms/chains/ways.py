"""Ways through a mechanism from the world to a goal: which joints and ties a serial chain is made of."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.model.mechanism.mechanism import WORLD, Mechanism

MOST_WAYS = 24
"""Ways that are looked at: those with the fewest joints."""
LONGEST_WAY = 24
"""Joints and ties of a way."""
_LOOKS = 5000
"""Links that are looked at on the way to ways."""


@dataclass(frozen=True, slots=True)
class Way:
    """A serial chain.

    Attributes:
        edges: what leads from link to link, from the world on: joint k as k, closure c as (number of joints) + c.
        goal: index of the goal at its end. Where the last edge is a ball or a connect and the goal a whole pose, the
            tied point is what the chain has to bring to where the goal has it.
    """

    edges: tuple[int, ...]
    goal: int


def ends_of(mechanism: Mechanism, edge: int) -> tuple[int, int]:
    """The two links that an edge is between; of a joint the one that carries it first."""
    joints = len(mechanism.joints)
    return (
        mechanism.closures[edge - joints].links
        if edge >= joints
        else (mechanism.joints[edge].parent, edge + 1)
    )


def is_point(mechanism: Mechanism, edge: int) -> bool:
    """Whether an edge ties a point alone: a ball, or a connect."""
    joints = len(mechanism.joints)
    if edge >= joints:
        return mechanism.closures[edge - joints].kind == "connect"
    return mechanism.joints[edge].kind == "ball"


def ways(problem: MechanismProblem) -> tuple[Way, ...]:
    """Ways that pass no link twice, those with the fewest joints first."""
    found = sorted(set(_ways(problem)), key=lambda way: (len(way.edges), way.goal, way.edges))
    return tuple(found[:MOST_WAYS])


def _ways(problem: MechanismProblem) -> Iterator[Way]:
    mechanism, looks = problem.mechanism, 0
    goals: dict[int, list[int]] = {}
    for g, goal in enumerate(problem.goals):
        if goal.position is not None:
            goals.setdefault(mechanism.frame(goal.frame).link, []).append(g)
    edges_at: dict[int, list[int]] = {}
    for edge in range(len(mechanism.joints) + len(mechanism.closures)):
        if edge >= len(mechanism.joints) or mechanism.joints[edge].kind != "free":
            for link in ends_of(mechanism, edge):
                edges_at.setdefault(link, []).append(edge)
    frontier: list[tuple[int, tuple[int, ...], frozenset[int]]] = [(WORLD, (), frozenset([WORLD]))]
    while frontier and looks < _LOOKS:
        link, edges, seen = frontier.pop(0)  # shortest first
        looks += 1
        if edges:
            yield from (Way(edges, g) for g in goals.get(link, ()))
        if (link in goals and edges) or len(edges) >= LONGEST_WAY:
            continue
        for edge in edges_at.get(link, ()):
            a, b = ends_of(mechanism, edge)
            there = b if a == link else a
            if there not in seen:
                frontier.append((there, (*edges, edge), seen | {there}))
