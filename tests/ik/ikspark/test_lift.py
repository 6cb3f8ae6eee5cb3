"""The lifted model: every true configuration lies in it, and its maps are the chain's own kinematics."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.ik.lifted_arms import parallel_elbow, scara, seven_axis, skew_arm
from workcell.errors import InputError
from workcell.ik.ikspark.instance import relaxation_of
from workcell.ik.ikspark.lift import Lift, goal_vector, rotation_map
from workcell.ik.problem import IKProblem
from workcell.ik.shared.limits import Interval
from workcell.model.robot import Robot
from workcell.pose import Pose, quat_to_matrix

ARMS = {
    "seven": seven_axis(),
    "scara": scara(),
    "elbow": parallel_elbow(),
    **{f"skew{n}": skew_arm(n, n) for n in (1, 2, 3, 4, 6, 9)},
}


@given(st.integers(0, 10_000))
def test_quaternion_rotations_are_linear_in_the_block(seed: int) -> None:
    from workcell.ik.shared.conic import svec

    q = np.random.default_rng(seed).standard_normal(4)
    q /= np.linalg.norm(q)
    assert rotation_map() @ svec(np.outer(q, q)) == pytest.approx(quat_to_matrix(q))


@pytest.mark.parametrize("name", ARMS)
def test_configurations_satisfy_every_row(name: str) -> None:
    robot = ARMS[name]
    rng = np.random.default_rng(1)
    for _ in range(5):
        q = robot.random_configuration(rng)
        problem = IKProblem(robot, robot.fk(q))
        relaxation = relaxation_of(problem)
        x = np.append(relaxation.lift.lift(q), 1.0)
        s = relaxation.tensor(Interval.of(problem), problem) @ goal_vector(problem.T_base_tool) @ x
        cones = relaxation.cones
        assert s[: cones.zero] == pytest.approx(np.zeros(cones.zero), abs=1e-9)
        assert np.all(s[cones.zero : cones.zero + cones.nonneg] >= -1e-9)
        for cone in s[cones.zero + cones.nonneg :].reshape(-1, 4):
            assert cone[0] >= np.linalg.norm(cone[1:]) - 1e-9


@pytest.mark.parametrize("name", ARMS)
def test_maps_are_the_chain_s_kinematics(name: str) -> None:
    robot, rng = ARMS[name], np.random.default_rng(2)
    lift = Lift(robot)
    q = robot.random_configuration(rng)
    goal, x = goal_vector(robot.fk(q)), np.append(lift.lift(q), 1.0)
    T = robot.link_transforms(q)
    assert lift.at(lift.rotations, goal) @ x == pytest.approx(T[:, :3, :3], abs=1e-9)
    assert lift.at(lift.origins, goal) @ x == pytest.approx(T[:, :3, 3], abs=1e-9)
    place = rng.standard_normal(3)
    link = robot.dof // 2
    assert lift.at(lift.point(link, place), goal) @ x == pytest.approx(
        T[link, :3, :3] @ place + T[link, :3, 3]
    )
    turned = lift.angles(x[:-1], goal) - q
    assert np.exp(1j * turned) == pytest.approx(np.ones(robot.dof), abs=1e-7)


def test_the_base_pose_is_taken_out() -> None:
    from dataclasses import replace

    robot = seven_axis()
    moved = replace(robot, T_world_base=Pose(np.array([1.0, -2.0, 0.5]), np.array([0.5, 0.5, -0.5, 0.5])))
    q = robot.random_configuration(np.random.default_rng(0))
    a, b = IKProblem(robot, robot.fk(q)), IKProblem(moved, moved.fk(q))
    assert goal_vector(a.T_base_tool) == pytest.approx(goal_vector(b.T_base_tool))
    assert Lift(moved).lift(q) == pytest.approx(Lift(robot).lift(q))
    assert relaxation_of(a) is relaxation_of(b)


def blocks(robot: Robot) -> tuple[int, int]:
    lift = Lift(robot)
    return len(lift.balls), len(lift.discs)


def test_facial_reduction() -> None:
    assert blocks(seven_axis()) == (4, 2)
    assert blocks(parallel_elbow()) == (3, 2)
    assert blocks(scara()) == (0, 2)
    assert blocks(skew_arm(0, 1)) == (0, 1)
    assert blocks(skew_arm(0, 2)) == (0, 1)
    assert blocks(skew_arm(0, 3)) == (0, 2)
    # parallel axes next to the base keep the following link planar as well
    from tests.ik.lifted_arms import X, Y, Z, arm

    offsets = [[0.2, 0, 0.1]] * 5
    assert blocks(arm([Z, Z, X, Y, Z], offsets, [-2] * 5, [2] * 5)) == (1, 3)


def test_prismatic_joints_are_refused_by_name() -> None:
    from dataclasses import replace

    robot = replace(seven_axis(), prismatic=np.arange(7) == 3)
    with pytest.raises(InputError, match="'j3' is prismatic"):
        Lift(robot)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000))
def test_steps_and_link_rotations_hold_at_the_reference(seed: int) -> None:
    robot = seven_axis()
    rng = np.random.default_rng(seed)
    reference = robot.random_configuration(rng)
    q = np.clip(reference + rng.uniform(-0.1, 0.1, 7), robot.lower, robot.upper)
    R0, R1 = (robot.link_transforms(at)[:, :3, :3] for at in (reference, q))
    turned = np.linalg.norm(R1 - R0, axis=(1, 2)).max()
    for bound, kept in (
        (turned + 1e-6, True),
        (0.9 * np.linalg.norm((R1 - R0)[1:-1], axis=(1, 2)).max(), False),
    ):
        problem = IKProblem(
            robot, robot.fk(q), q_reference=reference, max_step=0.11, max_link_rotation=float(bound)
        )
        relaxation = relaxation_of(problem)
        x = np.append(relaxation.lift.lift(q), 1.0)
        s = relaxation.tensor(Interval.of(problem), problem) @ goal_vector(problem.T_base_tool) @ x
        zero, nonneg = relaxation.cones.zero, relaxation.cones.nonneg
        assert bool(np.all(s[zero : zero + nonneg] >= -1e-9)) is kept
        cones = s[zero + nonneg :].reshape(-1, 4)
        assert np.all(cones[:, 0] >= np.linalg.norm(cones[:, 1:], axis=1))
