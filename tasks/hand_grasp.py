"""A hand of 24 joints grasps a cube with five fingers, each on the face that is assigned to it, and lifts it.

A contact is a point in a convex region: the centre of the ball in which a finger ends, a radius over its face and
inside its edges. The fingers come down on the faces gap by gap; then they press, and the wrist lifts what they hold.
"""

from dataclasses import replace

import numpy as np

from workcell import FrameWaypoint, InRegion, Job, MechanismSteps, Pose

STEPS = MechanismSteps(max_step=0.15, max_link_rotation=0.28)


def touching(job: Job, gap: float) -> FrameWaypoint:
    """Every fingertip `gap` metres over its face."""
    task, T = job.scene.task, resting(job)
    half, regions = np.full(3, task["half"]), []
    for contact in task["contacts"]:
        ball, lift = f"{contact['finger']}_ball", contact["radius"] + gap
        region = InRegion.on_face(ball, T, half, contact["face"], inset=task["inset"], lift=lift)
        inner = (0.0, 0.0, -contact["length"])  # the other end of the fingertip is over the face as well
        regions += [region, InRegion.polytope(ball, -region.A[:1], -region.b[:1], inner)]
    return FrameWaypoint((), tuple(regions))


def pressing(job: Job) -> dict[str, np.ndarray]:
    """The force of every fingertip on its face, in the world."""
    contacts, faces = job.scene.task["contacts"], touching(job, 0.0).regions[::2]
    return {face.frame: -c["force"] * face.A[0] for c, face in zip(contacts, faces, strict=True)}


def resting(job: Job) -> Pose:
    """Where the cube stands as the task begins."""
    return job.scene.body_pose(job.scene.task["thing"])


def run(job: Job) -> None:
    """Plan posture and contacts; approach, touch, press, lift, hold."""
    task, hand = job.scene.task, job.mechanism
    contacts, thing = task["contacts"], task["thing"]
    pairs = [(contact["geom"], thing) for contact in contacts]
    with job.phase("planning"):
        free = job.mechanism_problem(safety_margin=task["clear"], overshoot=None)
        allowed = job.mechanism_problem(touching=pairs, safety_margin=task["clear"], overshoot=None)
        over, *nearer = (touching(job, gap) for gap in task["gaps"])
        posture = replace(free, regions=over.regions, q_reference=hand.start)
        q_over = job.pose(posture, "approach posture").unwrap()
        there = job.move_mechanism(free, hand.start, q_over, "way to the posture")
        approach = job.time_mechanism(free, there, "motion to the posture")
        closing = job.follow_frames(allowed, nearer, q_over, STEPS, "fingers to their faces")
        grasp = job.time_mechanism(allowed, closing, "motion to the faces")
        turned = np.array(closing.end)
        turned[hand.mechanism.value_slices[hand.mechanism.joint(task["wrist"])]] += task["lift"]
        carrying = job.mechanism_problem(safety_margin=task["clear"], overshoot=None, absent=[thing])
        up = job.move_mechanism(carrying, closing.end, turned, "way of the wrist")
        lifting = job.time_mechanism(carrying, up, "motion of the wrist")

    with job.phase("execution"):
        simulation = job.mechanism_simulation()
        simulation.execute(approach, "approaching the cube")
        simulation.expect(pairs)
        simulation.execute(grasp, "closing the fingers")
        simulation.press(pressing(job), task["press_s"])
        simulation.hold(task["hold_s"])
        simulation.execute(lifting, "lifting the cube")
        simulation.hold(task["hold_s"])
        touched = simulation.touched()
        rose = float((simulation.body_pose(thing).position - resting(job).position)[2])
        job.summary |= {"rose_m": rose, "contacts": {" on ".join(p): round(f, 3) for p, f in touched.items()}}
        conditions = {
            "the fingers touch their faces and nothing else is touched": set(touched) == set(pairs),
            "the cube is held above its pedestal": rose >= task["lifted_m"],
        }
        job.judge(simulation, conditions)
