"""Baxter's two arms with a common grasp: what they can't reach together is proved, to two checkers."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from workcell.ik.mechanisms.check import check_mechanism
from workcell.ik.mechanisms.document import question_document
from workcell.ik.mechanisms.goals import FrameGoal
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.problem import Budget
from workcell.ik.result import Status
from workcell.ik.solve_mechanism import solve_mechanism
from workcell.model.mechanism.from_model import mechanism_of
from workcell.model.mechanism.mechanism import Closure, Mechanism
from workcell.model.mechanism.placing import place
from workcell.pose import Pose
from workcell.proofs.exact.mechanisms.check import check

ROBOT = Path(__file__).parents[4] / "assets" / "robots" / "baxter.xml"


@pytest.fixture(scope="module")
def loop() -> Mechanism:
    """Both tools on one bar of 0.3 m, which turns each towards the other."""
    mechanism = replace(mechanism_of(mujoco.MjModel.from_xml_path(str(ROBOT))), compiled=None)
    left, right = mechanism.frame("left/tool"), mechanism.frame("right/tool")
    T_left_right = Pose.from_rotation(np.array([0.0, 0.0, 0.3]), np.diag([1.0, -1.0, -1.0]))
    frames = (left.T_link_frame @ T_left_right, right.T_link_frame)
    return replace(mechanism, closures=(Closure("bar", "weld", (left.link, right.link), frames),))


@pytest.mark.parametrize("seed", range(4))
def test_what_both_arms_cannot_reach_is_proved(loop: Mechanism, seed: int) -> None:
    rng = np.random.default_rng(seed)
    q = np.array([rng.uniform(joint.lower, joint.upper) for joint in loop.joints])
    tool, placed = loop.frame("left/tool"), place(loop, q)
    p = placed.point(tool.link, tool.T_link_frame.position) + np.array([2.0, 0.0, 0.0])
    goal = FrameGoal("left/tool", p, placed.R[tool.link] @ tool.T_link_frame.rotation)
    problem = MechanismProblem(loop, (goal,))
    result = solve_mechanism(problem, budget=Budget(20.0))
    assert result.status is Status.UNREACHABLE
    certificate = result.certificate
    assert certificate is not None and check_mechanism(problem, certificate) is None
    assert check(question_document(problem), certificate.to_json()) == certificate.statement
