"""Answers about mechanisms are configurations that MuJoCo has nothing against, or proofs that are checked."""

import mujoco
import numpy as np
import pytest

from workcell.errors import InputError, UnknownNameError
from workcell.ik.mechanisms.check import check_mechanism
from workcell.ik.mechanisms.goals import FrameGoal, InRegion
from workcell.ik.mechanisms.problem import MechanismProblem, UserConstraint
from workcell.ik.problem import Budget
from workcell.ik.result import Status
from workcell.ik.solve_mechanism import (
    CLOSEST_SOLVERS,
    closest_configuration,
    mechanism_solver_names,
    solve_mechanism,
)
from workcell.model.mechanism.from_model import mechanism_of
from workcell.model.mechanism.placing import place
from workcell.pose import Pose

ARMS = """<mujoco><compiler angle="radian" autolimits="true"/><worldbody>%s%s
<body name="bar" pos="0 0 .6"><freejoint/><geom size=".02"/><site name="ee"/>
 <site name="L" pos="0 .25 0"/><site name="R" pos="0 -.25 0"/></body></worldbody>
<equality><weld site1="left" site2="L"/><weld site1="right" site2="R"/></equality></mujoco>"""
FOUR_BAR = """<mujoco><compiler angle="radian" autolimits="true"/><worldbody>
<body name="crank"><joint name="crank" axis="0 1 0" range="-3 3"/>
 <geom type="capsule" size=".01" fromto="0 0 0 0 0 .2"/>
 <body name="coupler" pos="0 0 .2"><joint name="coupler" axis="0 1 0"/>
  <geom type="capsule" size=".01" fromto="0 .05 0 .5 .05 0"/><site name="tip" pos=".25 .05 .1"/></body></body>
<body name="rocker" pos=".5 0 0"><joint name="rocker" axis="0 1 0" range="-1.5 1.5"/>
 <geom type="capsule" size=".01" fromto="0 .1 0 0 .1 .3"/></body></worldbody>
<equality><connect body1="coupler" body2="rocker" anchor=".5 0 0"/></equality>
<contact><exclude body1="crank" body2="rocker"/></contact></mujoco>"""


def arm(side):
    y = 0.3 if side == "left" else -0.3
    axes = ["0 0 1", "0 1 0", "1 0 0", "0 1 0", "1 0 0", "0 1 0", "0 0 1"]
    text = f'<site name="{side}"/>'
    for k in range(6, -1, -1):
        where = f"0 {y} .1" if k == 0 else "0.03 0 .15"
        geom = '<geom size=".01" contype="0" conaffinity="0"/>'
        joint = f'<joint name="{side}{k}" axis="{axes[k]}" range="-2.6 2.6"/>'
        text = f'<body name="{side}{k}" pos="{where}">{joint}{geom}{text}</body>'
    return text


@pytest.fixture(scope="module")
def two_arms():
    return mechanism_of(mujoco.MjModel.from_xml_string(ARMS % (arm("left"), arm("right"))))


def residual(mechanism, q):
    """What MuJoCo's constraints miss."""
    model = mechanism.compiled.model
    data = mujoco.MjData(model)
    data.qpos[:] = mechanism.compiled.qpos(q)
    mujoco.mj_fwdPosition(model, data)
    equal = data.efc_type[: data.nefc] == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    return np.abs(data.efc_pos[: data.nefc][equal]).max(), data


@pytest.mark.parametrize("solver", mechanism_solver_names())
@pytest.mark.parametrize("form", ["quaternion", "rotation"])
def test_two_arms_bring_what_both_hold_to_a_pose(two_arms, solver, form):
    goal = FrameGoal.posed(
        "ee", Pose(np.array([0.3, 0.02, 0.55]), np.array([0.99, 0.1, 0.05, 0.08]) / 0.9995)
    )
    result = solve_mechanism(
        MechanismProblem(two_arms, (goal,)), solver=solver, budget=Budget(20.0), form=form
    )
    assert result.solved and result.solver in mechanism_solver_names()[1:]
    missed, data = residual(two_arms, result.q)
    assert missed < 1e-6
    assert np.abs(data.site("ee").xpos - goal.position).max() < 1e-6
    if solver == "ikspark":
        assert result.stats["ikspark.rank_gap"] < 1e-5 and result.stats["ikspark.off_rotations"] < 1e-6


@pytest.mark.parametrize("form", ["quaternion", "rotation"])
def test_what_is_too_far_for_two_arms_is_proved_to_be(two_arms, form):
    goal = FrameGoal.posed("ee", Pose.from_xyz([2.3, 0.0, 0.5]))
    problem = MechanismProblem(two_arms, (goal,))
    result = solve_mechanism(problem, budget=Budget(10.0), form=form)
    assert result.status is Status.UNREACHABLE
    assert check_mechanism(problem, result.certificate) is None


