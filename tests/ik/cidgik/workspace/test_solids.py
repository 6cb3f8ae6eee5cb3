"""CIDGIK among boxes and the like: rows for spheres that cover them, where these are broken; planes by name."""

from __future__ import annotations

import warnings
from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest

from tests.ik.arms import beads, box, hugged
from tests.ik.lifted_arms import seven_axis
from workcell.bench.ik.cidgik_scaling import long_arm
from workcell.geometry.types import Piece
from workcell.ik.cidgik.instance import Instance
from workcell.ik.cidgik.model import fastest_relaxation_at, relaxation_at
from workcell.ik.cidgik.plain import relaxation
from workcell.ik.cidgik.solver import solve_cidgik
from workcell.ik.cidgik.workspace.keeper import Keeper
from workcell.ik.cidgik.workspace.solids import OVERSHOOT, Solids, SolidSpheres
from workcell.ik.judge.exact import ExactDistances, ExactKinematics, smallest_clearance
from workcell.ik.judge.verify import verify
from workcell.ik.problem import Budget, Clearance, IKProblem
from workcell.ik.registry import is_planned_by
from workcell.ik.result import Status
from workcell.ik.solve import solve
from workcell.ik.trees.query import Goal, Query
from workcell.pose import Pose

ROBOT = seven_axis()
COVER = beads(ROBOT, 0.05)
Q = np.array([0.3, 0.6, -0.2, 1.0, 0.4, 0.8, 0.5])
MOVABLE = 6
"""A sphere that neither the base nor the goal fixes."""


def clearance(problem: IKProblem, q: np.ndarray) -> float:
    assert problem.cover is not None
    rotation, position = ExactKinematics(problem.robot).links(q)
    return smallest_clearance(problem.cover, rotation, position, ExactDistances(problem.obstacles))[0]


def centre_of(sphere: int) -> np.ndarray:
    return COVER.centres_world(ROBOT.link_transforms(Q))[sphere]


def place(x: float, y: float, z: float) -> Pose:
    """Beside a sphere of the arm at Q."""
    return Pose.from_xyz(centre_of(MOVABLE) + np.array([x, y, z]))


def beside(gap: float, kind: str = "box") -> Piece:
    """A solid under a sphere of the arm at Q, `gap` metres from it."""
    below = centre_of(MOVABLE) - [0.0, 0.0, 0.05 + gap]
    if kind == "halfspace":
        return Piece("floor", "halfspace", Pose.from_xyz(below), np.zeros(0))
    return box("board", tuple(below - [0.0, 0.0, 0.02]), (0.06, 0.06, 0.02))


def at(q: np.ndarray, problem: IKProblem) -> tuple[Instance, Keeper, np.ndarray]:
    """The relaxation of a problem, its workspace, and the point of it that is a configuration."""
    instance, keeper = relaxation_at(problem)
    assert keeper is not None
    X = instance.structure.reduction.basis_at(q)
    columns = np.vstack([X, np.eye(3)])[instance.structure.keep]
    return instance, keeper, columns @ columns.T


def loaded(keeper: Keeper) -> list[tuple[int, int]]:
    return [(key[1], key[2]) for key in keeper.loaded if key is not None and key[0] == "cover"]


def test_rows_are_those_of_the_balls_that_are_broken() -> None:
    problem = IKProblem(ROBOT, ROBOT.fk(Q), (beside(-0.02),), COVER)
    _, keeper, Z = at(Q, problem)
    assert keeper.add_broken(Z) == len(loaded(keeper)) > 0
    assert MOVABLE in [i for i, _ in loaded(keeper)]
    assert keeper.covered is not None and keeper.conservative
    centres = COVER.centres_world(ROBOT.link_transforms(Q))
    for i, j in loaded(keeper):
        packed, constant, (vector, _) = keeper.inequality(("cover", i, j), 0.0)
        ball, radius = keeper.covered.centre[j], keeper.covered.radius[j]
        squared = float(np.sum((centres[i] - ball) ** 2))
        assert vector @ Z @ vector == pytest.approx(squared, abs=1e-9)
        assert constant == pytest.approx(-((radius + COVER.radius[i]) ** 2))
        assert squared < (radius + COVER.radius[i]) ** 2
        assert ExactDistances(problem.obstacles)(ball[None])[0].min() + radius <= OVERSHOOT
        assert len(packed)


