"""What hands do to an object that they share, against closed forms and MuJoCo's own constraint forces."""

import mujoco
import numpy as np
import pytest

from workcell.simulate.grasp import Weld
from workcell.simulate.shared_load import internal_force, weld_force

GRAVITY, LOAD_KG, HAND_KG = 9.81, 2.0, 0.5
WEIGHT = LOAD_KG * GRAVITY
# Hands that slide but don't turn, each tilted in its own way. An equality of others comes before the welds, and the
# contacts of a crate on the floor behind them, whose numbers are those of equalities too.
HAND = """
    <body name="rail_{name}" pos="{pos}">
      <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint type="slide" axis="0 0 1"/>
      <body name="{name}" euler="{euler}"><geom type="sphere" size="0.02" mass="0.5"/></body>
    </body>"""
MODEL = f"""
<mujoco>
  <option timestep="0.002" integrator="implicitfast" gravity="0 0 -9.81"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <geom type="plane" size="2 2 0.1" contype="1" conaffinity="1"/>
    <body name="bob" pos="0 1 1"><freejoint/><geom type="sphere" size="0.05" mass="1"/></body>
    <body name="crate" pos="1 1 0.1">
      <freejoint/><geom type="box" size="0.1 0.1 0.1" mass="1" contype="1" conaffinity="1"/>
    </body>
    <body name="load" pos="0 0 1" euler="0 0 20"><freejoint/><geom type="box" size="0.2 0.1 0.05" mass="2"/></body>
    {HAND.format(name="left", pos="-0.25 0 1", euler="30 40 50")}
    {HAND.format(name="right", pos="0.25 0.05 1.02", euler="0 -70 10")}
    {HAND.format(name="third", pos="0 0.2 1", euler="90 0 45")}
  </worldbody>
  <equality>
    <connect body1="bob" anchor="0 0 0.3"/>
    <weld name="left" body1="left" body2="load" active="false"/>
    <weld name="right" body1="right" body2="load" active="false"/>
    <weld name="third" body1="third" body2="load" active="false"/>
  </equality>
</mujoco>
"""


class Bench:
    """Hands that hold the load, and the forces that drive them."""

    def __init__(self, *hands: str) -> None:
        self.model = mujoco.MjModel.from_xml_string(MODEL)
        self.data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, self.data)
        load = self.model.body("load").id
        corners = np.zeros((0, 3))
        self.welds = [
            Weld(self.model.equality(hand).id, self.model.body(hand).id, load, corners) for hand in hands
        ]
        for weld in self.welds:
            weld.close(self.model, self.data)

    def drive(self, forces, moment=(0.0, 0.0, 0.0), seconds=0.6):
        """Each hand is carried and pushed by a constant force; `moment` turns the load."""
        for weld, force in zip(self.welds, forces, strict=True):
            self.data.xfrc_applied[weld.hand_body, :3] = np.add(force, [0.0, 0.0, HAND_KG * GRAVITY])
        self.data.xfrc_applied[self.welds[0].object_body, 3:] = moment
        mujoco.mj_step(self.model, self.data, round(seconds / self.model.opt.timestep))

    @property
    def strain(self):
        return internal_force(self.data, self.welds)


def constraint_force(model, data, weld):
    """(3,) force of the hand on the object: what MuJoCo's own pass over the bodies adds to forces from outside."""
    mujoco.mj_rnePostConstraint(model, data)
    return data.xfrc_applied[weld.hand_body, :3] - data.cfrc_ext[weld.hand_body, 3:]


@pytest.mark.parametrize("moment", [(0.0, 0.0, 0.0), (0.5, -2.0, 1.0)], ids=["", "moment"])
@pytest.mark.parametrize(
    ("apart", "along", "share", "push"),
    [
        ((10.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.5, 0.0),
        ((-10.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.5, 0.0),
        ((2.0, -3.0, 6.0), (0.0, 0.0, 0.0), 0.5, 0.0),
        ((10.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.9, 0.0),
        ((10.0, 0.0, 0.0), (1.0, 2.0, 0.5), 0.5, 0.1),
    ],
    ids=["pulled", "squeezed", "askew", "unequal shares", "moved along"],
)
def test_what_two_hands_pull_apart_with_is_what_cancels(apart, along, share, push, moment):
    """Closed form: each hand passes its force on, less what its own mass takes to move; half the difference cancels."""
    bench = Bench("left", "right")
    pull, common = np.array(apart), np.array(along)
    up = np.array([0.0, 0.0, WEIGHT])
    bench.drive([share * up - pull + common, (1 - share) * up + pull + common], moment)
    moved = 2 * common / (LOAD_KG + 2 * HAND_KG)
    left, right = (weld_force(bench.data, weld) for weld in bench.welds)
    assert left == pytest.approx(share * up - pull + common - HAND_KG * moved, abs=1e-3)
    assert right == pytest.approx((1 - share) * up + pull + common - HAND_KG * moved, abs=1e-3)
    assert bench.strain == pytest.approx(np.linalg.norm(pull - (share - 0.5) * up), abs=1e-3)


def test_the_hand_that_is_furthest_from_an_equal_share_counts():
    """Three hands: of forces that add up to nothing, the largest."""
    bench = Bench("left", "right", "third")
    strains = np.array([[4.0, 0.0, -3.0], [0.0, 12.0, 0.0], [-4.0, -12.0, 3.0]])
    bench.drive(strains + np.array([0.0, 0.0, WEIGHT / 3]))
    assert bench.strain == pytest.approx(13.0, abs=1e-3)


def test_hands_that_share_the_load_equally_have_none():
    bench = Bench("left", "right")
    bench.drive([[0.0, 0.0, WEIGHT / 2]] * 2)
    assert bench.strain < 1e-3
    bench.welds[1].release(bench.data)
    bench.drive([[0.0, 0.0, WEIGHT], [0.0, 0.0, 0.0]])
    assert np.all(weld_force(bench.data, bench.welds[1]) == 0.0)
    assert bench.strain == pytest.approx(WEIGHT / 2, abs=1e-3)


def test_in_any_motion_the_forces_are_those_of_mujoco_s_own_bookkeeping():
    """Random forces and moments, a load that sways: what constraints do to each hand's body and its joints."""
    rng = np.random.default_rng(3)
    bench = Bench("left", "right", "third")
    strains = []
    for _ in range(40):
        bench.drive(rng.normal(0.0, 15.0, (3, 3)), rng.normal(0.0, 1.0, 3), seconds=0.01)
        forces = np.array([constraint_force(bench.model, bench.data, weld) for weld in bench.welds])
        for weld, force in zip(bench.welds, forces, strict=True):
            slides = bench.model.body_dofadr[bench.model.body_parentid[weld.hand_body]] + np.arange(3)
            assert weld_force(bench.data, weld) == pytest.approx(force, rel=1e-9, abs=1e-9)
            assert -bench.data.qfrc_constraint[slides] == pytest.approx(force, rel=1e-9, abs=1e-9)
        expected = max(np.linalg.norm(force - forces.sum(axis=0) / 3) for force in forces)
        assert bench.strain == pytest.approx(expected, rel=1e-9)
        strains.append(expected)
    assert min(strains) > 1.0 and bench.data.ncon == 4
