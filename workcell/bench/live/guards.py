"""What the live guards let happen: contacts, limits and frames without an answer, among things that move.

Cells are random (`crowds`), movers leave arms a way out (`yielding`), and whoever judges has the joint values alone:
contacts are MuJoCo's own, limits those of differences of joint values.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from workcell.bench.live.arms import Arms
from workcell.bench.live.contacts import Contacts
from workcell.bench.live.crowds import Crowd, crowd
from workcell.bench.live.touching import Touching
from workcell.bench.live.traces import PERIOD, Setup
from workcell.bench.live.yielding import NEAR, Yielding
from workcell.bench.rows import Bench, Row
from workcell.pose import Array
from workcell.world.planning_world import PlanningWorld

if TYPE_CHECKING:
    from workcell.motion.live.limits import LiveLimits

_NAMED = 3
"""Pairs of geoms that a row names."""
FRAMES = 1500
"""Of a cell: half a minute."""
_SLACK = 1.0 + 1e-6
"""By which a difference may exceed a limit: its rounding."""
CELLS = (
    (Setup("sawyer", (0.7, 0.0, 0.3), (0.7, 0.0, 0.3), 0.3), 1),
    (Setup("ur5", (0.6, 0.0, 0.2), (0.6, 0.0, 0.2), 0.3), 1),
    (Setup("iiwa14", (0.6, 0.0, 0.4), (0.6, 0.0, 0.4), 0.3), 1),
    (Setup("iiwa7", (0.6, 0.0, 0.3), (0.6, 0.0, 0.3), 0.3, apart=0.9), 2),
    (Setup("jaco", (0.5, 0.0, 0.3), (0.5, 0.0, 0.3), 0.3), 1),
)
"""Arms, and how many of them, that take turns."""


@dataclass(slots=True)
class Tally:
    """What happened in frames of cells.

    Attributes:
        frames, cells: how many there were.
        contacts: frames in which an arm touched something, itself or another arm.
        pairs: of geoms that touched, and in how many frames; a row names the most frequent.
        no_way: frames for which the mover could not show a way out; contacts_no_way: contacts up to a second later.
        over: frames in which a joint was outside of its limit of position, velocity, acceleration, jerk.
        worst: largest share of a limit of velocity, acceleration, jerk.
        unanswered: frames without a finite answer.
        seconds: CPU time of each frame; errors: metres from the goal, the largest of the arms'.
    """

    frames: int = 0
    cells: int = 0
    contacts: int = 0
    pairs: dict[str, int] = field(default_factory=dict)
    no_way: int = 0
    contacts_no_way: int = 0
    over: Array = field(default_factory=lambda: np.zeros(4, dtype=int))
    worst: Array = field(default_factory=lambda: np.zeros(3))
    unanswered: int = 0
    seconds: list[float] = field(default_factory=list)
    errors: list[float] = field(default_factory=list)

    def row(self, name: str) -> Row:
        """A row of the table."""
        seconds = np.array(self.seconds)
        often = sorted(self.pairs.items(), key=lambda item: -item[1])
        return {
            "row": name,
            "n": self.frames,
            "cells": self.cells,
            "contacts": self.contacts,
            "contacts_without_a_way_out": self.contacts_no_way,
            "frames_without_a_way_out": self.no_way,
            "position_violations": int(self.over[0]),
            "velocity_violations": int(self.over[1]),
            "acceleration_violations": int(self.over[2]),
            "jerk_violations": int(self.over[3]),
            "velocity_share_max": float(self.worst[0]),
            "acceleration_share_max": float(self.worst[1]),
            "jerk_share_max": float(self.worst[2]),
            "unanswered": self.unanswered,
            "goal_error_m_median": float(np.median(self.errors)),
            "frame_ms_mean": 1e3 * float(seconds.mean()),
            "frame_ms_p99.9": 1e3 * float(np.quantile(seconds, 0.999)),
            "frame_ms_max": 1e3 * float(seconds.max()),
            "touched": ", ".join(f"{pair} ({count})" for pair, count in often[:_NAMED]),
        }

    def add(self, other: Tally) -> None:
        """Another tally's figures with these."""
        for name in ("frames", "cells", "contacts", "no_way", "contacts_no_way", "unanswered"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        for pair, count in other.pairs.items():
            self.pairs[pair] = self.pairs.get(pair, 0) + count
        self.over = self.over + other.over
        self.worst = np.maximum(self.worst, other.worst)
        self.seconds += other.seconds
        self.errors += other.errors


def live_guards(n: int, seed: int, sets: Path | None) -> list[Row]:
    """n frames in cells of half a minute, in turns of the arms; the first row is of all."""
    run_cell(crowd(*CELLS[0], 50, seed), seed)  # loads what is loaded lazily, unmeasured
    rows: dict[str, Tally] = {}
    done, k = 0, 0
    while done < n:
        setup, count = CELLS[k % len(CELLS)]
        frames = min(FRAMES, n - done)
        name = setup.robot if count == 1 else f"{count} x {setup.robot}"
        rows.setdefault(name, Tally()).add(run_cell(crowd(setup, count, frames, seed + k), seed + k))
        done, k = done + frames, k + 1
    total = Tally()
    for tally in rows.values():
        total.add(tally)
    return [total.row("all"), *(tally.row(name) for name, tally in rows.items())]


def run_cell(cell: Crowd, seed: int) -> Tally:
    """One cell, from its start on until its goals end."""
    from workcell.motion.live.live_ik import LiveIK

    names, rng = cell.arms.names, np.random.default_rng([seed, 7])
    worlds = [PlanningWorld.of(cell.scene, name) for name in names]
    moving = [name for mover in cell.movers for name in mover.bodies()]
    live = LiveIK(worlds, period=PERIOD, moving=moving)
    touching, frames = Touching(cell.scene, names), len(cell.goals[0])
    contacts = Contacts(cell.scene, names, own=False, limit=NEAR)
    # movers are moved: the cell keeps its own where they begin
    ghosts = [mover.ghost() for mover in cell.movers]
    yielding = Yielding(contacts, ghosts, cell.aims, live.limits.acceleration, live.limits.jerk, rng)
    way = np.empty((frames + 4, cell.arms.dof))
    way[:4] = cell.start()
    tally, cornered = Tally(frames, 1), -10_000
    for k in range(frames):
        places, twists = yielding.places(), yielding.twists()
        begun = time.process_time()
        for name, pose in places.items():
            live.place(name, pose, *twists[name])
        step = live.step({name: goals[k] for name, goals in zip(names, cell.goals, strict=True)})
        tally.seconds.append(time.process_time() - begun)
        tally.errors.append(float(step.position_error.max()))
        answered = bool(np.all(np.isfinite(step.q)))
        tally.unanswered += not answered
        way[k + 4] = step.q if answered else way[k + 3]
        if not yielding.advance(way[k : k + 4]):
            tally.no_way, cornered = tally.no_way + 1, k
        touching.place(yielding.places())
        met = touching.pairs(way[k + 4])
        tally.contacts += bool(met)
        tally.contacts_no_way += bool(met) and k - cornered < 50
        for a, b in met:
            tally.pairs[f"{a} and {b}"] = tally.pairs.get(f"{a} and {b}", 0) + 1
    tally.over, tally.worst = violations(way[3:], cell.arms, live.limits)
    return tally


def violations(q: Array, arms: Arms, limits: LiveLimits) -> tuple[Array, Array]:
    """(4,) frames of q (k + 1, n) outside of limits of position, velocity, acceleration and jerk, by differences.

    And (3,) the largest shares of the last three. The arms stood still before the first configuration.
    """
    before = np.concatenate([np.repeat(q[:1], 2, axis=0), q])
    lower = np.concatenate([robot.lower for robot in arms.robots])
    upper = np.concatenate([robot.upper for robot in arms.robots])
    outside = np.any((q[1:] < lower) | (q[1:] > upper), axis=1)
    over, worst = [np.count_nonzero(outside)], []
    for order, limit in ((1, limits.velocity), (2, limits.acceleration), (3, limits.jerk)):
        shares = np.abs(np.diff(before, order, axis=0)[-(len(q) - 1) :]) / (limit * PERIOD**order)
        over.append(np.count_nonzero(np.any(shares > _SLACK, axis=1)))
        worst.append(float(shares.max()))
    return np.array(over), np.array(worst)


BENCHES = [
    Bench(
        "live-guards",
        100_000,
        "contacts, limits and answers of live IK, n frames in cells where things move",
        live_guards,
    )
]
