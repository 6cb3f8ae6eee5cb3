"""A line restart ends at a point of the set, on its edge, and where it began plays a part in where that is."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tests.ik.lifted_arms import seven_axis
from workcell.errors import InputError
from workcell.ik.ikspark.instance import instance_of
from workcell.ik.ikspark.rank import linearise
from workcell.ik.ikspark.restart import LineRestarts, violation
from workcell.ik.ikspark.solver import solve_ikspark
from workcell.ik.judge.verify import verify
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.shared.conic import Cones, svec
from workcell.pose import Pose

BUDGET = Budget(20.0, effort=1.0)


def test_violation_is_that_of_the_worst_cone() -> None:
    cones = Cones(zero=1, nonneg=1, soc=(3,), psd=(2,))
    inside = np.concatenate([[0.0, 0.5], [1.0, 0.6, 0.8], svec(np.eye(2))])
    assert violation(cones, inside) == 0.0
    for row, value, worst in ((0, -0.2, 0.2), (1, -0.3, 0.3), (2, 0.5, 0.5), (5, -0.4, 0.4)):
        broken = inside.copy()
        broken[row] = value
        assert violation(cones, broken) == pytest.approx(worst)


def test_a_line_leads_through_the_set_to_its_edge() -> None:
    robot, rng = seven_axis(), np.random.default_rng(4)
    found = 0
    for _ in range(5):
        problem = IKProblem(robot, robot.fk(robot.random_configuration(rng)))
        with instance_of(problem) as instance:
            lines, N = LineRestarts(instance, rng), instance.lift.size
            stuck = instance.solve(rng.standard_normal(N)).x
            # a set may be too thin for most lines: then there is none
            ends = [end for end in (lines.beyond(stuck) for _ in range(4)) if end is not None]
            assert lines.programs == 1
            for end in ends:
                assert lines.holds(end)
                along = end - stuck
                assert np.linalg.norm(along) > 0.1
                # one more stride is outside: the whole line has between 1 and 60 of them
                steps = [stuck + along * (1.0 + 1.0 / k) for k in range(1, 61)]
                assert not all(lines.holds(step) for step in steps)
                gaps, gradient = linearise(instance.lift, end)
                assert np.all(gaps > -1e-5) and np.all(np.isfinite(gradient))
            assert not any(np.allclose(one, other) for one, other in itertools.pairwise(ends))
            found += len(ends)
    assert found >= 12


def test_an_empty_set_has_no_line() -> None:
    robot = seven_axis()
    far = IKProblem(robot, Pose.from_xyz([3.0, 0.0, 0.5]))
    with instance_of(far) as instance:
        lines = LineRestarts(instance, np.random.default_rng(0))
        assert lines.beyond(np.zeros(instance.lift.size)) is None


def test_both_kinds_of_restart_answer_and_repeat() -> None:
    robot, rng = seven_axis(2.0), np.random.default_rng(0)
    lines = 0.0
    for seed in range(10):
        problem = IKProblem(robot, robot.fk(robot.random_configuration(rng)))
        usual = solve_ikspark(problem, BUDGET, seed)
        candidate = solve_ikspark(problem, BUDGET, seed, restart="line")
        assert usual.stats["lines"] == 0.0
        if candidate.stats["restarts"] == 1.0:
            assert candidate.q is not None and np.array_equal(candidate.q, usual.q)
            continue
        lines += candidate.stats["lines"]
        again = solve_ikspark(problem, BUDGET, seed, restart="line")
        assert candidate.stats["sdps"] == again.stats["sdps"]
        if candidate.q is not None:
            assert verify(problem, candidate.q).accepted and np.array_equal(candidate.q, again.q)
    assert lines > 0.0


def test_an_unknown_kind_is_named() -> None:
    robot = seven_axis()
    with pytest.raises(InputError, match="restart"):
        solve_ikspark(IKProblem(robot, robot.fk(np.zeros(7))), BUDGET, 0, restart="lines")  # type: ignore[arg-type]
