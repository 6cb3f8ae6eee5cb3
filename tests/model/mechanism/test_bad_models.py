"""What a model asks of its joints is honoured, or refused by name."""

import mujoco
import numpy as np
import pytest

from tests.model.mechanism.trees import compiled
from workcell.errors import InputError, ModelError, UnknownNameError
from workcell.model.loading.load import compile_spec, load_spec
from workcell.model.mechanism.from_model import mechanism_of

INERTIA = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


def chain(equality="", one='range="-1 1"', two="", head="", more=""):
    return compiled(
        f"""<mujoco><compiler angle="radian"/>{head}<worldbody>
        <site name="ground" pos="0 0 1"/>
        <body name="one"><joint name="a" axis="0 0 1" {one}/><geom name="g1" size=".1"/>
          <site name="on_one" pos="0 0 .1"/>
          <body name="plate" pos=".1 0 0"><geom size=".05"/><site name="on_plate" pos="0 0 .1"/></body>
          <body name="two" pos=".5 0 0"><joint name="b" axis="0 1 0" {two}/><geom name="g2" size=".1"/>
            <site name="tip" pos=".5 0 0"/></body></body>{more}
        </worldbody><tendon><fixed name="t"><joint joint="a" coef="1"/><joint joint="b" coef="2"/></fixed></tendon>
        <equality>{equality}</equality></mujoco>"""
    )


def test_a_range_of_zero_width_locks():
    joint = mechanism_of(chain(two='range=".3 .3"')).joints[1]
    assert joint.lower == joint.upper == 0.3


def test_an_equality_with_a_number_locks_and_home_is_there():
    mechanism = mechanism_of(chain('<joint joint1="b" polycoef=".4"/>'))
    assert mechanism.joints[1].lower == mechanism.joints[1].upper == 0.4
    assert mechanism.home.tolist() == [0.0, 0.4]
    assert not mechanism.followers


def test_a_joint_that_follows_a_held_one_is_held():
    mechanism = mechanism_of(
        chain('<joint joint1="a" polycoef=".4"/><joint joint1="b" joint2="a" polycoef="0 .5"/>')
    )
    assert mechanism.joints[1].lower == mechanism.joints[1].upper == pytest.approx(0.2)


def test_home_keeps_the_couplings():
    mechanism = mechanism_of(chain('<joint joint1="b" joint2="a" polycoef=".25 .5"/>'))
    assert mechanism.home.tolist() == [0.0, 0.25]
    assert [f.name for f in mechanism.followers] == ["b follows a"]


def test_contradictory_locks_are_named():
    with pytest.raises(ModelError, match=r"hold joint 'b' at 0\.4 and 0\.5"):
        mechanism_of(chain('<joint joint1="b" polycoef=".4"/><joint joint1="b" polycoef=".5"/>'))


def test_a_lock_outside_the_range_is_named():
    with pytest.raises(ModelError, match=r"holds joint 'a' at 2, outside its range \[-1, 1\]"):
        mechanism_of(chain('<joint joint1="a" polycoef="2"/>'))


def test_contradictory_couplings_are_named():
    with pytest.raises(ModelError, match="couplings of joint 'b' with 'a' contradict each other"):
        mechanism_of(
            chain(
                '<joint joint1="b" joint2="a" polycoef="0 1"/><joint joint1="b" joint2="a" polycoef=".1 1"/>'
            )
        )


def test_reversed_limits_are_named():
    model = chain()
    model.jnt_range[0] = [1.0, -1.0]
    with pytest.raises(ModelError, match=r"the range of joint 'a' is \[1, -1\]"):
        mechanism_of(model)


def test_reversed_limits_of_a_ball_are_named():
    model = compiled(
        '<mujoco><worldbody><body><joint name="k" type="ball" limited="true" range="0 1"/><geom size="1"/>'
        "</body></worldbody></mujoco>"
    )
    model.jnt_range[0] = [0.0, -1.0]
    with pytest.raises(ModelError, match="range of joint 'k'"):
        mechanism_of(model)