def test_what_is_clear_of_the_cover_needs_no_rows() -> None:
    problem = IKProblem(ROBOT, ROBOT.fk(Q), (beside(2 * OVERSHOOT),), COVER)
    _, keeper, Z = at(Q, problem)
    assert keeper.add_broken(Z) == 0 and not keeper.conservative


def test_half_spaces_are_planes_that_every_solution_keeps() -> None:
    problem = IKProblem(ROBOT, ROBOT.fk(Q), (beside(-0.01, "halfspace"),), COVER)
    _, keeper, Z = at(Q, problem)
    assert keeper.add_broken(Z) > 0
    assert {key[0] for key in keeper.loaded if key is not None} == {"plane"}
    assert not keeper.passing and not keeper.conservative


def test_the_plain_model_agrees_on_how_near_a_ball_comes() -> None:
    """The least distance to a ball's centre, with its row, is that of the model in which nothing is reduced."""
    problem = IKProblem(ROBOT, ROBOT.fk(Q), (beside(-0.02),), COVER)
    instance, keeper, Z = at(Q, problem)
    keeper.add_broken(Z)
    i, j = next(pair for pair in loaded(keeper) if pair[0] == MOVABLE)
    packed, constant, _ = keeper.inequality(("cover", i, j), 0.0)
    instance.set_slots(instance.reduced(packed[None], np.array([constant])))
    vector = keeper.inequality(("cover", i, j), 0.0)[2][0]
    Z = instance.matrix(instance.solve(np.outer(vector, vector)).x)
    plain, model = relaxation(Query(ROBOT, (Goal.posed("tool", ROBOT.fk(Q)),)))
    assert keeper.covered is not None
    ball = model.constant(ROBOT.T_world_base.inverse().apply(keeper.covered.centre[j]))
    squared = model.squared_distance(model.point(int(COVER.link[i]), COVER.centre[i]), ball)
    row = squared >= float((keeper.covered.radius[j] + COVER.radius[i]) ** 2)
    oracle = cp.Problem(cp.Minimize(squared), [*plain.constraints, row])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # without an interior it may end a little early
        oracle.solve(solver="CLARABEL")
    assert vector @ Z @ vector == pytest.approx(oracle.value, abs=1e-4)


@pytest.mark.parametrize("kind", ["box", "cylinder", "capsule", "ellipsoid"])
def test_answers_are_clear_of_the_solids_themselves(kind: str) -> None:
    size = {"box": [0.05, 0.06, 0.04], "ellipsoid": [0.05, 0.06, 0.04]}.get(kind, [0.04, 0.05])
    solid = Piece("solid", kind, place(0.0, 0.03, -0.07), np.array(size))
    pieces = (solid, replace(solid, name="other", pose=place(0.15, 0.1, 0.1)))
    problem = IKProblem(ROBOT, ROBOT.fk(Q), pieces, COVER)
    assert clearance(problem, Q) < 0
    result = solve(problem, "cidgik", Budget(10.0, effort=1.0))
    assert result.status is Status.SOLVED and result.solver == "cidgik" and result.q is not None
    assert clearance(problem, result.q) >= 0


def test_planes_answer_under_their_own_name() -> None:
    problem = IKProblem(ROBOT, ROBOT.fk(Q), (beside(-0.02),), COVER)
    result = solve(problem, "cidgik+planes", Budget(10.0, effort=1.0))
    assert result.solved and result.solver == "cidgik+planes" and is_planned_by("cidgik", result.solver)
    assert result.q is not None and clearance(problem, result.q) >= 0


