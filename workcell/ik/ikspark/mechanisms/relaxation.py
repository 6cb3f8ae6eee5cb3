"""The relaxation of one question about a mechanism, put together: variables, rows, curves of joints that follow."""

from __future__ import annotations

from dataclasses import dataclass

from workcell.ik.ikspark.mechanisms.followers import Curve, edge_rows, edges_for, tied
from workcell.ik.ikspark.mechanisms.forms import FormName, form_of
from workcell.ik.ikspark.mechanisms.lift import MechanismLift, fixed_rotations
from workcell.ik.ikspark.mechanisms.nodes import find_nodes
from workcell.ik.ikspark.mechanisms.rows import Rows, asked, interval_of, structure, ties
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.model.mechanism.mechanism import WORLD
from workcell.pose import Array


@dataclass(frozen=True, slots=True)
class Relaxation:
    """What a configuration that answers a question keeps, convex.

    Attributes:
        problem: the question.
        lift: the variables.
        rows: what they keep.
        curves: of joints that follow others otherwise than linearly, cut off where they are left.
        interval: (joints, 2) limits of hinges and slides.
    """

    problem: MechanismProblem
    lift: MechanismLift
    rows: tuple[Rows, ...]
    curves: tuple[Curve, ...]
    interval: Array

    @staticmethod
    def of(
        problem: MechanismProblem,
        form: FormName = "quaternion",
        *,
        poses: bool = True,
        pointing: bool = True,
    ) -> Relaxation:
        """The relaxation of a question.

        Args:
            problem: the question.
            form: of the rotations of links that nothing fixes.
            poses: whether goals' positions and rotations are demanded; else they are a cost (Eq. 36).
            pointing: whether links whose direction a goal gives turn about it alone; proofs know them by rows.

        Raises:
            ModelError: ties that contradict each other.
        """
        mechanism, interval = problem.mechanism, interval_of(problem)
        fixed = {goal.frame: goal.rotation for goal in problem.goals if poses and goal.rotation is not None}
        given = _directions(problem) if pointing else []
        nodes = find_nodes(mechanism, interval, fixed_rotations(mechanism, fixed), given)
        edges = edges_for(mechanism, nodes) if form == "quaternion" else {}
        lift = MechanismLift(mechanism, nodes, form_of(form), interval, edges)
        follow, curves = tied(lift, interval)
        rows = (
            *structure(lift),
            *ties(lift, problem, interval),
            *edge_rows(lift),
            *follow,
            *asked(lift, problem, poses=poses),
        )
        return Relaxation(problem, lift, rows, tuple(curves), interval)


def _directions(problem: MechanismProblem) -> list[tuple[int, Array, Array]]:
    """(link, its axis, direction in the world) of goals that leave no cone."""
    found = []
    for goal in problem.goals:
        if goal.axis is not None and goal.direction is not None and goal.within == 0.0:
            frame = problem.mechanism.frame(goal.frame)
            found.append((frame.link, frame.T_link_frame.rotation @ goal.axis, goal.direction))
    return [one for one in found if one[0] != WORLD]
