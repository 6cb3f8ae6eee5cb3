"""Lifts of true configurations keep every row, and are read back; joints that follow do so at rank one."""

import mujoco
import numpy as np
import pytest

from workcell.ik.ikspark.mechanisms.program import keeps
from workcell.ik.ikspark.mechanisms.relaxation import Relaxation
from workcell.ik.mechanisms.goals import FrameGoal
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.model.mechanism.from_model import mechanism_of
from workcell.model.mechanism.placing import place
from workcell.pose import Pose

ARM = """<mujoco><compiler angle="radian" autolimits="true"/><worldbody>
<body name="a" pos=".1 0 .3" euler=".2 .1 0">
 <joint name="j1" axis="0 0 1" pos="0 .1 0" ref=".3" range="-2 2"/><geom size=".02"/>
 <body name="b" pos=".3 0 0"><joint name="j2" axis="0 0 1" range="-1.5 1"/>
  <joint name="s" type="slide" axis="0 1 0" ref=".1" pos=".1 .2 0" range="-.3 .5"/><geom size=".02"/>
  <body name="c" pos=".3 0 0"><joint name="j3" axis="0 1 0" range="-1 1.3"/><geom size=".02"/>
   <body name="d" pos=".3 .1 0"><joint name="j4" axis="0 .6 .8" range="-1 1.3"/><geom size=".02"/>
    <body name="e" pos=".3 .1 0"><joint name="j5" axis="1 0 0" range="-1 1.3"/><geom size=".02"/>
     <site name="tip" pos="0 0 .2"/></body></body></body></body></body></worldbody>
<equality>%s</equality></mujoco>"""
FOLLOWING = {
    "in the chain, backwards": ("j5", "j4", ".1 -1 0 0 0"),
    "next to a planar link": ("j3", "j2", ".1 1 0 0 0"),
    "far apart": ("j5", "j3", "0 1 0 0 0"),
    "curved": ("j4", "j3", "0 .5 0.1 0 0"),
    "a slide": ("j4", "s", "0 .7 0 0 0"),
    "a slide follows": ("s", "j1", "0 .1 0 0 0"),
    "next to the world": ("j2", "j1", "0 -.5 0 0 0"),
}


def following(case):
    one, two, numbers = FOLLOWING[case]
    tie = f'<joint joint1="{one}" joint2="{two}" polycoef="{numbers}"/>'
    return mechanism_of(mujoco.MjModel.from_xml_string(ARM % tie))


def somewhere(mechanism, rng, share=0.5):
    """A configuration in the middle of the limits, with followers where their leaders have them."""
    q = np.array([rng.uniform(share * joint.lower, share * joint.upper) for joint in mechanism.joints])
    for follower in mechanism.followers:
        q[follower.joint] = np.polynomial.polynomial.polyval(q[follower.leader], follower.coefficients)
    return q


def pose_of(mechanism, q, name):
    placed, frame = place(mechanism, q), mechanism.frame(name)
    R = placed.R[frame.link] @ frame.T_link_frame.rotation
    return Pose.from_rotation(placed.point(frame.link, frame.T_link_frame.position), R)


@pytest.mark.parametrize("form", ["quaternion", "rotation"])
@pytest.mark.parametrize("whole", [False, True])
@pytest.mark.parametrize("case", FOLLOWING)
def test_the_lift_of_a_configuration_keeps_every_row_and_is_read_back(case, whole, form):
    mechanism, rng = following(case), np.random.default_rng(3)
    for _ in range(3):
        q = somewhere(mechanism, rng)
        pose = pose_of(mechanism, q, "tip")
        goal = FrameGoal.posed("tip", pose) if whole else FrameGoal.at("tip", pose.position)
        relaxation = Relaxation.of(MechanismProblem(mechanism, (goal,)), form)
        x = relaxation.lift.lift(q)
        for rows in relaxation.rows:
            assert keeps(rows.cone, rows.rows @ np.append(x, 1.0), 1e-9), (rows.family, rows.index)
        assert all(curve.cut(x) is None for curve in relaxation.curves)
        back = place(mechanism, relaxation.lift.read(x))
        there = place(mechanism, q)
        assert np.abs(back.R - there.R).max() < 1e-12 and np.abs(back.p - there.p).max() < 1e-12


@pytest.mark.parametrize("case", ["curved", "a slide", "next to the world"])
def test_what_leaves_a_curve_is_cut_off_it(case):
    mechanism, rng = following(case), np.random.default_rng(4)
    q = somewhere(mechanism, rng)
    problem = MechanismProblem(mechanism, (FrameGoal.at("tip", pose_of(mechanism, q, "tip").position),))
    relaxation = Relaxation.of(problem)
    (curve,) = relaxation.curves
    off = np.array(q)
    off[mechanism.followers[0].joint] += 0.2
    x = relaxation.lift.lift(off)
    cut = curve.cut(x)
    assert cut is not None and float(cut.rows[0] @ np.append(x, 1.0)) < 0.0
    for _ in range(20):
        on = relaxation.lift.lift(somewhere(mechanism, rng))
        assert float(cut.rows[0] @ np.append(on, 1.0)) > -1e-9
