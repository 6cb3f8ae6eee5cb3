"""Goals of one link that contradict each other, or that say what others say already."""

from __future__ import annotations

import numpy as np

from workcell.errors import InputError
from workcell.ik.mechanisms.goals import FrameGoal
from workcell.ik.mechanisms.known import SAME, Known, fixed_links
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.pose import Array, Pose, rotation_vector


def check_goals(problem: MechanismProblem) -> tuple[tuple[str, ...], dict[int, Known]]:
    """Notes on goals that say nothing new, and what is known of links when all goals hold.

    Raises:
        InputError: goals of one link contradict each other, or are of a link that nothing moves and that is elsewhere.
    """
    links: dict[int, list[tuple[str, FrameGoal, Pose]]] = {}
    for g, goal in enumerate(problem.goals):
        frame = problem.mechanism.frame(goal.frame)
        links.setdefault(frame.link, []).append((f"goal {g} of {goal.frame!r}", goal, frame.T_link_frame))
    known, notes = fixed_links(problem.mechanism), []
    for link, goals in links.items():
        facts = known.setdefault(link, Known(problem.mechanism.link_names[link]))
        link_goals = _LinkGoals(problem, facts)
        for check in (link_goals.rotation, link_goals.position, link_goals.direction):
            for name, goal, T in goals:
                check(name, goal, T)
        notes += link_goals.notes
    return tuple(notes), known


class _LinkGoals:
    """Takes the goals of one link one after the other and compares each with what is known from those before."""

    def __init__(self, problem: MechanismProblem, facts: Known) -> None:
        self.facts = facts
        self.notes: list[str] = []
        self._tolerances = problem.tolerances
        # each of two goals may be off by its tolerance
        self._radians = (1.0 if facts.fixed else 2.0) * problem.tolerances.rotation
        self._axes: list[tuple[Array, FrameGoal, str]] = []

    def rotation(self, name: str, goal: FrameGoal, T: Pose) -> None:
        if goal.rotation is None:
            return
        R = goal.rotation @ T.rotation.T
        if self.facts.rotation is None:
            self.facts.rotation, self.facts.by = R, name
            return
        away = float(np.linalg.norm(rotation_vector(self.facts.rotation.T @ R)))
        self._compare(name, "rotation", away, self._radians, "rad", self.facts.by)

    def position(self, name: str, goal: FrameGoal, T: Pose) -> None:
        if goal.position is None:
            return
        local = T.position
        found = self.facts.world(local)
        if found is not None:
            away, lever = float(np.linalg.norm(found[0] - goal.position)), found[1]
            most = self._tolerances.position + self.facts.metres(lever, self._tolerances)
            self._compare(name, "position", away, most, "m", found[2])
            return
        for at, place_of, by in self.facts.points:
            there, here = np.linalg.norm(goal.position - place_of), np.linalg.norm(local - at)
            if abs(there - here) > 2 * self._tolerances.position:
                raise InputError(
                    f"{there:.6g} m from where {by} has a point that is {here:.6g} m away on the same link",
                    where=name,
                    remedy="goals that one rigid link can reach together",
                )
        self.facts.points.append((local, goal.position, name))

    def direction(self, name: str, goal: FrameGoal, T: Pose) -> None:
        if goal.axis is None or goal.direction is None:
            return
        axis = T.rotation @ goal.axis
        if self.facts.rotation is not None:
            away = _angle(self.facts.rotation @ axis, goal.direction) - goal.within
            self._compare(name, "direction", away, self._radians, "rad", self.facts.by)
            return
        for other_axis, other, by in self._axes:
            assert other.direction is not None
            between, wanted = _angle(axis, other_axis), _angle(goal.direction, other.direction)
            away = abs(between - wanted) - goal.within - other.within
            wider = between < SAME and wanted + other.within <= goal.within + SAME
            if wider or away > self._radians:
                self._compare(name, "direction", away, self._radians, "rad", by)
        self._axes.append((axis, goal, name))

    def _compare(self, name: str, part: str, away: float, most: float, unit: str, by: str) -> None:
        if away > most:
            raise InputError(
                f"its {part} is {away:.3g} {unit} from what is known of link {self.facts.name!r}: {by}",
                where=name,
                remedy="a frame that something moves" if self.facts.fixed else "goals that hold together",
            )
        self.notes.append(f"{name}: its {part} says nothing new of link {self.facts.name!r}: {by}")


def _angle(a: Array, b: Array) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))
