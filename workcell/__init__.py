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
    from workcell.ik.diverse.solutions import solutions
    from workcell.ik.explain.why_not import explain
    from workcell.ik.hjcd.batch import solve_batch
    from workcell.ik.judge.verify import verify
    from workcell.ik.mechanisms.goals import FrameGoal, InRegion
    from workcell.ik.mechanisms.problem import MechanismProblem, MechanismTolerances, UserConstraint
    from workcell.ik.mechanisms.result import MechanismResult
    from workcell.ik.problem import Budget, IKProblem, Tolerances
    from workcell.ik.result import IKResult, Status
    from workcell.ik.solve import solve
    from workcell.ik.solve_mechanism import closest_configuration, solve_mechanism
    from workcell.model.grip import actuated
    from workcell.model.loading.load import load_robot
    from workcell.model.mechanism.from_model import mechanism_of
    from workcell.model.mechanism.mechanism import Mechanism
    from workcell.model.robot import Robot
    from workcell.model.scene import Scene
    from workcell.motion.live.goals import LiveGoal
    from workcell.motion.live.limits import LiveLimits
    from workcell.motion.live.live_ik import LiveIK
    from workcell.motion.live.stream_file import read_stream
    from workcell.motion.mechanisms.follow import FrameWaypoint, MechanismSteps
    from workcell.motion.path import Path, Trajectory
    from workcell.motion.teams.team import Team
    from workcell.motion.timing.retime import retime
    from workcell.motion.tool_paths.follow import FollowLimits, follow
    from workcell.motion.tool_paths.poses import (
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
    from workcell.motion.tool_paths.route import route
    from workcell.pose import Pose
    from workcell.record.read.review import review
    from workcell.record.write.recording import Recording
    from workcell.simulate.carried import carried
    from workcell.simulate.simulation import Simulation
    from workcell.task.job import Job
    from workcell.task.run import run_task
    from workcell.world.mechanism_world import Held, MechanismWorld
    from workcell.world.planning_world import PlanningWorld

_HOMES = {
    "WorkcellError": "errors",
    "ClearanceEngine": "geometry.engine",
    "self_collision_pairs": "geometry.self_collision",
    "FreeSpace": "geometry.types",
    "Piece": "geometry.types",
    "SphereCover": "geometry.types",
    "solutions": "ik.diverse.solutions",
    "solve_batch": "ik.hjcd.batch",
    "Budget": "ik.problem",
    "IKProblem": "ik.problem",
    "Tolerances": "ik.problem",
    "IKResult": "ik.result",
    "Status": "ik.result",
    "solve": "ik.solve",
    "verify": "ik.judge.verify",
    "explain": "ik.explain.why_not",
    "FrameGoal": "ik.mechanisms.goals",
    "InRegion": "ik.mechanisms.goals",
    "MechanismProblem": "ik.mechanisms.problem",
    "MechanismTolerances": "ik.mechanisms.problem",
    "UserConstraint": "ik.mechanisms.problem",
    "MechanismResult": "ik.mechanisms.result",
    "closest_configuration": "ik.solve_mechanism",
    "solve_mechanism": "ik.solve_mechanism",
    "Mechanism": "model.mechanism.mechanism",
    "mechanism_of": "model.mechanism.from_model",
    "Held": "world.mechanism_world",
    "MechanismWorld": "world.mechanism_world",
    "LiveGoal": "motion.live.goals",
    "LiveIK": "motion.live.live_ik",
    "LiveLimits": "motion.live.limits",
    "read_stream": "motion.live.stream_file",
    "FrameWaypoint": "motion.mechanisms.follow",
    "MechanismSteps": "motion.mechanisms.follow",
    "Job": "task.job",
    "run_task": "task.run",
    "actuated": "model.grip",
    "load_robot": "model.loading.load",
    "Robot": "model.robot",
    "Scene": "model.scene",
    "FollowLimits": "motion.tool_paths.follow",
    "follow": "motion.tool_paths.follow",
    "Path": "motion.path",
    "Trajectory": "motion.path",
    "retime": "motion.timing.retime",
    "route": "motion.tool_paths.route",
    "Team": "motion.teams.team",
    "FREE": "motion.tool_paths.poses",
    "PathTolerance": "motion.tool_paths.poses",
    "arc": "motion.tool_paths.poses",
    "circle": "motion.tool_paths.poses",
    "distance_to_path": "motion.tool_paths.poses",
    "line": "motion.tool_paths.poses",
    "polyline": "motion.tool_paths.poses",
    "through": "motion.tool_paths.poses",
    "turned": "motion.tool_paths.poses",
    "PlanningWorld": "world.planning_world",
    "Pose": "pose",
    "Recording": "record.write.recording",
    "review": "record.read.review",
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
