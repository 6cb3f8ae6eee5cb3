"""A hand of 24 joints grasps a cube with five fingers, each on the face that is assigned to it, and lifts it.

A contact is a point in a convex region: the centre of the ball in which a finger ends, a radius over its face and
inside its edges. The fingers come down on the faces gap by gap; then they press, and the wrist lifts what they hold.
"""

from dataclasses import replace

import numpy as np

from workcell import FrameGoal, FrameWaypoint, InRegion, Job, MechanismSteps, Pose

STEPS = MechanismSteps(max_step=0.4, max_link_rotation=None)


def touching(job: Job, gap: float) -> FrameWaypoint:
    """Every fingertip `gap` metres over its face, the pad towards it."""
    task, T = job.scene.task, resting(job)
    half, goals, regions = np.full(3, task["half"]), [], []
    for contact in task["contacts"]:
        ball, lift, face = f"{contact['finger']}_ball", contact["radius"] + gap, contact["face"]
        region = InRegion.on_face(ball, T, half, face, inset=task["inset"], lift=lift)
        outward = region.A[:1]
        inner = (0.0, 0.0, -contact["length"])  # the other end of the fingertip is over the face as well
        regions += [region, InRegion.polytope(ball, -outward, -region.b[:1], inner)]
        goals.append(FrameGoal.pointing(f"{contact['finger']}_tip", -outward[0], within=task["lean"]))
    return FrameWaypoint(tuple(goals), tuple(regions))


def resting(job: Job) -> Pose:
    """Where the cube stands as the task begins."""
    return job.scene.body_pose(job.scene.task["thing"])


def run(job: Job) -> None:
    """Plan posture and contacts; approach, touch, press, lift, hold."""
    task, hand = job.scene.task, job.mechanism
    contacts, thing = task["contacts"], task["thing"]
    pairs = [(contact["geom"], thing) for contact in contacts]
    with job.phase("planning"):
        free, allowed = job.mechanism_problem(safety_margin=0.001), job.mechanism_problem(touching=pairs)
        over, *nearer = (touching(job, gap) for gap in task["gaps"])
        posture = replace(free, goals=over.goals, regions=over.regions, q_reference=hand.start)
        q_over = job.pose(posture, "approach posture").unwrap()
        approach = job.time_mechanism(free, job.straight(hand.start, q_over), "motion to the posture")
        closing = job.follow_frames(allowed, nearer, q_over, STEPS, "fingers to their faces")
        grasp = job.time_mechanism(allowed, closing, "motion to the faces")
        turned = np.array(closing.end)
        turned[hand.mechanism.value_slices[hand.mechanism.joint(task["wrist"])]] += task["lift"]
        lifting = job.time_mechanism(allowed, job.straight(closing.end, turned), "lifting by the wrist")

    with job.phase("execution"):
        simulation = job.mechanism_simulation()
        simulation.execute(approach, "approaching the cube")
        simulation.expect(pairs)
        simulation.execute(grasp, "closing the fingers")
        outward = {"+x": [1.0, 0.0, 0.0], "-x": [-1.0, 0.0, 0.0]}
        forces = {f"{c['finger']}_ball": -c["force"] * np.array(outward[c["face"]]) for c in contacts}
        simulation.press(forces, task["press_s"])
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
