"""Whose a body is drawn as: names are cut by their owner's prefix, and two of one name are drawn both."""

import mujoco
import numpy as np

from workcell.model.scene import Scene
from workcell.record.write.recording import Recording
from workcell.record.write.scenery import layers, owners_of_bodies
from workcell.world.planning_world import PlanningWorld

ARM = """
<mujoco><worldbody><body name="base"><geom size=".05"/><body name="x/tip" pos="0 0 .2"><joint name="j" range="-90 90"/>
<geom size=".03"/><geom size=".02" pos=".1 0 0"/><site name="tool" pos="0 0 .1"/>
<body><geom size=".02" pos="0 .1 0"/></body>
<body name="tip"><geom size=".01"/></body></body></body></worldbody><actuator><motor joint="j"/></actuator></mujoco>
"""
CELL = """
<mujoco><worldbody><site name="robot_mount"/><body name="arm/thing" pos="1 0 0"><geom size=".1"/></body>
<body pos="2 0 0"><geom size=".1"/></body><body pos="3 0 0"><geom size=".1"/></body></worldbody></mujoco>
"""
TASK = """
format = "workcell-task/1"
cell = "cell.xml"
robots = [{name = "arm", model = "arm.xml"}]
objects = [{name = "drill", model = "drill.xml", place = "arm/tool", fixed = true}]
"""


def loaded(folder) -> Scene:  # type: ignore[no-untyped-def]
    (folder / "arm.xml").write_text(ARM)
    (folder / "cell.xml").write_text(CELL)
    (folder / "drill.xml").write_text(
        '<mujoco><worldbody><body><geom size=".02" pos="0 0 .1"/></body></worldbody></mujoco>'
    )
    (folder / "task.toml").write_text(TASK)
    return Scene.load(folder / "task.toml")


def test_every_body_has_a_place_of_its_own(tmp_path) -> None:  # type: ignore[no-untyped-def]
    scene = loaded(tmp_path)
    found = list(layers(scene.model, owners_of_bodies(scene)))
    assert len({layer.path for layer in found}) == len(found) == scene.model.nbody - 1
    paths = {layer.path.split("/", 1)[1] for layer in found}
    assert {"robots/arm/visual/base", "robots/arm/visual/x.tip", "robots/arm/visual/tip"} <= paths
    assert "objects/drill/visual/drill" in paths and r"obstacles/arm.thing" in {
        p.replace("\\", "") for p in paths
    }
    assert all(len({shape.name for shape in layer.shapes}) == len(layer.shapes) for layer in found)


def test_bodies_alike_but_for_the_prefix_are_drawn_both() -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body name="arm/a"><geom size=".1"/></body><body name="a"><geom size=".1"/></body>'
        "</worldbody></mujoco>"
    )
    assert len({layer.path for layer in layers(model, {1: "robots/arm", 2: "robots/arm"})}) == 2


def test_what_a_hand_carries_is_recorded_with_its_cover(tmp_path) -> None:  # type: ignore[no-untyped-def]
    scene = loaded(tmp_path)
    world = PlanningWorld.of(scene)
    assert "drill/drill/geom 1 (sphere)" in world.cover.source
    with Recording(tmp_path / "r.rrd", task="t", seed=0) as recording:
        recording.log_scene(scene)
        recording.log_world(world)
        recording.log_states(
            np.array([0.0, 0.1]), np.array([scene.initial_qpos(), scene.initial_qpos() + 0.1])
        )
    assert (tmp_path / "r.rrd").stat().st_size > 0
