"""An IIWA empties a bin of mixed parts, each against one of its walls, into a tray.

Everything is planned before anything moves: for each part a grasp at which the hand fits between the walls, the way to
it, and the way to the tray with the part in the hand. The fingers hold by friction alone, so that a part may slip: the
simulation watches it, and judges how far it did.
"""

import numpy as np

from workcell import FollowLimits, Job, PlanningWorld, Pose, Scene, line

LIMITS = FollowLimits(max_step=0.2, clearance=0.002)  # radians between waypoints, metres to keep everywhere
TRANSFER = FollowLimits(
    max_step=0.2, clearance=0.002, deviation_m=0.01, deviation_rad=0.05
)  # it need not be straight


def grasp_of(job: Job, world: PlanningWorld, part: str) -> Pose:
    """Of the part's grasps, turned about the approach, the one with room for the hand that turns the wrist least."""
    grasp, symmetry = world.scene.site_pose(f"{part}/grasp"), world.scene.task["parts"][part]["symmetry"]
    halves = np.pi * np.arange(symmetry) / symmetry
    turns = [grasp @ Pose(np.zeros(3), np.array([np.cos(a), 0.0, 0.0, np.sin(a)])) for a in halves]
    fitting = [turn for turn in turns if world.hand_clearance(turn, [part]) >= world.scene.task["room"]]
    if not fitting:
        job.fail("NOT_FOUND", f"{part}: the hand does not fit around it at any of its {symmetry} grasps.")
    tool = world.robot.robot.fk(world.robot.start)
    return min(fitting, key=lambda turn: turn.error_to(tool)[1])


def plan_part(job: Job, scene: Scene, part: str):
    """All motions for one part, from where the robot of `scene` stands; and the scene that they leave behind."""
    task, arm = scene.task, scene.robot()
    world = PlanningWorld.of(scene, opening=task["opening"], approached=[part], seed=job.seed)
    stands, grasp = scene.object_pose(part), grasp_of(job, world, part)
    slot = scene.site_pose(task["tray_frame"]).apply([*task["parts"][part]["slot"], task["drop"]])
    shift = Pose.from_xyz(slot - stands.position)
    up, hover = Pose.from_xyz([0, 0, task["lift"]]), Pose.from_xyz([0, 0, task["hover"]])
    put = shift @ grasp
    into = job.reach(world, arm.start, line(up @ grasp, grasp), TRANSFER, f"{part}: into the bin")

    carrying = world.holding(part, grasp.inverse() @ stands, towards=[into.end])
    lifting, placing = carrying.standing_on(task["floor"]), carrying.standing_on(task["tray_floor"])
    out = job.follow(lifting, line(grasp, up @ grasp), into.end, LIMITS, f"{part}: out of the bin")
    over = job.reach(carrying, out.end, line(up @ put, hover @ put), TRANSFER, f"{part}: to the tray")
    down = job.follow(placing, line(hover @ put, put), over.end, LIMITS, f"{part}: onto the tray")

    after = scene.moved({part: shift @ stands}).with_start(arm.name, down.end)
    emptied = PlanningWorld.of(after, opening=task["opening"], approached=[part], seed=job.seed)
    back = job.follow(emptied, line(put, up @ put), down.end, LIMITS, f"{part}: off the tray")
    job.log_plan(into + out + over + down + back)
    gentle = task["gentle"]  # what a hand holds by friction must not be jerked
    ways = (
        (world, into, None),
        (lifting, out, gentle),
        (carrying, over, gentle),
        (placing, down, gentle),
        (emptied, back, None),
    )
    motions = [
        job.retime(view, path, task["max_tool_speed"], f"{part}: motion", acceleration=limit)
        for view, path, limit in ways
    ]
    return motions, after.with_start(arm.name, back.end)


def run(job: Job) -> None:
    """Plan every part; then pick them one after the other."""
    scene, task = job.scene, job.scene.task
    plans = {}
    with job.phase("planning"):
        for part in task["parts"]:
            plans[part], scene = plan_part(job, scene, part)

    with job.phase("execution"):
        simulation = job.simulation()
        slips = {}
        simulation.move_gripper(task["opening"])
        for part, (into, out, over, down, back) in plans.items():
            simulation.execute(into, f"reaching for the {part}")
            simulation.grasp(part, hold="friction")
            simulation.execute(out, f"lifting the {part}")
            simulation.execute(over, f"carrying the {part}")
            simulation.expect_contact(part, task["tray"])
            simulation.execute(down, f"putting the {part} down")
            slips[part] = simulation.slip()
            simulation.release(opening=task["opening"])
            simulation.execute(back, f"leaving the {part}")
        simulation.hold(task["hold_s"])
        conditions = {f"the {part} has left the bin": simulation.apart(part, task["bin"]) for part in plans}
        conditions |= {
            f"the {part} stands on the tray": simulation.stands_on(part, task["tray"]) for part in plans
        }
        conditions["nothing slipped in the hand"] = max(slips.values()) <= task["slip"]
        job.summary["max_slip_m"] = max(slips.values())
        job.judge(simulation, conditions)
