"""Poses whose first answer hits the robot itself are what they are called, and both rows are of the same ones."""

from __future__ import annotations

from workcell.bench.ik.entangled import BUDGET, bench_ikspark_self, entangled
from workcell.ik.ikspark.solver import solve_ikspark


def test_the_first_answer_is_refused_for_the_robot_itself() -> None:
    problems = entangled("iiwa14", 3, 0)
    assert len(problems) == 3
    for problem, start in problems:
        candidate = solve_ikspark(problem, BUDGET, start, apart=False)
        assert candidate.stats["restarts"] > 1 and " inside " in candidate.rejected[0]


def test_rows_are_of_the_same_poses() -> None:
    refused, apart = bench_ikspark_self(3, 0, "iiwa14")
    assert refused["row"] == "iiwa14/self/refused" and apart["row"] == "iiwa14/self/apart"
    assert refused["n"] == apart["n"] == 3 and refused["success"] == apart["success"] == 1.0
    assert apart["ratio_to_refused"] > 0.0
