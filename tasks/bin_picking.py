"""An IIWA empties a bin of mixed parts, each against one of its walls, into a tray.

Everything is planned before anything moves: for each part a grasp at which the hand fits between the walls, the way to
it, and the way to the tray with the part in the hand. The fingers hold by friction alone, so that a part may slip: the
simulation watches it, and judges how far it did.
"""

from workcell import FREE, FollowLimits, Job, PathTolerance, PlanningWorld, Pose, Scene, line, turned

# Between waypoints: radians of a joint, and of a link what 0.2 rad turn it (Frobenius norm); metres to keep everywhere.
LIMITS = FollowLimits(max_step=0.2, max_link_rotation=0.28, clearance=0.002)
TRANSFER = FollowLimits(
    max_step=0.2, max_link_rotation=0.28, clearance=0.002, deviation_m=0.01, deviation_rad=0.05
)  # need not be straight
LEVEL = PathTolerance(
    rotation=(0.0, 0.0, FREE), frame="world"
)  # a part may be turned on its way, but not tilted


def plan_part(job: Job, scene: Scene, part: str):
    """All motions for one part, from home and back; and the scene that they leave behind."""
    task, arm, home = scene.task, scene.robot(), job.scene.robot().start
    fk, stands, site = arm.robot.fk, scene.object_pose(part), scene.site_pose(f"{part}/grasp")
    world = PlanningWorld.of(scene, opening=task["opening"], approached=[part], seed=job.seed)
    grasps = turned(site, task["parts"][part]["symmetry"], near=fk(arm.start))
    fitting = [grasp for grasp in grasps if world.hand_clearance(grasp, [part]) >= task["room"]]
    if not fitting:
        job.fail("NOT_FOUND", f"{part}: the hand does not fit around it at any of its {len(grasps)} grasps.")
    up, down = Pose.from_xyz([0, 0, task["lift"]]), Pose.from_xyz([0, 0, task["drop"] - task["hover"]])
    first, *others = (line(up @ grasp, grasp) for grasp in fitting)
    into = job.reach(world, arm.start, first, TRANSFER, f"{part}: into the bin", others=others)

    grasp = fk(into.end)
    carrying = world.holding(part, grasp.inverse() @ stands, towards=[into.end])
    lifting, placing = carrying.standing_on(task["floor"]), carrying.standing_on(task["tray_floor"])
    slot = scene.site_pose(task["tray_frame"]).apply([*task["parts"][part]["slot"], task["hover"]])
    over = Pose.from_xyz(slot - stands.position) @ grasp
    out = job.follow(lifting, line(grasp, up @ grasp), into.end, LIMITS, f"{part}: out of the bin")
    across = (*line(up @ grasp, up @ over), *line(up @ over, over)[1:])
    over = job.follow(carrying, across, out.end, TRANSFER, f"{part}: to the tray", tolerance=LEVEL)
    put = down @ fk(over.end)
    onto = job.follow(placing, line(fk(over.end), put), over.end, LIMITS, f"{part}: onto the tray")

    after = scene.moved({part: put @ grasp.inverse() @ stands}).with_start(arm.name, onto.end)
    emptied = PlanningWorld.of(after, opening=task["opening"], approached=[part], seed=job.seed)
    back = job.follow(emptied, line(put, up @ put), onto.end, LIMITS, f"{part}: off the tray")
    back += job.move(emptied, back.end, home, f"{part}: home")
    ways = [(world, into), (lifting, out), (carrying, over), (placing, onto), (emptied, back)]
    return job.timed(ways, task["max_tool_speed"], f"{part}: motion"), after.with_start(arm.name, home)


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
