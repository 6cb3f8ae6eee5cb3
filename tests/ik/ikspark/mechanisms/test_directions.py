"""Where ascents begin: a floating body that may be anywhere has no farthest point, and is none the worse for it."""

import numpy as np

from tests.ik.ikspark.mechanisms.test_claim import AT_HOME, four_bar, platform
from workcell.ik.ikspark.mechanisms.directions import loose
from workcell.ik.mechanisms.goals import FrameGoal
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.problem import Budget
from workcell.ik.solve_mechanism import solve_mechanism
from workcell.model.mechanism.mechanism import Frame, Joint, Mechanism

TURNED = (0.6, 0.0, 0.8, 0.0)


def test_a_body_that_only_has_to_turn_is_turned() -> None:
    joints = (Joint("body", "free", 0, AT_HOME, np.zeros(3)),)
    body = Mechanism("body", joints, ("world", "body"), frames={"body": Frame("body", 1, AT_HOME)})
    problem = MechanismProblem(body, (FrameGoal.turned("body", TURNED),))
    assert loose(problem) == [0]
    assert solve_mechanism(problem, budget=Budget(10.0)).solved


def test_what_ties_or_goals_hold_is_not_loose() -> None:
    assert loose(MechanismProblem(four_bar())) == []
    assert loose(MechanismProblem(platform())) == []
    joints = (Joint("body", "free", 0, AT_HOME, np.zeros(3)),)
    body = Mechanism("body", joints, ("world", "body"), frames={"body": Frame("body", 1, AT_HOME)})
    assert loose(MechanismProblem(body, (FrameGoal.at("body", [1.0, 0.0, 0.0]),))) == []
