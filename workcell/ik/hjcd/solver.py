"""HJCD-IK with collisions inside: seeds, greedy coordinate descent, Newton polish, then clear of obstacles.

Its parts are those of the paper (sections III and IV), which knows kinematics alone; here each seed goes through both
phases before the next is drawn, until one is a solution. The paper's algorithm on a batch is `solve_two_phase`:

    @misc{hjcdik,
      title = {{HJCD-IK}: {GPU}-Accelerated Inverse Kinematics through Batched Hybrid {Jacobian} Coordinate Descent},
      url   = {https://github.com/a2r-lab/HJCD-IK},
    }

Here a pose in collision slides clear under a hinge on penetration, and an arm with joints to spare walks around its
self-motion curve. All of it is compiled when first called (`prepare` does so ahead of time) and cached on disk.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from workcell import clock
from workcell.compile_ahead import SAMPLING, wait_for
from workcell.geometry.packing import pack_couple, random_state
from workcell.ik.hjcd.batch import ACCURACY, BatchSolution, solve_batch, solve_two_phase
from workcell.ik.hjcd.memory import kernels, new_memory
from workcell.ik.hjcd.refine import DEEPEST, refine
from workcell.ik.judge.verify import sphere_name
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.result import NEAR_MISSES, Candidate
from workcell.ik.shared.packing import (
    empty_world,
    has_collisions,
    narrowed_arm,
    one_joint,
    pack_world,
    shrunk_world,
)
from workcell.pose import Array

__all__ = [
    "BatchSolution",
    "Collected",
    "collect",
    "collect_solutions",
    "prepare",
    "solve_batch",
    "solve_hjcd",
    "solve_two_phase",
]

if TYPE_CHECKING:
    from workcell.ik.hjcd.kernels.search import Memory
    from workcell.kernels.structures import World

RESTARTS = 16
"""Restarts between two looks at the clock."""
RESTARTS_A_SECOND, FREE_A_SECOND = 16_000, 70_000
"""Restarts that one quiet core makes in a second: among obstacles, in the median of the public problem sets, and
without any."""
MOST_CHECKS = 300
"""Candidates shown to a problem's own checker before the search gives up."""
MANY_JOINTS = 8
"""Joints from which near misses are refined: the self-motion is more than the curve that is walked."""
COLLECTING = Budget(10.0, effort=1.0)
"""For collecting solutions, where nothing else is said."""
NEARBY = 12
"""Seeds drawn near the reference where links may turn by little only."""


def prepare(problem: IKProblem) -> None:
    """Import and compile (or load from the cache) what `solve_hjcd` calls for a problem, so that it is a quick one."""
    if problem.robot.coupling is not None:
        _prepare_coupled()
    elif _searches(problem):
        _prepare_search(refinement=problem.robot.dof >= MANY_JOINTS)
    else:
        _prepare_free()


@functools.cache
def _prepare_coupled() -> None:
    from workcell.kernels.coupling import Couple

    couple = Couple(np.zeros(1, dtype=np.int64), np.array([[0.0, 1.0]]))
    nowhere = (np.zeros(7), np.zeros((0, 1)), ACCURACY, ACCURACY, 0, new_memory(1, 0), np.zeros(1))
    kernels().search_coupled(one_joint(), couple, empty_world(1), *nowhere)


@functools.cache
def _prepare_free() -> None:
    q, cost, first = np.zeros((1, 1)), np.zeros(1), np.zeros((0, 1))
    kernels().solve_targets(one_joint(), np.zeros((0, 7)), first, ACCURACY, 0, random_state(0), q, cost)


def kernels_ready() -> bool:
    """Whether sampling among obstacles was compiled before, on this machine."""
    from workcell.jit import is_compiled

    return is_compiled(kernels().search)


def prepare_kernels() -> None:
    """Compile what samples among obstacles, or load it from the cache."""
    _prepare_search(refinement=False)


@functools.cache
def _prepare_search(refinement: bool) -> None:
    wait_for(SAMPLING)
    arm, world, q, first = one_joint(), empty_world(1), np.zeros(1), np.zeros((0, 1))
    kernels().search(arm, world, np.zeros(7), first, ACCURACY, ACCURACY, 0, new_memory(1, 0), q)
    if refinement:
        refine(arm, world, np.zeros(7), first, ACCURACY, q)


def _searches(problem: IKProblem) -> bool:
    """Whether there is more to a problem than kinematics of joints that move by themselves, and their limits."""
    if problem.robot.coupling is not None:
        return True
    return has_collisions(problem) or problem.checker is not None or problem.max_link_rotation is not None


