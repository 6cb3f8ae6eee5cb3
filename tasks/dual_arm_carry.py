"""Two IIWAs carry one crate over a wall: a closed chain.

Everything is planned before anything moves. The hands go to the handles one after the other; then the crate's own path
is planned, both arms follow it, and one timing moves them together. The simulation holds the crate in both hands, and
measures how hard they work against each other.
"""

from workcell import FollowLimits, Job, PlanningWorld, Pose, Scene, Team, line

LIMITS = FollowLimits(max_step=0.2, clearance=0.002)  # radians between waypoints, metres to keep everywhere
SPACING = 0.01  # metres of the crate's path between waypoints


def reach_handle(job: Job, scene: Scene, name: str):
    """One hand to its handle, the other arm standing where `scene` has it."""
    task, crate = scene.task, scene.task["object"]
    grasp = scene.site_pose(f"{crate}/{name}")
    above = Pose.from_xyz([0, 0, task["over"]]) @ grasp
    world = PlanningWorld.of(scene, name, opening=task["opening"], approached=[crate], seed=job.seed)
    path = job.reach(world, scene.robot(name).start, line(above, grasp), LIMITS, f"{name}: way to the handle")
    motion = job.retime(world, path, task["max_tool_speed"], f"{name}: motion to the handle")
    return motion, scene.with_start(name, path.end)


def leave_handle(job: Job, scene: Scene, name: str):
    """One hand up and away from its handle."""
    task = scene.task
    tool = scene.robot(name).robot.fk(scene.robot(name).start)
    up = Pose.from_xyz([0, 0, task["over"]]) @ tool
    world = PlanningWorld.of(scene, name, opening=task["opening"], approached=[task["object"]], seed=job.seed)
    path = job.follow(world, line(tool, up), scene.robot(name).start, LIMITS, f"{name}: way off the handle")
    return job.retime(
        world, path, task["max_tool_speed"], f"{name}: motion off the handle"
    ), scene.with_start(name, path.end)


def plan_carry(job: Job, scene: Scene):
    """The crate's path, at the lowest lift that both arms can follow, as three motions of the team: up, over, down."""
    task, crate = scene.task, scene.task["object"]
    begin, target = scene.object_pose(crate), scene.site_pose(task["target"])
    grasps = {
        name: begin.inverse() @ scene.robot(name).robot.fk(scene.robot(name).start) for name in task["arms"]
    }
    hover, put = (Pose.from_xyz([0, 0, height]) @ target for height in (task["hover"], task["drop"]))
    carrying = Team.of(scene, crate, grasps, seed=job.seed)
    lifting = carrying.touching(task["stands_on"])
    placing = carrying.touching(task["target_geom"])
    starts = {name: scene.robot(name).start for name in task["arms"]}
    for height in task["lifts"]:
        up, high = (
            Pose.from_xyz([0, 0, height]) @ pose for pose in (begin, Pose.from_xyz([0, 0, -0.05]) @ target)
        )
        raised = job.carry(lifting, line(begin, up, SPACING), starts, LIMITS, f"lift by {height:g} m")
        if raised is None:
            continue
        poses = (*line(up, high, SPACING), *line(high, hover, SPACING)[1:])
        across = job.carry(carrying, poses, lifting.at(raised.end), LIMITS, f"over the wall at {height:g} m")
        if across is not None:
            break
    else:
        job.fail("NOT_FOUND", f"The arms can carry the crate at none of the heights {task['lifts']}.")
    down = job.carry(placing, line(hover, put, SPACING), placing.at(across.end), LIMITS, "onto the platform")
    if down is None:
        job.fail("NOT_FOUND", "The arms can't put the crate down.")
    stages = ((lifting, raised, "lift"), (carrying, across, "carry"), (placing, down, "put down"))
    motions = [
        job.retime_team(team, path, task["max_tool_speed"], task["strain_m"], what)
        for team, path, what in stages
    ]
    after = scene.moved({crate: put})
    for name, q in placing.at(down.end).items():
        after = after.with_start(name, q)
    return motions, after


def run(job: Job) -> None:
    """Grasp with both hands, carry, put down, let go."""
    scene, task = job.scene, job.scene.task
    crate, arms = task["object"], task["arms"]
    with job.phase("planning"):
        reaching, leaving = {}, {}
        for name in arms:
            reaching[name], scene = reach_handle(job, scene, name)
        (lift, carry, put_down), scene = plan_carry(job, scene)
        for name in arms:
            leaving[name], scene = leave_handle(job, scene, name)

    with job.phase("execution"):
        simulation = job.simulation()
        for name in arms:
            simulation.move_gripper(task["opening"], name)
            simulation.execute(reaching[name], f"{name}: reaching for the handle")
            simulation.grasp(crate, name)
        simulation.execute(lift, "lifting the crate")
        simulation.execute(carry, "carrying the crate over the wall")
        simulation.expect_contact(crate, task["target_body"])
        simulation.execute(put_down, "putting the crate down")
        for name in arms:
            simulation.release(name, opening=task["opening"])
        for name in arms:
            simulation.execute(leaving[name], f"{name}: leaving the handle")
        simulation.hold(task["hold_s"])
        off, turned = simulation.object_pose(crate).error_to(scene.site_pose(task["target"]))
        force = float(simulation.result().internal_force.max(initial=0.0))
        job.summary |= {"max_internal_force_n": force, "placed_error_m": off, "placed_error_rad": turned}
        job.judge(
            simulation,
            {
                "the crate stands on the platform": simulation.stands_on(crate, task["target_body"]),
                "it stands where it should": off <= task["placed_m"],
                "the hands worked together": force <= task["internal_force_n"],
            },
        )
