"""Fast local tracking: from waypoint to waypoint by small quadratic programs, the convex solver where they fail.

Each program moves the tool onto the path within its tolerance, keeps joint limits, the largest step and every clearance
of the sphere model, and spends the motions that leave the tool where it is on clearance, manipulability and distance
from joint limits. Configurations count only once the judge has accepted them (`workcell.motion.tool_paths.steps`).
"""

from __future__ import annotations

import functools
import importlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workcell.compile_ahead import TRACKING, wait_for
from workcell.geometry.packing import pack_couple, pack_variables
from workcell.ik.problem import IKProblem
from workcell.ik.shared.packing import empty_world, one_joint
from workcell.motion.tool_paths.models import worlds
from workcell.motion.tool_paths.poses import PathTolerance
from workcell.pose import Array, Pose

ACCURACY = 1e-7
"""Metres of error (a radian weighs 0.3 m) to which the tool is brought onto its pose."""
NEAR_LIMIT = 2e-3
"""Radians or metres from a joint limit that count as standing at it."""
SINGULAR = 1e-4
"""Manipulability below which an arm is called singular."""


@functools.cache
def _kernels() -> Any:
    """Compiled kernels, imported on first use: numba takes half a second."""
    return importlib.import_module("workcell.motion.tool_paths.kernels.track")


def kernels_ready() -> bool:
    """Whether tracking was compiled before, on this machine."""
    from workcell.jit import is_compiled

    return is_compiled(_kernels().track)


@functools.cache
def prepare_kernels() -> None:
    """Compile what tracks, or load it from the cache."""
    wait_for(TRACKING)
    kernels, none = _kernels(), np.zeros((0, 12))
    beside = kernels.Aside(0.0, 0.0, 0.0, 0.0, 0.0)
    arm, box, step = one_joint(), np.zeros(7), np.ones(1)
    couple = kernels.Couple(np.zeros(0, dtype=np.int64), np.zeros((0, 2)))
    kernels.track(
        arm,
        couple,
        empty_world(1),
        none,
        box,
        step,
        ACCURACY,
        beside,
        step,
        np.zeros((0, 1)),
        np.zeros((0, 3)),
    )
    some = np.zeros((0, 1))
    kernels.move(
        arm, couple, empty_world(1), np.zeros(12), box, step, ACCURACY, some, some, some, np.zeros((0, 2))
    )
    kernels.volumes(arm, couple, none, box, some, np.zeros(0))


@dataclass(frozen=True, slots=True)
class Aside:
    """What the arm does beside the path, in the motions that leave the tool where it is.

    Attributes:
        limits, singularities, obstacles: gains (radians a waypoint) of the gradients away from each; 0 switches one
            off.
        distance: metres of clearance below which an obstacle repels.
        longest: radians in any joint that one waypoint may add to the motion that the path needs.
    """

    limits: float = 0.01
    singularities: float = 0.02
    obstacles: float = 0.02
    distance: float = 0.08
    longest: float = 0.02


STILL = Aside(0.0, 0.0, 0.0)
"""Nothing beside the path."""


@dataclass(frozen=True, slots=True)
class Tracked:
    """How far local tracking got.

    Attributes:
        configurations: (k, n) at the poses that were reached, the start not among them.
        best: (n,) the nearest it came at the next pose; None when all were reached.
        error: metres by which the tool is off there (a radian weighs 0.3 m); clearance: metres in the sphere model.
    """

    configurations: Array
    best: Array | None
    error: float
    clearance: float

    @property
    def complete(self) -> bool:
        """Whether every pose was reached."""
        return self.best is None


