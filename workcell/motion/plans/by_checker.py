"""Collision-free joint motion by any judge of single configurations: a straight line, or RRT-Connect.

RRT-Connect grows a tree from either end towards random configurations and towards each other (Kuffner and LaValle,
"RRT-Connect: an efficient approach to single-query path planning", 2000). Edges are looked at by sampling while the
trees grow, with some clearance to spare; the path is then shortcut, and proved clear over its whole length
(`workcell.motion.proofs.on_model`). After a failed proof the search is repeated with samples twice as dense.

Where spheres and pieces are known, the compiled `workcell.motion.plans.compiled` comes first, and this is what remains
where its paths, found among spheres, are not clear for the geometry itself, or spheres close the only way. That is
seldom but needed: of the tasks that travel with workcell, seeds 0 to 2, `keep_upright` asks seven times for a way that
is no straight line; the compiled search finds three, this one three of the other four. Of 720 queries between random
configurations near things, in six of the tasks' cells, it answered 58 that the compiled search, with its 89, did not.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from workcell.geometry.types import SphereCover
from workcell.model.robot import Robot
from workcell.motion.path import Path
from workcell.motion.plans.ends import checked_end
from workcell.motion.plans.result import PlanResult, PlanSettings, PlanStatus
from workcell.motion.proofs.on_model import Checker, prove_path, prove_segment
from workcell.pose import Array


def connect(
    robot: Robot,
    q_a: ArrayLike,
    q_b: ArrayLike,
    checker: Checker,
    extent: SphereCover,
    *,
    clearance: float = 0.0,
) -> PlanResult:
    """The straight joint line between two configurations, if it is proved clear.

    Raises:
        InputError: an end outside the joint limits or in collision.
    """
    start, _ = checked_end(robot, q_a, checker, "q_a", wanted=clearance)
    goal, _ = checked_end(robot, q_b, checker, "q_b", wanted=clearance)
    proof = prove_segment(robot, start, goal, checker, extent, floor=clearance)
    spent = proof.evaluations + 2
    if not proof.proved:
        return PlanResult(PlanStatus.NOT_FOUND, None, None, proof.reason, 0, spent)
    return PlanResult(PlanStatus.PLANNED, Path(robot, np.stack([start, goal])), proof, "", 0, spent)


def plan(
    robot: Robot,
    q_start: ArrayLike,
    q_goal: ArrayLike,
    checker: Checker,
    extent: SphereCover,
    *,
    settings: PlanSettings | None = None,
    seed: int = 0,
) -> PlanResult:
    """A path from `q_start` to `q_goal` (n,) that is proved clear; the same seed gives the same path.

    Args:
        robot: serial.
        checker: the truth about collisions at one configuration.
        extent: spheres in link frames that contain all that moves.

    Raises:
        InputError: start or goal outside the joint limits, or in collision (which pair, how deep, and the nearest free
            configuration that was found).
    """
    settings = settings or PlanSettings()
    straight = connect(robot, q_start, q_goal, checker, extent, clearance=settings.clearance)
    if straight.planned:
        return straight
    start, goal = np.asarray(q_start, dtype=float), np.asarray(q_goal, dtype=float)
    ends = min(checker(start).distance, checker(goal).distance) - settings.clearance
    keep = settings.clearance + min(settings.spare, max(ends, 0.0) / 2)
    rng = np.random.default_rng(seed)
    search = _Search(robot, checker, settings, rng, keep, settings.resolution, straight.evaluations + 2)
    detail = straight.detail
    for _ in range(settings.attempts):
        corners = search.connect_trees(start, goal)
        if corners is None:
            detail = f"the trees did not meet within {settings.iterations} extensions"
            break
        path = Path(robot, np.stack(search.shortcut(corners)))
        proof = prove_path(path, checker, extent, floor=settings.clearance)
        search.evaluations += proof.evaluations
        if proof.proved:
            return PlanResult(PlanStatus.PLANNED, path, proof, "", search.iterations, search.evaluations)
        detail = proof.reason
        search.resolution /= 2
    return PlanResult(PlanStatus.NOT_FOUND, None, None, detail, search.iterations, search.evaluations)


@dataclass(slots=True)
class _Tree:
    """Configurations with the index of the one each was reached from."""

    nodes: list[Array]
    parents: list[int] = field(default_factory=lambda: [-1])

    def nearest(self, q: Array) -> int:
        return int(np.argmin(np.abs(np.array(self.nodes) - q).max(axis=1)))

    def add(self, q: Array, parent: int) -> int:
        self.nodes.append(q)
        self.parents.append(parent)
        return len(self.nodes) - 1

    def branch(self, index: int) -> list[Array]:
        """Configurations from the root to a node."""
        back = []
        while index >= 0:
            back.append(self.nodes[index])
            index = self.parents[index]
        return back[::-1]


@dataclass(slots=True)
class _Search:
    robot: Robot
    checker: Checker
    settings: PlanSettings
    rng: np.random.Generator
    keep: float
    resolution: float
    evaluations: int = 0
    iterations: int = 0

    def connect_trees(self, start: Array, goal: Array) -> list[Array] | None:
        """Corners of a path whose edges look clear, or None when the iterations are spent."""
        ours, theirs = _Tree([start]), _Tree([goal])
        forward = True
        for _ in range(self.settings.iterations):
            self.iterations += 1
            sample = self.rng.uniform(self.robot.lower, self.robot.upper)
            reached = self._extend(ours, ours.nearest(sample), sample)
            if reached is not None:
                meeting = self._reach(theirs, ours.nodes[reached])
                if meeting is not None:
                    mine, other = ours.branch(reached), theirs.branch(meeting)[::-1]
                    corners = mine + other[1:]
                    return corners if forward else corners[::-1]
            ours, theirs, forward = theirs, ours, not forward
        return None

    def _extend(self, tree: _Tree, nearest: int, target: Array) -> int | None:
        """One step from a node towards `target`; the new node, or None when something is in the way."""
        origin = tree.nodes[nearest]
        distance = float(np.abs(target - origin).max())
        fraction = min(1.0, self.settings.step / distance) if distance > 0 else 1.0
        q = origin + fraction * (target - origin)
        return tree.add(q, nearest) if self._looks_clear(origin, q) else None

    def _reach(self, tree: _Tree, target: Array) -> int | None:
        """Steps towards `target` until it is reached, or None."""
        node = tree.nearest(target)
        while True:
            step = self._extend(tree, node, target)
            if step is None:
                return None
            if float(np.abs(tree.nodes[step] - target).max()) < 1e-12:
                return step
            node = step

    def _looks_clear(self, a: Array, b: Array) -> bool:
        count = max(int(np.ceil(float(np.abs(b - a).max()) / self.resolution)), 1)
        for i in range(count, 0, -1):
            q = a + i / count * (b - a)
            self.evaluations += 1
            if self.checker(q).distance < self.keep:
                return False
        return True

    def shortcut(self, corners: list[Array]) -> list[Array]:
        """Replace stretches between two points of the path by straight lines where those look clear."""
        path = list(corners)
        for _ in range(self.settings.shortcuts):
            if len(path) < 3:
                break
            u, v = np.sort(self.rng.uniform(0, len(path) - 1, size=2))
            i, j = int(u), int(v)
            if j == i:
                continue
            a = path[i] + (u - i) * (path[i + 1] - path[i])
            b = path[j] + (v - j) * (path[j + 1] - path[j])
            if self._looks_clear(a, b):
                path = [*path[: i + 1], a, b, *path[j + 1 :]]
        return _without_repetitions(path)


def _without_repetitions(corners: list[Array]) -> list[Array]:
    kept = [corners[0]]
    for q in corners[1:]:
        if float(np.abs(q - kept[-1]).max()) > 1e-9:
            kept.append(q)
    return kept
