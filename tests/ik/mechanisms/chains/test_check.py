"""Certificates about chains: made where one can't do what is asked, checked again, refused when they say more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.ik.mechanisms.cases import four_bar, platform
from tests.ik.mechanisms.chains.test_query import loop
from workcell.ik.branch.mechanisms import solve_mechanism_chains
from workcell.ik.certificate import Certificate
from workcell.ik.mechanisms.chains.check import check_chain
from workcell.ik.mechanisms.check import check_mechanism
from workcell.ik.mechanisms.goals import FrameGoal
from workcell.ik.mechanisms.problem import MechanismProblem, MechanismTolerances
from workcell.ik.problem import Budget
from workcell.ik.result import Status
from workcell.ik.solve_mechanism import solve_mechanism
from workcell.model.mechanism.placing import place
from workcell.pose import Pose


def out_of_reach(seed: int = 2) -> MechanismProblem:
    mechanism, q, _ = loop(seed)
    end, placed = mechanism.frame("end"), place(mechanism, q)
    position = placed.point(end.link, end.T_link_frame.position) + np.array([0.0, 6.0, 0.0])
    return MechanismProblem(mechanism, (FrameGoal("end", position, placed.R[end.link]),))


@pytest.fixture(scope="module")
def proved() -> tuple[MechanismProblem, Certificate]:
    problem = out_of_reach()
    certificate = solve_mechanism_chains(problem, Budget(20.0)).certificate
    assert certificate is not None
    return problem, certificate


def test_a_proof_holds_and_survives_being_saved(proved):
    problem, certificate = proved
    assert certificate.kind == "mechanism_chain/1" and certificate.scope == "kinematics"
    for one in (certificate, Certificate.from_json(certificate.to_json())):
        assert check_mechanism(problem, one) is None and check_chain(problem, one) is None


def test_it_is_about_its_own_question_alone(proved):
    problem, certificate = proved
    goal = problem.goals[0]
    others = [
        replace(problem, goals=(replace(goal, position=goal.position - np.array([0.0, 6.0, 0.0])),)),
        replace(problem, tolerances=MechanismTolerances(position=2e-4)),
        replace(problem, goals=(goal, goal)),
        out_of_reach(5),
    ]
    for other in others:
        assert check_mechanism(other, certificate) == "it belongs to another problem"


def test_forged_ones_are_refused(proved):
    problem, certificate = proved
    data = dict(certificate.data)

    def changed(**arrays) -> Certificate:
        return replace(certificate, data={**data, **arrays})

    other_way = data["way"][:-1] if len(data["way"]) > 1 else data["way"] + 1
    forged = {
        "another way": changed(way=other_way),
        "a way of halves": changed(way=data["way"] + 0.5),
        "an endless way": changed(way=np.zeros(4000)),
        "no way": changed(way=np.zeros(0)),
        "another goal": changed(goal=np.ones(1)),
        "a goal from behind": changed(goal=-np.ones(1)),
        "another tree": changed(tree=np.array([-1.0]), splits=np.zeros(0)),
        "another root": changed(root=0.5 * data["root"]),
        "another seal": changed(seal=data["seal"] + 1.0),
        "collisions": changed(blocked=np.zeros((2, 1))),
        "wider": changed(inflation=2.0 * data["inflation"]),
        "an array more": changed(more=np.zeros(1)),
        "an array less": replace(certificate, data={k: v for k, v in data.items() if k != "seal"}),
        "other words": replace(certificate, statement=certificate.statement.replace("goal 0", "goal 1")),
        "a larger margin": replace(certificate, margin=1.0),
        "another scope": replace(certificate, scope="geometry"),
        "another kind": replace(certificate, kind="mechanism/1"),
    }
    if len(data["tree"]) == 1:
        del forged["another tree"]
    for name, one in forged.items():
        assert check_mechanism(problem, one) is not None, name


@pytest.mark.parametrize("seed", range(6))
def test_no_chain_is_said_to_fail_where_the_whole_has_an_answer(seed):
    mechanism, q, _ = loop(seed)
    problem = MechanismProblem(mechanism, tolerances=MechanismTolerances(1e-3, 1e-2, 0.02))
    end, placed = mechanism.frame("end"), place(mechanism, q)
    here = placed.point(end.link, end.T_link_frame.position)
    goal = FrameGoal("end", here, placed.R[end.link] @ end.T_link_frame.rotation)
    found = solve_mechanism_chains(replace(problem, goals=(goal,)), Budget(10.0, effort=1.0))
    assert found.certificate is None


def test_a_leg_that_is_too_short_proves_that_a_platform_can_t_get_there():
    mechanism = platform()
    far = MechanismProblem(mechanism, (FrameGoal.posed("tool", Pose.from_xyz([0.0, 0.0, 0.95])),))
    result = solve_mechanism(far, solver="chains", budget=Budget(10.0))
    assert result.status is Status.UNREACHABLE and result.certificate.kind == "mechanism_chain/1"
    near = MechanismProblem(mechanism, (FrameGoal.posed("tool", Pose.from_xyz([0.02, 0.0, 0.58])),))
    assert solve_mechanism(near, solver="chains", budget=Budget(20.0)).status is not Status.UNREACHABLE


def test_what_the_coupler_of_a_four_bar_can_t_reach_is_proved_along_either_side():
    mechanism = four_bar()
    far = MechanismProblem(mechanism, (FrameGoal.at("tip", [0.75, 0.1, 0.0]),))
    result = solve_mechanism(far, solver="chains", budget=Budget(10.0))
    assert result.status is Status.UNREACHABLE
    told = solve_mechanism(far, solver="auto", budget=Budget(10.0))
    assert told.status is Status.UNREACHABLE


def test_questions_without_a_chain_are_not_answered():
    mechanism, _, _ = loop(1)
    problem = MechanismProblem(mechanism, (FrameGoal.turned("end", [1.0, 0.0, 0.0, 0.0]),))
    found = solve_mechanism_chains(problem, Budget(1.0))
    assert found.q is None and found.certificate is None and "no serial chain" in found.rejected[0]