class LocalTracker:
    """Local tracking for one robot in one world: everything is packed once.

    Args:
        template: robot, obstacles, cover and tolerances.
        tolerance: of the tool along the path.
        max_step: (n,) or scalar, radians between waypoints.
        clearance: metres to keep, if more than the template's margin.
        aside: what to do beside the path.
    """

    def __init__(
        self,
        template: IKProblem,
        tolerance: PathTolerance | None = None,
        *,
        max_step: Array | float = 0.2,
        clearance: float = 0.0,
        aside: Aside | None = None,
    ) -> None:
        prepare_kernels()
        self.template, self.tolerance, self.aside = template, tolerance or PathTolerance(), aside or Aside()
        robot = template.robot
        self._arm, self._couple = pack_variables(robot), pack_couple(robot)
        self._max_step = np.array(np.broadcast_to(np.asarray(max_step, dtype=float), (robot.dof,)))
        self._worlds = worlds(template, max(clearance, template.tolerances.safety_margin))
        self._box = np.append(self.tolerance.box, float(self.tolerance.frame == "tool"))

    def track(
        self,
        poses: Sequence[Pose],
        q_start: Array,
        *,
        lane: int = 0,
        aside: Aside | None = None,
    ) -> Tracked:
        """From `q_start` (n,) through the poses, as far as programs lead.

        Args:
            poses: `T_world_tool`, the first one being the next after where `q_start` stands.
            lane: of the models that `lanes.worlds` makes, from the most careful to the boldest.
            aside: in place of the tracker's own.
        """
        chosen = aside or self.aside
        n, count = self.template.robot.dof, len(poses)
        out, report = np.empty((count, n)), np.empty((count, 3))
        beside = _kernels().Aside(
            chosen.limits, chosen.singularities, chosen.obstacles, chosen.distance, chosen.longest
        )
        world = self._worlds[min(lane, len(self._worlds) - 1)]
        reached = _kernels().track(
            self._arm, self._couple, world, frames(poses), self._box, self._max_step, ACCURACY, beside,
            np.array(q_start), out, report
        )  # fmt: skip
        if reached == count:
            return Tracked(out, None, 0.0, float(report[:, 2].min(initial=np.inf)))
        return Tracked(out[:reached], out[reached], float(report[reached, 1]), float(report[reached, 2]))

    def track_anyhow(self, poses: Sequence[Pose], q_start: Array) -> Tracked:
        """`track` in the most careful model that leads to the last pose, with motions beside the path and without.

        Where none does, on from the furthest pose that one leads to, as long as that is some way.
        """
        found, q = [np.zeros((0, len(q_start)))], np.asarray(q_start, dtype=float)
        done = 0
        while True:
            furthest = None
            for lane in range(len(self._worlds)):
                for aside in (self.aside, STILL):
                    last = self.track(poses[done:], q, lane=lane, aside=aside)
                    if last.complete:
                        return replace(last, configurations=np.concatenate([*found, last.configurations]))
                    if furthest is None or len(last.configurations) > len(furthest.configurations):
                        furthest = last
            assert furthest is not None
            found.append(furthest.configurations)
            if not len(furthest.configurations):
                return replace(furthest, configurations=np.concatenate(found))
            done += len(furthest.configurations)
            q = furthest.configurations[-1]

    def moved(
        self, pose: Pose, starts: Array, wishes: Array, lane: int = 0
    ) -> tuple[NDArray[np.bool_], Array, Array]:
        """From each of many configurations (k, n) to one pose, with what a wish (k, n) has that leaves the tool there.

        Returns:
            (k,) whether the pose was reached within `max_step`, clear in the model of that lane; (k, n) configurations;
            (k,) metres of clearance in that model.
        """
        out, report = np.empty(starts.shape), np.empty((len(starts), 2))
        world = self._worlds[min(lane, len(self._worlds) - 1)]
        _kernels().move(
            self._arm, self._couple, world, frames([pose])[0], self._box, self._max_step, ACCURACY,
            np.ascontiguousarray(starts), np.ascontiguousarray(wishes), out, report,
        )  # fmt: skip
        return report[:, 0] == _kernels().REACHED, out, report[:, 1]

    @property
    def largest(self) -> float:
        """Radians: the smallest of the joints' largest steps."""
        return float(self._max_step.min())

    @property
    def lanes(self) -> int:
        """How many models there are to track in."""
        return len(self._worlds)

    def manipulability(self, poses: Sequence[Pose], q: Array) -> Array:
        """(k,) sqrt(det(J J^T)) of the coordinates without tolerance at each q (k, n) and pose; 1 rad weighs 0.3 m."""
        out = np.empty(len(q))
        _kernels().volumes(self._arm, self._couple, frames(poses), self._box, np.array(q), out)
        return out

    def why(self, pose: Pose, tracked: Tracked, q_before: Array) -> str:
        """Why tracking ended before `pose`, in words."""
        q = tracked.best
        if q is None:
            return "it did not end"
        robot, reasons = self.template.robot, []
        at = np.minimum(q - robot.lower, robot.upper - q) < NEAR_LIMIT
        if np.any(at):
            names = " and ".join(robot.joint_names[k] for k in np.flatnonzero(at))
            reasons.append(f"{names} at the joint limit")
        volume = float(self.manipulability([pose], q[None])[0])
        if volume < SINGULAR:
            reasons.append(f"the arm is near a singularity (manipulability {volume:.1e})")
        if np.any(np.abs(q - q_before) > self._max_step - 1e-9):
            joint = robot.joint_names[int(np.argmax(np.abs(q - q_before) / self._max_step))]
            reasons.append(f"{joint} would have to move more than the largest step")
        keep = self._worlds[-1].required
        if tracked.clearance < keep + 1e-3:
            reasons.append(f"spheres are {1e3 * tracked.clearance:.1f} mm from an obstacle")
        if not reasons:
            reasons.append("local tracking found no step")
        return f"{', '.join(reasons)}; the tool is {1e3 * tracked.error:.2f} mm from its pose"


def frames(poses: Sequence[Pose]) -> Array:
    """Rows (k, 12) for the kernels: rotation (9, row-major) and position."""
    return np.array([np.concatenate([pose.rotation.ravel(), pose.position]) for pose in poses]).reshape(
        -1, 12
    )
