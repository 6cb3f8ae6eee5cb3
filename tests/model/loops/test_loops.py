"""Passive joints are where the model's loops have them; loops that tie driven joints are refused by name."""

from dataclasses import replace

import numpy as np
import pytest

from tests.model.loops.linkages import demanded, four_bar, linked_gripper, parallel_arm
from workcell.errors import ModelError
from workcell.ik.judge.verify import Verifier
from workcell.model.collision_model import CollisionModel
from workcell.model.grip import fingers_at
from workcell.model.loops.motion import LoopBounds
from workcell.model.scene import Scene
from workcell.motion.path import Path
from workcell.motion.proofs.on_model import prove_path
from workcell.world.planning_world import PlanningWorld


def scene_of(tmp_path, text):
    (tmp_path / "cell.xml").write_text(text)
    return Scene.load(tmp_path / "cell.xml")


@pytest.mark.parametrize("seed", range(6))
def test_a_parallel_rod_stays_parallel(tmp_path, seed):
    rng = np.random.default_rng(seed)
    scene = scene_of(tmp_path, parallel_arm(rng))
    robot, collision = scene.robot(), CollisionModel(scene)
    assert robot.loops.passive == ("pb", "pr") and not robot.loops.refusals and not robot.loops.undetermined
    assert set(robot.loops.bodies) == {scene.model.body(name).id for name in ("bracket", "rod")}
    for q in robot.robot.random_configuration(rng, 20):
        qpos = collision.full_qpos(q)
        assert qpos[scene.model.joint("pr").qposadr[0]] == pytest.approx(q[0], abs=1e-9)
        assert qpos[scene.model.joint("pb").qposadr[0]] == pytest.approx(-q[0], abs=1e-9)
        assert demanded(scene.model, qpos) < 1e-9
        assert collision.distance(q).reason == ""
        assert np.array_equal(collision.full_qpos(q), qpos)  # same positions, same answer


@pytest.mark.parametrize("seed", range(8))
def test_a_four_bar_is_followed_as_far_as_it_closes(tmp_path, seed):
    rng = np.random.default_rng(seed)
    scene = scene_of(tmp_path, four_bar(rng))
    collision, model = CollisionModel(scene), scene.model
    before, closed = None, 0
    for value in np.linspace(0.0, 3.0, 400):
        qpos, found = collision.full_qpos([value]), collision.distance([value])
        if found.reason:
            assert (
                "connect 'pin'" in found.reason and "can't be closed" in found.reason and found.distance < 0
            )
            break
        closed += 1
        assert demanded(model, qpos) < 1e-6
        here = qpos[[model.joint(name).qposadr[0] for name in "pr"]]
        assert before is None or np.abs(here - before).max() < 0.3  # no jump to the other assembly
        before = here
    assert closed > 3


def test_there_is_no_configuration_where_a_loop_is_open(tmp_path):
    for seed in range(20):
        scene = scene_of(tmp_path, four_bar(np.random.default_rng(seed)))
        world = PlanningWorld.of(scene)
        q = next((np.array([v]) for v in np.linspace(0, 3, 40) if world.collision.distance([v]).reason), None)
        if q is not None:
            break
    verdict = Verifier(world.problem(world.tool_pose(q)))(q)
    assert not verdict.accepted and verdict.reasons == (world.collision.distance(q).reason,)
    assert world.collision.contact(q) is None or world.clearance(q).reason
    assert "can't be closed" in world.collision.torn([0.0], q)


@pytest.mark.parametrize("make", [parallel_arm, four_bar])
def test_passive_joints_stay_within_what_is_proved_of_them(tmp_path, make):
    proved = 0
    for seed in range(4):
        rng = np.random.default_rng(seed)
        scene = scene_of(tmp_path, make(rng))
        collision, (loop,) = CollisionModel(scene), scene.robot().loops.loops
        bounds, robot = LoopBounds(scene.model, loop.system), scene.robot().robot
        given = [int(np.flatnonzero(scene.robot().qpos_addresses == a)[0]) for a in loop.system.given_qpos]
        for q in robot.random_configuration(rng, 15):
            if collision.distance(q).reason:
                continue
            half, qpos = 10 ** rng.uniform(-3, -1, robot.dof), collision.full_qpos(q)
            radii = bounds.radii(qpos, half[given])
            if radii is None:
                continue
            proved += 1
            for _ in range(10):
                near = np.clip(q + half * rng.choice([-1, -0.3, 1], robot.dof), robot.lower, robot.upper)
                assert not collision.distance(near).reason
                moved = collision.full_qpos(near)[loop.system.passive_qpos] - qpos[loop.system.passive_qpos]
                assert (np.abs(moved) <= radii).all()
    assert proved > 15


