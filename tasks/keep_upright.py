"""A Sawyer carries a full cup around a pillar, and the cup stays upright all the way.

The hand may turn about the vertical as it likes, the cup is round: which way it points, from the grasp to the place
where the cup is put down, is part of the choice of one motion that leads all the way around.
"""

import numpy as np

from workcell import FREE, FollowLimits, Job, Path, PathTolerance, PlanningWorld, Pose, carried, line, through

# Between waypoints: radians of a joint, and of a link what 0.2 rad turn it (Frobenius norm); metres to keep everywhere.
LIMITS = FollowLimits(max_step=0.2, max_link_rotation=0.28, deviation_m=1e-3, clearance=0.003)
UPRIGHT = PathTolerance(rotation=(0.0, 0.0, FREE), frame="world")  # it may turn about the vertical alone


def run(job: Job) -> None:
    """Grasp the cup, lift it, carry it around, put it down, let go."""
    scene, task = job.scene, job.scene.task
    arm, cup, speed = scene.robot(), task["object"], task["max_tool_speed"]
    grasp, stands = scene.goal("grasp").pose, scene.object_pose(cup)
    spread = np.random.default_rng(job.seed).uniform(-1, 1, 2) * task["target_spread"]
    target = scene.site_pose(task["target"]).position + np.append(spread, 0.0)
    shift, up = Pose.from_xyz(target - stands.position), Pose.from_xyz([0.0, 0.0, task["lift"]])
    pillar = scene.site_pose(task["pillar"]).position[:2]
    beside = Pose.from_xyz([*(pillar - [task["around"], 0.0] - stands.position[:2]), 0.0])

    with job.phase("planning"):
        world = PlanningWorld.of(scene, approached=[cup], seed=job.seed)
        job.log_world(world)
        carrying = world.holding(cup, grasp.inverse() @ stands)
        lifting = carrying.standing_on([task["from"], task["to"]])
        over = through([up @ grasp, up @ beside @ grasp, up @ shift @ grasp])
        way = [*line(grasp, over[0], 0.01), *over[1:], *line(over[-1], shift @ grasp, 0.01)[1:]]
        back = Pose.from_xyz([0.0, 0.0, -task["approach"]])

        def reach(q: np.ndarray) -> Path:
            taken = arm.robot.fk(q)
            away = job.follow(world, line(taken, taken @ back, 0.01), q, LIMITS, "way to the cup")
            return job.move(world, arm.start, away.end, "way to the table") + away.reversed()

        whole = job.trace(lifting, way, LIMITS, "way around the pillar", tolerance=UPRIGHT, begins=reach)
        off, around, down = whole.split([over[0].position, over[-1].position])

        put = arm.robot.fk(whole.end)
        emptied = PlanningWorld.of(scene.moved({cup: shift @ stands}), approached=[cup], seed=job.seed)
        leave = job.follow(emptied, line(put, put @ back, 0.01), whole.end, LIMITS, "way off")
        (reaching,) = job.timed([(world, reach(whole.start))], 2 * speed, "motion to the cup")
        stretches, gentle = [(lifting, off), (carrying, around), (lifting, down)], task["max_acceleration"]
        lift, carry, lower = job.timed(stretches, speed, "motion with the cup", acceleration=gentle)
        (leaving,) = job.timed([(emptied, leave)], speed, "motion off the cup")

    with job.phase("execution"):
        simulation = job.simulation()
        simulation.execute(reaching, "reaching for the cup")
        simulation.grasp(cup)
        begin = simulation.time
        simulation.execute(lift, "lifting the cup")
        simulation.execute(carry, "carrying it around")
        simulation.expect_contact(cup, task["to"])
        simulation.execute(lower, "putting it down")
        end = simulation.time
        simulation.release()
        simulation.execute(leaving, "leaving it")
        simulation.hold(task["hold_s"])

        moved, aim = carried(scene, simulation.result(), cup, begin, end), Pose.from_xyz(target)
        away, off_by = moved.position[:, :2] - pillar, simulation.object_pose(cup).error_to(aim)[0]
        passed_at = np.linalg.norm(away, axis=1)
        x, side = away[int(np.argmin(passed_at)), 0], away[[0, -1], 1]
        job.summary |= {"max_tilt_rad": float(moved.tilt.max()), "max_slosh_rad": float(moved.slosh.max())}
        job.summary |= {"pillar_passed_at_m": float(passed_at.min()), "put_down_off_by_m": off_by}
        conditions = {
            "the cup tilted by at most 2 degrees": bool(moved.tilt.max() <= task["max_tilt"]),
            "nothing was spilled": bool(moved.slosh.max() <= task["max_slosh"]),
            "the cup went past the pillar on the robot's side": bool(x < 0 and side[0] * side[1] < 0),
            "the cup stands on the other plinth": simulation.stands_on(cup, task["to"]) and off_by < 3e-3,
        }
        job.judge(simulation, conditions)
