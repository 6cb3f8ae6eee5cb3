"""The search's workers: each works depth first on a tree of its own and hands boxes to those without any.

A tree in pre-order with boxes left on its stack goes on with the subtree of the topmost box, then of the one below, and
so on. So a box taken from the bottom is a tree of its own whose nodes follow all that its owner still writes.
"""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from workcell import clock
from workcell.ik.branch.arrays import Arrays
from workcell.pose import Array

MOST_NODES = 2_000_000
"""Size of all trees together at which the search gives up: its memory is 32 bytes a node."""
_DEPTH = 1024
_CHUNK = 64
"""Boxes between two looks at the clock."""


class Worker:
    """One tree: what has been written, the boxes left, and the trees of those that were given away.

    The last that was given away comes first.
    """

    def __init__(self, arrays: Arrays, box: Array) -> None:
        from workcell.ik.branch.kernels import search
        from workcell.ik.branch.kernels.obstacles import new_sweep
        from workcell.ik.branch.kernels.state import new_state

        self.search, self._arrays = search, arrays
        joints = box.shape[1]
        self._state, self._sweep = new_state(arrays.chain), new_sweep(joints)
        self.tree = search.Tree(
            stack=np.empty((_DEPTH, 2, joints)),
            nodes=np.empty((256, 4)),
            counts=np.zeros(8, dtype=np.int64),
            found=np.zeros(joints),
            best_gap=np.full(1, -np.inf),
        )
        self.tree.stack[0] = box
        self.tree.counts[0], self.tree.counts[6] = 1, -1
        self.given: list[Worker] = []

    @property
    def boxes_left(self) -> int:
        """Boxes on the stack."""
        return int(self.tree.counts[0])

    def work(self, reached: Array, chunk: int) -> int:
        """Work on so many boxes at most; the outcome as `workcell.ik.branch.kernels.search.run` names it."""
        search, arrays = self.search, self._arrays
        if self.tree.counts[1] + _CHUNK > len(self.tree.nodes):
            more = np.empty_like(self.tree.nodes)
            self.tree = self.tree._replace(nodes=np.concatenate([self.tree.nodes, more]))
        state, sweep = self._state, self._sweep
        outcome: int = search.run(
            arrays.chain, arrays.world, arrays.root, state, sweep, self.tree, reached, chunk
        )
        return outcome

    def give(self) -> Worker:
        """A worker for the lowest box of the stack, which is the largest."""
        stack, left = self.tree.stack, self.boxes_left
        other = Worker(self._arrays, np.array(stack[0]))
        stack[: left - 1] = stack[1:left].copy()
        self.tree.counts[0] -= 1
        self.given.insert(0, other)
        return other

    def everyone(self) -> list[Worker]:
        """This worker and those it gave boxes to, in the order of the whole tree."""
        return [self] + [worker for other in self.given for worker in other.everyone()]


class Crew:
    """Workers of one query; `run` can be called again to go on."""

    def __init__(self, arrays: Arrays, reached: Array, accept: Callable[[Array], bool]) -> None:
        self.first = Worker(arrays, arrays.root)
        self._reached, self._accept = reached, accept
        self._open = [self.first]
        self._over = False

    def run(self, deadline: float, most: float = np.inf, threads: int = 1) -> None:
        """Work until a configuration is accepted, no box is left, memory ends, or so many more nodes are written.

        Several threads work side by side on a chunk each and wait for each other before they share boxes anew, so that
        it never matters which is quicker.

        Args:
            deadline: `clock.cpu_seconds` at which to end in any case.
            most: nodes.
            threads: workers at work at once.
        """
        last = self.nodes + most
        with ThreadPoolExecutor(threads) if threads > 1 else contextlib.nullcontext() as pool:
            while self._open and not self._over and self.nodes < last and clock.cpu_seconds() <= deadline:
                self._share(threads)
                crew = self._open[-threads:]
                chunk = int(min(_CHUNK, np.ceil((last - self.nodes) / len(crew))))
                work = functools.partial(Worker.work, reached=self._reached, chunk=chunk)
                outcomes = dict(zip(crew, (pool.map if pool else map)(work, crew), strict=True))
                for worker in self.first.everyone():
                    if worker in outcomes and not self._goes_on(worker, outcomes[worker]):
                        self._open.remove(worker)

    def _share(self, threads: int) -> None:
        """Give boxes to idle threads, each from the worker that has most of them."""
        while len(self._open) < threads:
            fullest = max(self._open, key=lambda worker: worker.boxes_left)
            if fullest.boxes_left < 2:
                return
            self._open.append(fullest.give())

    def _goes_on(self, worker: Worker, outcome: int) -> bool:
        """Whether a worker has something left to do after a chunk; what it found is offered."""
        search = worker.search
        if outcome == search.FOUND:
            self._over = self._over or self._accept(np.array(worker.tree.found))
        elif outcome == search.FULL or self.nodes > MOST_NODES:
            self._over = True
        return bool(outcome != search.DONE and worker.boxes_left > 0)

    @property
    def nodes(self) -> int:
        """Nodes of all trees."""
        return sum(int(worker.tree.counts[1]) for worker in self.first.everyone())

    @property
    def finished(self) -> bool:
        """Whether every box has been excluded."""
        return all(int(w.tree.counts[0]) == 0 and int(w.tree.counts[4]) == 0 for w in self.first.everyone())

    def written(self) -> Array:
        """(nodes, 4) the whole tree."""
        return np.concatenate(
            [worker.tree.nodes[: worker.tree.counts[1]] for worker in self.first.everyone()]
        )

    def stats(self) -> dict[str, float]:
        """Sums over the workers, and by how much the best configuration in reach of the target kept the clearance."""
        names = ("boxes_left", "nodes", "kinematic_leaves", "collision_leaves", "given_up", "local_searches")
        everyone: list[Any] = self.first.everyone()
        total = np.sum([worker.tree.counts for worker in everyone], axis=0)
        stats = {name: float(total[k]) for k, name in enumerate(names)}
        best = max(float(worker.tree.best_gap[0]) for worker in everyone)
        return stats if np.isinf(best) else {**stats, "best_excess_clearance_m": best}