def test_planes_follow_where_spheres_have_not_answered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("workcell.ik.cidgik.solver.SPHERES_FIRST", 1)
    problem = hugged(ROBOT, COVER, np.random.default_rng(9), 4)
    result = solve(problem, "cidgik", Budget(10.0, effort=1.0))
    assert result.solved and result.solver == "cidgik+planes"
    assert any("give way to planes" in stage.note for stage in result.stages)
    assert result.stats["cidgik.restarts"] > 1


def test_a_step_past_a_cover_that_is_in_the_way_needs_no_planes() -> None:
    """Where it ends the arm is clear of a board, but not of the spheres that cover it: the judge is asked."""
    begun = Q + 0.00199 * np.array([1.0, -1, 1, -1, 1, 1, -1])
    problem = IKProblem(ROBOT, ROBOT.fk(Q), (beside(1e-5),), COVER, q_reference=begun, max_step=0.002)
    assert clearance(problem, begun) > OVERSHOOT
    result = solve(problem, "cidgik", Budget(10.0, effort=1.0))
    assert result.solved and result.solver == "cidgik" and result.q is not None
    assert clearance(problem, result.q) >= 0
    assert "the spheres that cover the obstacles leave no configuration" in result.rejected


def test_what_overlaps_where_a_step_begins_is_left_to_the_judge() -> None:
    """The checker allows the contact; the spheres of arm and board overlap before and after the step."""
    problem = IKProblem(
        ROBOT, ROBOT.fk(Q), (beside(-0.01),), COVER, checker=lambda q: Clearance(1.0), q_reference=Q + 0.01
    )
    result = solve(replace(problem, max_step=0.05), "cidgik", Budget(10.0, effort=1.0))
    assert result.solved and result.solver == "cidgik"
    assert any("overlap where the step begins" in stage.note for stage in result.stages)


def test_spheres_that_stick_out_of_the_robot_by_as_much_give_way_to_the_judge() -> None:
    """The step ends 0.5 mm inside; the robot's spheres are up to a millimetre, or nothing, larger than the robot."""
    begun = Q + 0.00499 * np.array([1.0, -1, 1, -1, 1, 1, -1])
    step = IKProblem(
        ROBOT,
        ROBOT.fk(Q),
        (beside(-5e-4),),
        COVER,
        checker=lambda q: Clearance(1.0),
        q_reference=begun,
        max_step=5e-3,
    )
    for overshoot, solver in ((1e-3, "cidgik"), (0.0, None)):
        cover = replace(COVER, kind="outer", overshoot=np.full(len(COVER), overshoot))
        result = solve(replace(step, cover=cover), "cidgik", Budget(10.0, effort=1.0))
        assert result.solved == (solver is not None)
        dropped = [stage for stage in result.stages if "stick out of it by as much" in stage.note]
        assert bool(dropped) == (solver is not None)


def test_no_proof_rests_on_covering_spheres() -> None:
    """A step that has the arm in a board is refused by the cover alone: nothing is proved by it."""
    problem = IKProblem(ROBOT, ROBOT.fk(Q), (beside(-0.02),), COVER, q_reference=Q, max_step=1e-4)
    candidate = solve_cidgik(problem, Budget(10.0, effort=0.3))
    assert candidate.q is None and candidate.certificate is None


def test_a_hand_that_its_spheres_put_into_a_board_is_left_to_the_judge() -> None:
    """Where the target fixes a sphere, nothing but the judge can say whether it is the robot that is in the board."""
    hand = COVER.centres_world(ROBOT.link_transforms(Q))[-1]
    pieces = (box("board", tuple(hand - [0.0, 0.0, 0.05 + 0.02 - 1.5e-3]), (0.02, 0.02, 0.02)),)
    for overshoot, status in ((2e-3, Status.SOLVED), (1e-4, Status.BLOCKED_IN_MODEL)):
        cover = replace(COVER, kind="outer", overshoot=np.full(len(COVER), overshoot))
        problem = IKProblem(ROBOT, ROBOT.fk(Q), pieces, cover, checker=lambda q: Clearance(1.0))
        result = solve(problem, "cidgik", Budget(10.0, effort=1.0))
        assert result.status is status
        assert (result.certificate is None) == (status is Status.SOLVED)


