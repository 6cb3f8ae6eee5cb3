"""workcell: a MuJoCo-simulated manipulation workcell with verified inverse kinematics in the loop.

Public names are imported when first used, so that `import workcell` costs next to nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from workcell.errors import WorkcellError
    from workcell.geometry.engine import ClearanceEngine
    from workcell.geometry.self_collision import self_collision_pairs
    from workcell.geometry.types import FreeSpace, Piece, SphereCover
    from workcell.ik.diverse import solutions
    from workcell.ik.hjcd_batch import solve_batch
    from workcell.ik.problem import Budget, IKProblem, Tolerances
    from workcell.ik.result import IKResult, Status
    from workcell.ik.solve import solve
    from workcell.ik.verify import verify
    from workcell.ik.why_not import explain
    from workcell.job import Job
    from workcell.model.grip import actuated
    from workcell.model.load import load_robot
    from workcell.model.robot import Robot
    from workcell.model.scene import Scene
    from workcell.motion.follow import FollowLimits, follow
    from workcell.motion.path import Path, Trajectory
    from workcell.motion.retime import retime
    from workcell.motion.route import route
    from workcell.motion.team import Team
    from workcell.motion.toolpath import (
        FREE,
        PathTolerance,
        arc,
        circle,
        distance_to_path,
        line,
        polyline,
        through,
        turned,
    )
    from workcell.motion.world import PlanningWorld
    from workcell.pose import Pose
    from workcell.record.recording import Recording
    from workcell.record.review import review
    from workcell.run import run_task
    from workcell.simulate.carried import carried
    from workcell.simulate.simulation import Simulation

_HOMES = {
    "WorkcellError": "errors",
    "ClearanceEngine": "geometry.engine",
    "self_collision_pairs": "geometry.self_collision",
    "FreeSpace": "geometry.types",
    "Piece": "geometry.types",
    "SphereCover": "geometry.types",
    "solutions": "ik.diverse",
    "solve_batch": "ik.hjcd_batch",
    "Budget": "ik.problem",
    "IKProblem": "ik.problem",
    "Tolerances": "ik.problem",
    "IKResult": "ik.result",
    "Status": "ik.result",
    "solve": "ik.solve",
    "verify": "ik.verify",
    "explain": "ik.why_not",
    "Job": "job",
    "run_task": "run",
    "actuated": "model.grip",
    "load_robot": "model.load",
    "Robot": "model.robot",
    "Scene": "model.scene",
    "FollowLimits": "motion.follow",
    "follow": "motion.follow",
    "Path": "motion.path",
    "Trajectory": "motion.path",
    "retime": "motion.retime",
    "route": "motion.route",
    "Team": "motion.team",
    "FREE": "motion.toolpath",
    "PathTolerance": "motion.toolpath",
    "arc": "motion.toolpath",
    "circle": "motion.toolpath",
    "distance_to_path": "motion.toolpath",
    "line": "motion.toolpath",
    "polyline": "motion.toolpath",
    "through": "motion.toolpath",
    "turned": "motion.toolpath",
    "PlanningWorld": "motion.world",
    "Pose": "pose",
    "Recording": "record.recording",
    "review": "record.review",
    "carried": "simulate.carried",
    "Simulation": "simulate.simulation",
}

__all__ = sorted(_HOMES)  # noqa: PLE0605


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'workcell' has no attribute {name!r}")
    return getattr(importlib.import_module(f"workcell.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])
