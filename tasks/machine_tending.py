"""A UR10 loads the chuck of a lathe, through its door, with a blank from a rack.

Everything is planned before anything moves: to the rack, through the door into the open jaws, and out again. Then the
plan is executed; the chuck closes while the hand still holds the blank, and has to hold it alone once the hand has
gone.
"""

from workcell import FollowLimits, Job, PlanningWorld, Pose, actuated, line

# Between waypoints: radians of a joint, and of a link what 0.2 rad turn it (Frobenius norm); metres to keep everywhere.
LIMITS = FollowLimits(max_step=0.25, max_link_rotation=0.28, clearance=0.002)


def run(job: Job) -> None:
    """Fetch, load, clamp, leave."""
    scene, task = job.scene, job.scene.task
    arm, blank, speed = scene.robot(), task["object"], task["max_tool_speed"]
    lies, grasp = scene.object_pose(blank), scene.site_pose(f"{blank}/grasp")
    above = Pose.from_xyz([0, 0, task["lift"]]) @ grasp
    seat = scene.site_pose(task["seat"])
    seated = seat @ lies.inverse() @ grasp  # the tool, when the blank sits in the chuck
    before = Pose.from_xyz(seat.rotation @ [-task["in_front"], 0, 0]) @ seated
    outside = Pose.from_xyz([-task["outside"], 0, 0]) @ before
    back = Pose.from_xyz([-task["draw_back"], 0, 0]) @ seated
    left = Pose.from_xyz([-task["outside"], 0, 0]) @ back

    with job.phase("planning"):
        rack = PlanningWorld.of(scene, approached=[blank], seed=job.seed)
        job.log_world(rack)
        fetch = job.reach(rack, arm.start, line(above, grasp), LIMITS, "way to the blank")
        carrying = rack.holding(blank, grasp.inverse() @ lies, towards=[fetch.end])
        lifting = carrying.standing_on(task["posts"])
        up = job.follow(lifting, line(grasp, above), fetch.end, LIMITS, "way off the rack")
        inserting = carrying.close_to(task["close_up"])
        inward = (*line(outside, before), *line(before, seated, 0.01)[1:])
        load = job.reach(inserting, up.end, inward, LIMITS, "way into the chuck")

        clamped = actuated(scene.moved({blank: seat}), task["chuck"], 1.0).with_start(arm.name, load.end)
        leaving = PlanningWorld.of(clamped, approached=[blank], seed=job.seed).close_to(task["close_up"])
        outward = (*line(seated, back), *line(back, left)[1:])
        leave = job.follow(leaving, outward, load.end, LIMITS, "way out of the machine")
        job.log_plan(fetch + up + load + leave)
        motions = [
            job.retime(world, path, speed, what)
            for world, path, what in (
                (rack, fetch, "motion to the blank"),
                (lifting, up, "motion off the rack"),
                (inserting, load, "motion into the chuck"),
                (leaving, leave, "motion out of the machine"),
            )
        ]

    with job.phase("execution"):
        simulation = job.simulation()
        simulation.execute(motions[0], "reaching for the blank")
        simulation.grasp(blank)
        simulation.execute(motions[1], "lifting the blank")
        simulation.execute(motions[2], "loading the chuck")
        for jaw in task["jaws"]:
            simulation.expect_contact(blank, jaw)
        simulation.actuate(task["chuck"], 1.0, 0.5)
        simulation.release()
        simulation.execute(motions[3], "leaving the machine")
        simulation.hold(task["hold_s"])
        off, _ = simulation.object_pose(blank).error_to(seat)
        job.summary["seat_error_m"] = off
        job.judge(
            simulation,
            {
                "the blank sits in the chuck": off <= task["seated_m"],
                "all jaws hold it": all(simulation.stands_on(blank, jaw) for jaw in task["jaws"]),
                "the hand has left the machine": simulation.tool_pose().position[0] < task["machine_front"],
            },
        )
