"""The baseline for mechanisms finds what can be found, says why where it does not, and repeats itself."""

import mujoco
import numpy as np

from tests.ik.mechanisms.cases import four_bar, frame_at, platform
from workcell.geometry.types import Piece, SphereCover
from workcell.ik.mechanisms.goals import FrameGoal
from workcell.ik.mechanisms.judge import judge_mechanism
from workcell.ik.mechanisms.problem import MechanismProblem, UserConstraint
from workcell.ik.multistart.mechanisms import solve_mechanism_multistart
from workcell.ik.problem import Budget
from workcell.model.mechanism.from_model import mechanism_of
from workcell.pose import Pose


def test_poses_of_a_platform():
    mechanism, rng = platform(), np.random.default_rng(0)
    R, p = frame_at(mechanism, "tool", mechanism.home)
    for seed in range(5):
        goal = FrameGoal("tool", p + rng.uniform(-0.05, 0.05, 3), R)
        problem = MechanismProblem(mechanism, (goal,))
        found = solve_mechanism_multistart(problem, Budget(30.0, iterations=30), seed)
        assert judge_mechanism(problem, found.q).accepted
        assert found.stats["starts"] >= 1


def test_the_same_seed_finds_the_same():
    mechanism = four_bar()
    tip = np.array([0.25, 0.25, 0.0])
    problem = MechanismProblem(mechanism, (FrameGoal.at("tip", tip),), collisions=False)
    one, two = (solve_mechanism_multistart(problem, Budget(60.0, iterations=5), 3) for _ in range(2))
    assert one.stats == two.stats and one.rejected == two.rejected
    assert (one.q is None) == (two.q is None)


def test_what_is_out_of_reach_is_not_found_and_said():
    problem = MechanismProblem(four_bar(), (FrameGoal.at("tip", [3.0, 0.0, 0.0]),), collisions=False)
    found = solve_mechanism_multistart(problem, Budget(60.0, iterations=4))
    assert found.q is None and found.stats["starts"] == 4
    assert any("tip is" in reason for reason in found.rejected)
    assert solve_mechanism_multistart(problem, Budget(0.0)).stats["starts"] == 0


ARM = """<mujoco><compiler angle="radian"/><worldbody><geom name="wall" type="box" size=".1 .1 .1" pos="1 .55 0"/>
  <body name="one"><joint name="a" axis="0 0 1" range="-3 3"/><geom name="upper" size=".05"/>
    <body name="two" pos="1 0 0"><joint name="b" axis="0 0 1" range="-3 3"/>
      <geom name="fore" type="capsule" fromto=".1 0 0 .9 0 0" size=".05"/><site name="tip" pos="1 0 0"/></body></body>
  </worldbody></mujoco>"""


def test_the_way_around_an_obstacle_is_found():
    mechanism = mechanism_of(mujoco.MjModel.from_xml_string(ARM))
    wall = Piece("wall", "box", Pose.from_xyz([1.0, 0.55, 0]), np.full(3, 0.1), geom=0)
    cover = SphereCover(np.full(9, 2), np.linspace([0.1, 0, 0], [0.9, 0, 0], 9), np.full(9, 0.08), "outer")
    goal = FrameGoal.at("tip", [1.0, 1.0, 0.0])
    for obstacles in ((wall,), ()):
        problem = MechanismProblem(mechanism, (goal,), obstacles=obstacles, cover=cover)
        found = solve_mechanism_multistart(problem, Budget(30.0, iterations=40))
        assert judge_mechanism(problem, found.q).accepted
        assert found.q[0] > 0.5  # the elbow at y = 1 m; the other posture is in the wall


def test_users_constraints_are_judged():
    problem = MechanismProblem(
        four_bar(), constraints=(UserConstraint("crank below", lambda e: []),), collisions=False
    )

    def below(q):
        return [] if q[0] < -0.5 else ["the crank is above"]

    found = solve_mechanism_multistart(problem, Budget(30.0, iterations=60), 0, below)
    assert found.q[0] < -0.5
    assert "nobody looked at" in solve_mechanism_multistart(problem, Budget(9.0, iterations=1)).rejected[0]
