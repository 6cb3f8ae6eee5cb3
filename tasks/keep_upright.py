"""A Sawyer carries a full cup around a pillar, and the cup stays upright all the way.

The hand may turn about the vertical as it likes, the cup is round: which way it points, from the grasp to the place
where the cup is put down, is part of the choice of one motion that leads all the way around.
"""

import numpy as np

from workcell import FREE, FollowLimits, Job, PathTolerance, PlanningWorld, Pose, carried, line, through

LIMITS = FollowLimits(max_step=0.2, deviation_m=1e-3, clearance=0.003)
UPRIGHT = PathTolerance(
    rotation=(0.0, 0.0, FREE), frame="world"
)  # free to turn about the vertical, and no other way


def run(job: Job) -> None:
    """Grasp the cup, lift it, carry it around, put it down, let go."""
    scene, task = job.scene, job.scene.task
    arm, cup, speed, gentle = scene.robot(), task["object"], task["max_tool_speed"], task["max_acceleration"]
    grasp, stands = scene.goal("grasp").pose, scene.object_pose(cup)
    spread = np.random.default_rng(job.seed).uniform(-1, 1, 2) * task["target_spread"]
    target = scene.site_pose(task["target"]).position + np.append(spread, 0.0)
    shift, up = Pose.from_xyz(target - stands.position), Pose.from_xyz([0.0, 0.0, task["lift"]])
    pillar = scene.site_pose(task["pillar"]).position
    beside = Pose.from_xyz(
        [pillar[0] - task["around"] - stands.position[0], pillar[1] - stands.position[1], 0.0]
    )

    with job.phase("planning"):
        world = PlanningWorld.of(scene, approached=[cup], seed=job.seed)
        job.log_world(world)
        carrying = world.holding(cup, grasp.inverse() @ stands)
        lifting = carrying.standing_on([task["from"], task["to"]])
        over = through([up @ grasp, up @ beside @ grasp, up @ shift @ grasp])
        way = [*line(grasp, over[0], 0.01), *over[1:], *line(over[-1], shift @ grasp, 0.01)[1:]]
        whole = job.trace(lifting, way, LIMITS, "way around the pillar", tolerance=UPRIGHT)
        height = whole.robot.fk_transform(whole.configurations)[:, 2, 3] - grasp.position[2]
        first, last = np.flatnonzero(height > task["lift"] - 1e-4)[[0, -1]]
        off, round_it, down = whole.part(0, first), whole.part(first, last), whole.part(last, len(whole) - 1)

        taken, put = whole.robot.fk(whole.start), whole.robot.fk(whole.end)
        back = Pose.from_xyz([0.0, 0.0, -task["approach"]])
        reach = job.trace(
            world, line(taken, taken @ back, 0.01), LIMITS, "way to the cup", q_start=whole.start
        )
        reach = job.move(world, arm.start, reach.end, "way to the table") + reach.reversed()
        emptied = PlanningWorld.of(scene.moved({cup: shift @ stands}), approached=[cup], seed=job.seed)
        leave = job.trace(emptied, line(put, put @ back, 0.01), LIMITS, "way off", q_start=whole.end)
        job.log_plan(reach + whole + leave)
        reaching = job.retime(world, reach, 2 * speed, "motion to the cup")
        motions = [
            job.retime(view, path, speed, f"motion {what}", acceleration=gentle)
            for view, path, what in ((lifting, off, "off the plinth"), (carrying, round_it, "around"), (lifting, down, "down"))
        ]  # fmt: skip
        leaving = job.retime(emptied, leave, speed, "motion off the cup")

    with job.phase("execution"):
        simulation = job.simulation()
        simulation.execute(reaching, "reaching for the cup")
        simulation.grasp(cup)
        begin = simulation.time
        for motion, what in zip(motions[:2], ("lifting the cup", "carrying it around"), strict=True):
            simulation.execute(motion, what)
        simulation.expect_contact(cup, task["to"])
        simulation.execute(motions[2], "putting it down")
        end = simulation.time
        simulation.release()
        simulation.execute(leaving, "leaving it")
        simulation.hold(task["hold_s"])
        moved = carried(scene, simulation.result(), cup, begin, end)
        beside = moved.position[:, :2] - pillar[:2]
        passed = np.unwrap(np.arctan2(-beside[:, 1], -beside[:, 0]))  # 0 on the robot's side of the pillar
        away = float(np.linalg.norm(simulation.object_pose(cup).position - target))
        job.summary.update(
            max_tilt_rad=float(moved.tilt.max()),
            max_slosh_rad=float(moved.slosh.max()),
            pillar_passed_at_m=float(np.linalg.norm(beside, axis=1).min()),
            put_down_off_by_m=away,
        )
        job.judge(
            simulation,
            {
                "the cup tilted by at most 2 degrees": bool(moved.tilt.max() <= task["max_tilt"]),
                "nothing was spilled": bool(moved.slosh.max() <= task["max_slosh"]),
                "the cup went around the pillar, on the robot's side": bool(
                    abs(passed).max() < 0.75 * np.pi and np.ptp(passed) > 1.5
                ),
                "the cup stands on the other plinth": simulation.stands_on(cup, task["to"]) and away < 3e-3,
            },
        )
