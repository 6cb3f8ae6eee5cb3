"""Chains decide what two arms on one bar can reach: as branch and bound says of each arm by itself."""

from __future__ import annotations

import numpy as np

from workcell.bench.ik.mechanisms.baxter import goal_poses, problems_of, reachable
from workcell.ik.mechanisms.check import check_mechanism
from workcell.ik.mechanisms.judge import judge_mechanism
from workcell.ik.problem import Budget
from workcell.ik.result import Status
from workcell.ik.solve_mechanism import solve_mechanism


def test_two_arms_on_a_bar_are_decided_one_by_one():
    poses = goal_poses(12, 0)
    truth, problems = reachable(poses, 0), problems_of(poses)
    assert truth.count(False) >= 3 and truth.count(True) >= 6
    for can, problem in zip(truth, problems, strict=True):
        result = solve_mechanism(problem, solver="chains", budget=Budget(20.0, effort=5.0))
        if can is False:
            assert result.status is Status.UNREACHABLE
            assert check_mechanism(problem, result.certificate) is None
        elif can is True:
            assert result.status in (Status.SOLVED, Status.NOT_FOUND)
            if result.solved:
                assert judge_mechanism(problem, result.q).accepted


def test_in_turns_a_chain_proves_what_the_relaxation_leaves_open():
    poses = goal_poses(12, 0)
    impossible = [
        problem for can, problem in zip(reachable(poses, 0), problems_of(poses), strict=True) if can is False
    ]
    kinds = set()
    for problem in impossible:
        result = solve_mechanism(problem, solver="auto", budget=Budget(30.0))
        assert result.status is Status.UNREACHABLE
        kinds.add(result.certificate.kind)
    assert "mechanism_chain/1" in kinds


def test_an_answer_keeps_what_no_chain_passes_where_it_was():
    problem = problems_of(goal_poses(2, 0))[1]
    result = solve_mechanism(problem, solver="chains", budget=Budget(20.0))
    assert result.solved and result.measured.closure_error < 1e-6
    passed = {k for k, joint in enumerate(problem.mechanism.joints) if joint.kind == "hinge"}
    moved = {
        k
        for k, at in enumerate(problem.mechanism.value_slices)
        if np.abs(result.q[at] - problem.mechanism.home[at]).max() > 1e-9
    }
    assert moved <= passed | {len(problem.mechanism.joints) - 1}
