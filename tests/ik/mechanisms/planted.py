"""Random mechanisms with a configuration planted in them that keeps every tie and reaches every goal."""

import numpy as np

from workcell.ik.mechanisms.goals import FrameGoal, InRegion
from workcell.ik.mechanisms.problem import MechanismProblem, MechanismTolerances
from workcell.model.mechanism.mechanism import Closure, Frame, Joint, Mechanism
from workcell.model.mechanism.placing import moved, place
from workcell.pose import Pose, axis_angle_to_matrix

LOOSE = MechanismTolerances(position=1e-2, rotation=2e-2, closure=1e-3, region=1e-3)


def unit(rng, size=3):
    v = rng.normal(size=size)
    return v / np.linalg.norm(v)


def random_pose(rng, scale=0.4):
    return Pose(scale * rng.normal(size=3), unit(rng, 4))


def small_turn(rng, angle):
    return axis_angle_to_matrix(unit(rng), angle)


def random_joint(rng, k, parallel):
    """One joint on the world or on an earlier link; `parallel`: it turns or slides along z of what it hangs on."""
    kind = str(rng.choice(["hinge", "hinge", "slide", "ball", "free"]))
    parent = 0 if kind == "free" else int(rng.integers(max(k - 2, 0), k + 1))
    T = Pose.from_xyz(0.4 * rng.normal(size=3)) if parallel else random_pose(rng)
    axis = np.zeros(3)
    if kind in ("hinge", "slide"):
        axis = np.array([0.0, 0.0, 1.0]) if parallel else unit(rng)
    return Joint(f"j{k}", kind, parent, T, axis)


def random_values(rng, joints):
    """A configuration, and the joints with limits around it: narrow, wide or none."""
    q, limited = [], []
    for joint in joints:
        if joint.kind in ("hinge", "slide"):
            value = float(rng.uniform(-1.5, 1.5) if joint.kind == "hinge" else rng.uniform(-0.4, 0.4))
            room = rng.choice([1e-7, 0.3, 1.0, np.inf]) * rng.uniform(0.2, 1.0, 2)
            limited.append(
                Joint(
                    joint.name,
                    joint.kind,
                    joint.parent,
                    joint.T_parent_joint,
                    joint.axis,
                    value - room[0],
                    value + room[1],
                )
            )
            q.append([value])
        elif joint.kind == "ball":
            angle = float(rng.uniform(0.0, 2.0))
            q.append(Pose.from_rotation(np.zeros(3), small_turn(rng, angle)).quat_wxyz)
            upper = float(rng.choice([angle + 1e-7, 2.5, np.inf]))
            limited.append(
                Joint(joint.name, "ball", joint.parent, joint.T_parent_joint, joint.axis, 0.0, upper)
            )
        else:
            q.append(np.concatenate([0.4 * rng.normal(size=3), unit(rng, 4)]))
            limited.append(joint)
    return np.concatenate(q), tuple(limited)


def planted(seed, tolerances=LOOSE, worst=1.0):
    """A problem and a configuration (size,) that answers it, missing everything by up to `worst` of its tolerance."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 8))
    parallel = rng.uniform() < 0.5
    q, joints = random_values(rng, [random_joint(rng, k, parallel) for k in range(count)])
    names = ("world", *(f"l{k}" for k in range(count)))
    links = range(count + 1)
    frames = {f"f{k}": Frame(f"f{k}", int(rng.choice(links)), random_pose(rng, 0.2)) for k in range(4)}
    placed = place(Mechanism("bare", joints, names), q)
    closures = []
    for c in range(int(rng.integers(0, 3))):
        a, b = map(int, rng.choice(links, 2, replace=False))
        F = random_pose(rng, 0.2)
        missing, twist = (worst * tolerances.closure * rng.uniform() for _ in range(2))
        p = placed.point(a, F.position) + missing * unit(rng)
        R = placed.R[a] @ F.rotation @ small_turn(rng, twist)
        G = Pose.from_rotation(placed.R[b].T @ (p - placed.p[b]), placed.R[b].T @ R)
        closures.append(Closure(f"c{c}", str(rng.choice(["connect", "weld"])), (a, b), (F, G)))
    mechanism = Mechanism("planted", joints, names, tuple(closures), frames=frames)
    goals, regions = [], []
    for name in ("f0", "f1"):
        goals.append(planted_goal(rng, placed, frames[name], tolerances, worst))
    for name in ("f2", "f3"):
        if rng.uniform() < 0.5:
            regions.append(planted_region(rng, placed, frames[name], tolerances, worst))
    bounds = {}
    if rng.uniform() < 0.5:
        step = rng.uniform(0.01, 0.3, mechanism.dof)
        reference = moved(mechanism, q, 0.5 * step * rng.uniform(-1.0, 1.0, mechanism.dof))
        far = np.linalg.norm(place(mechanism, reference).R - placed.R, axis=(1, 2)).max()
        bounds = {"q_reference": reference, "max_step": step, "max_link_rotation": float(far) + 1e-9}
        bounds.pop(str(rng.choice(["max_step", "max_link_rotation", "none"])), None)
    return MechanismProblem(mechanism, tuple(goals), tuple(regions), tolerances=tolerances, **bounds), q


def planted_goal(rng, placed, frame, tolerances, worst):
    p = placed.point(frame.link, frame.T_link_frame.position)
    p = p + worst * tolerances.position * rng.uniform() * unit(rng)
    R = placed.R[frame.link] @ frame.T_link_frame.rotation
    turned = R @ small_turn(rng, worst * tolerances.rotation * rng.uniform())
    sort = rng.integers(5)
    if sort == 0:
        return FrameGoal.posed(frame.name, Pose.from_rotation(p, turned))
    if sort == 1:
        return FrameGoal.at(frame.name, p)
    if sort == 2:
        return FrameGoal.turned(frame.name, Pose.from_rotation(p, turned).quat_wxyz)
    axis = unit(rng)
    if sort == 3:
        return FrameGoal.pointing(
            frame.name, turned @ axis, axis, position=p if rng.uniform() < 0.5 else None
        )
    within = float(rng.uniform(0.1, 1.0))
    across = np.cross(R @ axis, unit(rng))
    leant = (
        axis_angle_to_matrix(across / np.linalg.norm(across), within + worst * tolerances.rotation) @ R @ axis
    )
    return FrameGoal.pointing(frame.name, leant, axis, within=within)


def planted_region(rng, placed, frame, tolerances, worst):
    point = 0.1 * rng.normal(size=3)
    p = placed.point(frame.link, frame.T_link_frame.apply(point))
    A = np.stack([unit(rng) for _ in range(4)])
    equal = np.array([True, False, False, False])
    room = np.where(equal, 0.0, rng.choice([0.0, 0.2], 4))
    missed = worst * tolerances.region * rng.uniform(0.0, 1.0, 4)
    return InRegion(frame.name, A, A @ p + room - missed, point, equal)
