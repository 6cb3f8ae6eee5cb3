"""The search's workers: each works depth first on a tree of its own and hands boxes to those without any.

A tree in pre-order with boxes left on its stack goes on with the subtree of the topmost box, then of the one below, and
so on. So a box taken from the bottom is a tree of its own whose nodes follow all that its owner still writes.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

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

        self._search, self._arrays = search, arrays
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

    def work(self, reached: Array) -> int:
        """Work on a chunk of boxes; the outcome as `workcell.ik.branch.kernels.search.run` names it."""
        search, arrays = self._search, self._arrays
        if self.tree.counts[1] + _CHUNK > len(self.tree.nodes):
            more = np.empty_like(self.tree.nodes)
            self.tree = self.tree._replace(nodes=np.concatenate([self.tree.nodes, more]))
        state, sweep = self._state, self._sweep
        outcome: int = search.run(
            arrays.chain, arrays.world, arrays.root, state, sweep, self.tree, reached, _CHUNK
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
        self._lock = threading.Lock()
        self._open = [self.first]
        self._idle = 0
        self._over = False

    def run(self, deadline: float, threads: int = 1) -> None:
        """Work until a configuration is accepted, no box is left, memory ends, or `deadline` (process CPU time)."""
        if self._over:
            return
        if threads <= 1:
            while self._step_any(deadline):
                pass
            return
        self._idle = 0
        helpers = [threading.Thread(target=self._take_part, args=(deadline, threads)) for _ in range(threads)]
        for helper in helpers:
            helper.start()
        for helper in helpers:
            helper.join()

    def _step_any(self, deadline: float) -> bool:
        if not self._open or self._over or time.process_time() > deadline:
            return False
        if not self._step(self._open[-1]):
            self._open.pop()
        return True

    def _take_part(self, deadline: float, threads: int) -> None:
        worker: Worker | None = None
        waiting = False
        while True:
            with self._lock:
                if worker is None and self._open:
                    worker = self._open.pop()
                    self._idle -= waiting
                    waiting = False
                elif worker is None and not waiting:
                    waiting = True
                    self._idle += 1
                finished = self._over or self._idle == threads or time.process_time() > deadline
                if finished:
                    if worker is not None:
                        self._open.append(worker)
                    return
                if worker is not None and self._idle > len(self._open) and worker.boxes_left > 1:
                    self._open.append(worker.give())
            if worker is None:
                time.sleep(2e-4)
            elif not self._step(worker):
                worker = None

    def _step(self, worker: Worker) -> bool:
        """One chunk of a worker; False once it has nothing left to do."""
        search = worker._search
        outcome = worker.work(self._reached)
        if outcome == search.FOUND:
            with self._lock:
                if not self._over and self._accept(np.array(worker.tree.found)):
                    self._over = True
        elif outcome == search.FULL or self.nodes > MOST_NODES:
            self._over = True
        return outcome != search.DONE and worker.boxes_left > 0

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
