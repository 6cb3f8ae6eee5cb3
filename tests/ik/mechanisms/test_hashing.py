"""A proof belongs to one question: whatever it may rest on changes the hash, names do not."""

from dataclasses import replace

import numpy as np
import pytest

from workcell.ik.mechanisms.goals import FrameGoal, InRegion
from workcell.ik.mechanisms.hashing import mechanism_hash
from workcell.ik.mechanisms.problem import MechanismProblem, MechanismTolerances, UserConstraint
from workcell.model.mechanism.mechanism import Closure, Follower, Frame, Joint, JointSum, Mechanism
from workcell.pose import Pose

Z = np.array([0.0, 0.0, 1.0])
ONE = Pose.from_xyz([0.1, 0.2, 0.3])
OTHER = Pose(np.array([0.1, 0.2, 0.3]), np.array([0.6, 0.8, 0.0, 0.0]))
MECHANISM = Mechanism(
    "m",
    (Joint("a", "hinge", 0, ONE, Z, -1.0, 1.0), Joint("b", "slide", 1, ONE, Z, -1.0, 1.0)),
    ("world", "one", "two"),
    (Closure("c", "connect", (0, 2), (ONE, ONE)),),
    (Follower("f", 1, 0, np.array([0.0, 0.5])),),
    (JointSum("s", (0, 1), np.array([1.0, 2.0]), 0.0, 1.0),),
    {"tool": Frame("tool", 2, ONE), "other": Frame("other", 1, ONE)},
)
PROBLEM = MechanismProblem(
    MECHANISM,
    (FrameGoal.posed("tool", ONE),),
    (InRegion.plane("tool", Z, 0.5),),
    q_reference=np.zeros(2),
    max_step=0.5,
    max_link_rotation=0.5,
)


def mechanism(**changes):
    return replace(PROBLEM, mechanism=replace(MECHANISM, **changes))


def joints(**changes):
    return mechanism(joints=(replace(MECHANISM.joints[0], **changes), MECHANISM.joints[1]))


@pytest.mark.parametrize(
    "changed",
    [
        joints(kind="slide"),
        joints(T_parent_joint=OTHER),
        joints(axis=np.array([1.0, 0.0, 0.0])),
        joints(lower=-1.1),
        joints(upper=np.nextafter(1.0, 2.0)),
        mechanism(joints=(MECHANISM.joints[0], replace(MECHANISM.joints[1], parent=0))),
        mechanism(closures=()),
        mechanism(closures=(Closure("c", "weld", (0, 2), (ONE, ONE)),)),
        mechanism(closures=(Closure("c", "connect", (1, 2), (ONE, ONE)),)),
        mechanism(closures=(Closure("c", "connect", (0, 2), (ONE, OTHER)),)),
        mechanism(followers=()),
        mechanism(sums=()),
        mechanism(frames={**MECHANISM.frames, "tool": Frame("tool", 1, ONE)}),
        mechanism(frames={**MECHANISM.frames, "tool": Frame("tool", 2, OTHER)}),
        replace(PROBLEM, goals=()),
        replace(PROBLEM, goals=(FrameGoal.posed("tool", OTHER),)),
        replace(PROBLEM, goals=(FrameGoal.at("tool", ONE.position),)),
        replace(PROBLEM, goals=(FrameGoal.posed("other", ONE),)),
        replace(PROBLEM, goals=(FrameGoal.pointing("tool", Z),)),
        replace(PROBLEM, regions=()),
        replace(PROBLEM, regions=(InRegion.plane("tool", Z, 0.6),)),
        replace(PROBLEM, regions=(InRegion.polytope("tool", Z[None], np.array([0.5])),)),
        replace(PROBLEM, q_reference=np.full(2, 0.1)),
        replace(PROBLEM, max_step=0.4),
        replace(PROBLEM, max_step=None),
        replace(PROBLEM, max_link_rotation=0.4),
        replace(PROBLEM, tolerances=MechanismTolerances(position=2e-4)),
        replace(PROBLEM, tolerances=MechanismTolerances(rotation=2e-3)),
        replace(PROBLEM, tolerances=MechanismTolerances(closure=2e-6)),
        replace(PROBLEM, tolerances=MechanismTolerances(region=2e-6)),
    ],
)
def test_whatever_a_proof_may_rest_on_counts(changed):
    assert mechanism_hash(changed) != mechanism_hash(PROBLEM)


def test_names_and_what_no_proof_uses_do_not():
    named = mechanism(
        name="other",
        link_names=("w", "x", "y"),
        joints=(replace(MECHANISM.joints[0], name="x"), MECHANISM.joints[1]),
    )
    users = replace(PROBLEM, constraints=(UserConstraint("u", lambda expressions: []),), collisions=False)
    assert mechanism_hash(named) == mechanism_hash(users) == mechanism_hash(PROBLEM)
