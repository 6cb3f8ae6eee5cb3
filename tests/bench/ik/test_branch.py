"""Problems of the branch and bound's benches are what they are said to be."""

from tests.ik.branch.test_solver import elbow_problem
from workcell.bench.ik.branch import cut_problem, supplement_problems
from workcell.bench.ik.soundness import try_boxes
from workcell.bench.reference.closed_forms import parallel_arm
from workcell.ik.judge.verify import Verifier
from workcell.ik.problem import Budget
from workcell.ik.result import Status
from workcell.ik.solve import solve


def test_every_closed_form_of_the_supplement_collides() -> None:
    for problem in supplement_problems(2, seed=1):
        judge = Verifier(problem)
        solutions = parallel_arm(problem.robot, problem.target)
        assert len(solutions)
        assert all(judge(q).clearance.distance < 0 for q in solutions)
        assert judge(solutions[0]).position_error < 1e-6


def test_a_cut_problem_has_no_solution_left() -> None:
    problem = elbow_problem(())
    assert solve(problem).solved
    cut = cut_problem(problem)
    assert len(cut.obstacles) > 1
    assert solve(cut, budget=Budget(20.0)).status is Status.BLOCKED


def test_boxes_are_counted() -> None:
    descent = try_boxes("search/all", 120, seed=0, each=50)
    assert (descent.boxes, descent.violations) == (120, 0)
