"""Robots that move at once are proved clear of each other, or named; bases that moved on are noticed."""

import copy
import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from workcell.errors import InputError
from workcell.model.grip import actuated
from workcell.model.scene import Scene
from workcell.motion.path import Path, Trajectory
from workcell.motion.timing.retime import retime
from workcell.simulate.execution import StopReason
from workcell.simulate.meeting import Mover, first_meeting
from workcell.simulate.simulation import Simulation

ARM = """
<mujoco><compiler angle="radian"/><worldbody><body><geom type="cylinder" size=".06 .05" pos="0 0 .05"/>
 <body pos="0 0 .15"><joint name="j1" axis="0 0 1" range="-3 3"/><geom type="cylinder" size=".04 .02" mass="2"/>
 <body pos="0 0 .05"><joint name="j2" axis="0 1 0" range="-2 2"/>
 <geom type="capsule" fromto="0 0 .08 0 0 .3" size=".03" mass="2"/>
 <body pos="0 0 .35"><joint name="j3" axis="0 1 0" range="-2.4 2.4"/>
 <geom type="capsule" fromto=".06 0 0 .3 0 0" size=".025" mass="1"/><site name="tool" pos=".35 0 0"/>
 </body></body></body></body></worldbody>
<custom><numeric name="j1:velocity" data="2"/><numeric name="j2:velocity" data="2"/>
<numeric name="j3:velocity" data="2"/>
<numeric name="j1:acceleration" data="5"/><numeric name="j2:acceleration" data="5"/>
<numeric name="j3:acceleration" data="5"/></custom>
<actuator><motor name="j1" joint="j1"/><motor name="j2" joint="j2"/><motor name="j3" joint="j3"/></actuator></mujoco>
"""
CELL = """
<mujoco><option timestep="0.002"/><worldbody><site name="left"/><site name="right" pos=".75 0 0" euler="0 0 180"/>
<body pos="0 -2 0"><joint name="slide" type="slide" axis="1 0 0" range="-1 1" armature="200"/>
<geom size=".02" mass="1"/><site name="cart" pos="0 0 .1"/></body></worldbody>
<actuator><position name="slide" joint="slide" kp="20000" kv="4000" ctrlrange="-1 1"/></actuator></mujoco>
"""
TASK = 'format = "workcell-task/1"\ncell = "cell.xml"\nrobots = [{robots}]\n'
HOME = np.array([0.0, -0.5, -0.4])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("meeting")
    (folder / "arm.xml").write_text(ARM)
    (folder / "cell.xml").write_text(CELL)
    robots = [
        f'{{name = "{name}", model = "arm.xml", mount = "{name}"}}' for name in ("left", "right", "cart")
    ]
    (folder / "two.toml").write_text(TASK.format(robots=", ".join(robots[:2])))
    (folder / "cart.toml").write_text(TASK.format(robots=", ".join(robots[2:])))
    return folder


@pytest.fixture(scope="module")
def scene(folder) -> Scene:
    scene = Scene.load(folder / "two.toml")
    return scene.with_start("left", HOME).with_start("right", HOME)


def motion(scene: Scene, robot: str, q: np.ndarray, start: np.ndarray | None = None) -> Trajectory:
    actor = scene.robot(robot)
    return retime(Path(actor.robot, np.array([actor.start if start is None else start, q])), dt=0.002)


def smallest(scene: Scene, motions: dict[str, np.ndarray]) -> float:
    """Smallest distance of the two arms by plain MuJoCo, looked at eight times in every step."""
    model, data, least = scene.model, mujoco.MjData(scene.model), np.inf
    length = max(len(q) for q in motions.values())
    bodies = {name: scene.robot(name).body_ids for name in motions}
    for t in np.linspace(0, length - 1, 8 * length):
        data.qpos[:] = scene.initial_qpos()
        for name, q in motions.items():
            here = [np.interp(t, np.arange(len(q)), column) for column in q.T]
            data.qpos[scene.robot(name).qpos_addresses] = here
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        for contact in data.contact:
            one, two = model.geom_bodyid[contact.geom]
            if {one in bodies["left"], two in bodies["left"]} == {True, False}:
                least = min(least, contact.dist)
    return float(least)