def test_a_joint_without_a_name_gets_one_that_no_other_has():
    text = """<mujoco><worldbody><body><joint axis="0 0 1"/><geom size=".1"/>
      <body pos="1 0 0"><joint name="joint 0"/><geom size=".1"/></body></body></worldbody></mujoco>"""
    mechanism = mechanism_of(compiled(text))
    assert [joint.name for joint in mechanism.joints] == ["joint 0 (unnamed)", "joint 0"]
    assert [j.name for j in mechanism_of(compiled(text), moving=["joint 0"]).joints] == ["joint 0"]


def test_inactive_constraints_do_not_count():
    assert not mechanism_of(chain('<connect active="false" body1="two" anchor="0 0 0"/>')).closures


def test_a_constraint_to_the_world_and_one_between_sites():
    mechanism = mechanism_of(
        chain('<connect body1="two" anchor="0 0 0"/><weld name="w" site1="tip" site2="ground"/>')
    )
    assert [(c.kind, c.links, c.id) for c in mechanism.closures] == [
        ("connect", (2, 0), 0),
        ("weld", (2, 0), 1),
    ]


def test_a_weld_of_two_bodies_of_one_link_that_hold_as_they_stand_is_noted():
    mechanism = mechanism_of(chain('<weld body1="one" body2="plate"/>'))
    assert not mechanism.closures and "ties bodies that no joint moves" in mechanism.notes[0]


@pytest.mark.parametrize(
    "equality",
    [
        '<weld name="w" body1="one" body2="plate" relpose=".2 0 0 1 0 0 0"/>',
        '<weld name="w" body1="one" body2="plate" relpose=".1 0 0 .6 .8 0 0"/>',
        '<connect name="w" site1="on_plate" site2="on_one"/>',
    ],
)
def test_a_loop_that_can_not_close_is_named(equality):
    with pytest.raises(ModelError, match=r"'w'.*a loop that can't close"):
        mechanism_of(chain(equality))


def test_a_loop_of_joints_that_stay_is_left_as_it_stands():
    model = chain('<connect body1="two" anchor="0 0 0"/>')
    model.body_pos[model.body("two").id] += 0.1
    more = mechanism_of(model, moving=["b"], qpos=[0.3, 0.0])
    assert len(more.closures) == 1  # b still moves its point
    assert not mechanism_of(
        chain('<connect body1="one" body2="plate" anchor="0 0 0"/>'), moving=["b"]
    ).closures


def test_what_is_said_twice_is_left_out_and_noted():
    mechanism = mechanism_of(
        chain(
            '<connect name="c" body1="two" anchor=".1 0 0"/><connect name="d" body1="two" anchor=".1 0 0"/>'
            '<tendon tendon1="t" polycoef=".2"/><tendon tendon1="t" polycoef=".2"/>'
        )
    )
    assert len(mechanism.closures) == 1 and len(mechanism.sums) == 1
    assert mechanism.notes[0] == "connect 'd' (two, world) says what connect 'c' (two, world) says already"
    assert len(mechanism.notes) == 2


def test_tendons_that_contradict_each_other_are_named():
    with pytest.raises(ModelError, match="contradict each other"):
        mechanism_of(chain('<tendon tendon1="t" polycoef=".2"/><tendon tendon1="t" polycoef=".3"/>'))


def test_a_tendon_through_space_is_refused():
    model = compiled(
        """<mujoco><worldbody><site name="p"/><body><joint/><geom size=".1"/><site name="q" pos="1 0 0"/></body>
        </worldbody><tendon><spatial name="s"><site site="p"/><site site="q"/></spatial></tendon>
        <equality><tendon tendon1="s"/></equality></mujoco>"""
    )
    with pytest.raises(ModelError, match="tendons through space are not supported"):
        mechanism_of(model)


