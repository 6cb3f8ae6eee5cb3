"""Follow a tool path: from which configuration the arm can go all the way round is chosen before it moves.

The stylus stays normal to the circle; how far it is turned about its own axis is free. What comes back is continuous,
and proved clear between its waypoints too.
"""

import numpy as np

from workcell import FREE, FollowLimits, PathTolerance, PlanningWorld, Pose, Scene, circle, route

scene = Scene.load("circle_trace")  # a Sawyer with a stylus, a bench, a lamp
world = PlanningWorld.of(scene)
centre, radius = np.array([0.6, 0.0, 0.35]), 0.1  # metres
down = [0.0, 1.0, 0.0, 0.0]  # w, x, y, z
poses = circle(Pose(centre + radius * np.array([1.0, 0.0, 0.0]), down), centre, [0.0, 0.0, 1.0], spacing=0.02)

about_itself = PathTolerance(rotation=(0.0, 0.0, FREE))
limits = FollowLimits(max_step=0.2, clearance=0.002)  # radians between waypoints, metres to keep everywhere
result = route(world.problem(poses[0]), poses, tolerance=about_itself, limits=limits, seed=0)
print(f"{result.status.value}: {result.status.sentence}")
print(
    f"{len(poses)} poses, {result.metrics.waypoints} waypoints, largest step {result.metrics.largest_step:.3f} rad"
)
print(f"at most {1e3 * result.metrics.deviation_m:.2f} mm off half-way between waypoints")
print(f"proved {1e3 * result.metrics.clearance_between:.1f} mm clear all along")

points = np.stack([world.tool_pose(q).position for q in result.path.configurations]) - centre
print(f"radius {1e3 * np.linalg.norm(points[:, :2], axis=1).mean():.2f} mm, as the compiled model has it")
