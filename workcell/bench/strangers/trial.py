"""One stranger's cell put to workcell: what is lost, called impossible, or contradicted by plain MuJoCo."""

from __future__ import annotations

import tempfile
import traceback
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path as FilePath

import numpy as np

from workcell.bench.strangers.cells import Cell
from workcell.bench.strangers.oracle import Oracle
from workcell.bench.strangers.tasks import TRAVEL
from workcell.errors import WorkcellError
from workcell.ik.problem import Budget
from workcell.ik.solve import solve
from workcell.model.grip import actuated
from workcell.model.scene import Scene
from workcell.motion.plans.in_scene import plan_in_world
from workcell.motion.plans.result import PlanSettings
from workcell.motion.proofs.on_model import trajectory_clearance
from workcell.motion.timing.retime import retime
from workcell.pose import Array, Pose
from workcell.world.planning_world import PlanningWorld

DEEP = 1e-6
"""Metres of contact from which MuJoCo contradicts an answer."""
ROOM = 2e-3
"""Metres that a planted configuration keeps from everything."""
STEP = 0.01
"""Radians between the configurations of a path that MuJoCo is asked about."""
_DRAWS = 300


@dataclass
class Outcome:
    """What came of a cell.

    Attributes:
        queries, solved, paths, planned: how many of each.
        baseline: how many of the queries the plain multi-start search solves, where it was asked.
        failures: kind and words: `lost`, `impossible`, `contradicted`, `crash`.
        refused: why workcell would not take the cell, in its own words; empty where it did.
    """

    queries: int = 0
    solved: int = 0
    paths: int = 0
    planned: int = 0
    baseline: int = 0
    failures: list[tuple[str, str]] = field(default_factory=list)
    refused: str = ""


def try_cell(cell: Cell, queries: int, paths: int, budget_s: float = 1.0, baseline: bool = False) -> Outcome:
    """Ask for planted configurations, paths and motions in a cell, and hold plain MuJoCo against the answers.

    Args:
        cell: the cell.
        queries, paths: of each arm, at most.
        budget_s: CPU seconds of a query.
        baseline: whether the plain multi-start search is asked too, in the same time.
    """
    outcome = Outcome()
    try:
        with tempfile.TemporaryDirectory() as folder:
            for name, text in cell.files.items():
                (FilePath(folder) / name).write_text(text, encoding="utf-8")
            scene = Scene.load(FilePath(folder) / cell.source)
        for name, value in cell.moved.items():
            scene = actuated(scene, name, 0.5 + value / (2 * TRAVEL))
        for prefix in cell.arms:
            _Trial(cell, scene, prefix, outcome, budget_s, baseline).run(queries, paths)
    except WorkcellError as error:
        outcome.refused = str(error)
    except Exception as error:  # whatever it is, a user would have seen a traceback
        where = traceback.extract_tb(error.__traceback__)[-1]
        outcome.failures.append(("crash", f"{type(error).__name__}: {error} ({where.name}:{where.lineno})"))
    return outcome


