"""The judge's kinematics are those of `placing`, and so MuJoCo's."""

import numpy as np
import pytest

from tests.model.mechanism.trees import compiled, random_q, random_tree
from workcell.ik.mechanisms.exact import exact_mechanism
from workcell.model.mechanism.from_model import mechanism_of
from workcell.model.mechanism.placing import place


@pytest.mark.parametrize("seed", range(10))
def test_two_ways_to_place_links_agree(seed):
    rng = np.random.default_rng(seed)
    model = compiled(random_tree(rng))
    mechanism = mechanism_of(model, moving=[model.joint(j).name for j in range(model.njnt)])
    exact = exact_mechanism(mechanism)
    assert exact_mechanism(mechanism) is exact
    for _ in range(5):
        q = random_q(mechanism, rng)
        R, p = exact.links(q)
        placed = place(mechanism, q)
        np.testing.assert_allclose(R, placed.R, atol=1e-12)
        np.testing.assert_allclose(p, placed.p, atol=1e-11)
    frame = mechanism.frame("s3")
    R, p = exact.frames(("s3",), q)["s3"]
    np.testing.assert_allclose(p, placed.point(frame.link, frame.T_link_frame.position), atol=1e-11)
    np.testing.assert_allclose(R, placed.R[frame.link] @ frame.T_link_frame.rotation, atol=1e-12)
