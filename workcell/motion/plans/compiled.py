"""Compiled search for a path among spheres and convex obstacles: straight lines, RRT-Connect, then shortening.

Every line of the result has been proved clear when it was made (`workcell.motion.kernels.line`); the whole path is
proved once more at the end, for its margin.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workcell import clock
from workcell.compile_ahead import PLANNING, wait_for
from workcell.errors import InputError
from workcell.geometry.packing import random_state
from workcell.motion.body import NO_CONE, kernels
from workcell.pose import Array

if TYPE_CHECKING:
    from workcell.motion.kernels.body import Body
    from workcell.motion.kernels.optimise import Costs
    from workcell.motion.kernels.tree import Trees

CHUNK = 200
"""Samples between two looks at the clock."""
NODES = 20_000
"""Room for nodes of one tree, at most."""
FIRST_NODES = 1000
"""Room for nodes of one tree, at first."""
CORNERS = 400
"""Room for corners of a path that is being shortened."""


@dataclass(frozen=True, slots=True)
class Effort:
    """How hard to try.

    Attributes:
        step: length of a tree's edges, radians (of all joints together, L2).
        iterations: samples to draw, at most.
        looks: configurations to look at while the trees grow, about.
        cpu_s: CPU seconds to spend, at most; inf: only the iterations count, and the result depends on nothing else.
        shortcuts, pulls: of the path that was found (see `kernels.shorten`).
        optimise_s: CPU seconds to spend on shorter paths once there is one (`workcell.motion.plans.optimise`); 0: none.
        optimise_iterations: samples to draw for that, at most; with `optimise_s` inf the result depends on nothing
            else.
    """

    step: float = 1.0
    iterations: int = 1_000_000
    looks: int = 10_000_000
    cpu_s: float = float("inf")
    shortcuts: int = 40
    pulls: int = 4
    optimise_s: float = 0.0
    optimise_iterations: int = 100_000_000

    def __post_init__(self) -> None:
        if not (np.isfinite(self.step) and self.step > 0 and self.cpu_s >= 0):
            raise InputError(
                f"a search with steps of {self.step} rad within {self.cpu_s} s makes no sense", where="effort"
            )
        if not self.optimise_s >= 0:
            raise InputError(
                f"{self.optimise_s} s can't be spent on shorter paths", where="effort", remedy="0 or more"
            )
        if min(self.iterations, self.looks, self.shortcuts, self.pulls, self.optimise_iterations) < 0:
            raise InputError("the counts of a search are not negative", where="effort")

    @property
    def optimises(self) -> bool:
        """Whether shorter paths are looked for."""
        return self.optimise_s > 0 and self.optimise_iterations > 0


@dataclass(frozen=True, slots=True)
class Found:
    """What a search came to.

    Attributes:
        path: (k, n) corners from the start to a goal, proved; None when none was found.
        goal: row of the goal that was reached; -1 for none.
        iterations: samples drawn; 0 where a straight line was clear.
        lines, looks: lines tried and configurations looked at.
    """

    path: Array | None
    goal: int
    iterations: int
    lines: int
    looks: int


def kernels_ready() -> bool:
    """Whether the search was compiled before, on this machine."""
    from workcell.jit import is_compiled

    return all(is_compiled(kernel) for kernel in (kernels().grow, kernels().shorten))


def bare_body() -> Body:
    """One joint with nothing on it, for compiling."""
    empty = np.zeros((0, 6)), np.zeros((2, 6)), np.zeros((0, 19)), np.zeros((0, 13))
    alone = np.zeros((0, 2), dtype=np.int64), np.zeros((0, 0), dtype=np.uint8)
    couple = kernels().Couple(np.zeros(0, dtype=np.int64), np.zeros((0, 2)))
    body: Body = kernels().Body(
        np.zeros((3, 13)), np.zeros((3, 1)), *empty, np.zeros((2, 1)), *alone, NO_CONE, 0.0, couple
    )
    return body


@functools.cache
def prepare_kernels() -> None:
    """Compile (or load from the cache) what the search calls, so that the first query is a quick one."""
    wait_for(PLANNING)
    entries, body, zero = kernels(), bare_body(), np.zeros((1, 1))
    entries.prove_lines(body, np.zeros((2, 1)), 0.5, 1e-6, 10, np.zeros(7))
    entries.gaps(body, zero, 1.0, np.zeros((1, 3)))
    trees = _new_trees(zero[0], zero, 0, 2)
    entries.grow(body, trees, 1.0, 0, np.zeros(2, dtype=np.int64))
    entries.shorten(body, np.zeros((4, 1)), 2, random_state(0), 0, 0, 0, np.zeros(2, dtype=np.int64))


def search(body: Body, start: Array, goals: ArrayLike, effort: Effort | None = None, seed: int = 0) -> Found:
    """A proved path from `start` (n,) to any of `goals` (k, n); the same seed gives the same path.

    Start and goals are taken to be clear; goals that are not are never reached.

    Raises:
        InputError: start or goals of the wrong shape, or not finite.
    """
    prepare_kernels()
    effort, entries = effort or Effort(), kernels()
    deadline = clock.cpu_seconds() + effort.cpu_s
    start, goals = checked_query(body, start, goals)
    direct, tried, looks = _straight(body, start, goals)
    if direct >= 0:
        return Found(np.stack([start, goals[direct]]), direct, 0, tried, looks)
    trees = _new_trees(start, goals, seed, FIRST_NODES)
    meeting = np.zeros(2, dtype=np.int64)
    status, done = entries.OPEN, 0
    while status != entries.JOINED:
        chunk = min(CHUNK, effort.iterations - done)
        looked_enough = int(trees.tally[entries.LOOKS]) > effort.looks
        if chunk <= 0 or looked_enough or (done and clock.cpu_seconds() > deadline):
            break
        status = entries.grow(body, trees, effort.step, chunk, meeting)
        done = int(trees.tally[entries.ITERATIONS])
        if status == entries.FULL:
            if trees.nodes.shape[1] >= NODES:
                break
            trees = _roomier(trees)
    lines, looked = tried + int(trees.tally[entries.EDGES]), looks + int(trees.tally[entries.LOOKS])
    if status != entries.JOINED:
        return Found(None, -1, done, lines, looked)
    path, goal = branches(trees, meeting)
    path, more = shorten(body, path, effort, seed)
    return Found(path, goal, done, lines + int(more[0]), looked + int(more[1]))


def checked_query(body: Body, start: ArrayLike, goals: ArrayLike) -> tuple[Array, Array]:
    """Start (n,) and goals (k, n) as the kernels take them.

    Raises:
        InputError: of the wrong shape, or not finite.
    """
    goals = np.ascontiguousarray(goals, dtype=float)
    start = np.ascontiguousarray(start, dtype=float)
    n = body.bounds.shape[1]
    if (
        start.shape != (n,)
        or goals.shape[1:] != (n,)
        or not (np.isfinite(start).all() and np.isfinite(goals).all())
    ):
        raise InputError(
            f"a start of shape {start.shape} and goals of shape {goals.shape}, or not finite",
            where="search",
            remedy=f"({n},) and (k, {n})",
        )
    return start, goals


def _straight(body: Body, start: Array, goals: Array) -> tuple[int, int, int]:
    """The nearest goal that a straight line reaches (-1: none), and the lines and configurations that took."""
    entries, out = kernels(), np.empty(7)
    looks = 0
    order = np.argsort(np.linalg.norm(goals - start, axis=1))
    for tried, goal in enumerate(order, start=1):
        ends = np.stack([start, goals[goal]])
        code = entries.prove_lines(body, ends, 0.0, entries.FINEST, entries.MOST, out)
        looks += int(out[6])
        if code == entries.PROVED:
            return int(goal), tried, looks
    return -1, len(goals), looks


def shorten(body: Body, path: Array, effort: Effort, seed: int = 0) -> tuple[Array, NDArray[np.int64]]:
    """A path (k, n) with the same ends, shortened; and how many lines and configurations that took."""
    room = np.zeros((max(CORNERS, 2 * len(path)), path.shape[1]))
    room[: len(path)] = path
    tally = np.zeros(2, dtype=np.int64)
    count = kernels().shorten(
        body,
        room,
        len(path),
        random_state(seed + 1),
        effort.shortcuts,
        effort.shortcuts // 4,
        effort.pulls,
        tally,
    )
    return room[:count].copy(), tally


def _new_trees(start: Array, goals: Array, seed: int, nodes: int) -> Trees:
    n = len(start)
    room = nodes + len(goals)
    trees: Trees = kernels().Trees(
        np.empty((2, room, n)),
        np.full((2, room), -1, dtype=np.int64),
        np.full((2, room), np.inf),
        np.array([1, len(goals)], dtype=np.int64),
        random_state(seed),
        np.zeros(3, dtype=np.int64),
    )
    trees.nodes[0, 0] = start
    trees.nodes[1, : len(goals)] = goals
    return trees


def _roomier(trees: Trees) -> Trees:
    """The same trees with up to four times the room."""
    room = min(4 * trees.nodes.shape[1], NODES)
    used = trees.nodes.shape[1]
    nodes = np.empty((2, room, trees.nodes.shape[2]))
    parents, radius = np.full((2, room), -1, dtype=np.int64), np.full((2, room), np.inf)
    nodes[:, :used], parents[:, :used], radius[:, :used] = trees.nodes, trees.parents, trees.radius
    return trees._replace(nodes=nodes, parents=parents, radius=radius)


def branches(trees: Trees | Costs, meeting: NDArray[np.int64]) -> tuple[Array, int]:
    """The corners (k, n) from the start over the meeting point to a goal, and that goal's row."""
    rows: list[list[int]] = []
    for side in range(2):
        row, branch = int(meeting[side]), []
        while row >= 0:
            branch.append(row)
            row = int(trees.parents[side, row])
        rows.append(branch)
    there = trees.nodes[0, rows[0][::-1]]
    # the meeting point stands in both trees
    back = trees.nodes[1, rows[1][1:]]
    return np.concatenate([there, back]), rows[1][-1]