class _Trial:
    """The questions to one arm of a cell."""

    def __init__(
        self, cell: Cell, scene: Scene, prefix: str, outcome: Outcome, budget_s: float, baseline: bool
    ) -> None:
        self.cell, self.scene, self.outcome, self.budget = cell, scene, outcome, Budget(budget_s)
        self.baseline = baseline
        self.arm, self.oracle = cell.arms[prefix], Oracle(cell, prefix)
        self.robot = scene.robot(prefix.removesuffix("/") or None)
        self.rng = np.random.default_rng([cell.seed, 7])

    def run(self, queries: int, paths: int) -> None:
        self._nothing_lost()
        if self.outcome.failures:
            return
        world = PlanningWorld.of(self.scene, self.robot.name)
        planted = list(self._planted(max(queries, paths + 1)))
        for q in planted[:queries]:
            self._ask(world, q)
        for first, second in pairwise(planted[: paths + 1]):
            self._travel(world, first, second)

    def _fail(self, kind: str, words: str) -> None:
        self.outcome.failures.append((kind, words))

    def _nothing_lost(self) -> None:
        arm, robot = self.arm, self.robot.robot
        if set(robot.joint_names) != set(arm.driven):
            self._fail("lost", f"joints {robot.joint_names} for {arm.driven}")
        elif len(self.robot.body_ids) < len(self.oracle.own):
            self._fail("lost", f"{len(self.robot.body_ids)} bodies for {len(self.oracle.own)}")

    def _mine(self, q: Array) -> Array:
        """Values in the order of the file (n,) in workcell's order."""
        order = [self.arm.driven.index(name) for name in self.robot.robot.joint_names]
        return q[order]

    def _theirs(self, q: Array) -> Array:
        order = [self.robot.robot.joint_names.index(name) for name in self.arm.driven]
        return q[..., order]

    def _planted(self, count: int) -> Iterator[Array]:
        """Configurations, at most `count`, that are clear by MuJoCo's contacts."""
        found = 0
        for _ in range(_DRAWS):
            if found == count:
                return
            q = self.oracle.random_configuration(self.rng)
            if q is not None and self.oracle.nearest(q).distance > ROOM:
                found += 1
                yield q

    def _ask(self, world: PlanningWorld, q: Array) -> None:
        target = self.oracle.tool_pose(q)
        self.outcome.queries += 1
        result = solve(world.problem(target), budget=self.budget, seed=self.cell.seed)
        if result.status.is_impossible:
            self._fail("impossible", f"{result.status.value} by {result.solver} for {q.tolist()}")
        if result.q is not None:
            self.outcome.solved += 1
            self._contradict("answer", self._theirs(result.q), target)
        if self.baseline:
            plain = solve(world.problem(target), "multistart", self.budget, self.cell.seed)
            self.outcome.baseline += plain.solved

    def _contradict(self, what: str, q: Array, target: Pose | None = None) -> None:
        """Hold limits, contacts and the tool's pose against a configuration, in the file's order."""
        outside = self.oracle.limits_broken(q)
        if outside > 2e-6:
            self._fail("contradicted", f"{what} {outside:.2g} outside the limits at {q.tolist()}")
        contact = self.oracle.nearest(q)
        if contact.distance < -DEEP:
            deep = f"{-1e3 * contact.distance:.3f} mm deep, geoms {contact.geoms}"
            self._fail("contradicted", f"{what} {deep} at {q.tolist()}")
        if target is not None:
            here = self.oracle.tool_pose(q)
            off = float(np.linalg.norm(here.position - target.position))
            turn = float(np.linalg.norm(here.rotation - target.rotation))
            if off > 2e-4 or turn > 3e-3:
                self._fail("contradicted", f"{what} misses the target by {1e3 * off:.2f} mm, {turn:.2g} rad")

    def _travel(self, world: PlanningWorld, first: Array, second: Array) -> None:
        self.outcome.paths += 1
        settings = PlanSettings(iterations=3000, attempts=1)
        found = plan_in_world(
            world, self._mine(first), self._mine(second), settings=settings, seed=self.cell.seed
        )
        if found.path is None:
            return
        self.outcome.planned += 1
        for q in self._samples(found.path.configurations):
            self._contradict("path", self._theirs(q))
            if self.outcome.failures:
                return
        limits = np.full(self.robot.robot.dof, 1.0)
        motion = retime(found.path, velocity=limits, acceleration=2 * limits)
        if not trajectory_clearance(self.robot.robot, motion, world.clearance, world.cover).proved:
            return  # round corners a motion leaves its path: nobody claims anything of it
        for q in motion.q[:: max(1, len(motion) // 200)]:
            self._contradict("motion", self._theirs(q))
            if self.outcome.failures:
                return

    @staticmethod
    def _samples(corners: Array) -> Iterator[Array]:
        for a, b in pairwise(corners):
            steps = max(2, int(np.ceil(np.abs(b - a).max() / STEP)))
            for share in np.linspace(0.0, 1.0, steps, endpoint=False):
                yield a + share * (b - a)
        yield corners[-1]
