"""Where a joint may be: limits, the step from a reference, slack, and what is left where the two don't meet."""

import numpy as np

from tests.ik.arms import planar
from workcell.ik.branch.chain import joint_box
from workcell.ik.branch.checker.setup import admissible
from workcell.ik.problem import IKProblem
from workcell.ik.shared.limits import Interval
from workcell.ik.shared.packing import narrowed_arm
from workcell.model.robot import LIMIT_SLACK


def near(reference, step):
    robot = planar(limit=1.0)
    return IKProblem(robot, robot.fk(np.zeros(2)), q_reference=np.array(reference), max_step=step)


def test_bounds_stay_inside_the_limits():
    interval = Interval.of(near([0.95, 0.0], 0.1)).closed
    assert np.allclose(interval.lower, [0.85, -0.1]) and np.allclose(interval.upper, [1.0, 0.1])
    assert not interval.empty


def test_without_a_step_the_limits_count_alone():
    robot = planar(limit=1.0)
    for problem in (
        IKProblem(robot, robot.fk(np.zeros(2))),
        IKProblem(robot, robot.fk(np.zeros(2)), q_reference=np.ones(2)),
    ):
        interval = Interval.of(problem)
        assert np.array_equal(interval.lower, robot.lower) and np.array_equal(interval.upper, robot.upper)


def test_a_reference_beyond_the_limits_leaves_nothing_but_an_end_to_clip_to():
    problem = near([1.5, 0.0], 0.2)
    interval = Interval.of(problem)
    assert interval.empty and interval.lower[0] > interval.upper[0]
    closed = interval.closed
    assert np.array_equal(closed.lower, interval.lower) and closed.upper[0] == closed.lower[0]
    assert closed.upper[1] == interval.upper[1]
    assert np.all(np.isfinite(narrowed_arm(problem).bounds))


def test_slack_widens_limits_and_step_as_the_checker_of_proofs_does_for_itself():
    for problem in (near([0.95, 0.0], 0.1), near([-1.1, 0.3], [0.2, 0.05])):
        interval = Interval.of(problem, LIMIT_SLACK)
        lower, upper, _ = admissible(problem)
        assert np.array_equal(interval.lower, lower) and np.array_equal(interval.upper, upper)
        assert np.array_equal(joint_box(problem), [lower, upper])
