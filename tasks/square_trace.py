"""A stylus draws a square in the air above a bench.

The stylus stays normal to the square's plane; how far it is turned about its own axis is free. One continuous motion
leads round all four sides, and is timed side by side: the arm comes to rest in each corner, so that none is cut.
"""

import numpy as np

from workcell import FREE, FollowLimits, Job, PathTolerance, PlanningWorld, Pose, distance_to_path, polyline

# Between waypoints: radians of a joint, and of a link what 0.2 rad turn it (Frobenius norm); metres to keep everywhere.
LIMITS = FollowLimits(max_step=0.2, max_link_rotation=0.28, deviation_m=2e-4, clearance=0.002)
NORMAL = PathTolerance(rotation=(0.0, 0.0, FREE))  # about the stylus's own axis


def run(job: Job) -> None:
    """Plan the square, go there, draw it side by side, hold."""
    scene, task = job.scene, job.scene.task
    arm, speed = scene.robot(), task["max_tool_speed"]
    frame, half = drawing(job)
    corners = [
        frame @ Pose.from_xyz([x * half, y * half, 0.0]) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    corners.append(corners[0])
    with job.phase("planning"):
        world = PlanningWorld.of(scene, seed=job.seed)
        job.log_world(world)
        outline = job.trace(world, polyline(corners, task["spacing"]), LIMITS, "square", tolerance=NORMAL)
        there = job.move(world, arm.start, outline.start, "way to the square")
        job.log_plan(there + outline)
        approach = job.retime(world, there, 2 * speed, "motion to the square")
        sides = outline.split([corner.position for corner in corners[1:-1]])
        drawn = [job.retime(world, side, speed, f"motion along side {k + 1}") for k, side in enumerate(sides)]

    with job.phase("execution"):
        simulation = job.simulation()
        simulation.execute(approach, "going to the square")
        begin = simulation.time
        for k, motion in enumerate(drawn):
            simulation.execute(motion, f"drawing side {k + 1}")
        end = simulation.time
        simulation.hold(task["hold_s"])
        points = job.tool_trace(simulation, begin, end)
        off = distance_to_path(points, corners)
        missed = max(np.linalg.norm(points - corner.position, axis=1).min() for corner in corners)
        job.summary.update(
            side_m=2 * half, max_deviation_m=float(off.max()), corners_missed_by_m=float(missed)
        )
        job.judge(
            simulation,
            {
                "the trace is at most 0.5 mm off the square": bool(off.max() <= 5e-4),
                "every corner is reached to 0.5 mm": bool(missed <= 5e-4),
            },
        )


def drawing(job: Job) -> tuple[Pose, float]:
    """The square's frame, z into the bench, and half its side, for this seed."""
    task, rng = job.scene.task, np.random.default_rng(job.seed)
    centre = np.array(task["centre"]) + rng.uniform(-1, 1, 3) * task["centre_spread"]
    half, tilt, turn = (
        0.5 * rng.uniform(*task["side"]),
        rng.uniform(0, task["tilt"]),
        rng.uniform(0, 2 * np.pi),
    )
    down = Pose([0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0])
    tilted = Pose([0.0, 0.0, 0.0], [np.cos(tilt / 2), np.sin(tilt / 2), 0.0, 0.0])
    turned = Pose(centre, [np.cos(turn / 2), 0.0, 0.0, np.sin(turn / 2)])
    job.say(f"square of {2e3 * half:.0f} mm, tilted by {np.rad2deg(tilt):.0f} degrees")
    return turned @ tilted @ down, half
