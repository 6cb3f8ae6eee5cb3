"""The chain of proofs: that of the robot, and the quadratic forms of quaternions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.ik.lifted_arms import seven_axis, skew_arm
from workcell.ik.claims.chain import Chain, quaternion_forms, rotation_sums, skew, unsuited
from workcell.ik.problem import IKProblem
from workcell.model.robot import LIMIT_SLACK
from workcell.pose import Pose, quat_to_matrix


def test_the_chain_is_that_of_the_robot() -> None:
    robot = skew_arm(5, 5)
    rng = np.random.default_rng(0)
    q = robot.random_configuration(rng)
    chain = Chain.of(IKProblem(robot, robot.fk(q)))
    R, origin = np.eye(3), np.zeros(3)
    for k in range(chain.joints):
        a = chain.axis[k]
        turn = np.eye(3) + np.sin(q[k]) * skew(a) + (1 - np.cos(q[k])) * skew(a) @ skew(a)
        before = R
        origin, R = origin + R @ chain.xyz[k], R @ chain.turn[k] @ turn
        assert np.allclose(before @ chain.along[k], R @ a)
        assert np.isclose(chain.across[k] @ a, 0.0) and np.isclose(np.linalg.norm(chain.across[k]), 1.0)
        cosine = (before @ chain.turned[k]) @ (R @ chain.across[k])
        assert np.isclose(cosine, np.cos(q[k] - chain.middle[k]))
    assert np.allclose(R, chain.last)
    assert np.allclose(origin + R @ chain.tool, chain.position)
    assert np.allclose(chain.half, np.minimum(0.5 * (robot.upper - robot.lower) + LIMIT_SLACK, np.pi))


def test_steps_narrow_the_intervals() -> None:
    robot = seven_axis()
    q = np.full(7, 0.1)
    chain = Chain.of(IKProblem(robot, robot.fk(q), q_reference=q, max_step=0.2))
    assert np.allclose(chain.middle, 0.1) and np.allclose(chain.half, 0.2 + LIMIT_SLACK)


def test_forms_of_quaternions_are_rotations() -> None:
    rng = np.random.default_rng(1)
    quats = rng.standard_normal((20, 4))
    quats /= np.linalg.norm(quats, axis=1)[:, None]
    R, N = quat_to_matrix(quats), rng.standard_normal((20, 3, 3))
    forms = np.einsum("ki,kij,kj->k", quats, quaternion_forms(N), quats)
    assert np.allclose(forms, np.sum(N * R, axis=(1, 2)))
    outer = quats[:, :, None] * quats[:, None, :]
    assert np.allclose(rotation_sums(outer), R)
    assert np.allclose(0.25 * (quaternion_forms(R) + np.eye(4)), outer)
    P = rng.standard_normal((20, 4, 4))
    P = P + np.swapaxes(P, 1, 2)
    assert np.allclose(
        np.sum(rotation_sums(P) * N, axis=(1, 2)), np.sum(P * quaternion_forms(N), axis=(1, 2))
    )


def test_robots_that_rounding_is_not_accounted_for_are_refused() -> None:
    robot = seven_axis()
    here = IKProblem(robot, robot.fk(np.zeros(7)))
    assert unsuited(here) is None
    assert "reach" in str(unsuited(replace(here, target=Pose.from_xyz([60.0, 0.0, 0.0]))))
    sliding = replace(robot, prismatic=np.arange(7) == 2)
    assert "turning joints" in str(unsuited(replace(here, robot=sliding)))
