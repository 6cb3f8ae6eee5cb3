"""Problem sets as the documents of problem-set files, for tests that read them back."""

from __future__ import annotations

from typing import Any

import numpy as np

from workcell.errors import InputError
from workcell.pose import Pose, matrix_to_quat
from workcell.sets.problems import FORMAT, NamedProblem, ProblemSet


def problem_set_document(problem_set: ProblemSet) -> dict[str, Any]:
    """A set as the JSON document that `parse_problem_set` reads.

    Raises:
        InputError: the robot or an obstacle is of a kind that the format doesn't know.
    """
    robot, cover = problem_set.robot, problem_set.cover
    if np.any(robot.prismatic) or not robot.is_serial:
        raise InputError("the format takes serial chains of revolute joints", where=robot.name)
    joints = [
        {
            "name": robot.joint_names[k],
            "xyz": robot.joint_xyz[k].tolist(),
            "quat": matrix_to_quat(robot.joint_rotation[k]).tolist(),
            "axis": robot.axis[k].tolist(),
            "lower": float(robot.lower[k]),
            "upper": float(robot.upper[k]),
        }
        for k in range(robot.dof)
    ]
    rows = np.column_stack([cover.link, cover.centre, cover.radius]).tolist()
    return {
        "format": FORMAT,
        "set": problem_set.name,
        "n": len(problem_set),
        "robot": {
            "name": robot.name,
            "joints": joints,
            "tool": _pose(robot.tool().T_link_tool),
            "spheres": [[int(row[0]), *row[1:]] for row in rows],
        },
        "problems": [_problem(named) for named in problem_set.problems],
    }


def _problem(named: NamedProblem) -> dict[str, Any]:
    obstacles: dict[str, list[dict[str, Any]]] = {"boxes": [], "spheres": [], "cylinders": []}
    for piece in named.problem.obstacles:
        centre, quat = piece.pose.position.tolist(), piece.pose.quat_wxyz.tolist()
        if piece.kind == "box":
            obstacles["boxes"].append({"centre": centre, "half": piece.size.tolist(), "quat": quat})
        elif piece.kind == "sphere":
            obstacles["spheres"].append({"centre": centre, "radius": float(piece.size[0])})
        elif piece.kind == "cylinder":
            radius, half = piece.size.tolist()
            obstacles["cylinders"].append(
                {"centre": centre, "quat": quat, "half_length": half, "radius": radius}
            )
        else:
            raise InputError(
                f"the format has no {piece.kind}", where=piece.name, remedy="box, sphere, cylinder"
            )
    document = {"id": named.id, "target": _pose(named.problem.target), "obstacles": obstacles}
    return document if named.start is None else {**document, "start": named.start.tolist()}


def _pose(pose: Pose) -> dict[str, list[float]]:
    return {"xyz": pose.position.tolist(), "quat": pose.quat_wxyz.tolist()}
