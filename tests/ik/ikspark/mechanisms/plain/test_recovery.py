"""Algorithm 1 in cvxpy: configurations that are true, and none for what is out of reach."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.ik.ikspark.mechanisms.plain.chance import mechanism_of
from workcell.ik.ikspark.mechanisms.plain.recovery import rank_recovery
from workcell.ik.mechanisms.goals import FrameGoal
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.model.mechanism.placing import missed, place


def posed(kinds, seed, loop=None):
    mechanism, q = mechanism_of(np.random.default_rng(seed), kinds, loop=loop)
    frame = mechanism.frames[f"f{len(kinds)}"]
    position = place(mechanism, q).point(frame.link, frame.T_link_frame.position)
    return MechanismProblem(mechanism, (FrameGoal.at(frame.name, position),))


CHAIN = (("hinge", "slide", "ball"), None)
LOOP = (("ball", "slide", "ball"), "connect")


@pytest.mark.parametrize(
    ("mechanism", "form", "slide", "seed"),
    [
        (CHAIN, "quaternion", "split", None),
        (CHAIN, "quaternion", "split", 0),
        (CHAIN, "rotation", "paper", 0),
        (CHAIN, "quaternion", "whole", None),
        (LOOP, "quaternion", "whole", 0),
        (LOOP, "quaternion", "paper", None),
        (LOOP, "quaternion", "three", 0),
    ],
)
def test_what_is_recovered_answers_the_question(mechanism, form, slide, seed) -> None:
    kinds, loop = mechanism
    problem = posed(kinds, 4, loop)
    found = rank_recovery(problem, form, slide, seed=seed, longest=20)
    assert found.q is not None, found
    assert found.gaps[-1] < 1e-5
    placed = place(problem.mechanism, found.q)
    frame = problem.mechanism.frames[problem.goals[0].frame]
    reached = placed.point(frame.link, frame.T_link_frame.position)
    # a part of a block that is rank 1 but for a gap may be off by the gap's square root
    close = 1e-6 if slide != "split" else found.gaps[-1] ** 0.5
    np.testing.assert_allclose(reached, problem.goals[0].position, atol=close)
    assert np.abs(missed(placed)[0]).max(initial=0.0) < close
    if seed is None:
        assert found.bound == pytest.approx(0.0, abs=1e-6)


def test_out_of_reach_there_is_a_bound_and_no_configuration() -> None:
    problem = posed(("hinge", "hinge"), 3)
    goal = problem.goals[0]
    far = replace(problem, goals=(FrameGoal.at(goal.frame, goal.position + np.array([4.0, 0.0, 0.0])),))
    found = rank_recovery(far)
    assert (found.q, found.status) == (None, "infeasible")
    reach = 2 * 0.5 * 3**0.5 + 0.5 * 3**0.5
    assert (4.0 - 2 * reach) ** 2 <= found.bound <= 16.0
