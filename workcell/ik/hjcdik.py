"""HJCD-IK: seeds, greedy coordinate descent, damped Newton polish (arXiv: see PAPERS), with collisions inside.

The paper samples and polishes for kinematics alone. Here a pose in collision slides clear under a hinge on penetration;
an arm with one joint to spare walks around its self-motion curve. Kernels are compiled, on the first call.
"""

from __future__ import annotations

import time

import numpy as np

from workcell.ik.packing import narrowed_arm, pack_arm, pack_world
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.result import Candidate
from workcell.model.robot import Robot
from workcell.pose import Array

ACCURACY = 1e-8
"""Metres of residual (a radian weighs 0.3 m) at which a pose counts as reached inside the solver."""
CHUNK = 50
"""Restarts between looks at the clock."""


def solve_hjcd(problem: IKProblem, budget: Budget, seed: int = 0) -> Candidate:
    """Look for a configuration."""
    from workcell.ik.kernels import search as kernels
    deadline = time.process_time() + budget.cpu_s
    arm = narrowed_arm(problem)
    world = pack_world(problem)
    n = problem.robot.dof
    pose = np.concatenate([problem.target.position, problem.target.quat_wxyz])
    if world is None:
        from workcell.ik.kernels import free
        q = np.empty((1, n)); cost = np.empty(1)
        free.solve_targets(arm, pose[None], np.empty((0, n)), ACCURACY, 1000, np.array([seed], np.uint64), q, cost)
        return Candidate(q=q[0])
    memory = new_memory(n, seed)
    out = np.empty(n)
    first = np.empty((0, n))
    while True:
        status = kernels.search(arm, world, pose, first, ACCURACY, CHUNK, memory, out)
        if status == kernels.FOUND:
            return Candidate(q=out, stats={"restarts": memory.counts[0], "poses": memory.counts[1], "slides":memory.counts[2],"curves": memory.counts[3]})
        if status == kernels.EXHAUSTED or time.process_time() > deadline:
            return Candidate(stats={"restarts": memory.counts[0], "poses": memory.counts[1], "slides":memory.counts[2],"curves": memory.counts[3], "exhausted": float(status == -1)})


def new_memory(n: int, seed: int):
    from workcell.ik.kernels.search import MISSES, Memory
    from workcell.ik.kernels.trace import MEMORY

    counts = np.zeros(8)
    counts[5] = -1.0
    misses = np.full((MISSES, n + 3), -1e3)
    return Memory(np.array([seed], np.uint64), counts, np.empty((MEMORY, 2 * n + 1)), np.zeros(1), np.zeros(n), misses)