def test_random_motions_at_once_are_proved_or_touch(scene: Scene) -> None:
    rng, free, met = np.random.default_rng(0), 0, 0
    scene = replace(scene, model=copy.copy(scene.model))
    scene.model.geom_margin[:] = 0.02
    for _ in range(30):
        ends = {name: rng.uniform([-0.4, 0.2, -0.4], [0.4, 1.0, 0.4]) for name in scene.robots}
        motions = {name: motion(scene, name, q).q[::5] for name, q in ends.items()}
        movers = {name: Mover(scene.robot(name), q) for name, q in motions.items()}
        found, seen = first_meeting(scene, movers, scene.initial_qpos(), ()), smallest(scene, motions)
        if found is None:
            assert seen > 0
            free += 1
        else:
            assert seen < 5e-3 and set(found.robots) == {"left", "right"}
            met += 1
    assert free > 10 and met > 4


def test_arms_that_meet_are_named_and_each_alone_is_not(scene: Scene) -> None:
    """Both reach for the middle: each is clear of the other where it stands, not where it goes."""
    q = np.array([0.0, 0.6, 0.2])
    reaches = [motion(scene, name, q) for name in ("left", "right")]
    both = Simulation(scene, "left")
    assert not both.execute(reaches) and both.stop is not None and both.stop.reason is StopReason.CONTACT
    assert re.fullmatch(r"left and right come together after 0\.\d\d s: left/.* right/.*", both.unproved[0])
    warning = both.result().events[0]
    assert warning.level == "WARN" and both.unproved[0] in warning.text
    for alone in reaches:
        simulation = Simulation(scene, "left")
        assert simulation.execute(alone) and not simulation.unproved


def test_one_that_was_planned_for_before_the_other_moved_is_named(scene: Scene) -> None:
    q = np.array([0.0, 0.6, 0.2])
    simulation = Simulation(scene, "left")
    assert simulation.execute(motion(scene, "left", q)) and not simulation.unproved
    assert not simulation.execute(motion(scene, "right", q))
    assert "left and right come together" in simulation.unproved[0]


def test_motions_that_keep_apart_run_at_once(scene: Scene) -> None:
    away = [
        motion(scene, "left", np.array([1.5, 0.3, 0.0])),
        motion(scene, "right", np.array([1.5, 0.3, 0.0])),
    ]
    simulation = Simulation(scene, "left")
    assert simulation.execute(away) and not simulation.unproved
    assert simulation.result().min_clearance > 0


def test_a_base_that_stands_elsewhere_than_was_planned_for_is_refused(folder) -> None:
    scene = Scene.load(folder / "cart.toml").with_start("cart", HOME)
    moved = actuated(scene, "slide", 0.8)
    simulation = Simulation(scene)
    with pytest.raises(InputError, match=r"the base of cart stands 0\.6"):
        simulation.execute(motion(moved, "cart", np.zeros(3)))
    assert simulation.actuate("slide", 0.8, 2.0) and simulation.hold(2.0)
    assert simulation.result().max_tracking_error_m < 5e-3  # on its base
    assert simulation.execute(motion(moved, "cart", np.zeros(3)))
    begun = Simulation(moved)
    assert begun.execute(motion(moved, "cart", np.zeros(3)))
    assert begun.tool_pose().position[0] == pytest.approx(simulation.tool_pose().position[0], abs=2e-3)


def test_a_base_that_gives_way_under_a_motion_stops_the_run(folder) -> None:
    scene = Scene.load(folder / "cart.toml").with_start("cart", HOME)
    simulation = Simulation(scene)
    slide = scene.model.actuator("slide").id
    simulation.model.actuator_gainprm[slide, 0], simulation.model.actuator_biasprm[slide, :3] = 1.0, 0.0
    simulation.data.ctrl[slide] = 1.0
    simulation.model.opt.gravity[0] = 1.0
    assert not simulation.execute(motion(scene, "cart", np.array([2.0, 0.0, 0.0])))
    assert simulation.stop is not None and simulation.stop.reason is StopReason.TRACKING
    assert "the base of cart has moved" in simulation.stop.detail
