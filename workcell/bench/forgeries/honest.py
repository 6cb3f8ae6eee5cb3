"""Problems, certificates of them, and twins of which these are false: what forgeries are made from.

All stands in documents as files have it, a set of problems (`workcell-ikset/1`) and certificates, so that any checker
can be handed them.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from workcell.ik.branch.checker.check import seal, statement
from workcell.ik.branch.solver import solve_branch
from workcell.ik.certificate import Certificate, problem_hash
from workcell.ik.cidgik.solver import prove_cidgik
from workcell.ik.elementary.bounds import prove_impossible
from workcell.ik.ikspark.solver import solve_ikspark
from workcell.ik.judge.verify import verify
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.registry import SOLVERS, load
from workcell.ik.solution.issue import certify_solution
from workcell.pose import Array, Pose
from workcell.sets.problems import FORMAT, parse_problem_set

BUDGET = Budget(20.0)
_AWAY = 4.0
"""Metres by which the obstacles of a solvable twin are moved away."""


@dataclass(frozen=True, slots=True)
class Case:
    """A certificate, the problem that it is about, and a problem of the same form of which its claim is false.

    Attributes:
        name: what the proof rests on.
        own, twin: sets of one problem each, as documents: of the twin the certificate's claim is false.
        certificate: as a document; it holds of its own problem.
    """

    name: str
    own: dict[str, Any]
    twin: dict[str, Any]
    certificate: dict[str, Any]

    def problem(self, *, own: bool) -> IKProblem:
        """The problem of one of the sets."""
        return _problem(self.own if own else self.twin)

    def borrowed(self) -> dict[str, Any]:
        """The certificate as one who forges hands it in for the twin: with that problem's hash."""
        document = copy.deepcopy(self.certificate)
        document["problem_hash"] = problem_hash(self.problem(own=False))
        return document


def _problem(document: dict[str, Any]) -> IKProblem:
    return parse_problem_set(document).problems[0].problem


def sealed(document: dict[str, Any]) -> dict[str, Any]:
    """A tree's document with seal and statement as they would be if its numbers were honest."""
    data = {
        name: np.array(entry["values"], dtype=float).reshape(entry["shape"])
        for name, entry in document["data"].items()
        if name != "seal"
    }
    document["data"]["seal"] = {"shape": [8], "values": seal(data).tolist()}
    document["statement"] = statement(data)
    document["margin"] = float(data["inflation"][0])
    return document


NAMES = (
    "reach/seven",
    "last_link/seven",
    "farkas/seven",
    "cidgik/seven",
    "branch/limits/seven",
    "branch/obstacles/seven",
    "reach/six",
    "last_link/six",
    "farkas/six",
    "cidgik/six",
    "branch/limits/six",
    "branch/obstacles/six",
    "cidgik/obstacles/six",
    "solution/seven",
    "solution/six",
)
"""The cases: one or more of every kind of proof."""


def cases() -> tuple[Case, ...]:
    """All of them."""
    return tuple(case(name) for name in NAMES)


@lru_cache(maxsize=len(NAMES))
def case(name: str) -> Case:
    """One of `NAMES`, made once."""
    kind, _, arm = name.rpartition("/")
    robot = _arm(7 if arm == "seven" else 6)
    q = np.linspace(0.3, -0.4, len(robot["joints"]))
    makers: dict[str, tuple[Callable[[], dict[str, Any]], Callable[[IKProblem], Certificate | None]]] = {
        "reach": (lambda: _far(robot, q, 2.4), prove_impossible),
        "last_link": (lambda: _pinned(robot, q), prove_impossible),
        "farkas": (lambda: _far(robot, q, 1.6), _by_ikspark),
        "cidgik": (lambda: _far(robot, q, 2.4), prove_cidgik),
        "branch/limits": (lambda: _beyond_limits(robot), _by_branch),
        "branch/obstacles": (lambda: _walled(robot, q), _by_branch),
        "cidgik/obstacles": (lambda: _ball_in_the_way(robot), prove_cidgik),
    }
    if kind == "solution":
        return _solved(name, _pinned(robot, q), q)
    make, prove = makers[kind]
    return _case(name, make(), q, prove)


def _solved(name: str, impossible: dict[str, Any], q: Array) -> Case:
    """A solution of a problem whose twin has none."""
    possible = _with_solution(impossible, q)
    certificate = certify_solution(_problem(possible), q)
    assert certificate is not None and len(certificate.data["joints"]), name
    return Case(name, possible, impossible, certificate.to_json())


def _case(
    name: str, impossible: dict[str, Any], q: Array, prove: Callable[[IKProblem], Certificate | None]
) -> Case:
    certificate = prove(_problem(impossible))
    assert certificate is not None, name
    return Case(name, impossible, _with_solution(impossible, q), certificate.to_json())


def _with_solution(impossible: dict[str, Any], q: Array) -> dict[str, Any]:
    """The same with q as a solution, or what is nearest to it within the limits, and the obstacles away."""
    twin, robot = copy.deepcopy(impossible), _problem(impossible).robot
    q = np.clip(q, robot.lower, robot.upper)
    posed, entry = robot.fk(q), twin["problems"][0]
    entry["target"] = {"xyz": posed.position.tolist(), "quat": posed.quat_wxyz.tolist()}
    for pieces in entry["obstacles"].values():
        for piece in pieces:
            piece["centre"] = [piece["centre"][0], piece["centre"][1], piece["centre"][2] - _AWAY]
    assert verify(_problem(twin), q).accepted
    return twin


