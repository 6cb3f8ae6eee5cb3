"""Two IIWAs carry one crate over a wall: a closed chain.

Everything is planned before anything moves. The hands go to the handles one after the other; then the crate's own path
is planned, both arms follow it, and one timing moves them together. The simulation holds the crate in both hands, and
measures how hard they work against each other.
"""

from workcell import FollowLimits, Job, PlanningWorld, Pose, Scene, Team, line, polyline

# Between waypoints: radians of a joint, and of a link what 0.2 rad turn it (Frobenius norm); metres to keep everywhere.
LIMITS = FollowLimits(max_step=0.2, max_link_rotation=0.28, clearance=0.002)
SPACING = 0.01  # metres of the crate's path between waypoints


def plan_handle(job: Job, scene: Scene, name: str, leaving: bool = False):
    """One hand to its handle, or up from it, the other arm standing where `scene` has it."""
    task, robot = scene.task, scene.robot(name)
    world = PlanningWorld.of(scene, name, opening=task["opening"], approached=[task["object"]], seed=job.seed)
    grasp = robot.robot.fk(robot.start) if leaving else scene.site_pose(f"{task['object']}/{name}")
    above = Pose.from_xyz([0, 0, task["over"]]) @ grasp
    if leaving:
        path = job.follow(world, line(grasp, above), robot.start, LIMITS, f"{name}: way off the handle")
    else:
        path = job.reach(world, robot.start, line(above, grasp), LIMITS, f"{name}: way to the handle")
    (motion,) = job.timed([(world, path)], task["max_tool_speed"], f"{name}: motion")
    return motion, scene.with_start(name, path.end)


def plan_carry(job: Job, scene: Scene):
    """The crate's path as three motions of the team: up, over the wall, down; and the scene that they leave behind."""
    task, crate = scene.task, scene.task["object"]
    begin, target = scene.object_pose(crate), scene.site_pose(task["target"])
    up = Pose.from_xyz([0, 0, task["lift"]]) @ begin
    high, hover, put = (Pose.from_xyz([0, 0, task[h]]) @ target for h in ("clear", "hover", "drop"))
    robots = {name: scene.robot(name) for name in task["arms"]}
    grasps = {name: begin.inverse() @ robot.robot.fk(robot.start) for name, robot in robots.items()}
    carrying = Team.of(scene, crate, grasps, seed=job.seed)
    stretches = (
        (carrying.touching(task["stands_on"]), line(begin, up, SPACING), f"lifting the {crate}"),
        (carrying, polyline([up, high, hover], SPACING), f"carrying the {crate} over the wall"),
        (carrying.touching(task["target_geom"]), line(hover, put, SPACING), f"putting the {crate} down"),
    )
    return job.transport(scene, stretches, LIMITS, task["max_tool_speed"], task["strain_m"])


def run(job: Job) -> None:
    """Grasp with both hands, carry, put down, let go."""
    scene, task = job.scene, job.scene.task
    crate, arms, reaching, leaving = task["object"], task["arms"], {}, {}
    with job.phase("planning"):
        for name in arms:
            reaching[name], scene = plan_handle(job, scene, name)
        (lift, carry, put_down), scene = plan_carry(job, scene)
        for name in arms:
            leaving[name], scene = plan_handle(job, scene, name, leaving=True)

    with job.phase("execution"):
        simulation = job.simulation()
        for name in arms:
            simulation.move_gripper(task["opening"], name)
            simulation.execute(reaching[name], f"{name}: reaching for the handle")
            simulation.grasp(crate, name)
        simulation.execute(lift, f"lifting the {crate}")
        simulation.execute(carry, f"carrying the {crate} over the wall")
        simulation.expect_contact(crate, task["target_body"])
        simulation.execute(put_down, f"putting the {crate} down")
        for name in arms:
            simulation.release(name, opening=task["opening"])
        for name in arms:
            simulation.execute(leaving[name], f"{name}: leaving the handle")
        simulation.hold(task["hold_s"])
        off, turned = simulation.object_pose(crate).error_to(scene.site_pose(task["target"]))
        force = float(simulation.result().internal_force.max(initial=0.0))
        job.summary |= {"max_internal_force_n": force, "placed_error_m": off, "placed_error_rad": turned}
        conditions = {
            f"the {crate} stands on the platform": simulation.stands_on(crate, task["target_body"]),
            "it stands where it should": off <= task["placed_m"],
            "the hands worked together": force <= task["internal_force_n"],
        }
        job.judge(simulation, conditions)