@pytest.mark.parametrize("angle", [-0.8, 0.1, 0.9])
def test_a_four_bar_is_closed_where_its_tip_is_asked_for(angle):
    mechanism = mechanism_of(mujoco.MjModel.from_xml_string(FOUR_BAR))
    from workcell.ik.mechanisms.polish import polish_mechanism

    q = polish_mechanism(MechanismProblem(mechanism), mechanism.configuration({"crank": angle})).q
    frame = mechanism.frame("tip")
    tip = place(mechanism, q).point(frame.link, frame.T_link_frame.position)
    result = solve_mechanism(MechanismProblem(mechanism, (FrameGoal.at("tip", tip),)), budget=Budget(10.0))
    missed, data = residual(mechanism, result.unwrap())
    assert missed < 1e-6 and np.abs(data.site("tip").xpos - tip).max() < 1e-6


def test_points_in_regions_cones_and_users_constraints_hold_at_the_configuration(two_arms):
    import cvxpy as cp

    problem = MechanismProblem(
        two_arms,
        (FrameGoal.pointing("ee", (0.0, 0.0, 1.0), within=0.3),),
        regions=(InRegion.plane("ee", (0.0, 0.0, 1.0), 0.6),),
        constraints=(
            UserConstraint(
                "near a post", lambda of: [cp.norm(of.point("ee") - np.array([0.2, 0.1, 0.6])) <= 0.05]
            ),
        ),
    )
    result = solve_mechanism(problem, budget=Budget(20.0))
    missed, data = residual(two_arms, result.unwrap())
    assert missed < 1e-6
    assert abs(data.site("ee").xpos[2] - 0.6) < 1e-6
    assert data.site("ee").xmat[8] >= np.cos(0.3) - 1e-4
    assert np.linalg.norm(data.site("ee").xpos - [0.2, 0.1, 0.6]) <= 0.05 + 1e-5


def test_same_seed_same_answer_and_no_budget_no_answer(two_arms):
    goal = FrameGoal.at("ee", (0.3, 0.0, 0.6))
    problem = MechanismProblem(two_arms, (goal,))
    one, two = (solve_mechanism(problem, seed=3, budget=Budget(20.0)).unwrap() for _ in range(2))
    assert np.array_equal(one, two)
    assert solve_mechanism(problem, budget=Budget(0.0)).status is Status.NOT_FOUND


def test_what_makes_no_sense_is_refused_by_name(two_arms):
    with pytest.raises(UnknownNameError, match="ikspark"):
        solve_mechanism(MechanismProblem(two_arms), solver="iksprak")
    with pytest.raises(UnknownNameError, match="ee"):
        MechanismProblem(two_arms, (FrameGoal.at("eee", (0, 0, 0)),))
    empty = InRegion.polytope("ee", np.array([[1.0, 0, 0], [-1.0, 0, 0]]), np.array([0.0, -1.0]))
    with pytest.raises(InputError, match="ee"):
        solve_mechanism(MechanismProblem(two_arms, regions=(empty,)))
    bent = UserConstraint("bent", lambda of: [of.point("ee")[0] ** 2 >= 1])
    with pytest.raises(InputError, match="bent"):
        solve_mechanism(MechanismProblem(two_arms, constraints=(bent,)))


@pytest.mark.parametrize("solver", ["auto", *CLOSEST_SOLVERS])
def test_the_closest_configuration_holds_the_bar_with_both_arms(two_arms, solver):
    problem = MechanismProblem(two_arms, (FrameGoal.posed("ee", Pose.from_xyz([2.5, 0.0, 0.8])),))
    found = closest_configuration(problem, solver=solver, budget=Budget(20.0, effort=0.6), seed=1)
    assert found.status is Status.SOLVED, found.rejected
    assert residual(two_arms, found.q)[0] < 1e-6
    assert found.measured.accepted and found.measured.position_error > 1.0
    assert 0.0 <= found.bound <= found.cost and found.gap == found.cost - found.bound
    assert (found.bound > 1.0) == (solver != "multistart")
    assert np.isfinite(found.cost) and found.solver in ("ikspark", "multistart")


def test_what_nothing_keeps_has_no_closest_configuration(two_arms):
    above = InRegion.polytope("ee", [[0, 0, -1.0]], [-9.0])
    goal = FrameGoal.at("ee", [0.4, 0.0, 0.6])
    found = closest_configuration(MechanismProblem(two_arms, (goal,), (above,)), budget=Budget(20.0))
    assert found.status is Status.UNREACHABLE and found.q is None and found.certificate is not None
    with pytest.raises(UnknownNameError):
        closest_configuration(MechanismProblem(two_arms, (goal,)), solver="guess")
    with pytest.raises(InputError):
        closest_configuration(
            MechanismProblem(
                two_arms, (goal,), (InRegion.polytope("ee", [[1.0, 0, 0], [-1.0, 0, 0]], [0, -1]),)
            )
        )
