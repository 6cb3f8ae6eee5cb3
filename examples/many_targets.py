"""Solve many targets at once, kinematics alone: tens of thousands a second."""

import time

import numpy as np

from workcell import load_robot, solve_batch

robot = load_robot("iiwa14")
rng = np.random.default_rng(0)
targets = [robot.fk(q) for q in robot.random_configuration(rng, 2000)]  # all within reach

solve_batch(robot, targets[:1])  # the first call loads the kernels, or compiles them
began = time.perf_counter()
answer = solve_batch(robot, targets, seed=0, threads=2)
spent = time.perf_counter() - began
print(
    f"{np.mean(answer.residual < 1e-6):.1%} of {len(targets)} targets solved to a micrometre in {spent:.2f} s"
)
print(f"{answer.restarts} seeds were polished; the worst residual is {1e6 * answer.residual.max():.4f} um")
print(f"all within the joint limits: {bool(robot.within_limits(answer.q).all())}")
