"""The quick look before elementary proofs never passes over a target that has one."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.ik.arms import beads, box, random_arm
from workcell.ik.elementary.bounds import prove_impossible
from workcell.ik.elementary.screen import may_be_impossible
from workcell.ik.problem import IKProblem, Tolerances
from workcell.pose import Pose


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.3, 4.0), st.sampled_from([1, 2, 6, 7, 9]))
def test_no_proof_is_passed_over(seed, stretch, dof):
    rng = np.random.default_rng(seed)
    robot = random_arm(rng, dof, sliding=bool(seed % 2))
    reached = robot.fk(robot.random_configuration(rng))
    base = robot.T_world_base.position
    target = Pose(base + stretch * (reached.position - base), reached.quat_wxyz)
    pieces = tuple(
        box(f"box {k}", tuple(target.position + rng.normal(size=3) * 0.3), (0.1, 0.1, 0.1)) for k in range(4)
    )
    margin = Tolerances(safety_margin=float(rng.uniform(0.0, 0.02)))
    problem = IKProblem(robot, target, pieces, beads(robot), tolerances=margin)
    assert may_be_impossible(problem) or prove_impossible(problem) is None


def test_most_reachable_targets_are_passed_over():
    rng = np.random.default_rng(0)
    robot = random_arm(rng, 7)
    targets = [robot.fk(robot.random_configuration(rng)) for _ in range(50)]
    assert not any(may_be_impossible(IKProblem(robot, target)) for target in targets)
    far = Pose(robot.T_world_base.position + np.array([9.0, 0, 0]), targets[0].quat_wxyz)
    assert may_be_impossible(IKProblem(robot, far))