def _by_branch(problem: IKProblem) -> Certificate | None:
    # so that compiling is no part of the budget
    load(SOLVERS["branch"].prepare)(problem)
    return solve_branch(problem, BUDGET).certificate


def _by_ikspark(problem: IKProblem) -> Certificate | None:
    bare = replace(problem, obstacles=())
    certificate = solve_ikspark(bare, BUDGET, 0).certificate
    return None if certificate is None else replace(certificate, problem_hash=problem_hash(problem))


def _arm(joints: int) -> dict[str, Any]:
    """A serial arm of alternating axes with a sphere or two a link."""
    rows, spheres = [], []
    for k in range(joints):
        axis = [0.0, 0.0, 1.0] if k % 2 == 0 else [0.0, 1.0, 0.0]
        xyz = [0.0, 0.02 * (k % 3), 0.18 if k else 0.1]
        turned = [float(np.cos(0.1 * k)), 0.0, 0.0, float(np.sin(0.1 * k))]
        rows.append({"name": f"j{k}", "xyz": xyz, "quat": turned, "axis": axis, "lower": -2.2, "upper": 2.2})
        spheres.append([k + 1, 0.0, 0.0, 0.06, 0.05])
    tool = {"xyz": [0.0, 0.0, 0.12], "quat": [1.0, 0.0, 0.0, 0.0]}
    return {"name": f"arm{joints}", "joints": rows, "tool": tool, "spheres": spheres, "sphere_model": "own"}


def _set(robot: dict[str, Any], target: Pose, obstacles: dict[str, Any]) -> dict[str, Any]:
    placed = {"xyz": target.position.tolist(), "quat": target.quat_wxyz.tolist()}
    problem = {"id": "one", "target": placed, "obstacles": obstacles}
    return {"format": FORMAT, "set": "forgeries", "seed": 0, "n": 1, "robot": robot, "problems": [problem]}


def _posed(robot: dict[str, Any], q: Array) -> Pose:
    return _problem(_set(robot, Pose.identity(), {})).robot.fk(q)


def _far(robot: dict[str, Any], q: Array, distance: float) -> dict[str, Any]:
    posed = _posed(robot, q)
    return _set(robot, Pose(np.array([distance, 0.3, 0.2]), posed.quat_wxyz), {})


def _beyond_limits(robot: dict[str, Any]) -> dict[str, Any]:
    """Joints that turn by 2 radians at most, and a pose that takes a little more."""
    narrow = copy.deepcopy(robot)
    for joint in narrow["joints"]:
        joint["lower"], joint["upper"] = -2.0, 2.0
    q = np.full(len(robot["joints"]), 0.3)
    q[1] = 2.1
    return _set(narrow, _posed(robot, q), {})


def _walled(robot: dict[str, Any], q: Array) -> dict[str, Any]:
    """A box around the middle of the arm as it must stand to reach the pose within its limits."""
    narrow = copy.deepcopy(robot)
    for joint, value in zip(narrow["joints"], q.tolist(), strict=True):
        joint["lower"], joint["upper"] = value - 1.2, value + 1.2
    scene = _problem(_set(robot, _posed(robot, q), {}))
    centres = scene.cover.centres_world(scene.robot.link_transforms(q)) if scene.cover is not None else q
    boxes = [{"centre": centres[2].tolist(), "half": [0.1, 0.1, 0.1]}]
    boxes.append({"centre": [2.0, 2.0, 2.0], "half": [0.05, 0.05, 0.05], "quat": [0.6, 0.8, 0.0, 0.0]})
    return _set(narrow, _posed(robot, q), {"boxes": boxes})


def _pinned(robot: dict[str, Any], q: Array) -> dict[str, Any]:
    """A box, a ball and a cylinder, one of them on the last link's sphere."""
    posed = _posed(robot, q)
    at = posed.apply([0.0, 0.0, -0.06]).tolist()
    elsewhere = [1.5, 1.5, 1.5]
    return _set(
        robot,
        posed,
        {
            "boxes": [{"centre": elsewhere, "half": [0.1, 0.1, 0.1]}],
            "spheres": [{"centre": elsewhere, "radius": 0.1}],
            "cylinders": [{"centre": at, "quat": [0.8, 0.0, 0.6, 0.0], "half_length": 0.05, "radius": 0.04}],
        },
    )


def _ball_in_the_way(robot: dict[str, Any]) -> dict[str, Any]:
    """A large ball that the last links can't avoid."""
    posed = _posed(robot, np.linspace(0.3, -0.4, len(robot["joints"])))
    at = posed.apply([0.0, 0.0, -0.15]).tolist()
    balls = [{"centre": [2.0, 2.0, 2.0], "radius": 0.2}, {"centre": at, "radius": 0.12}]
    return _set(robot, posed, {"boxes": [], "spheres": balls})
