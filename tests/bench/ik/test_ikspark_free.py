"""One start of IKSPARK is one ascent, judged as every answer is."""

from __future__ import annotations

import numpy as np
import pytest

from workcell.bench.ik.ikspark import STARTS, bench_ikspark_free, far_problems, one_start, reachable_problems
from workcell.ik.judge.verify import verify


def test_one_start_repeats_is_judged_and_keeps_to_its_programs() -> None:
    solved = 0
    for seed, problem in enumerate(reachable_problems("iiwa14", 12, 0)):
        result, again = one_start(problem, seed, 30), one_start(problem, seed, 30)
        assert result.status is again.status and result.stats["sdps"] == again.stats["sdps"] <= 30
        if result.solved:
            assert result.q is not None and again.q is not None
            assert verify(problem, result.q).accepted and np.array_equal(result.q, again.q)
            solved += 1
    assert solved >= 6


def test_one_program_is_hardly_ever_enough_and_a_far_pose_never_reached() -> None:
    assert not any(one_start(problem, 0, 1).solved for problem in reachable_problems("sawyer", 5, 0))
    (far,) = far_problems("sawyer", 1, 0)
    result = one_start(far, 0)
    assert not result.solved and result.q is None and result.stats["sdps"] == 1


@pytest.mark.parametrize("robot", ["ur10"])
def test_the_table_has_both_starts_beside_the_solver(robot: str) -> None:
    names = [row["row"] for row in bench_ikspark_free(2, 0, robot)]
    assert [name for name in names if "one start" in name] == [
        f"{robot}/free/ikspark, one start of {most} programs at most" for most in STARTS
    ]
    assert f"{robot}/free/ikspark" in names and f"{robot}/free/multistart" in names
