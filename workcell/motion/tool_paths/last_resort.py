"""Where no route of the graph can be followed: a proof that a pose is impossible, or all that can be reached.

A proof comes first, since it ends the search. Then all that continuous motions reach is looked through
(`workcell.motion.tool_paths.layers`), and what can be followed of it is; at last the convex solver is asked where the
graph ended.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from workcell.motion.proofs.on_model import prove_segment
from workcell.motion.tool_paths.diagnosis import PROVED, Coroner
from workcell.motion.tool_paths.graph import DeadEnd, Routes
from workcell.motion.tool_paths.layers import Sheet
from workcell.motion.tool_paths.query import RouteQuery
from workcell.motion.tool_paths.result import FollowResult, not_begun
from workcell.motion.tool_paths.self_motion import APART
from workcell.motion.tool_paths.starts import all_turns
from workcell.motion.tool_paths.steps import LocalSolver
from workcell.pose import Array

MANY = 48
"""Configurations of the first pose from which everything that can be reached is looked through."""


@dataclass(slots=True)
class LastResort:
    """The rest of one query."""

    query: RouteQuery
    local: LocalSolver
    starts: list[Array]
    free_start: bool
    coroner: Coroner = field(init=False)

    def __post_init__(self) -> None:
        query = self.query
        self.coroner = Coroner(
            query.problem, query.poses, query.tolerance, query.limits.max_step, query.solver, query.seed
        )

    def run(self, found: Routes, best: FollowResult | None) -> FollowResult:
        """The result, from what the graph found, and the furthest that one of its routes could be followed."""
        query, end, in_model = self.query, found.furthest, None
        if end is not None and not found.complete:
            in_model = self.coroner.impossible([end.waypoint], end.motion[-1])
            if in_model is not None and in_model.status in PROVED:
                return _with_path(in_model, self._partly(end))
        sheet = self._sheet()
        motion, may_begin = self._cheapest(sheet)
        in_part = best
        if motion is not None:
            in_part = query.follow(self.local, *sheet.without_waits(motion))
            if sheet.complete and (in_part.followed or best is None):
                best = in_part
        if best is not None and (best.followed or sheet.complete):
            return best
        if not may_begin:
            return not_begun(query.poses[0])
        if end is not None:
            rescued = query.follow(self.local, end.motion, halvings=1)
            if rescued.followed:
                return rescued
            in_part = in_part or rescued
        return _with_path(self._failure(sheet, best, in_model), in_part)

    def _partly(self, end: DeadEnd) -> FollowResult | None:
        """As far as a start led, followed in full; None where that is nowhere."""
        poses = self.query.poses[: end.waypoint]
        return self.query.follow(self.local, end.motion, poses) if len(poses) > 1 else None

    def _sheet(self) -> Sheet:
        """Everything that continuous motions reach from the starts, or any; the tool waits only where it has to."""
        query, free = self.query, self.free_start
        starts = self.starts
        if free:
            starts = all_turns(query.template.robot, [*starts, *query.sampled(0, MANY)])
        floor = query.problem.tolerances.safety_margin
        for patient in (False, True):
            sheet = Sheet(self.local.tracker, query.poses, query.clearance, floor, patient)
            sheet.grow(np.stack(starts), spread=free)
            if sheet.complete:
                break
        return sheet

    def _cheapest(self, sheet: Sheet) -> tuple[Array | None, bool]:
        """The cheapest motion (k, n) as far as the sheet goes, every edge proved; whether one may begin at all."""
        if len(sheet.layers) < 2:
            return None, True
        begins = self.query.begins if sheet.complete else None
        motion = sheet.cheapest(self._is_proved, begins, self.query.way_to(sheet.layers[0].q))
        may_begin = motion is not None or begins is None or sheet.cheapest(self._is_proved) is None
        return motion, may_begin

    def _is_proved(self, q_a: Array, q_b: Array) -> bool:
        """Whether the straight motion between two configurations keeps its clearance."""
        template, floor = self.query.template, self.query.limits.clearance
        extent = self.query.extent or template.cover
        if template.checker is None or extent is None:
            return True
        return prove_segment(template.robot, q_a, q_b, template.checker, extent, floor=floor).proved

    def _failure(
        self, sheet: Sheet, followed: FollowResult | None, in_model: FollowResult | None
    ) -> FollowResult:
        """The pose that nothing gets to, or one further on that is proved impossible, and why."""
        last = len(self.query.poses) - 1
        row, q_before = min(sheet.reached, last), sheet.layers[-1].q[0]
        why = sheet.why() if not sheet.complete else "what the sphere model reaches could not be proved clear"
        if followed is not None and followed.failure is not None and followed.failure.waypoint > row:
            row, why = followed.failure.waypoint, followed.failure.detail
            q_before = q_before if followed.path is None else followed.path.end
        words = (
            f"{why}. No continuous motion was found among {sheet.nodes} configurations at {len(sheet.layers)} poses, "
            f"self-motions looked through every {APART:g} rad"
        )
        proved = self.coroner.impossible(range(row, last + 1), q_before)
        if proved is not None and proved.status in PROVED:
            return proved
        if in_model is None and proved is None:
            return self.coroner.at(row, q_before, words)
        return _explained(in_model or proved, f"In the real geometry: {words}.")


def _explained(result: FollowResult | None, words: str) -> FollowResult:
    """A failure with more words to it."""
    assert result is not None and result.failure is not None
    return replace(result, failure=replace(result.failure, detail=f"{result.failure.detail} {words}"))


def _with_path(failure: FollowResult, followed: FollowResult | None) -> FollowResult:
    """The failure with the motion that could be followed before it."""
    if followed is None:
        return failure
    return replace(
        failure,
        path=followed.path,
        metrics=followed.metrics,
        solved=failure.solved + followed.solved,
        answered=followed.answered,
    )
