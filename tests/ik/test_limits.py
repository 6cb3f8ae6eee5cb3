"""Limits mean one thing: what judges accept, widened by the slack, is what proofs are about."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tests.ik.arms import gantry, planar
from tests.ik.lifted_arms import seven_axis, skew_arm
from workcell.ik.branch.checker.setup import admissible
from workcell.ik.cidgik.solver import prove_cidgik
from workcell.ik.elementary.bounds import prove_impossible
from workcell.ik.ikspark.solver import solve_ikspark
from workcell.ik.judge.verify import verify
from workcell.ik.problem import STEP_SLACK, Budget, IKProblem, Tolerances
from workcell.ik.registry import solver_names
from workcell.ik.shared.limits import Interval
from workcell.ik.solve import solve
from workcell.model.robot import LIMIT_SLACK, Robot
from workcell.pose import Array, Pose, axis_angle_to_matrix

FINE = Tolerances(1e-9, 1e-9)
"""A thousandth of the slack: nothing that is accepted is so because of them."""


def sliding_in_line() -> Robot:
    """Two slides along x, so that the farthest point is exactly where both are at their upper limits."""
    robot, _ = gantry(0.05)
    return dataclasses.replace(robot, axis=np.tile([1.0, 0.0, 0.0], (2, 1)), lower=np.array([0.2, 0.2]))


def beyond(robot: Robot, share: float) -> tuple[IKProblem, Array]:
    """A target where all joints are a share of the slack beyond their upper limits."""
    q = robot.upper + share * LIMIT_SLACK
    return IKProblem(robot, robot.fk(q), tolerances=FINE), q


ARMS = {
    "turning": lambda: planar((0.5, 0.4, 0.2), 1.2),
    "crossed": lambda: gantry(0.05)[0],
    "in line": sliding_in_line,
}


@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize("share", [0.0, 0.5, 0.999])
def test_what_the_judge_accepts_beyond_a_limit_is_never_proved_impossible(arm: str, share: float) -> None:
    robot = ARMS[arm]()
    problem, q = beyond(robot, share)
    assert verify(problem, q).accepted
    assert prove_impossible(problem) is None
    for solver in solver_names():
        if not robot.prismatic.any() or solver in ("auto", "hjcd", "branch", "multistart"):
            if solver.startswith("cidgik"):
                continue  # refuses arms whose axes are all parallel
            assert not solve(problem, solver, Budget(0.3)).status.is_proof, solver


@pytest.mark.parametrize("arm", ARMS)
def test_beyond_the_slack_nothing_is_accepted(arm: str) -> None:
    problem, q = beyond(ARMS[arm](), 2.0)
    assert not verify(problem, q).within_limits
    lower, upper, _ = admissible(problem)
    assert np.all(q > upper) and np.all(lower < problem.robot.lower)


def test_bounds_against_a_reference_are_those_of_the_judge() -> None:
    robot = planar((0.5, 0.4, 0.2), 2.0)
    reference = np.array([0.1, 0.2, 0.3])
    for name, moved in (("max_step", np.full(3, 0.5)), ("max_link_rotation", np.array([0.5, 0.0, 0.0]))):
        q = reference + moved
        turned = 0.5 if name == "max_step" else float(2.0 * np.sqrt(2.0) * np.sin(0.25))
        problem = IKProblem(
            robot, robot.fk(q), q_reference=reference, tolerances=FINE, **{name: turned - 0.9 * STEP_SLACK}
        )
        assert verify(problem, q).accepted, name
        assert solve_ikspark(problem, Budget(0.5)).certificate is None, name
        assert np.all(Interval.of(problem).half >= 0.0)


def test_a_skew_arm_at_its_limits_is_not_proved_out_of_reach() -> None:
    for seed in range(5):
        robot = skew_arm(seed, 6, spread=1.0)
        problem, q = beyond(robot, 0.999)
        assert verify(problem, q).accepted
        assert prove_cidgik(problem) is None
        assert not solve(problem, "branch", Budget(0.3)).status.is_proof
        assert not solve(problem, "ikspark", Budget(0.3)).status.is_proof


@pytest.mark.parametrize("share", [0.5, 0.99])
def test_what_the_judge_accepts_beside_a_target_is_never_proved_out_of_reach(share: float) -> None:
    for robot, q in ((seven_axis(), np.zeros(7)), (planar((0.5, 0.4, 0.2), 1.2), np.zeros(3))):
        pose, allowed = robot.fk(q), Tolerances()
        outwards = (pose.position - robot.joint_xyz[0]) / np.linalg.norm(pose.position - robot.joint_xyz[0])
        turn = axis_angle_to_matrix(np.array([0.6, 0.0, 0.8]), share * allowed.rotation)
        target = Pose.from_rotation(pose.position + share * allowed.position * outwards, turn @ pose.rotation)
        problem = IKProblem(robot, target, tolerances=allowed)
        assert verify(problem, q).accepted
        assert prove_impossible(problem) is None
        for solver in ("auto", "branch", "ikspark", "cidgik"):
            if solver != "cidgik" or robot.dof == 7:
                assert not solve(problem, solver, Budget(0.5)).status.is_proof, solver
        if robot.dof == 7:
            assert prove_cidgik(problem) is None
