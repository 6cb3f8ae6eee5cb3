"""The one entry: only the judge awards SOLVED, only a certificate holds a "no", and nothing numerical escapes."""

from dataclasses import replace

import numpy as np
import pytest

from tests.ik.arms import beads, box, planar, random_arm, seven
from workcell.errors import InputError, NotSolvedError, UnknownNameError
from workcell.geometry.types import Piece, SphereCover
from workcell.ik.certificate import Certificate, problem_hash
from workcell.ik.elementary.bounds import prove_impossible
from workcell.ik.judge.verify import verify
from workcell.ik.problem import Budget, Clearance, IKProblem
from workcell.ik.registry import Turn, solver_names
from workcell.ik.result import Candidate, Status
from workcell.ik.solve import check_solver_name, solve
from workcell.pose import Pose


def _problem(**parts):
    robot = seven()
    return IKProblem(robot, robot.fk(np.array([0.3, 0.5, -0.4, 1.0, 0.2, -0.7, 0.1])), **parts)


def _with_solver(monkeypatch, candidate):
    def propose(problem, budget, seed):
        if isinstance(candidate, BaseException):
            raise candidate
        return candidate

    monkeypatch.setattr("workcell.ik.multistart.solver.solve_multistart", propose)


@pytest.mark.parametrize(
    ("solver", "found_by"), [("auto", "hjcd"), ("hjcd", "hjcd"), ("multistart", "multistart")]
)
def test_solved_means_verified(solver, found_by):
    wall = box("wall", (1.0, 0.0, 0.5), (0.05, 0.5, 0.5))
    problem = _problem(obstacles=(wall,), cover=beads(seven(), 0.04))
    result = solve(problem, solver)
    assert result.solved and result.solver == found_by
    verdict = verify(problem, result.q)
    assert verdict.accepted
    assert result.position_error == verdict.position_error and result.clearance == verdict.clearance
    assert np.array_equal(result.unwrap(), result.q)
    assert result.stats["cpu_s"] > 0 and result.stats[f"{found_by}.cpu_s"] > 0


def test_the_same_seed_gives_the_same_answer():
    first, again = (solve(_problem(), seed=3).unwrap() for _ in range(2))
    assert np.array_equal(first, again)


def test_out_of_reach_is_proved():
    problem = IKProblem(seven(), Pose.from_xyz([3.0, 0, 0]))
    result = solve(problem)
    assert result.status is Status.UNREACHABLE and result.status.is_proof
    assert result.certificate is not None and result.q is None
    with pytest.raises(NotSolvedError, match="UNREACHABLE"):
        result.unwrap()


def _blocked(**parts):
    robot = planar()
    target = robot.fk(np.array([0.3, 0.8]))
    cover = SphereCover(np.array([2]), np.array([[0.2, 0, 0]]), np.array([0.05]), parts.pop("kind", "given"))
    ball = Piece("ball", "sphere", Pose.from_xyz(target.apply([-0.2, 0, 0])), np.array([0.04]))
    return IKProblem(robot, target, (ball,), cover, **parts)


def test_a_blocked_last_link_is_proved():
    result = solve(_blocked())
    assert result.status is Status.BLOCKED and result.solver == "elementary"


def test_a_proof_in_the_model_does_not_end_the_search_for_the_truth():
    clear = _blocked(kind="outer", checker=lambda q: Clearance(0.01))
    assert solve(clear).solved
    hit = _blocked(kind="outer", checker=lambda q: Clearance(-0.01, ("arm", "ball")))
    result = solve(hit, budget=Budget(0.2))
    assert result.status is Status.BLOCKED_IN_MODEL and result.certificate is not None


@pytest.mark.parametrize("solver", solver_names())
def test_a_budget_of_zero_finds_nothing(solver):
    result = solve(_problem(), solver, Budget(0.0))
    assert result.status is Status.NOT_FOUND and result.q is None and result.certificate is None


def test_unknown_solvers_are_named_with_those_that_exist():
    with pytest.raises(UnknownNameError, match="did you mean ikspark"):
        solve(_problem(), "iksparc")
    with pytest.raises(UnknownNameError, match="auto, branch, cidgik"):
        check_solver_name("")


@pytest.mark.parametrize("seed", [-1, 1.5, True, "0", None])
def test_a_seed_is_a_whole_number(seed):
    with pytest.raises(InputError, match="seed"):
        solve(_problem(), seed=seed)


@pytest.mark.parametrize("budget", [-1.0, float("nan"), float("inf")])
def test_a_budget_is_finite_and_not_negative(budget):
    with pytest.raises(InputError, match="budget"):
        Budget(budget)


