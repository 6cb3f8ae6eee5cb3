"""A stylus draws a circle in the air above a bench.

The stylus stays normal to the circle's plane; how far it is turned about its own axis is free. From which configuration
the arm can go all the way round is a choice made before it moves.
"""

import numpy as np

from workcell import FREE, FollowLimits, Job, PathTolerance, PlanningWorld, Pose, circle

# Between waypoints: radians of a joint, and of a link what 0.2 rad turn it (Frobenius norm); metres to keep everywhere.
LIMITS = FollowLimits(max_step=0.2, max_link_rotation=0.28, deviation_m=2e-4, clearance=0.002)
NORMAL = PathTolerance(rotation=(0.0, 0.0, FREE))  # about the stylus's own axis


def run(job: Job) -> None:
    """Plan the circle, go there, draw it, hold."""
    scene, task = job.scene, job.scene.task
    arm, speed = scene.robot(), task["max_tool_speed"]
    start, centre, normal, radius = drawing(job)
    with job.phase("planning"):
        world = PlanningWorld.of(scene, seed=job.seed)
        job.log_world(world)
        poses = circle(start, centre, normal, task["spacing"])
        ring = job.trace(world, poses, LIMITS, "circle", tolerance=NORMAL)
        there = job.move(world, arm.start, ring.start, "way to the circle")
        job.log_plan(there + ring)
        approach = job.retime(world, there, 2 * speed, "motion to the circle")
        drawn = job.retime(world, ring, speed, "motion along the circle")

    with job.phase("execution"):
        simulation = job.simulation()
        simulation.execute(approach, "going to the circle")
        begin = simulation.time
        simulation.execute(drawn, "drawing the circle")
        end = simulation.time
        simulation.hold(task["hold_s"])
        points = job.tool_trace(simulation, begin, end) - centre
        height = points @ normal
        flat = points - height[:, None] * normal
        off = np.hypot(np.linalg.norm(flat, axis=1) - radius, height)
        across = np.cross(normal, start.position - centre) / radius
        angles = np.unwrap(np.arctan2(flat @ across, flat @ (start.position - centre) / radius))
        job.summary.update(
            radius_m=radius, max_deviation_m=float(off.max()), turned_rad=float(np.ptp(angles))
        )
        job.judge(
            simulation,
            {
                "the trace is at most 0.5 mm off the circle": bool(off.max() <= 5e-4),
                "the circle is closed": bool(np.ptp(angles) > 2 * np.pi - 0.01),
            },
        )


def drawing(job: Job) -> tuple[Pose, np.ndarray, np.ndarray, float]:
    """The first pose, the centre, the normal (away from the bench) and the radius of this seed's circle."""
    task, rng = job.scene.task, np.random.default_rng(job.seed)
    centre = np.array(task["centre"]) + rng.uniform(-1, 1, 3) * task["centre_spread"]
    radius, tilt = float(rng.uniform(*task["radius"])), float(rng.uniform(0, task["tilt"]))
    towards = rng.uniform(0, 2 * np.pi)
    normal = np.array([np.sin(tilt) * np.cos(towards), np.sin(tilt) * np.sin(towards), np.cos(tilt)])
    first = np.cross(normal, [0.0, 1.0, 0.0])  # towards the robot, along the plane
    first /= np.linalg.norm(first)
    stylus = np.column_stack([first, np.cross(first, normal), -normal])
    job.say(f"circle of radius {1e3 * radius:.0f} mm, tilted by {np.rad2deg(tilt):.0f} degrees")
    return Pose.from_rotation(centre + radius * first, stylus), centre, normal, radius
