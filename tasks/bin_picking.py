"""An IIWA empties a bin of mixed parts, each against one of its walls, into a tray.

Everything is planned before anything moves: for each part a grasp at which the hand fits between the walls, the way to
it, and the way to the tray with the part in the hand. The fingers hold by friction alone, so that a part may slip: the
simulation watches it, and judges how far it did.
"""

import numpy as np

from workcell import FollowLimits, Job, PlanningWorld, Pose, Scene, line

LIMITS = FollowLimits(max_step=0.2, clearance=0.002)  # radians between waypoints, metres to keep everywhere


def plan_part(job: Job, scene: Scene, part: str):
    """All motions for one part, from where the robot of `scene` stands; and the scene that they leave behind."""
    task, arm = scene.task, scene.robot()
    settings, speed = task["parts"][part], task["max_tool_speed"]
    world = PlanningWorld.of(scene, opening=task["opening"], approached=[part], seed=job.seed)
    up = Pose.from_xyz([0, 0, task["lift"]])
    grasp, into = reach_part(job, world, scene.site_pose(f"{part}/grasp"), up, settings["symmetry"], part)

    stands = scene.object_pose(part)
    slot = scene.site_pose(task["tray_frame"]).apply([*settings["slot"], task["drop"]])
    shift = Pose.from_xyz(slot - stands.position)
    carrying = world.holding(part, grasp.inverse() @ stands, towards=[into.end])
    lifting = carrying.standing_on(task["floor"])
    out = job.follow(lifting, line(grasp, up @ grasp), into.end, LIMITS, f"{part}: out of the bin")
    hover, put = Pose.from_xyz([0, 0, task["hover"]]) @ shift @ grasp, shift @ grasp
    over = job.reach(carrying, out.end, [up @ shift @ grasp, hover], LIMITS, f"{part}: to the tray")
    placing = carrying.standing_on(task["tray_floor"])
    down = job.follow(placing, line(hover, put), over.end, LIMITS, f"{part}: onto the tray")

    after = scene.moved({part: shift @ stands}).with_start(arm.name, down.end)
    emptied = PlanningWorld.of(after, opening=task["opening"], approached=[part], seed=job.seed)
    back = job.follow(emptied, line(put, up @ put), down.end, LIMITS, f"{part}: off the tray")
    job.log_plan(into + out + over + down + back)
    motions = [
        job.retime(view, path, speed, f"{part}: motion {what}")
        for view, path, what in (
            (world, into, "to the part"),
            (lifting, out, "out of the bin"),
            (carrying, over, "to the tray"),
            (placing, down, "onto the tray"),
            (emptied, back, "off the tray"),
        )
    ]
    return motions, after.with_start(arm.name, back.end)


def reach_part(job: Job, world: PlanningWorld, grasp: Pose, up: Pose, symmetry: int, part: str):
    """The first of the part's grasps at which the hand has room and the arm gets there, and the way."""
    turns = [
        grasp @ Pose.from_rotation([0, 0, 0], rotation_z(2 * np.pi * k / symmetry)) for k in range(symmetry)
    ]
    least = world.robot.robot.fk(world.robot.start)
    room = [turn for turn in turns if world.hand_clearance(turn, [part]) >= world.scene.task["room"]]
    if not room:
        job.fail("BLOCKED", f"{part}: the hand does not fit around it at any of its {symmetry} grasps.")
    chosen = min(room, key=lambda turn: turn.error_to(least)[1])
    return chosen, job.reach(
        world, world.robot.start, line(up @ chosen, chosen), LIMITS, f"{part}: into the bin"
    )


def rotation_z(angle: float) -> np.ndarray:
    """About z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


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
