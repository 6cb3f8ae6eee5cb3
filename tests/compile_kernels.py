"""Compiles the kernels that most tests call, one share of them a process, so that no test pays for it twice.

python -m tests.compile_kernels branch | sampling | live
"""

from __future__ import annotations

import sys


def branch() -> None:
    """The solver and the checker of branch and bound."""
    from workcell.ik.branch.solver import prepare_kernels

    prepare_kernels()


def sampling() -> None:
    """Clearances, sampling with and without obstacles, tracking and planning."""
    from tests.ik.arms import beads, box, planar
    from workcell.geometry.engine import ClearanceEngine
    from workcell.ik.elementary import screen
    from workcell.ik.hjcd.solver import prepare
    from workcell.ik.problem import IKProblem
    from workcell.motion.plans import optimise
    from workcell.motion.tool_paths import tracker

    arm = planar()
    target, wall = arm.fk(arm.home), box("wall", (2.0, 0.0, 0.0), (0.1, 0.1, 0.1))
    screen.prepare()
    prepare(IKProblem(arm, target, (wall,), beads(arm)))
    prepare(IKProblem(arm, target))
    ClearanceEngine(arm, beads(arm), (wall,)).clearance_and_gradient(arm.home)
    tracker.prepare_kernels()
    optimise.prepare_optimising()


def live() -> None:
    """Frames of live inverse kinematics."""
    from workcell.motion.live.live_ik import LiveIK
    from workcell.world.planning_world import PlanningWorld

    live = LiveIK(PlanningWorld.of("ur5"))
    live.step(live.robot.fk(live.q))


if __name__ == "__main__":
    {"branch": branch, "sampling": sampling, "live": live}[sys.argv[1]]()
