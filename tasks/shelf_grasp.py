"""A Sawyer takes a mug out of a narrow shelf.

Everything is planned before anything moves: a verified grasp configuration, a continuous tool path into the shelf, and
one out of it with the mug in the hand. Then the plan is executed in MuJoCo, and judged there.
"""

from workcell import FollowLimits, Job, PlanningWorld, line

OVERSHOOT = 0.03  # metres by which the planner's spheres may exceed the arm and the mug
# Between waypoints: radians of a joint, and of a link what 0.2 rad turn it (Frobenius norm); metres to keep everywhere.
LIMITS = FollowLimits(max_step=0.2, max_link_rotation=0.28, clearance=0.002)


def run(job: Job) -> None:
    """Reach in, grasp, lift, carry out, hold."""
    scene, task = job.scene, job.scene.task
    arm, mug, speed = scene.robot(), task["object"], task["max_tool_speed"]
    approach, grasp, lift, retreat = (scene.goal(name).pose for name in task["path"])

    with job.phase("planning"):
        # The fingers must come closer to the mug than their spheres allow; the compiled model watches them there.
        shelf = PlanningWorld.of(scene, overshoot=OVERSHOOT, approached=[mug], seed=job.seed)
        goal = job.solve(shelf.problem(grasp, q_reference=arm.start), "grasp configuration").unwrap()
        shelf = shelf.with_free_space_around([goal])
        job.log_world(shelf)
        reach = job.reach(shelf, arm.start, line(approach, grasp), LIMITS, "way into the shelf", goal=goal)

        # From here on the mug is part of the robot; until it is lifted it may touch what it stands on.
        carrying = shelf.holding(mug, grasp.inverse() @ scene.object_pose(mug), towards=[reach.end])
        lifting = carrying.standing_on(task["supports"])
        up = job.follow(lifting, line(grasp, lift, 0.01), reach.end, LIMITS, "way off the board")
        out = job.follow(carrying, line(lift, retreat), up.end, LIMITS, "way out with the mug")
        job.log_plan(reach + up + out)
        reach_motion = job.retime(shelf, reach, speed, "motion into the shelf")
        lift_motion = job.retime(lifting, up, speed, "motion off the board")
        carry_motion = job.retime(carrying, out, speed, "motion out of the shelf")

    with job.phase("execution"):
        simulation = job.simulation()
        simulation.execute(reach_motion, "reaching into the shelf")
        simulation.grasp(mug)
        simulation.execute(lift_motion, "lifting the mug")
        simulation.execute(carry_motion, "carrying the mug out")
        simulation.hold(task["hold_s"])
        job.judge(
            simulation,
            {
                "the mug has left the shelf": simulation.apart(mug, task["shelf"]),
                "the mug hangs in the hand alone": simulation.held == mug and not simulation.touches(mug),
            },
        )