def solve_hjcd(problem: IKProblem, budget: Budget, seed: int = 0) -> Candidate:
    """Look for a configuration until the budget is spent: CPU seconds of this process, or restarts.

    The first start is `q_reference` where there is one; `max_step` narrows the joint limits. Deterministic for a seed,
    as far as the budget reaches. Compilation is not charged. `stats["exhausted"]` is 1 where the search ended early
    because every restart of a long series led to configurations seen before: strong evidence that there is no solution,
    but no proof.
    """
    if budget.cpu_s <= 0:
        return Candidate()
    prepare(problem)
    deadline = clock.cpu_seconds() + budget.cpu_s
    if _searches(problem):
        return _Search(problem, seed).run(deadline, most_restarts(budget, RESTARTS_A_SECOND))
    return _solve_free(problem, deadline, most_restarts(budget, FREE_A_SECOND), seed)


def most_restarts(budget: Budget, a_second: int) -> float:
    """How many restarts a budget allows: its `iterations`, else what its effort is worth."""
    return budget.work(a_second) if budget.iterations is None else budget.iterations


@dataclass(frozen=True, slots=True)
class Collected:
    """Solutions (n,) in the order in which they were found, and the restarts that it took."""

    configurations: tuple[Array, ...]
    restarts: int


def collect_solutions(
    problem: IKProblem, most: int, seed: int = 0, budget: Budget | None = None
) -> list[Array]:
    """The configurations (n,) of `collect`, alone."""
    return list(collect(problem, most, seed, budget).configurations)


def collect(problem: IKProblem, most: int, seed: int = 0, budget: Budget | None = None) -> Collected:
    """Up to `most` solutions in the order in which random seeds and self-motion curves yield them.

    Ends early where the search is exhausted or the budget (default: `COLLECTING`) is spent. Every one keeps pose,
    limits and clearance; a `checker` is asked about each. They may lie close to each other: see
    `workcell.ik.diverse.solutions`.
    """
    if problem.robot.coupling is not None:
        _prepare_coupled()
    else:
        _prepare_search(refinement=problem.robot.dof >= MANY_JOINTS)
    budget = budget or COLLECTING
    deadline, restarts = clock.cpu_seconds() + budget.cpu_s, most_restarts(budget, RESTARTS_A_SECOND)
    search = _Search(problem, seed)
    found: list[Array] = []
    while len(found) < most and search.restarts < restarts and clock.cpu_seconds() < deadline:
        q = search.run(deadline, restarts - search.restarts).q
        if q is None:
            break
        found.append(np.array(q))
    return Collected(tuple(found), search.restarts)


def target_row(problem: IKProblem) -> Array:
    """The target's position and quaternion wxyz (7,)."""
    return np.concatenate([problem.target.position, problem.target.quat_wxyz])


def enough(problem: IKProblem) -> float:
    """Metres of residual that surely meet the problem's tolerances."""
    return 0.2 * min(problem.tolerances.position, 0.3 * problem.tolerances.rotation)


def _solve_free(problem: IKProblem, deadline: float, most: float, seed: int) -> Candidate:
    """Restart until the pose is reached; nothing to collide with."""
    arm, n = narrowed_arm(problem), problem.robot.dof
    poses, q, cost = target_row(problem)[None], np.empty((1, n)), np.empty(1)
    first = np.empty((0, n)) if problem.q_reference is None else np.array(problem.q_reference)[None]
    random, accepted = random_state(seed), enough(problem) ** 2
    restarts, best = 0, np.inf
    while True:
        chunk = int(min(100, most - restarts))
        restarts += kernels().solve_targets(arm, poses, first, ACCURACY, chunk, random, q, cost)
        if cost[0] <= accepted:
            return Candidate(q=q[0], stats={"restarts": float(restarts), "residual_m": float(cost[0]) ** 0.5})
        best = min(best, float(cost[0]))
        if clock.cpu_seconds() > deadline or restarts >= most:
            return Candidate(stats={"restarts": float(restarts)}, rejected=(_unreached(restarts, best),))


