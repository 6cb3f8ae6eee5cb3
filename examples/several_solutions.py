"""Ask for several solutions of one pose that differ: in the arm's posture first, then as far apart as they come.

Two configurations of different posture can't be joined without passing a singularity: some of them go around what
blocks the others.
"""

import numpy as np

from workcell import Budget, PlanningWorld, Pose, Scene, solutions

world = PlanningWorld.of(Scene.load("tracing", robot="ur10"))
problem = world.problem(Pose([0.55, 0.1, 0.55], [0.0, 1.0, 0.0, 0.0]))  # over the bench, pointing down

found = solutions(problem, 4, Budget(2.0), seed=0)
print(f"{len(found)} solutions, every one verified on the compiled model")
for result in found:
    angles = " ".join(f"{angle:7.1f}" for angle in np.rad2deg(result.q))
    print(f"  {angles} degrees, {1e3 * result.clearance.distance:5.1f} mm clear")
apart = [np.abs(a.q - b.q).max() for i, a in enumerate(found) for b in found[:i]]
print(f"the two most alike differ by {np.rad2deg(min(apart)):.0f} degrees in some joint")