def test_the_other_assembly_is_not_reached_without_opening(tmp_path):
    scene = scene_of(tmp_path, four_bar(np.random.default_rng(1)))
    (loop,), collision = scene.robot().loops.loops, CollisionModel(scene)
    one = collision.full_qpos([0.02])
    assert collision.torn([0.02], [0.05]) == ""
    other = one.copy()
    other[loop.system.passive_qpos] += [2.0, -1.0]
    assert not loop.system.follows(one, other)
    assert "assembled in another way" in scene.robot().loops.torn(one, other)


def test_limits_of_passive_joints_hold(tmp_path):
    text = parallel_arm(np.random.default_rng(0)).replace(
        'name="pr" axis="0 1 0" range="-3 3"', 'name="pr" axis="0 1 0" range="-.5 .5"'
    )
    collision = CollisionModel(scene_of(tmp_path, text))
    assert collision.distance([0.4, 0.0]).reason == ""
    assert "joint pr = 0.7, which connect 'joint'" in collision.distance([0.7, 0.0]).reason


REFUSED = {
    "a connect that ties driven joints": (
        '<connect name="tie" body1="fore" body2="world" anchor="0.2 0 0"/>',
        r"connect 'tie' \(fore, world\) ties joints that are driven: j1, j2",
    ),
    "a weld that ties driven joints": (
        '<weld name="tie" body1="fore" body2="base"/>',
        r"weld 'tie' \(fore, base\) ties joints that are driven: j1, j2",
    ),
    "a loop that leaves nothing to choose": (
        '<connect name="a" body1="rod" body2="bracket" anchor="0 0 .2"/>'
        '<connect name="b" body1="rod" body2="fore" anchor="0 0 .1"/>',
        r"connect 'a'.*connect 'b'.*ties joints that are driven: j1, j2",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_ties_driven_joints_is_refused_by_name(tmp_path, case):
    equality, words = REFUSED[case]
    scene = scene_of(tmp_path, parallel_arm(np.random.default_rng(3), equality=equality))
    with pytest.raises(ModelError, match=words):
        PlanningWorld.of(scene)


def test_inactive_constraints_do_not_count_and_idle_joints_are_named(tmp_path):
    equality = '<connect name="off" active="false" body1="fore" body2="world" anchor="0.2 0 0"/>'
    scene = scene_of(tmp_path, parallel_arm(np.random.default_rng(3), equality=equality))
    loops = scene.robot().loops
    assert loops.loops == () and loops.refusals == () and loops.undetermined == ("pb", "pr")
    assert PlanningWorld.of(scene).clearance(scene.robot().start).reason == ""


@pytest.mark.parametrize("kind", ["weld", "sites", "tendon"])
def test_other_elements_close_loops_as_well(tmp_path, kind):
    rng = np.random.default_rng(5)
    text = parallel_arm(rng)
    if kind == "weld":  # a small body on the bracket's end is one with the rod
        end = '<body name="end" pos="{x} {y} 0"><joint name="pe" axis="0 1 0"/><geom type="sphere" size=".004"/></body>'
        x, y = text.split('fromto="-.02 ')[1].split(" ")[2], text.split('fromto="-.02 ')[1].split(" ")[0]
        text = parallel_arm(
            np.random.default_rng(5),
            extra=end.format(x=x, y=y),
            equality='<weld name="w" body1="rod" body2="end"/>',
        )
    elif kind == "sites":
        z = text.split('<body name="fore" pos="0 0 ')[1].split('"')[0]
        x, y = text.split('fromto="-.02 ')[1].split(" ")[2], text.split('fromto="-.02 ')[1].split(" ")[0]
        text = text.replace('<geom name="rod"', f'<site name="s1" pos="0 0 {z}"/><geom name="rod"')
        text = text.replace('<geom name="bracket"', f'<site name="s2" pos="{x} {y} 0"/><geom name="bracket"')
        text = (
            text.split("<equality>")[0]
            + '<equality><connect name="w" site1="s1" site2="s2"/></equality>'
            + text.split("</equality>")[1]
        )
    else:
        tendons = '<fixed name="t1"><joint joint="pr" coef="2"/></fixed>'
        tendons += '<fixed name="t2"><joint joint="j1" coef="1"/></fixed>'
        tendons += '<fixed name="t3"><joint joint="pb" coef="1"/><joint joint="j1" coef="1"/></fixed>'
        text = (
            text.split("<equality>")[0]
            + (
                f'<tendon>{tendons}</tendon><equality><tendon name="w" tendon1="t1" tendon2="t2" polycoef="0 2 0 0 0"/>'
                '<tendon name="v" tendon1="t3"/></equality>'
            )
            + text.split("</equality>")[1]
        )
    scene = scene_of(tmp_path, text)
    assert scene.robot().loops.refusals == ()
    collision = CollisionModel(scene)
    for q in scene.robot().robot.random_configuration(rng, 10):
        qpos = collision.full_qpos(q)
        assert qpos[scene.model.joint("pr").qposadr[0]] == pytest.approx(q[0], abs=1e-8)
        assert qpos[scene.model.joint("pb").qposadr[0]] == pytest.approx(-q[0], abs=1e-8)
        assert demanded(scene.model, qpos) < 1e-8


def test_a_grippers_linkages_close_with_its_fingers(tmp_path):
    scene = scene_of(tmp_path, linked_gripper(np.random.default_rng(0)))
    robot, model = scene.robot(), scene.model
    assert robot.loops.loops == () and not robot.loops.refusals and not robot.loops.undetermined
    assert set(robot.loops.passive) == {"f_l", "r_l", "f_r", "r_r"} and robot.gripper == "gripper"
    assert {"rod_l", "finger_r"} <= {
        model.body(b).name for b in robot.link_body_ids[1]
    }  # they ride on the hand
    for opening, angle in ((0.0, -0.6), (0.3, -0.42), (1.0, 0.0)):
        there = replace(robot, fingers=fingers_at(scene, robot, opening))
        moved = replace(scene, robots={robot.name: there})
        collision = CollisionModel(moved)
        for q in (-0.5, 0.7):
            qpos = collision.full_qpos([q])
            crank = qpos[model.joint("c_l").qposadr[0]]
            assert demanded(model, qpos) < 1e-6
            assert qpos[model.joint("r_l").qposadr[0]] == pytest.approx(-crank, abs=1e-8)
            assert qpos[model.joint("f_l").qposadr[0]] == pytest.approx(crank, abs=1e-8)
        assert crank == pytest.approx(angle)


LIMITED = {
    "fixed": '<fixed name="rope" range="-1 .5"><joint joint="j1" coef="1"/><joint joint="j2" coef="-.5"/></fixed>',
    "passive": '<fixed name="rope" range="-1 .5"><joint joint="pr" coef="1"/></fixed>',
    "space": '<spatial name="rope" range="0 .5"><site site="tool"/><site site="here"/></spatial>',
}


def with_tendon(kind):
    text = parallel_arm(np.random.default_rng(4), '<site name="here"/>')
    return text.replace("<equality>", f"<tendon>{LIMITED[kind]}</tendon><equality>")


def test_limits_of_fixed_tendons_hold(tmp_path):
    scene = scene_of(tmp_path, with_tendon("fixed"))
    world, rng = PlanningWorld.of(scene), np.random.default_rng(0)
    reference = float(scene.model.qpos0[scene.model.joint("j2").qposadr[0]])
    for q in scene.robot().robot.random_configuration(rng, 40):
        length = q[0] - 0.5 * q[1]
        reason = world.clearance(q).reason
        assert ("tendon 'rope'" in reason) == (not -1 <= length <= 0.5), (q, length, reference, reason)
    inside, outside = np.array([0.2, 0.0]), np.array([0.9, 0.2])
    proof = prove_path(Path(world.robot.robot, [inside, outside]), world.clearance, world.cover)
    assert not proof.proved and "tendon 'rope'" in proof.reason


@pytest.mark.parametrize("kind", ["passive", "space"])
def test_other_limited_tendons_are_refused_by_name(tmp_path, kind):
    scene = scene_of(tmp_path, with_tendon(kind))
    with pytest.raises(ModelError, match="the limits of tendon 'rope'"):
        CollisionModel(scene)
