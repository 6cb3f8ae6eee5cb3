"""A stylus follows a target around two posts while a ball swings through; nobody knows ahead where either goes.

Live inverse kinematics is asked at every tick: its guards keep the arm within its limits and clear of posts and ball,
whatever the target does.
"""

from collections.abc import Callable

import numpy as np

from workcell import Job, LiveIK, PlanningWorld, Pose

Motion = Callable[[float], Pose]


def run(job: Job) -> None:
    """Lead the target away from the tool, around the posts, and to rest."""
    scene, task = job.scene, job.scene.task
    with job.phase("preparation"):
        live = LiveIK(PlanningWorld.of(scene, seed=job.seed), moving=["ball"], margin=task["margin"])

    with job.phase("execution"):
        simulation = job.simulation()
        target, seconds = winding(job, simulation.tool_pose())
        simulation.drive("ball", swinging(job, seconds))
        job.follow_goals(simulation, live, target, seconds, "following the target")
        mean = np.nanmean(np.concatenate([part.position_error for part in simulation.result().live]))
        off, turned = simulation.tool_pose().error_to(target(seconds))
        job.summary |= {"off_at_rest_m": off, "off_at_rest_rad": turned}
        job.judge(
            simulation,
            {
                "the target is followed": bool(mean <= task["mean_error_m"]),
                "the tool is on the target where it rests": off <= task["reached_m"],
            },
        )


def winding(job: Job, begin: Pose) -> tuple[Motion, float]:
    """Where the target is at each second, and for how many: from the tool to a figure of eight, once around it."""
    task, rng = job.scene.task, np.random.default_rng(job.seed)
    along, across, period = (float(rng.uniform(*task[key])) for key in ("along", "across", "period_s"))
    centre = np.add(task["centre"], [0.0, 0.0, rng.uniform(-1, 1) * task["height_spread"]])
    side, lead = rng.choice([-1.0, 1.0]), task["lead_s"]
    facing = np.arctan2(begin.rotation[1, 0], begin.rotation[0, 0])  # as the tool begins, but pointing down
    job.say(f"a figure of eight, {200 * across:.0f} by {200 * along:.0f} cm, once around in {period:.1f} s")

    def figure(t: float) -> Pose:
        s = 2 * np.pi * min(t / period, 1.0)
        offset = [along * np.sin(2 * s), side * across * np.sin(s), task["rise"] * np.sin(3 * s)]
        yaw = facing + task["turn"] * np.sin(s)
        c, d = np.cos(yaw), np.sin(yaw)
        return Pose.from_rotation(centre + offset, np.array([[c, d, 0], [d, -c, 0], [0, 0, -1]]))

    def target(t: float) -> Pose:
        share = min(t / lead, 1.0)
        return figure(t - lead) if t > lead else begin.interpolate(figure(0), share**2 * (3 - 2 * share))

    return target, lead + period + task["rest_s"]


def swinging(job: Job, seconds: float) -> Motion:
    """Where the ball is at each second: across the bench, and back when the target rests."""
    task, rng = job.scene.task, np.random.default_rng([job.seed, 1])
    x, z = (float(rng.uniform(*task[key])) for key in ("ball_x", "ball_z"))
    far = rng.choice([-1.0, 1.0]) * task["ball_swing"]
    return lambda t: Pose.from_xyz([x, far * np.cos(2 * np.pi * t / seconds), z])
