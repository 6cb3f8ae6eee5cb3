"""The path of an object that several arms hold.

IKSPARK plans all arms together, as the one closed chain that they are with the object (`closed`). With another planner
each arm's inverse kinematics runs by itself, with the tool where its own grasp has it on the object.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from workcell.ik.registry import plans_alone
from workcell.motion.path import Path
from workcell.motion.proofs.on_model import Proof
from workcell.motion.teams.closed import follow_closed
from workcell.motion.teams.team import Team, prove_team
from workcell.motion.tool_paths.follow import FollowLimits, FollowResult, follow, steps_of
from workcell.motion.tool_paths.result import Answered
from workcell.pose import Array, Pose

CLOSED = "ikspark"
"""The planner that knows closed chains."""


@dataclass(frozen=True, slots=True)
class TeamResult:
    """What became of an object's path.

    Attributes:
        path: of the whole team, proved clear; None when there is none.
        proof: of the path; None when an arm could not follow.
        failure: which arm failed, where and why, in words; empty when it is proved.
        arms: how each arm followed, where each did by itself.
        together: who answered where all arms did at once.
    """

    path: Path | None
    proof: Proof | None
    failure: str
    arms: Mapping[str, FollowResult]
    together: Answered = field(default_factory=Answered)

    @property
    def answered(self) -> Answered:
        """Who answered the configurations of all arms."""
        return sum((arm.answered for arm in self.arms.values()), self.together)


def carry(
    team: Team,
    object_poses: Sequence[Pose],
    starts: Mapping[str, Array],
    *,
    limits: FollowLimits,
    solver: str = "ikspark",
    seed: int = 0,
) -> TeamResult:
    """Follow an object's path with all arms that hold it, and prove that they stay clear of each other and the rest.

    Args:
        team: the arms.
        object_poses: `T_world_object`, two or more, the first being where the object is at `starts`.
        starts: (n,) of each arm, by name.
        limits: of each arm's motion.
        solver: the planner whose steps these are. IKSPARK makes those of the one closed chain that arms and object are
            (`workcell.motion.teams.closed`); with another planner each arm follows its own poses.
        seed: same seed, same path.
    """
    if solver == CLOSED:
        way = follow_closed(team, object_poses, starts, limits=limits, solver=solver, seed=seed)
        if way.configurations is None:
            return TeamResult(None, None, way.failure, {}, way.answered)
        whole = Path(team.robot, way.configurations)
        proof = prove_team(team, whole, floor=limits.clearance)
        return TeamResult(whole if proof.proved else None, proof, proof.reason, {}, way.answered)
    poses, arms = tuple(object_poses), dict[str, FollowResult]()
    for _ in range(limits.max_halvings + 1):
        for name, grasp in team.grasps.items():
            arms[name] = _follow(
                team, name, [pose @ grasp for pose in poses], starts[name], limits, solver, seed
            )
            if not arms[name].followed:
                return TeamResult(None, None, _why(name, arms[name], len(poses)), arms)
        paths = {name: arm.path for name, arm in arms.items() if arm.path is not None}
        finest = max(paths, key=lambda name: len(paths[name]))
        if len(paths[finest]) == len(poses):
            break
        # where one arm had to halve a step, the object stops for all of them
        poses = tuple(pose @ team.grasps[finest].inverse() for pose in paths[finest].tool_poses)
    else:
        return TeamResult(None, None, f"{finest}: its steps can't be made however close the poses are", arms)
    whole = Path(team.robot, np.concatenate([path.configurations for path in paths.values()], axis=1))
    proof = prove_team(team, whole, floor=limits.clearance)
    return TeamResult(whole if proof.proved else None, proof, proof.reason, arms)


def _follow(
    team: Team,
    name: str,
    poses: Sequence[Pose],
    start: Array,
    limits: FollowLimits,
    solver: str,
    seed: int,
) -> FollowResult:
    """How one arm follows poses of its own tool."""
    world = team.worlds[name]
    problem = (world.fitting(poses) if plans_alone(solver) else world).problem(poses[0])
    steps = steps_of(solver, problem, limits=limits, seed=seed)
    return follow(problem, poses, start, limits=limits, solver=steps)


def _why(name: str, arm: FollowResult, count: int) -> str:
    """Why an arm can't follow, in words."""
    failure = arm.failure
    where = "" if failure is None else f" at pose {failure.waypoint} of {count}: {failure.detail}"
    return f"{name}{where}. {arm.status.sentence}"
