"""The plain cvxpy model is the oracle: same optimal values, same verdicts."""

from __future__ import annotations

from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest

from tests.ik.arms import beads
from tests.ik.lifted_arms import parallel_elbow, scara, seven_axis, skew_arm
from workcell.errors import InputError
from workcell.geometry.types import FreePolytope, FreeSpace
from workcell.ik.ikspark.instance import instance_of
from workcell.ik.ikspark.obstacles.cuboids import whole_set
from workcell.ik.ikspark.plain import PlainModel, relaxation
from workcell.ik.problem import IKProblem
from workcell.pose import Pose

TIGHT = {"tol_gap_abs": 1e-9, "tol_gap_rel": 1e-9, "tol_feas": 1e-9}


def objective(problem: IKProblem, model: PlainModel, lift_maps, seed: int):
    """A random linear function of the unknown rotations and of a point: for cvxpy, and over (x, 1)."""
    robot, rng = problem.robot, np.random.default_rng(seed)
    weights = rng.standard_normal((robot.dof + 1, 3, 3))
    weights[[0, -1]] = 0.0
    direction, place = rng.standard_normal((2, 3))
    link = robot.dof // 2
    expression = sum(cp.sum(cp.multiply(weights[k], model.rotations[k])) for k in range(1, robot.dof))
    expression = expression + direction @ model.point(link, place)
    lift, goal = lift_maps
    base = robot.T_world_base
    row = np.einsum("kab,ac,kcbx->x", weights, base.rotation, lift.at(lift.rotations, goal))
    row = row + direction @ base.rotation @ lift.at(lift.point(link, place), goal)
    row[-1] += direction @ base.position
    return expression, row


def minimum(problem: IKProblem, seed: int) -> tuple[float, str]:
    plain, model = relaxation(problem)
    with instance_of(problem, tolerance=1e-9) as instance:
        expression, row = objective(problem, model, (instance.lift, instance.goal), seed)
        oracle = cp.Problem(cp.Minimize(expression), plain.constraints)
        oracle.solve(solver="CLARABEL", **TIGHT)
        solution = instance.solve(row[:-1])
        if oracle.status == "infeasible":
            return np.nan, solution.status
        assert oracle.status == "optimal"
        assert solution.status == "solved"
        return oracle.value - (solution.dual_objective + row[-1]), solution.status


BASE = Pose(np.array([0.3, -0.2, 0.5]), np.array([0.5, 0.5, 0.5, -0.5]))
ARMS = [
    seven_axis(),
    replace(seven_axis(1.2), T_world_base=BASE),
    parallel_elbow(),
    skew_arm(4, 4),
    skew_arm(6, 6),
]


@pytest.mark.parametrize("robot", ARMS, ids=lambda robot: f"{robot.name}{robot.dof}")
def test_optimal_values_agree(robot) -> None:
    rng = np.random.default_rng(1)
    for seed in range(2):
        problem = IKProblem(robot, robot.fk(robot.random_configuration(rng)))
        difference, _ = minimum(problem, seed)
        assert abs(difference) < 1e-6


def test_optimal_values_agree_next_to_a_reference() -> None:
    robot, rng = seven_axis(), np.random.default_rng(2)
    reference = rng.uniform(-2, 2, 7)
    target = robot.fk(reference + rng.uniform(-0.1, 0.1, 7))
    problem = IKProblem(robot, target, q_reference=reference, max_step=0.3, max_link_rotation=0.6)
    assert abs(minimum(problem, 0)[0]) < 1e-6


@pytest.mark.parametrize(
    "robot", [seven_axis(), parallel_elbow(), scara(), skew_arm(6, 6)], ids=lambda r: r.name
)
def test_both_find_far_targets_infeasible(robot) -> None:
    target = robot.fk(np.zeros(robot.dof))
    problem = IKProblem(robot, Pose(target.position + 3.0 * np.eye(3)[0], target.quat_wxyz))
    plain, _ = relaxation(problem)
    plain.solve(solver="CLARABEL")
    assert plain.status == "infeasible"
    with instance_of(problem) as instance:
        assert (
            instance.contradiction is not None
            or instance.solve(np.zeros(instance.lift.size)).status == "infeasible"
        )


def cut_off(lower, upper) -> FreePolytope:
    """A box without one of its corners."""
    A = np.vstack([np.eye(3), -np.eye(3), np.full((1, 3), 3**-0.5)])
    corner = float(A[-1] @ upper) - 0.2 * float(np.linalg.norm(upper - lower))
    return FreePolytope(A, np.concatenate([upper, -lower, [corner]]), 0.0)


@pytest.mark.parametrize("polytopes", [False, True])
@pytest.mark.parametrize("feasible", [True, False])
def test_values_and_verdicts_agree_with_regions(feasible: bool, polytopes: bool) -> None:
    robot, rng = seven_axis(), np.random.default_rng(3)
    q = rng.uniform(-1.5, 1.5, 7)
    cover = beads(robot, 0.04)
    centres = cover.centres_world(robot.link_transforms(q))
    size = np.array([0.3, 0.25, 0.2]) if feasible else np.array([0.05, 0.05, 0.05])
    middle = centres[::3] if feasible else centres[::5]
    lower, upper = middle - size, middle + size
    space = FreeSpace(lower, upper)
    if polytopes:
        space = FreeSpace(lower[::2], upper[::2], polytopes=tuple(map(cut_off, lower[1::2], upper[1::2])))
    problem = IKProblem(robot, robot.fk(q), cover=cover, free_space=space)
    plain, model = relaxation(problem)
    with instance_of(problem) as instance:
        expression, row = objective(problem, model, (instance.lift, instance.goal), 5)
        oracle = cp.Problem(cp.Minimize(expression), plain.constraints)
        oracle.solve(solver="CLARABEL", **TIGHT)
        cuboids = whole_set(instance, problem, problem.free_space, tolerance=1e-8)
        if not feasible:
            assert oracle.status == "infeasible"
            assert cuboids is None or cuboids.solve(row[:-1]).status == "infeasible"
            return
        solution = cuboids.solve(row[:-1])
        assert (oracle.status, solution.status) == ("optimal", "solved")
        assert abs(oracle.value - solution.dual_objective - row[-1]) < 1e-6


def test_a_user_s_own_constraint() -> None:
    robot = seven_axis()
    q = np.array([0.3, 0.6, -0.4, 1.2, 0.2, 0.8, 0.0])
    problem = IKProblem(robot, robot.fk(q))
    plain, model = relaxation(problem)
    elbow = robot.link_transforms(q)[4, :3, 3]
    kept = cp.Problem(cp.Minimize(0), [*plain.constraints, model.point(4, np.zeros(3))[2] >= elbow[2] - 1e-3])
    kept.solve(solver="CLARABEL")
    assert kept.status == "optimal"
    broken = cp.Problem(cp.Minimize(0), [*plain.constraints, model.point(4, np.zeros(3))[2] >= 2.0])
    broken.solve(solver="CLARABEL")
    assert broken.status == "infeasible"


def test_refusals() -> None:
    robot = replace(seven_axis(), prismatic=np.arange(7) == 1)
    with pytest.raises(InputError, match="revolute"):
        relaxation(IKProblem(robot, Pose.identity()))
