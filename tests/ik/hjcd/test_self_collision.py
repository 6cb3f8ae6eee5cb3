"""The sampling solver keeps an arm clear of itself: gaps and gradients of pairs, solutions, why there are none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.ik.arms import beads, box, distant_pairs, gap_of_pairs, seven
from workcell.ik.hjcd.solver import solve_hjcd
from workcell.ik.judge.verify import verify
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.solve import solve
from workcell.pose import Pose

BUDGET = Budget(10.0)


def folded():
    """A seven-joint arm, its spheres and pairs, and configurations in which it touches itself."""
    robot = seven()
    cover = beads(robot, 0.1)
    pairs = distant_pairs(cover, 4)
    problem = IKProblem(robot, Pose.identity(), (), cover, self_collision=pairs)
    rows = robot.random_configuration(np.random.default_rng(0), 400)
    return problem, [q for q in rows if -0.06 < gap_of_pairs(problem, q) < -0.005]


def test_solutions_keep_clear_of_the_arm_itself():
    problem, touching = folded()
    assert len(touching) >= 8
    solved = 0
    for seed, q in enumerate(touching[:8]):
        query = replace(problem, target=problem.robot.fk(q), q_reference=q)
        # the reference reaches the target, but touches: the solver has to slide or walk away from it
        candidate = solve_hjcd(query, BUDGET, seed)
        if candidate.q is None:
            # every self-motion curve was walked: the pose itself makes the arm touch itself
            assert candidate.stats["exhausted"] == 1.0
            continue
        solved += 1
        assert verify(query, candidate.q).accepted
        assert gap_of_pairs(query, candidate.q) >= 0.0
    assert solved >= 4


def test_obstacles_and_pairs_together():
    problem, touching = folded()
    wall = (box("wall", (0.5, 0.0, 0.2), (0.02, 0.3, 0.3)),)
    results = [
        solve(replace(problem, target=problem.robot.fk(q), obstacles=wall), "hjcd", Budget(0.5))
        for q in touching[:4]
    ]
    assert any(result.solved for result in results)


def test_an_arm_that_must_touch_itself_names_the_spheres():
    robot = seven()
    cover = beads(robot, 0.03)
    # two spheres on the same link overlap for ever
    cover = replace(cover, radius=np.where(cover.link == 7, 0.2, 0.03))
    last = np.flatnonzero(cover.link == 7)
    problem = IKProblem(robot, robot.fk(np.full(7, 0.4)), (), cover, self_collision=last[None])
    candidate = solve_hjcd(problem, Budget(0.3), 0)
    assert candidate.q is None
    first, second = last
    assert any(
        f"sphere {first}" in line and "mm inside" in line and f"sphere {second}" in line
        for line in candidate.rejected
    )
