"""Ties that say nothing new are told from those that do."""

from dataclasses import replace

import numpy as np
import pytest

from tests.model.loops.linkages import four_bar, parallel_arm
from tests.model.mechanism.trees import compiled
from workcell.model.mechanism.from_model import mechanism_of
from workcell.model.mechanism.mechanism import Follower, JointSum
from workcell.model.mechanism.redundancy import redundant_ties


@pytest.mark.parametrize("seed", range(4))
def test_a_loop_that_closes_once_needs_its_tie(seed):
    mechanism = mechanism_of(compiled(four_bar(np.random.default_rng(seed))))
    assert redundant_ties(mechanism, mechanism.home) == ()
    twice = replace(mechanism, closures=(*mechanism.closures, replace(mechanism.closures[0], name="again")))
    assert redundant_ties(twice, mechanism.home) == ("again",)
    pin = mechanism.closures[0]
    higher = tuple(replace(F, position=F.position + F.rotation @ [0.0, 0.0, 0.1]) for F in pin.frames)
    hinge = (*mechanism.closures, replace(pin, name="farther up", frames=higher))
    assert redundant_ties(replace(mechanism, closures=hinge), mechanism.home) == ("farther up",)


@pytest.mark.parametrize("seed", range(4))
def test_a_coupling_that_a_linkage_makes_already_is_named(seed):
    mechanism = mechanism_of(compiled(parallel_arm(np.random.default_rng(seed))))
    joints = [mechanism.joint(name) for name in ("j1", "pr", "pb")]
    implied = Follower("rod follows arm", joints[1], joints[0], np.array([0.0, 1.0]))
    new = JointSum("stiff", (mechanism.joint("j2"), joints[0]), np.ones(2), 0.0, 0.0)
    more = replace(mechanism, followers=(implied,), sums=(new,))
    assert redundant_ties(more, mechanism.home) == ("rod follows arm",)


def test_what_a_held_joint_leaves_nothing_to_say():
    mechanism = mechanism_of(compiled(four_bar(np.random.default_rng(0))))
    held = tuple(replace(joint, lower=0.0, upper=0.0) for joint in mechanism.joints)
    assert redundant_ties(replace(mechanism, joints=held), mechanism.home) == (mechanism.closures[0].name,)