def test_steps_of_a_way_pass_a_box() -> None:
    """The arm can't follow the line as it would without the box: every step is CIDGIK's, in bounds and clear."""
    start, goal = ROBOT.fk(Q), ROBOT.fk(Q + 0.12 * np.array([1.0, 1, 0, -1, 0, 1, 0]))
    free = _way(start, goal, ())
    elbow = COVER.centres_world(ROBOT.link_transforms(free[-1]))[MOVABLE]
    pieces = (box("post", tuple(np.add(elbow, [0.0, 0.1, 0.0])), (0.03, 0.052, 0.2)),)
    problem = IKProblem(ROBOT, goal, pieces, COVER)
    assert clearance(problem, Q) > 0 > clearance(problem, free[-1])
    assert min(clearance(problem, q) for q in _way(start, goal, pieces)) >= 0


def _way(start: Pose, goal: Pose, pieces: tuple[Piece, ...]) -> list[np.ndarray]:
    """Configurations of ten steps from Q, each CIDGIK's own and within the bounds."""
    way = [Q]
    for share in np.linspace(0.1, 1.0, 10):
        step = IKProblem(
            ROBOT,
            start.interpolate(goal, float(share)),
            pieces,
            COVER,
            q_reference=way[-1],
            max_step=0.2,
            max_link_rotation=0.28,
        )
        result = solve(step, "cidgik", Budget(10.0, effort=1.0))
        assert result.solved and result.solver == "cidgik" and result.q is not None
        assert verify(step, result.q).accepted
        way.append(np.array(result.q))
    return way


def test_long_chains_keep_out_of_solids_too() -> None:
    robot = long_arm(20, 2.0)
    cover = beads(robot, 0.03)
    pose = robot.fk(np.random.default_rng(0).uniform(-0.8, 0.8, 20))
    free = solve(IKProblem(robot, pose, (), cover), "cidgik", Budget(10.0)).unwrap()
    centres = cover.centres_world(robot.link_transforms(free))
    boxes = [
        box(f"box {k}", tuple(np.add(centres[k], [0.0, 0.04, 0.02])), (0.04, 0.03, 0.03)) for k in (14, 22)
    ]
    problem = IKProblem(robot, pose, tuple(boxes), cover)
    _, blocks, keeper = fastest_relaxation_at(problem)
    assert not isinstance(blocks, Instance) and keeper is not None
    assert clearance(problem, free) < 0
    result = solve(problem, "cidgik", Budget(10.0, effort=1.0))
    assert result.solver == "cidgik" and result.stats["cidgik.rows"] > 0
    assert clearance(problem, result.unwrap()) >= 0


@pytest.mark.parametrize("radius", [0.0, 0.03])
def test_whatever_is_inside_meets_a_ball(radius: float) -> None:
    """Bare points deep inside, too; and nothing that is farther from the solids than their covers stick out."""
    pieces = (
        box("block", (0.3, 0.0, 0.4), (0.2, 0.15, 0.1)),
        Piece("drum", "cylinder", Pose.from_xyz([-0.3, 0.1, 0.4]), np.array([0.1, 0.2])),
    )
    points = np.random.default_rng(0).uniform([-0.6, -0.4, 0.1], [0.7, 0.4, 0.7], (400, 3))
    met = SolidSpheres(Solids(pieces), np.full(400, radius), None, np.zeros(400))
    pairs = {(i, met.solid[j]) for i, j in met.met(points)}
    gap = np.array([ExactDistances(pieces)(point[None])[0] for point in points]) - radius
    assert {(int(i), int(k)) for i, k in np.argwhere(gap < -1e-6)} <= pairs
    assert pairs <= {(int(i), int(k)) for i, k in np.argwhere(gap < OVERSHOOT)}
    assert len(pairs) > 20
    for i, j in met.met(points):
        assert np.linalg.norm(points[i] - met.centre[j]) < met.radius[j] + radius
