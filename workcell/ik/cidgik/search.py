"""CIDGIK's search: convex iteration restarted from random objectives, workspace rows added where broken."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from workcell import clock
from workcell.ik.cidgik.instance import Instance
from workcell.ik.cidgik.proof import Proof, empty_with_all, proof_of, prove_empty
from workcell.ik.cidgik.rank import Blocks, Iterate, Kept, Relaxed, converge
from workcell.ik.cidgik.recover import joint_angles
from workcell.ik.cidgik.skeleton import Skeleton
from workcell.ik.cidgik.workspace.keeper import Keeper
from workcell.ik.result import NEAR_MISSES
from workcell.ik.shared.convex import MAX_POLISH, MOST_FAILURES
from workcell.ik.stages import StageLog
from workcell.pose import Array

ROUNDS = 8
"""Times that rows are added within one restart."""
PROGRAMS_A_SECOND = 300
"""Cone programs, with what goes on between them, that one quiet core does in a second."""
PROVE_AFTER = 3
"""Restarts after which, once, the relaxation is asked whether it is empty with every sphere that it breaks."""

COUNTS = ("sdps", "restarts", "low_rank", "rows")
"""Of the numbers about a search's work those that add up over several."""


@dataclass(frozen=True, slots=True)
class Finished:
    """A polished configuration: by how much polish moved a joint, and why it is no answer (None: it is one)."""

    q: Array
    moved: float
    refusal: str | None


class Finisher(Protocol):
    """Polishes and judges what the search reads from low-rank points."""

    def finish(self, q: Array) -> Finished:
        """A few steps onto the goals, then the verdict."""
        ...

    def descend(self, q: Array) -> Finished:
        """A local search from an iterate's angles (`+lm`)."""
        ...

    def prove(self, proof: Proof) -> bool:
        """Keep a proof if it holds; whether it does."""
        ...


