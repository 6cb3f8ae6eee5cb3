"""A UR10 is asked for a block under a beam that leaves no room for its hand: a proof, and a picture of why.

Nothing moves. The recording shows what is in the way (red), and the arm as near to the block as it gets (orange).
"""

from workcell import FollowLimits, Job, PlanningWorld, line

OVERSHOOT = 0.03  # metres by which the planner's spheres may exceed the arm
# Between waypoints: radians of a joint, and of a link what 0.2 rad turn it (Frobenius norm); metres to keep everywhere.
LIMITS = FollowLimits(max_step=0.2, max_link_rotation=0.28, clearance=0.002)


def run(job: Job) -> None:
    """Decide whether the hand can be at the block; reach for it if it can, which the beam forbids."""
    scene, task = job.scene, job.scene.task
    block, grasp = task["object"], scene.goal("grasp").pose

    with job.phase("planning"):
        world = PlanningWorld.of(scene, overshoot=OVERSHOOT, approached=[block], seed=job.seed)
        job.log_world(world)
        # ends the task: there is none, and that is proved
        goal = job.solve(world.problem(grasp), "grasp configuration").unwrap()

        inward = line(scene.goal("above").pose, grasp)
        path = job.reach(world, scene.robot().start, inward, LIMITS, "way to the block", goal=goal)
        job.log_plan(path)
        motion = job.retime(world, path, task["max_tool_speed"], "motion to the block")

    with job.phase("execution"):
        simulation = job.simulation()
        simulation.execute(motion, "reaching for the block")
        simulation.grasp(block)
        job.judge(simulation, {"the block is in the hand": simulation.held == block})