class _Search:
    """One query among obstacles: chunks of compiled search, and the judges that only Python can ask in between."""

    def __init__(self, problem: IKProblem, seed: int) -> None:
        self.problem, self._seed = problem, seed
        self._arm, self._pose = narrowed_arm(problem), target_row(problem)
        self._first = self._starts()
        world = pack_world(problem)
        self._lanes = [(world, new_memory(problem.robot.dof, seed))]
        if problem.checker is not None and has_collisions(problem):
            # An outer cover may forbid what the true shape allows: every other chunk forgives it its overshoot.
            self._lanes.append((shrunk_world(problem, world), new_memory(problem.robot.dof, seed + 1)))
        self._couple = None if problem.robot.coupling is None else pack_couple(problem.robot)
        self._checks = 0
        self._refined: set[bytes] = set()
        self._refused: dict[str, None] = {}

    def _starts(self) -> Array:
        """Configurations (k, n) to begin from: the reference, and some near it where links may not turn far."""
        problem = self.problem
        if problem.q_reference is None:
            return np.empty((0, problem.robot.dof))
        starts = np.array(problem.q_reference)[None]
        if problem.max_link_rotation is not None:
            spread = np.random.default_rng(self._seed).normal(size=(NEARBY, problem.robot.dof))
            starts = np.concatenate([starts, starts + 0.25 * problem.max_link_rotation * spread])
        bounds = self._arm.bounds
        return np.clip(starts, bounds[0], bounds[1])

    @property
    def restarts(self) -> int:
        """Restarts so far, of the lane that has made most."""
        return int(max(memory.counts[kernels().RESTARTS] for _, memory in self._lanes))

    def run(self, deadline: float, most: float = np.inf) -> Candidate:
        """Search until a configuration is found, the search is exhausted, `most` restarts are made or time is over."""
        lanes, exhausted = list(self._lanes), False
        q, done = np.empty(self.problem.robot.dof), 0
        while lanes and done < most:
            chunk = int(min(RESTARTS, most - done))
            done += chunk
            for lane in list(lanes):
                world, memory = lane
                status = self._look(world, memory, chunk, q)
                if status == kernels().FOUND and self._passes(q):
                    return self._candidate(q, exhausted=False)
                if status == kernels().EXHAUSTED:
                    lanes = [other for other in lanes if other is not lane]
                elif status == kernels().SPENT and self._refine(world, memory, q) and self._passes(q):
                    return self._candidate(q, exhausted=False)
                if clock.cpu_seconds() > deadline or self._checks >= MOST_CHECKS:
                    return self._candidate(None, exhausted=False)
            exhausted = not lanes
        return self._candidate(None, exhausted)

    def _look(self, world: World, memory: Memory, chunk: int, q: Array) -> int:
        """Some restarts, by the kernel for the robot; what it found goes into q."""
        given = (world, self._pose, self._first, ACCURACY, enough(self.problem), chunk, memory, q)
        if self._couple is not None:
            return int(kernels().search_coupled(self._arm, self._couple, *given))
        return int(kernels().search(self._arm, *given))

    def _refine(self, world: World, memory: Memory, q: Array) -> bool:
        """Quadratic programs from the nearest misses, into q; for arms whose self-motion is more than a curve."""
        if self.problem.robot.dof < MANY_JOINTS or self._couple is not None:
            return False
        starts = [miss[3:] for miss in memory.misses if miss[0] > world.required - DEEPEST]
        starts = [q for q in starts if q.tobytes() not in self._refined]
        self._refined |= {q.tobytes() for q in starts}
        return bool(starts) and refine(self._arm, world, self._pose, np.array(starts), ACCURACY, q)

    def _passes(self, q: Array) -> bool:
        """Ask the judges that the kernels don't know: link rotations and the problem's own checker."""
        problem = self.problem
        if problem.max_link_rotation is not None and problem.q_reference is not None:
            T = problem.robot.link_transforms(np.stack([q, problem.q_reference]))[:, :, :3, :3]
            change = np.linalg.norm(T[0] - T[1], axis=(1, 2))
            if change.max() > problem.max_link_rotation:
                self._refused[f"link {problem.robot.link_names[int(change.argmax())]} turns too far"] = None
                return False
        if problem.checker is None:
            return True
        self._checks += 1
        clearance = problem.checker(q)
        if clearance.distance >= problem.tolerances.safety_margin:
            return True
        first, second = clearance.pair
        self._refused[f"{first} is {_gap(clearance.distance)} {second}, says the problem's checker"] = None
        return False

    def _candidate(self, q: Array | None, exhausted: bool) -> Candidate:
        entries = kernels()
        counts = np.sum([memory.counts for _, memory in self._lanes], axis=0)
        stats = {
            "restarts": float(counts[entries.RESTARTS]),
            "poses": float(counts[entries.POSES]),
            "slides": float(counts[entries.SLID]),
            "curves": float(counts[entries.CURVES]),
            "refinements": float(len(self._refined)),
            "checks": float(self._checks),
            "exhausted": float(exhausted),
        }
        if q is not None:
            return Candidate(q=q, stats=stats)
        return Candidate(stats=stats, rejected=self._near_misses())

    def _near_misses(self) -> tuple[str, ...]:
        """Why the nearest configurations are no solutions."""
        reasons = list(self._refused)[:NEAR_MISSES]
        memory = self._lanes[0][1]
        for row in memory.misses:
            if row[0] > -1e3:
                sphere, other = sphere_name(self.problem, int(row[1])), int(row[2])
                against = (
                    self.problem.obstacles[other].name
                    if other >= 0
                    else sphere_name(self.problem, -1 - other)
                )
                reasons.append(f"{sphere} is {_gap(row[0])} {against}")
        if not reasons:
            entries = kernels()
            reasons.append(_unreached(int(memory.counts[entries.RESTARTS]), memory.counts[entries.BEST]))
        return tuple(dict.fromkeys(reasons))[:NEAR_MISSES]


def _gap(distance: float) -> str:
    return f"{-1e3 * distance:.3g} mm inside" if distance < 0 else f"{1e3 * distance:.3g} mm from"


def _unreached(restarts: int, cost: float) -> str:
    return f"none of {restarts} restarts reached the pose; the nearest left a residual of {1e3 * cost**0.5:.3g} mm"
