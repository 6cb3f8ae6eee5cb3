"""The rows of docs/proofs.md, 12.4, at a configuration, one by one: an oracle that shares no code with sums."""

import numpy as np

from workcell.ik.mechanisms.proofs.multipliers import Multipliers
from workcell.ik.problem import STEP_SLACK
from workcell.model.mechanism.placing import place
from workcell.model.robot import LIMIT_SLACK
from workcell.pose import axis_angle_to_matrix


def random_multipliers(problem, rng, share=0.5):
    """Multipliers of chance, each in its place and of the right sign; half-spaces of hinges are zero."""
    m = Multipliers.none(problem)
    mechanism = problem.mechanism

    def drawn(shape):
        return rng.normal(size=shape) * (rng.uniform() < share)

    for k, joint in enumerate(mechanism.joints):
        if joint.kind == "hinge":
            m.axes[k], m.limits[k] = drawn(3), drawn(3)
        if joint.kind in ("hinge", "ball"):
            m.turns[k] = drawn((3, 3))
        if joint.kind == "ball" and problem.max_step is not None:
            m.steps[k] = drawn((3, 3))
    for c, closure in enumerate(mechanism.closures):
        m.closures[c] = drawn(3)
        if closure.kind == "weld":
            m.welds[c] = drawn((3, 3))
    for g, goal in enumerate(problem.goals):
        if goal.position is not None:
            m.positions[g] = drawn(3)
        if goal.rotation is not None:
            m.rotations[g] = drawn((3, 3))
        if goal.direction is not None and goal.within == 0.0:
            m.directions[g] = drawn(3)
        elif goal.direction is not None:
            m.cones[g] = abs(drawn(()))
    first = 0
    for region in problem.regions:
        z = drawn(len(region.b))
        m.regions[first : first + len(z)] = np.where(region.equal, z, np.abs(z))
        first += len(z)
    if problem.max_link_rotation is not None:
        m.links[:] = np.abs(drawn(len(m.links)))
    elif problem.max_step is not None:
        m.links[1:] = [abs(drawn(())) * (joint.kind == "free") for joint in mechanism.joints]
    return m


def at(problem, graph, m, q, tolerances):
    """(F, slack): the sum of all rows at q, each with the tolerance that the configuration may use up.

    `F` is the sum of multipliers times rows, without tolerances; `slack` what tolerances may take from it.
    """
    mechanism, placed = problem.mechanism, place(problem.mechanism, q)
    position, rotation, closure, region_tolerance = tolerances
    total = 0.0
    for k, joint in enumerate(mechanism.joints):
        before, after = placed.R[joint.parent] @ joint.T_parent_joint.rotation, placed.R[k + 1]
        if joint.kind == "hinge":
            total += m.axes[k] @ (before @ joint.axis - after @ joint.axis)
            e = graph.across[k]
            u = axis_angle_to_matrix(joint.axis, graph.middle[k]) @ e
            assert np.linalg.norm(before @ u - after @ e) <= 2.0 * np.sin(0.5 * graph.half[k]) + 1e-12
            total += np.linalg.norm(m.limits[k]) * 2.0 * np.sin(0.5 * graph.half[k])
            total += m.limits[k] @ (before @ u - after @ e)
        if joint.kind in ("hinge", "ball"):
            middle = np.eye(3)
            if joint.kind == "hinge":
                middle = axis_angle_to_matrix(joint.axis, graph.middle[k])
            apart, most = before @ middle - after, np.sqrt(8.0) * np.sin(0.5 * graph.half[k])
            assert np.linalg.norm(apart) <= most + 1e-12
            total += np.sum(m.turns[k] * apart) + np.linalg.norm(m.turns[k]) * most
        if joint.kind == "ball" and problem.max_step is not None:
            reference = place(mechanism, problem.q_reference).R
            step = np.linalg.norm(problem.max_step[mechanism.rate_slices[k]] + LIMIT_SLACK)
            apart = placed.R[joint.parent] @ reference[joint.parent].T @ reference[k + 1] - after
            most = np.sqrt(8.0) * np.sin(0.5 * min(step, np.pi))
            assert np.linalg.norm(apart) <= most + 1e-12
            total += np.sum(m.steps[k] * apart) + np.linalg.norm(m.steps[k]) * most
    for c, tie in enumerate(mechanism.closures):
        (a, b), (F, G) = tie.links, tie.frames
        total += m.closures[c] @ (placed.point(a, F.position) - placed.point(b, G.position))
        total += 2.0 * closure * np.linalg.norm(m.closures[c])
        total += np.sum(m.welds[c] * (placed.R[a] @ F.rotation - placed.R[b] @ G.rotation))
        total += 5.0 * closure * np.linalg.norm(m.welds[c])
    for g, goal in enumerate(problem.goals):
        frame = mechanism.frame(goal.frame)
        R = placed.R[frame.link] @ frame.T_link_frame.rotation
        p = placed.point(frame.link, frame.T_link_frame.position)
        if goal.position is not None:
            total += m.positions[g] @ (p - goal.position) + position * np.linalg.norm(m.positions[g])
        if goal.rotation is not None:
            total += np.sum(m.rotations[g] * (R - goal.rotation))
            total += np.sqrt(8.0) * np.sin(0.5 * rotation) * np.linalg.norm(m.rotations[g])
        if goal.direction is not None:
            total += m.directions[g] @ (R @ goal.axis - goal.direction)
            total += rotation * np.linalg.norm(m.directions[g])
            total += m.cones[g] * (goal.direction @ R @ goal.axis - np.cos(goal.within + rotation))
    first = 0
    for region in problem.regions:
        frame = mechanism.frame(region.frame)
        p = placed.point(frame.link, frame.T_link_frame.apply(region.point))
        z = m.regions[first : first + len(region.b)]
        first += len(z)
        total += z @ (region.b - region.A @ p) + region_tolerance * np.abs(z).sum()
    if problem.q_reference is not None:
        reference = place(mechanism, problem.q_reference).R
        for link, value in enumerate(m.links):
            bounds = [np.sqrt(8.0)]
            if problem.max_link_rotation is not None:
                bounds.append(problem.max_link_rotation + STEP_SLACK)
            if link and mechanism.joints[link - 1].kind == "free" and problem.max_step is not None:
                step = np.linalg.norm(problem.max_step[mechanism.rate_slices[link - 1]][3:] + LIMIT_SLACK)
                bounds.append(np.sqrt(8.0) * np.sin(0.5 * min(step, np.pi)))
            least = 3.0 - 0.5 * min(bounds) ** 2
            total += value * (np.sum(placed.R[link] * reference[link]) - least)
    return float(total)