@dataclass(slots=True)
class Search:
    """One run.

    Attributes:
        skeleton, instance, keeper, finisher: the robot's vectors, the relaxation, the workspace (None: nothing to
            keep), and the judge.
        whole: makes the relaxation in one block, and its workspace, in which proofs are given.
        deadline: `clock.cpu_seconds()` at which to stop.
        most: cone programs after which to stop.
        rng: of the objectives.
        near: (n,) a configuration to begin next to, or None.
        patience: cone programs after which to stop where solids are kept out of by other rules than their own.
        local: also descend from iterates that are not of low rank.
    """

    skeleton: Skeleton
    instance: Relaxed
    keeper: Kept | None
    finisher: Finisher
    whole: Callable[[], tuple[Instance, Keeper | None]]
    deadline: float
    most: float
    rng: np.random.Generator
    near: Array | None = None
    local: bool = False
    patience: float = np.inf
    anew: bool = True
    restarts: int = 0
    low_rank: int = 0
    rows: int = 0
    moved: float = 0.0
    last: Iterate = field(default_factory=lambda: Iterate(None))
    rejected: list[str] = field(default_factory=list)
    error: str | None = None
    stages: StageLog = field(default_factory=StageLog)

    @property
    def stats(self) -> dict[str, float]:
        """Numbers about the work done."""
        return {
            "sdps": float(self.instance.solves),
            "restarts": float(self.restarts),
            "low_rank": float(self.low_rank),
            "rows": float(self.rows),
            "left_out": 0.0 if self.keeper is None else float(self.keeper.left_out),
            "rank_gap": self.last.gap if np.isfinite(self.last.gap) else 0.0,
            "moved": self.moved,
        }

    def over(self) -> bool:
        """Whether the budget is spent."""
        return clock.cpu_seconds() >= self.deadline or self.instance.solves >= self.most

    def run(self) -> Array | None:
        """A configuration that the finisher accepts; None when there is none, or none was found in time."""
        failures, rays = 0, 0
        while not self.over() and failures < MOST_FAILURES:
            if self.keeper is not None:
                self.keeper.forget_passing()
            q = self._attempt(self._objective())
            if q is not None:
                return q
            if self._without_hope():
                return None
            if self.anew:
                continue
            empty = self.last.Z is None and not (self.keeper is not None and self.keeper.passing)
            if empty and self._prove(self.last):
                return None
            if self.instance.determined:
                return None
            failures, rays = (failures + 1, rays + (self.last.ray is not None)) if empty else (0, 0)
            if self.restarts == PROVE_AFTER and self._prove_with_all():
                return None
        if failures == MOST_FAILURES and not rays:
            self.error = "Clarabel found neither a point of the relaxation nor a proof that it is empty"
        return None

    def _without_hope(self) -> bool:
        """Whether spheres that cover solids leave nothing, or have been tried for long enough: that proves nothing."""
        if self.keeper is None:
            return False
        if self.keeper.conservative and self.last.Z is None:
            self.note("the spheres that cover the obstacles leave no configuration")
            given = self.keeper.give_way()
            if not given:
                return True
            self.stages.add(
                "rows", note=f"{given} dropped: spheres of the robot may stick out of it by as much"
            )
            self.anew = True
        doubtful = self.keeper.conservative or self.keeper.left_out > 0
        return doubtful and self.instance.solves >= self.patience

    def _objective(self) -> Blocks:
        """First toward the configuration to stay near, or the nuclear norm (C = I); then random."""
        if not self.anew:
            return self.instance.random_objective(self.rng)
        self.anew = False
        if self.near is None:
            return self.instance.nuclear()
        return self.instance.toward(self.near)

    def _attempt(self, C: Blocks) -> Array | None:
        """One restart: converge, add the rows that are broken, converge again; a configuration, if there is one."""
        self.restarts += 1
        for _ in range(ROUNDS):
            for step, iterate in enumerate(converge(self.instance, C)):
                self.last = iterate
                self._tell(step, iterate)
                if self.local and iterate.Z is not None and not iterate.low_rank:
                    q = self._accepted(self.finisher.descend(self._angles(iterate.Z)))
                    if q is not None:
                        return q
                if self.over():
                    break
            Z, next_objective = self.last.Z, self.last.C
            if Z is None or next_objective is None or not self.last.low_rank:
                return None
            added = self._add_broken(Z)
            if not added:
                self.low_rank += 1
                return self._accepted(self.finisher.finish(self._angles(Z)))
            C = next_objective
        return None

    def _add_broken(self, Z: Blocks) -> int:
        """Rows for what the points of Z break; how many."""
        if self.keeper is None:
            return 0
        known, added = self.keeper.left_out, self.keeper.add_broken(Z)
        if self.keeper.left_out > known:
            left = f"{self.keeper.left_out} pairs of sphere and obstacle overlap where the step begins"
            self.stages.add("rows", note=f"{left}: left to the judge")
        if added:
            self.rows += added
            self.stages.add("rows", note=f"{added} added for what points break")
        return added

    def _angles(self, Z: Blocks) -> Array:
        return joint_angles(self.skeleton, self.instance.directions(Z))

    def _tell(self, step: int, iterate: Iterate) -> None:
        """Log a solve of a convex iteration."""
        gap = None if iterate.Z is None else iterate.gap
        self.stages.add_point(step, gap, iterate.ray is not None, f"restart {self.restarts}")

    def _accepted(self, finished: Finished) -> Array | None:
        verdict = "accepted" if finished.refusal is None else finished.refusal
        moved = f"polish moved a joint by {finished.moved:.1e} rad: {verdict}"
        self.stages.add(
            "snap and judge" if self.last.low_rank else "local descent", gap=self.last.gap, note=moved
        )
        if finished.refusal is None and not self.local and finished.moved > MAX_POLISH:
            self.note(f"polish moved a joint by {finished.moved:.2g} rad from a low-rank point")
        elif finished.refusal is not None:
            self.note(finished.refusal)
        else:
            self.moved = finished.moved
            return finished.q
        return None

    def _prove(self, empty: Iterate) -> bool:
        """Whether the ray of an empty relaxation is a proof."""
        if empty.ray is None:
            return False
        if isinstance(self.instance, Instance) and (self.keeper is None or isinstance(self.keeper, Keeper)):
            proof = proof_of(self.instance, self.keeper, empty.ray)
        else:
            proof = prove_empty(*self.whole(), self.over)
        proved = proof is not None and self.finisher.prove(proof)
        self.stages.add("proof", note="the relaxation is empty" if proved else "too weak")
        if proved:
            return True
        self.note("the relaxation is empty, but not by the margin that the tolerances need")
        return False

    def _prove_with_all(self) -> bool:
        """Whether the relaxation is empty with every sphere that it breaks, and that can be proved."""
        if self.keeper is None or self.keeper.conservative:
            return False
        self.keeper.forget_passing()
        ray = empty_with_all(self.instance, self.keeper, self.over)
        return ray is not None and self._prove(Iterate(None, ray=ray))

    def note(self, reason: str) -> None:
        """Keep a reason for the report."""
        if reason not in self.rejected and len(self.rejected) < NEAR_MISSES:
            self.rejected.append(reason)