@pytest.mark.parametrize(
    "failure",
    [
        np.linalg.LinAlgError("singular"),
        FloatingPointError("overflow"),
        ValueError("shape"),
        ZeroDivisionError(),
    ],
)
def test_numerical_failures_become_results(monkeypatch, failure):
    _with_solver(monkeypatch, failure)
    result = solve(_problem(), "multistart")
    assert result.status is Status.SOLVER_ERROR
    assert type(failure).__name__ in result.rejected[0]


def test_a_solver_that_does_not_apply_is_passed_over_by_auto_alone(monkeypatch):
    robot = random_arm(np.random.default_rng(7), n=7, sliding=True)
    assert np.any(robot.prismatic)
    target = robot.fk(robot.random_configuration(np.random.default_rng(1)))
    with pytest.raises(InputError, match="prismatic"):
        solve(IKProblem(robot, target), "cidgik")
    turns = (Turn("cidgik", 0.5), Turn("multistart"))
    monkeypatch.setattr("workcell.ik.solve.auto_turns", lambda dof, goal: turns)
    result = solve(IKProblem(robot, target))
    assert result.solved and "cidgik does not apply" in result.rejected[0]


def test_a_panic_of_the_conic_solver_becomes_a_result(monkeypatch):
    class PanicException(BaseException):
        pass

    _with_solver(monkeypatch, PanicException("index out of bounds"))
    assert solve(_problem(), "multistart").status is Status.SOLVER_ERROR


def test_an_interruption_is_not_swallowed(monkeypatch):
    _with_solver(monkeypatch, KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        solve(_problem(), "multistart")


@pytest.mark.parametrize(
    ("q", "words"),
    [
        (np.zeros(7), "mm from its target"),
        (np.full(7, np.nan), "not finite"),
        (np.zeros(3), "3 joint values"),
    ],
)
def test_a_wrong_configuration_is_never_solved(monkeypatch, q, words):
    _with_solver(monkeypatch, Candidate(q=q))
    result = solve(_problem(), "multistart")
    assert result.status is Status.NOT_FOUND and result.q is None
    assert any(words in reason for reason in result.rejected)


def test_a_wrong_certificate_is_never_a_no(monkeypatch):
    problem = _problem()
    other = prove_impossible(IKProblem(seven(), Pose.from_xyz([3.0, 0, 0])))
    assert other is not None
    made_up = Certificate("reach", "kinematics", "believe me", 1.0, problem_hash(problem), dict(other.data))
    for certificate in (other, made_up):
        _with_solver(monkeypatch, Candidate(certificate=certificate))
        result = solve(problem, "multistart")
        assert result.status is Status.NOT_FOUND and result.certificate is None
        assert "certificate was refused" in result.rejected[0]


def test_rounding_beyond_a_limit_is_clamped_and_reported(monkeypatch):
    robot = planar(limit=1.0)
    q = np.array([1.0 + 5e-7, -0.5])
    _with_solver(monkeypatch, Candidate(q=q))
    result = solve(IKProblem(robot, robot.fk(q)), "multistart")
    assert result.solved and result.q[0] == 1.0
    assert result.stats["clamped_to_limits"] == pytest.approx(5e-7)
    _with_solver(monkeypatch, Candidate(q=q + np.array([1e-5, 0.0])))
    assert solve(IKProblem(robot, robot.fk(q)), "multistart").status is Status.NOT_FOUND


def test_a_robot_without_freedom_is_answered():
    robot = planar((0.3,))
    assert solve(IKProblem(robot, robot.fk(np.array([0.4])))).solved
    result = solve(IKProblem(robot, Pose.from_xyz([0.3, 0.0, 0.2])), budget=Budget(0.3))
    assert result.status in (Status.NOT_FOUND, Status.UNREACHABLE)


def test_links_without_length_are_answered():
    robot = replace(seven(), joint_xyz=np.zeros((7, 3)))
    q = np.array([0.3, 0.5, -0.4, 1.0, 0.2, -0.7, 0.1])
    assert solve(IKProblem(robot, robot.fk(q))).solved
    result = solve(IKProblem(robot, Pose.from_xyz([0.0, 0.0, 0.5])))
    assert result.status is Status.UNREACHABLE


def test_a_reference_outside_the_limits_leaves_no_room():
    robot = planar(limit=1.0)
    problem = IKProblem(robot, robot.fk(np.zeros(2)), q_reference=np.array([2.0, 0.0]), max_step=0.1)
    assert not solve(problem, "multistart", Budget(0.1)).solved
