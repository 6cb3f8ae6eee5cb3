"""Chains as questions: whatever answers the whole answers each of them, also at the ends of tolerances."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.ik.mechanisms.cases import four_bar, platform
from workcell.ik.judge.verify import verify
from workcell.ik.mechanisms.chains.query import NoChainError, chain_query
from workcell.ik.mechanisms.chains.ways import Way, ways
from workcell.ik.mechanisms.goals import FrameGoal
from workcell.ik.mechanisms.judge import judge_mechanism
from workcell.ik.mechanisms.problem import MechanismProblem, MechanismTolerances
from workcell.model.mechanism.mechanism import Closure, Frame, Joint, Mechanism
from workcell.model.mechanism.placing import place
from workcell.pose import Pose, axis_angle_to_matrix

TOLERANCES = MechanismTolerances(0.01, 0.02, 0.015)
KINDS = ("hinge", "slide", "hinge", "ball")


def unit(rng, size=3):
    v = rng.normal(size=size)
    return v / np.linalg.norm(v)


def pose(rng, size=0.3):
    return Pose(size * rng.normal(size=3), unit(rng, 4))


def small(rng, metres, radians):
    """A transform of just so many metres and radians."""
    return Pose.from_rotation(metres * unit(rng), axis_angle_to_matrix(unit(rng), radians))


def loop(seed: int, tie: str = "weld", *, balls: bool = False):
    """Two branches on the world and one on the first, tied so that a random configuration misses by all that it may."""
    rng = np.random.default_rng(seed)
    parents = (0, 1, 2, 0, 4, 5, 3)
    kinds = [("ball" if balls and k in (1, 4) else KINDS[int(rng.integers(3))]) for k in range(len(parents))]
    joints = tuple(
        Joint(
            f"j{k}",
            kind,
            parent,
            pose(rng),
            unit(rng) if kind != "ball" else np.zeros(3),
            -np.inf if kind == "hinge" and k == 3 else -1.5,
            np.inf if kind == "hinge" and k == 3 else (np.pi if kind == "ball" else 1.5),
        )
        for k, (kind, parent) in enumerate(zip(kinds, parents, strict=True))
    )
    joints = tuple(replace(j, lower=0.0) if j.kind == "ball" else j for j in joints)
    frames = {"end": Frame("end", 7, pose(rng)), "other": Frame("other", 6, pose(rng))}
    open_chain = Mechanism("loop", joints, ("world", *(f"l{k}" for k in range(7))), frames=frames)
    q = np.concatenate(
        [unit(rng, 4) if joint.kind == "ball" else rng.uniform(-1.5, 1.5, 1) for joint in joints]
    )
    placed = place(open_chain, q)
    F = pose(rng)
    T = [Pose.from_rotation(placed.p[link], placed.R[link]) for link in range(8)]
    C = 0.999 * TOLERANCES.closure
    G = T[6].inverse() @ T[3] @ F @ small(rng, C, 0.0 if tie == "connect" else C)
    if tie == "connect":
        G = Pose(G.position, unit(rng, 4))
    closure = Closure("tie", tie, (3, 6), (F, G))
    return replace(open_chain, closures=(closure,)), q, rng


def goal_missed(mechanism, q, rng, kind: str, frame: str) -> FrameGoal:
    """A goal that a configuration misses by all that it may."""
    placed, at = place(mechanism, q), mechanism.frame(frame)
    here = Pose.from_rotation(placed.p[at.link], placed.R[at.link]) @ at.T_link_frame
    away, turned = 0.999 * TOLERANCES.position, 0.999 * TOLERANCES.rotation
    there = Pose.from_rotation(
        here.position + away * unit(rng), here.rotation @ axis_angle_to_matrix(unit(rng), turned)
    )
    if kind == "pose":
        return FrameGoal.posed(frame, there)
    if kind == "position":
        return FrameGoal.at(frame, there.position)
    axis, within = unit(rng), 0.1 * float(rng.integers(2))
    about = np.cross(axis, unit(rng))
    tilted = axis_angle_to_matrix(about / np.linalg.norm(about), within + turned) @ axis
    return FrameGoal.pointing(frame, here.rotation @ tilted, axis, position=there.position, within=within)


@pytest.mark.parametrize("frame", ["end", "other"])
@pytest.mark.parametrize("kind", ["pose", "position", "axis"])
def test_an_answer_of_the_whole_answers_every_chain(kind, frame):
    looked = 0
    for seed in range(12):
        mechanism, q, rng = loop(seed)
        goal = goal_missed(mechanism, q, rng, kind, frame)
        problem = MechanismProblem(mechanism, (goal,), tolerances=TOLERANCES)
        assert judge_mechanism(problem, q).accepted
        found = ways(problem)
        assert len(found) == 2
        for way in found:
            query = chain_query(problem, way)
            assert query.problem.goal == kind
            values = np.array([q[mechanism.value_slices[k].start] for k in query.values])
            wide = np.where(query.problem.robot.prismatic, values, (values + np.pi) % (2 * np.pi) - np.pi)
            wide = np.where(query.problem.robot.upper < np.pi, values, wide)
            verdict = verify(query.problem, wide)
            assert verdict.accepted, verdict.reasons
            looked += len(mechanism.joints) in way.edges
    assert looked == 12


def test_the_tolerances_of_a_chain_are_not_wide():
    mechanism, q, rng = loop(3)
    tight = MechanismTolerances(1e-6, 1e-6, 1e-6)
    problem = MechanismProblem(mechanism, (goal_missed(mechanism, q, rng, "pose", "end"),), tolerances=tight)
    for way in ways(problem):
        allowed = chain_query(problem, way).problem.tolerances
        assert allowed.position < 4e-5 and allowed.rotation < 2e-5


def test_the_point_of_a_connect_is_where_the_goal_of_its_link_has_it():
    for seed in range(10):
        mechanism, q, rng = loop(seed, "connect")
        goal = goal_missed(mechanism, q, rng, "pose", "other")
        problem = MechanismProblem(mechanism, (goal,), tolerances=TOLERANCES)
        assert judge_mechanism(problem, q).accepted
        way = next(way for way in ways(problem) if way.edges[-1] == len(mechanism.joints))
        query = chain_query(problem, way)
        assert query.problem.goal == "position" and query.values == (0, 1, 2)
        assert verify(query.problem, q[:3]).accepted


def test_balls_on_the_way_are_three_hinges():
    """An arm of a hinge, a ball and a slide: some values of three hinges put the chain where the ball has it."""
    for seed in range(6):
        mechanism, q, rng = loop(seed, balls=True)
        goal = goal_missed(mechanism, q, rng, "pose", "end")
        problem = MechanismProblem(mechanism, (goal,), tolerances=TOLERANCES)
        way = ways(problem)[0]
        assert way.edges == (0, 1, 2, 6)
        query = chain_query(problem, way)
        assert query.values == (0, -1, -1, -1, 2, 6)
        S = Pose(np.zeros(3), q[mechanism.value_slices[1]]).rotation
        b = np.arcsin(np.clip(S[0, 2], -1.0, 1.0))
        turns = np.arctan2(-S[1, 2], S[2, 2]), b, np.arctan2(-S[0, 1], S[0, 0])
        at = [q[mechanism.value_slices[k].start] for k in (0, 2, 6)]
        assert verify(query.problem, np.array([at[0], *turns, at[1], at[2]])).accepted


def test_a_step_cuts_the_limits_of_a_chain():
    mechanism, q, rng = loop(1)
    goal = goal_missed(mechanism, q, rng, "pose", "end")
    problem = MechanismProblem(mechanism, (goal,), q_reference=q, max_step=0.1, tolerances=TOLERANCES)
    for way in ways(problem):
        query = chain_query(problem, way)
        at = np.array([q[mechanism.value_slices[k].start] for k in query.values])
        assert np.all(query.problem.robot.lower >= at - 0.1) and np.all(query.problem.robot.upper <= at + 0.1)
        assert verify(query.problem, at).accepted


@pytest.mark.parametrize(
    "way",
    [
        Way((), 0),
        Way((0,), 0),
        Way((1, 2), 0),
        Way((0, 1, 2, 6, 6), 0),
        Way((0, 1, 2, 6), 1),
        Way((0, 1, 2, 6), -1),
        Way((0, 1, 2, 99), 0),
        Way((-1, 1, 2, 6), 0),
        Way((0,) * 40, 0),
    ],
)
def test_ways_that_are_none_are_refused(way):
    mechanism, q, rng = loop(1)
    goal = goal_missed(mechanism, q, rng, "pose", "end")
    with pytest.raises(NoChainError):
        chain_query(MechanismProblem(mechanism, (goal,), tolerances=TOLERANCES), way)


def test_what_no_chain_can_be_about_is_refused():
    mechanism, q, rng = loop(1)
    goal = goal_missed(mechanism, q, rng, "pose", "end")
    way = Way((0, 1, 2, 6), 0)
    longer = tuple(replace(joint, axis=1.001 * joint.axis) for joint in mechanism.joints)
    sheared = replace(goal, rotation=np.array(goal.rotation) + 1e-6)
    for changed in (
        {"goals": (sheared,)},
        {"goals": (FrameGoal.turned("end", [1.0, 0.0, 0.0, 0.0]),)},
        {"goals": (replace(goal, rotation=None, axis=np.array([0.0, 0.0, 1.1]), direction=np.eye(3)[2]),)},
        {"tolerances": MechanismTolerances(closure=0.2)},
        {"mechanism": replace(mechanism, joints=longer)},
    ):
        with pytest.raises(NoChainError):
            chain_query(replace(MechanismProblem(mechanism, (goal,)), **changed), way)


def test_legs_of_a_platform_are_chains_to_their_connects():
    mechanism = platform()
    problem = MechanismProblem(mechanism, (FrameGoal.posed("tool", Pose.from_xyz([0.0, 0.0, 0.55])),))
    found = ways(problem)
    assert len(found) == 6
    for way in found:
        query = chain_query(problem, way)
        assert query.problem.goal == "position" and query.problem.robot.dof == 4


def test_loops_have_a_way_around():
    mechanism = four_bar()
    problem = MechanismProblem(mechanism, (FrameGoal.at("tip", [0.4, 0.1, 0.0]),))
    edges = {way.edges for way in ways(problem)}
    assert edges == {(0, 1), (2, 3)}
    around = chain_query(problem, Way((2, 3), 0)).problem
    assert around.robot.dof == 4  # the rocker, and the connect as three hinges
