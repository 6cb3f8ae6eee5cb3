"""A platform on six legs goes through several poses of its workspace, and holds each of them.

Six drives slide, twelve ball joints follow, six loops are closed: every waypoint is a question about the whole
mechanism. What the legs really hold is measured in the simulation.
"""

import numpy as np

from workcell import FrameGoal, FrameWaypoint, Job, MechanismSteps, Pose
from workcell.pose import axis_angle_to_matrix

STEPS = MechanismSteps(max_step=0.3, max_link_rotation=0.28)


def drawn(job: Job) -> list[Pose]:
    """The poses of this seed."""
    task, rng = job.scene.task, np.random.default_rng(job.seed)
    lower, upper = np.array([task["x"], task["y"], task["z"]]).T
    most, poses = np.array([task["yaw"], task["tilt"], task["tilt"]]), []
    for _ in range(task["poses"]):
        position, angles = rng.uniform(lower, upper), rng.uniform(-most, most)
        z, y, x = (axis_angle_to_matrix(axis, a) for axis, a in zip(np.eye(3)[::-1], angles, strict=True))
        poses.append(Pose.from_rotation(position, z @ y @ x))
    return poses


def straight(job: Job, begin: Pose, end: Pose) -> list[FrameWaypoint]:
    """Poses of the platform on the straight way from one to another."""
    task, (far, turned) = job.scene.task, begin.error_to(end)
    count = max(int(np.ceil(max(far / task["spacing"], turned / task["turn"]))), 1)
    poses = [begin.interpolate(end, k / count) for k in range(1, count + 1)]
    return [FrameWaypoint((FrameGoal.posed("platform", pose),)) for pose in poses]


def run(job: Job) -> None:
    """Plan the way to every pose, then go there and hold."""
    task, poses, speed = job.scene.task, drawn(job), {"platform": job.scene.task["max_speed"]}
    here, q, motions = job.scene.site_pose("platform"), job.mechanism.start, []
    with job.phase("planning"):
        question = job.mechanism_problem()
        for k, pose in enumerate(poses, 1):
            way = job.follow_frames(question, straight(job, here, pose), q, STEPS, f"way to pose {k}")
            motions.append(job.time_mechanism(question, way, f"motion to pose {k}", frame_speed=speed))
            here, q = pose, way.end

    with job.phase("execution"):
        simulation, errors = job.mechanism_simulation(), []
        for k, (pose, motion) in enumerate(zip(poses, motions, strict=True), 1):
            simulation.execute(motion, f"going to pose {k}")
            simulation.hold(task["hold_s"])
            errors.append(simulation.frame_pose("platform").error_to(pose))
        off, turned = (float(worst) for worst in np.max(errors, axis=0))
        job.summary |= {"poses": len(poses), "pose_error_m": off, "pose_error_rad": turned}
        conditions = {
            "every pose is held": off <= task["reached_m"] and turned <= task["reached_rad"],
        }
        job.judge(simulation, conditions)
