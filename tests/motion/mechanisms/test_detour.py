"""Ways between two configurations: straight where nothing is in it, else by one configuration between."""

import mujoco
import numpy as np
import pytest

from tests.simulate.mechanisms.crank import write_task
from workcell.errors import InputError, UnknownNameError
from workcell.ik.mechanisms.result import Measured
from workcell.model.mechanism.from_model import mechanism_of
from workcell.model.scene import Scene
from workcell.motion.mechanisms.detour import way_between
from workcell.motion.mechanisms.path import MechanismPath

TWO = """<mujoco><compiler angle="radian"/><worldbody><body name="a"><joint name="x" type="slide" axis="1 0 0"/>
<geom size=".1"/><body name="b"><joint name="y" type="slide" axis="0 1 0"/><geom size=".1"/></body></body></worldbody>
<actuator><motor joint="x"/><motor joint="y"/></actuator></mujoco>"""


@pytest.fixture(scope="module")
def plane():
    return mechanism_of(mujoco.MjModel.from_xml_string(TWO))


def outside_disc(radius):
    """All but a disc around (0.5, 0.5) is free."""

    def measure(q):
        inside = float(np.hypot(q[0] - 0.5, q[1] - 0.5)) < radius
        return Measured(reasons=("in the disc",) if inside else ())

    return measure


def test_a_free_way_is_straight(plane):
    path = MechanismPath(plane, np.array([[0.0, 0.0], [0.2, 0.2]]))
    assert way_between(path, outside_disc(0.2), 0.02, 0) == (path, "")


def test_what_is_in_the_way_is_gone_around(plane):
    path, measure = MechanismPath(plane, np.array([[0.0, 0.0], [1.0, 1.0]])), outside_disc(0.2)
    way, wrong = way_between(path, measure, 0.02, 3)
    assert not wrong and len(way) == 3
    assert np.array_equal(way.start, path.start) and np.array_equal(way.end, path.end)
    for k in range(2):
        assert all(measure(way.at(k, share).q).accepted for share in np.linspace(0, 1, 60))
    assert np.array_equal(way_between(path, measure, 0.02, 3)[0].configurations, way.configurations)


def test_where_nothing_leads_around_the_reason_is_told(plane):
    path = MechanismPath(plane, np.array([[0.0, 0.0], [1.0, 1.0]]))
    assert way_between(path, outside_disc(0.7), 0.05, 0) == (None, "in the disc")


def test_only_what_floats_can_be_left_out(tmp_path):
    moving = Scene.load(write_task(tmp_path)).mechanism
    with pytest.raises(UnknownNameError, match="nothing"):
        moving.without(["nothing"])
    with pytest.raises(InputError, match="does not float"):
        moving.without(["wall"])
    hand = Scene.load("hand_grasp").mechanism
    without = hand.without(["cube"])
    apart = np.flatnonzero(without.compiled.start != hand.compiled.start)
    assert len(apart) == 1 and without.compiled.start[apart[0]] > 100.0
