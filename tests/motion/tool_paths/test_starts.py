"""Whole turns of joints: the same posture, as near to where the robot stands as the limits allow."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from workcell.model.loading.load import load_robot
from workcell.motion.tool_paths.starts import with_turns

TURNED = 2 * np.pi - 1.0
"""A whole turn from -1: every joint of the UR10 may do it but the elbow, which ends at half a turn."""


@pytest.fixture(scope="module")
def ur10():
    return load_robot("ur10")


shares = st.lists(st.floats(0.0, 1.0), min_size=6, max_size=6).map(np.array)


@given(q=shares, near=shares)
def test_a_turned_configuration_is_the_same_posture_and_never_further(ur10, q, near):
    q, near = (ur10.lower + share * (ur10.upper - ur10.lower) for share in (q, near))
    turned = ur10.unwrap(q, near)
    assert np.all(turned >= ur10.lower) and np.all(turned <= ur10.upper)
    assert np.allclose(ur10.link_transforms(turned), ur10.link_transforms(q), atol=1e-9)
    assert np.all(np.abs(turned - near) <= np.abs(q - near) + 1e-9)


def test_a_turn_beyond_the_limits_is_not_made(ur10):
    turned = ur10.unwrap(np.full(6, -1.0), np.full(6, 3.5))
    assert np.allclose(turned, [TURNED, TURNED, -1.0, TURNED, TURNED, TURNED])


def test_both_turns_are_offered_the_nearer_one_first(ur10):
    near, q = np.array([3.5, 0, 0, 0, 0, 0]), np.full(6, -1.0)
    first, second = with_turns(ur10, [q], near)
    assert np.allclose(first, [TURNED, -1, -1, -1, -1, -1]) and np.array_equal(second, q)
    assert len(with_turns(ur10, [near], near)) == 1 and len(with_turns(ur10, [q], None)) == 1
