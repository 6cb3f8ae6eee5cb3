"""Restarts of stalled ascents: lines stay in the set up to their end, and every kind comes to the same answers."""

import numpy as np
import pytest

from tests.ik.arms import seven
from workcell.errors import UnknownNameError
from workcell.ik.ikspark.mechanisms.program import Program
from workcell.ik.ikspark.mechanisms.relaxation import Relaxation
from workcell.ik.ikspark.mechanisms.restart import RESTARTS, STEP, Restarts, along_line
from workcell.ik.ikspark.mechanisms.solver import solve_mechanism_ikspark
from workcell.ik.mechanisms.goals import FrameGoal
from workcell.ik.mechanisms.judge import judge_mechanism
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.problem import Budget
from workcell.model.mechanism.of_robot import of_robot
from workcell.pose import Pose

ROBOT = seven()


def question(seed=0):
    mechanism = of_robot(ROBOT)
    q = 0.7 * ROBOT.random_configuration(np.random.default_rng(seed))
    return MechanismProblem(mechanism, (FrameGoal.posed(next(iter(mechanism.frames)), ROBOT.fk(q)),))


def test_a_line_ends_where_the_set_does_and_keeps_equalities():
    relaxation = Relaxation.of(question())
    program, rng = Program(relaxation.lift.size, relaxation.rows), np.random.default_rng(0)
    equal = np.vstack([one.rows for one in relaxation.rows if one.cone == "zero"])
    for _ in range(5):
        x, end = (program.solve(rng.standard_normal(relaxation.lift.size)).x for _ in range(2))
        last = along_line(program, x, end - x)
        n = (last - x) @ (end - x) / ((end - x) @ (end - x)) / STEP
        assert n == pytest.approx(round(n), abs=1e-6)
        assert n >= round(1.0 / STEP) - 2  # the other end is in the set, but for rounding
        assert program.inside(last, slack=1e-6)
        assert not program.inside(last + STEP * (end - x), slack=1e-6)
        assert np.abs(equal[:, :-1] @ last + equal[:, -1]).max() < 1e-4


@pytest.mark.parametrize("kind", RESTARTS)
def test_every_kind_answers_and_repeats_itself(kind):
    for seed in range(3):
        problem = question(seed)
        found = solve_mechanism_ikspark(problem, Budget(20.0, effort=2.0), 3, restart=kind)
        assert found.q is not None and judge_mechanism(problem, found.q).accepted
        again = solve_mechanism_ikspark(problem, Budget(20.0, effort=2.0), 3, restart=kind)
        assert np.array_equal(found.q, again.q) and found.stats["restarts"] == again.stats["restarts"] >= 1


@pytest.mark.parametrize("kind", RESTARTS)
def test_no_kind_finds_what_is_not_there(kind):
    mechanism = of_robot(ROBOT)
    goal = FrameGoal.posed(next(iter(mechanism.frames)), Pose.from_xyz([3.0, 0.0, 0.0]))
    found = solve_mechanism_ikspark(MechanismProblem(mechanism, (goal,)), Budget(20.0), restart=kind)
    assert found.q is None and found.certificate is not None


def test_kinds_that_there_are_not_are_named():
    with pytest.raises(UnknownNameError, match="configuration, line, objective"):
        Restarts("hope", np.random.default_rng(0))


def test_a_line_needs_a_point_to_begin_at():
    relaxation = Relaxation.of(question())
    program, size = Program(relaxation.lift.size, relaxation.rows), relaxation.lift.size
    blocks, rng, bounded = relaxation.lift.blocks, np.random.default_rng(0), np.ones(size)
    assert Restarts("line", rng).direction(blocks, program, None, bounded) is None
    assert Restarts("configuration", rng).direction(blocks, program, np.zeros(size), bounded) is None
    aside = Restarts("objective", rng).direction(blocks, program, None, 0.0 * bounded)
    assert aside is not None and not aside.any()
