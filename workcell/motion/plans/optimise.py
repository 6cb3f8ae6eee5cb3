"""Shorter and shorter proved paths for as long as it is worth it: asymptotically optimal planning, compiled.

Starts from a path that was found, and looks for one that is shorter than the best so far, again and again
(`workcell.motion.kernels.optimise`). Every one is shortened, and every line of it is proved when it is made.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workcell import clock
from workcell.errors import InputError
from workcell.geometry.packing import random_state
from workcell.motion.body import kernels
from workcell.motion.plans.compiled import (
    CHUNK,
    FIRST_NODES,
    Effort,
    bare_body,
    branches,
    checked_query,
    prepare_kernels,
    shorten,
)
from workcell.pose import Array

if TYPE_CHECKING:
    from workcell.motion.kernels.body import Body
    from workcell.motion.kernels.optimise import Costs

_CLOSE = 1e-9
"""Share by which the best path may exceed the lower bound and count as the shortest."""


@dataclass(frozen=True, slots=True)
class Shortened:
    """What optimising came to.

    Attributes:
        paths: of falling length, each (k, n) and proved; the first is the one given.
        goals: row of the goal that each of them reaches.
        lower_bound: radians; no path to any of the goals is shorter: the straight line to the nearest.
        iterations: samples drawn.
        lines, looks: lines tried and configurations looked at.
    """

    paths: tuple[Array, ...]
    goals: tuple[int, ...]
    lower_bound: float
    iterations: int
    lines: int
    looks: int


@functools.cache
def prepare_optimising() -> None:
    """Compile (or load from the cache) what optimising calls."""
    prepare_kernels()
    trees = _new_trees(np.zeros(1), np.zeros((1, 1)), 0, 0)
    kernels().improve(bare_body(), trees, 1.0, 1.0, 0, np.zeros(2, dtype=np.int64))


def path_length(path: Array) -> float:
    """Length of corners (k, n) joined by straight lines, radians (L2 of all joints together)."""
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def optimise(
    body: Body,
    start: ArrayLike,
    goals: ArrayLike,
    path: ArrayLike,
    goal: int,
    effort: Effort | None = None,
    seed: int = 0,
) -> Shortened:
    """Shorter paths from `start` (n,) to any of `goals` (k, n).

    Ends after `effort.optimise_s` CPU seconds or `effort.optimise_iterations` samples, or when a straight line to the
    nearest goal was found. Where the samples end it, the same seed gives the same paths, and more samples go on
    from there: the length never rises with them.

    Args:
        path: (k, n) corners that are proved, as `search` finds them.
        goal: row of the goal that the path reaches.
        effort: default: a second.

    Raises:
        InputError: start, goals or path of the wrong shape, or not finite, or the path does not lead from the start
            to its goal.
    """
    effort = effort or Effort(optimise_s=1.0)
    start, goals = checked_query(body, start, goals)
    path = np.array(path, dtype=float)
    if (
        path.ndim != 2
        or path.shape[1] != len(start)
        or not 0 <= goal < len(goals)
        or not (np.array_equal(path[0], start) and np.array_equal(path[-1], goals[goal]))
    ):
        raise InputError("the path does not lead from the start to its goal", where="path")
    prepare_optimising()
    deadline = clock.cpu_seconds() + effort.optimise_s
    return _Optimisation(body, start, goals, effort, seed).run(path, goal, deadline)


class _Optimisation:
    """Trees that are grown anew below the length of every better path."""

    def __init__(self, body: Body, start: Array, goals: Array, effort: Effort, seed: int) -> None:
        self.body, self.start, self.goals, self.effort, self.seed = body, start, goals, effort, seed
        self.distance = np.linalg.norm(goals - start, axis=1)
        self.paths: list[Array] = []
        self.reached: list[int] = []
        self.length, self.done, self.searches = float("inf"), 0, 0
        self.tally = np.zeros(2, dtype=np.int64)

    def run(self, path: Array, goal: int, deadline: float) -> Shortened:
        least, meeting = float(self.distance.min()), np.zeros(2, dtype=np.int64)
        self.keep(path, goal)
        self.shorten(path, goal)
        trees, rows = self.new_trees()
        entries = kernels()
        while self.length > least * (1.0 + _CLOSE) and clock.cpu_seconds() <= deadline:
            chunk = min(CHUNK, self.effort.optimise_iterations - self.done)
            if chunk <= 0:
                break
            before = int(trees.tally[entries.ITERATIONS])
            status = entries.improve(self.body, trees, self.length, self.effort.step, chunk, meeting)
            self.done += int(trees.tally[entries.ITERATIONS]) - before
            if status == entries.FULL:
                trees = _roomier(trees)
            elif status == entries.OPEN and chunk == CHUNK:
                # other shortcuts; not where the samples end, so that more of them go on from the same path
                self.searches += 1
                self.shorten(self.paths[-1], self.reached[-1])
            elif status == entries.JOINED:
                found, row = branches(trees, meeting)
                goal = int(rows[row])
                self.keep(found, goal)
                self.shorten(found, goal)
                self.tally += trees.tally[1:]
                trees, rows = self.new_trees()
        lines, looks = (int(count) for count in self.tally + trees.tally[1:])
        return Shortened(tuple(self.paths), tuple(self.reached), least, self.done, lines, looks)

    def keep(self, path: Array, goal: int) -> None:
        """A path to be returned, if it is shorter than the last."""
        length = path_length(path)
        if length < self.length:
            self.paths.append(path)
            self.reached.append(goal)
            self.length = length

    def shorten(self, path: Array, goal: int) -> None:
        shorter, tally = shorten(self.body, path, self.effort, self.seed + self.searches)
        self.tally += tally
        self.keep(shorter, goal)

    def new_trees(self) -> tuple[Costs, NDArray[np.int64]]:
        """Trees of the start, the goals that are near enough and the best path so far, and the rows of these goals."""
        rows = np.flatnonzero(self.distance < self.length)
        path, root = self.paths[-1], np.flatnonzero(rows == self.reached[-1])
        self.searches += 1
        trees = _new_trees(self.start, self.goals[rows], self.seed + self.searches, len(path))
        _hang(trees, 0, 0, path)
        if len(root):
            _hang(trees, 1, int(root[0]), path[::-1])
        return trees, rows


def _new_trees(start: Array, goals: Array, seed: int, corners: int) -> Costs:
    room = FIRST_NODES + corners + len(goals)
    trees: Costs = kernels().Costs(
        np.empty((2, room, len(start))),
        np.full((2, room), -1, dtype=np.int64),
        np.zeros((2, room)),
        np.array([1, len(goals)], dtype=np.int64),
        np.array([1, len(goals)], dtype=np.int64),
        random_state(seed),
        np.zeros(3, dtype=np.int64),
    )
    trees.nodes[0, 0] = start
    trees.nodes[1, : len(goals)] = goals
    return trees


def _hang(trees: Costs, side: int, root: int, path: Array) -> None:
    """Make the corners of a path that begins at a root a branch of a tree, all but its end."""
    lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
    parent = root
    for k in range(1, len(path) - 1):
        node = int(trees.size[side])
        trees.nodes[side, node], trees.parents[side, node] = path[k], parent
        trees.cost[side, node] = lengths[:k].sum()
        trees.size[side], parent = node + 1, node


def _roomier(trees: Costs) -> Costs:
    """The same trees with four times the room."""
    used = trees.nodes.shape[1]
    more = 4 * used
    nodes = np.empty((2, more, trees.nodes.shape[2]))
    parents, cost = np.full((2, more), -1, dtype=np.int64), np.zeros((2, more))
    nodes[:, :used], parents[:, :used], cost[:, :used] = trees.nodes, trees.parents, trees.cost
    return trees._replace(nodes=nodes, parents=parents, cost=cost)