def test_a_tie_of_a_deformable_body_is_refused():
    model = chain('<connect name="f" body1="two" anchor="0 0 0"/>')
    model.eq_type[0] = mujoco.mjtEq.mjEQ_FLEX
    with pytest.raises(ModelError, match="'f': deformable bodies are not supported"):
        mechanism_of(model)
    model.eq_type[0] = mujoco.mjtEq.mjEQ_DISTANCE
    with pytest.raises(ModelError, match=r"distance 'f'.* are not supported"):
        mechanism_of(model)


def test_a_leader_that_stays_holds_its_follower_and_the_other_way_round():
    model = chain('<joint joint1="b" joint2="a" polycoef=".1 .5"/>')
    held = mechanism_of(model, moving=["b"], qpos=[0.4, 0.0]).followers[0]
    assert held.leader == -1 and held.coefficients.tolist() == pytest.approx([0.3])
    led = mechanism_of(model, moving=["a"], qpos=[0.0, 0.3]).followers[0]
    assert led.joint == 0 and led.leader == -1 and led.coefficients.tolist() == pytest.approx([0.4])
    bent = chain('<joint joint1="b" joint2="a" polycoef=".1 .5 1"/>')
    with pytest.raises(ModelError, match="b follows a, and stays where it begins"):
        mechanism_of(bent, moving=["a"])


def test_unknown_joints_and_wrong_positions_are_named():
    with pytest.raises(UnknownNameError, match="no joint named 'c'"):
        mechanism_of(chain(), moving=["c"])
    for wrong in ([0.0], [0.0, np.nan]):
        with pytest.raises(InputError, match="2 finite numbers"):
            mechanism_of(chain(), qpos=wrong)
    with pytest.raises(ModelError, match="no joint"):
        mechanism_of(chain(), moving=[])
    with pytest.raises(ModelError, match="no joint"):
        mechanism_of(compiled("<mujoco/>"))


def test_a_floating_body_that_nothing_ties_stays():
    more = '<body name="cup" pos="0 1 0"><freejoint name="f"/><geom size=".1"/></body>'
    assert [j.name for j in mechanism_of(chain(more=more)).joints] == ["a", "b"]
    tied = '<connect body1="cup" body2="two" anchor="0 0 0"/>'
    assert [j.kind for j in mechanism_of(chain(tied, more=more)).joints] == ["hinge", "hinge", "free"]


def test_mimic_joints_of_a_urdf_follow(tmp_path):
    inertia = "".join(f'{name}="{value}" ' for name, value in zip(INERTIA, (1, 1, 1, 0, 0, 0), strict=True))
    mass = f'<inertial><mass value="1"/><inertia {inertia}/></inertial>'
    (tmp_path / "arm.urdf").write_text(
        f"""<robot name="r"><link name="base"/><link name="l1">{mass}</link><link name="l2">{mass}</link>
        <joint name="j1" type="revolute"><parent link="base"/><child link="l1"/><axis xyz="0 0 1"/>
          <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
        <joint name="j2" type="revolute"><parent link="l1"/><child link="l2"/><axis xyz="0 1 0"/>
          <mimic joint="j1" multiplier="-2" offset=".3"/>
          <limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>"""
    )
    path = tmp_path / "arm.urdf"
    mechanism = mechanism_of(compile_spec(load_spec(path), path), where=path)
    (follower,) = mechanism.followers
    assert (follower.joint, follower.leader) == (1, 0)
    assert follower.coefficients.tolist() == pytest.approx([0.3, -2.0])


def test_locks_of_a_file_are_locks(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(
        """<mujoco><worldbody><body><joint name="a" axis="0 0 1" range="0 0"/><geom size=".1"/>
        <body pos="1 0 0"><joint name="b" axis="0 0 1" range="30 30"/><geom size=".1"/></body></body></worldbody>
        </mujoco>"""
    )
    joints = mechanism_of(compile_spec(load_spec(path), path)).joints
    assert (joints[0].lower, joints[0].upper) == (0.0, 0.0)
    assert joints[1].lower == joints[1].upper == pytest.approx(np.pi / 6)
