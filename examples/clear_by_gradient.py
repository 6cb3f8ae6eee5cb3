"""Measure how far an arm is from everything, with gradients, and let it back away from what is nearest.

The arm is covered with spheres, each obstacle of the cell is a few convex pieces; the engine packs both once and
answers in compiled code: microseconds for a whole arm.
"""

import numpy as np

from workcell import ClearanceEngine, PlanningWorld, Scene, self_collision_pairs

world = PlanningWorld.of(Scene.load("shelf", robot="iiwa14"))
robot, cover = world.robot.robot, world.cover
pairs = self_collision_pairs(robot, cover, known_free=world.robot.start)
engine = ClearanceEngine(robot, cover, world.obstacles, pairs)
print(f"{len(cover)} spheres, {len(world.obstacles)} obstacle pieces, {len(engine.pairs)} pairs of spheres")

drawn = robot.random_configuration(np.random.default_rng(0), 2000)  # (2000, 7) radians
clearances = engine.clearances(drawn)  # (2000,) metres; negative inside of something
print(f"{np.mean(clearances > 0):.0%} of {len(drawn)} random configurations are clear")

q = drawn[np.argmin(np.abs(clearances + 0.03))]  # about 3 cm deep in something
gap, gradient = engine.clearance_and_gradient(q)
print(
    f"one is {1e3 * gap:.1f} mm clear; a radian in the best direction gains {np.linalg.norm(gradient):.2f} m"
)
step = 0.2  # radians, of all joints together
while step > 1e-3:
    nearer = np.clip(q + step * gradient / np.linalg.norm(gradient), robot.lower, robot.upper)
    if engine.clearance(nearer) > gap:
        q = nearer
        gap, gradient = engine.clearance_and_gradient(q)
    else:
        step /= 2
print(f"up the gradient it ends {1e3 * gap:.1f} mm clear")
