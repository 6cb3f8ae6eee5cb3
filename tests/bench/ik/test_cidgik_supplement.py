"""The samples of CIDGIK's supplement."""

from __future__ import annotations

import numpy as np
import pytest

from workcell.bench.ik.cidgik_supplement import infeasible_problems
from workcell.bench.reference.cidgik_problems import environment
from workcell.bench.reference.closed_forms import parallel_arm


@pytest.mark.parametrize("eight", [True, False])
def test_every_closed_form_collides_and_what_the_goal_fixes_does_not(eight: bool) -> None:
    centres, radius = environment("cube")
    counts = []
    for problem in infeasible_problems(6, 2, eight):
        robot, cover = problem.robot, problem.cover
        assert cover is not None
        solutions = parallel_arm(robot, problem.target)
        counts.append(len(solutions))
        links = [robot.link_transforms(q) for q in solutions]
        for q, frames in zip(solutions, links, strict=True):
            assert max(robot.fk(q).error_to(problem.target)) < 1e-6
            points = cover.centres_world(frames)
            assert np.linalg.norm(points[:, None] - centres, axis=-1).min() < radius
        for point in (problem.target.position, links[0][-1, :3, 3]):
            assert np.linalg.norm(point - centres, axis=1).min() >= radius
    assert (min(counts) == 8) == eight
