"""What recording costs: CPU time of the same run with and without it, and the size of the file."""

from __future__ import annotations

import tempfile
import time
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from workcell.bench.rows import Bench, Row
from workcell.bench.runs.tracking import motions
from workcell.ik.observing import report
from workcell.ik.problem import IKProblem
from workcell.ik.result import IKResult
from workcell.ik.solve import solve
from workcell.model.scene import Scene
from workcell.motion.path import Trajectory
from workcell.record.write.recording import Recording
from workcell.record.write.rrd import rerun
from workcell.simulate.simulation import Simulation
from workcell.world.planning_world import PlanningWorld

_SECONDS = 20.0
_QUERIES = 40
_NEAR = 1e-3
"""Radians by which the answers of a way may differ from the motion's configurations."""
_FILE = "run.rrd"


Answered = list[tuple[IKProblem, IKResult]]


def _way(world: PlanningWorld, motion: Trajectory) -> Answered:
    """Steps of IKSPARK to configurations of the motion, found among cuboids where it can: a recording follows them."""
    robot, before = world.robot.robot, np.array(motion.q[0])
    answered: Answered = []
    for q in motion.q[np.linspace(0, len(motion.q) - 1, _QUERIES).astype(int)]:
        problem = replace(world.problem(robot.fk(q)), q_reference=q, max_step=_NEAR)
        result = solve(problem, solver="ikspark")
        if result.q is not None:
            answered.append((replace(problem, q_reference=before), result))
            before = np.array(result.q)
    return answered


def _execute(
    world: PlanningWorld, motion: Trajectory, answered: Answered, recording: Recording | None
) -> None:
    """Twenty simulated seconds of one motion, there and back again, along a way that was asked for."""
    if recording is not None:
        recording.log_scene(world.scene)
        recording.log_cover(world.robot, world.cover)
        recording.log_free_space(world.free_space)
        with recording.queries("the way"):
            for problem, result in answered:
                report(problem, result)
    simulation = Simulation(world.scene, on_chunk=None if recording is None else recording.log_execution)
    while simulation.time < _SECONDS:
        simulation.execute(motion)


def _ask(world: PlanningWorld, motion: Trajectory, recording: Recording | None) -> None:
    """Queries of IKSPARK along the motion, each with all of its stages."""
    robot = world.robot.robot
    with nullcontext() if recording is None else recording.queries("poses on the way"):
        for seed, q in enumerate(motion.q[np.linspace(0, len(motion.q) - 1, _QUERIES).astype(int)]):
            solve(world.problem(robot.fk(q)), solver="ikspark", seed=seed)


def recording_cost(n: int, seed: int, sets: Path | None) -> list[Row]:
    """`n` pairs of runs in turns, without a recording and with one; medians of each."""
    scene = Scene.load("shelf_grasp")
    world = PlanningWorld.of(scene, overshoot=0.03, seed=seed)
    motion = next(motions(scene, 1, seed))
    rerun()  # its import is no part of what is measured, as little as compiling is
    rows: list[Row] = []
    execute = partial(_execute, world, motion, _way(world, motion))
    ask = partial(_ask, world, motion)
    for name, work in (("20 s of motion", execute), (f"{_QUERIES} queries of ikspark", ask)):
        work(None)
        plain, recorded, sizes = [], [], []
        for _ in range(n):
            begun = time.process_time()
            work(None)
            plain.append(time.process_time() - begun)
            with tempfile.TemporaryDirectory() as folder:
                begun = time.process_time()
                with Recording(Path(folder) / _FILE, task="cost") as recording:
                    work(recording)
                recorded.append(time.process_time() - begun)
                sizes.append((Path(folder) / _FILE).stat().st_size / 1e6)
        ratio = float(np.median(recorded) / np.median(plain))
        rows.append(
            {
                "row": f"sawyer/{name}",
                "n": n,
                "cpu_s_without": float(np.median(plain)),
                "cpu_s_with": float(np.median(recorded)),
                "overhead": ratio - 1.0,
                "recording_mb": float(max(sizes)),
                "success": float(ratio <= 1.2 and max(sizes) <= 5.0),
                "paper": None,
            }
        )
    return rows


BENCHES = [Bench("recording", 3, "what recording a run costs: CPU time and size of the file", recording_cost)]
