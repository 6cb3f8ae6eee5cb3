"""Names with slashes and spaces come back from entity paths as they went in."""

import numpy as np
import pytest

from workcell.ik.observing import report
from workcell.ik.result import IKResult, Status
from workcell.model.scene import Scene
from workcell.record.read.paths import above, names_of
from workcell.record.read.review import review
from workcell.record.write.recording import Recording
from workcell.record.write.rrd import entity
from workcell.world.planning_world import PlanningWorld

ARM = """
<mujoco><worldbody><body><geom size=".05"/><body pos="0 0 .2"><joint name="j" range="-90 90"/>
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".03"/><site name="tool" pos=".3 0 0"/></body></body></worldbody>
<actuator><motor joint="j"/></actuator></mujoco>
"""


@pytest.mark.parametrize("names", [["world", "a/body 1", "geom 2 (box)"], ["metrics", "x\\y"], ["plain"]])
def test_paths_are_taken_apart_as_they_were_put_together(names: list[str]) -> None:
    path = entity(*names)
    assert names_of(path) == names
    assert names_of(above(path)) == names[:-1]


def test_links_without_a_name_are_read_back(tmp_path) -> None:
    (tmp_path / "arm.xml").write_text(ARM.replace("<body><geom", '<body name="foot"><geom'))
    (tmp_path / "cell.xml").write_text('<mujoco><worldbody><site name="robot_mount"/></worldbody></mujoco>')
    scene = Scene.load(tmp_path / "cell.xml", robot=str(tmp_path / "arm.xml"))
    with Recording(tmp_path / "r.rrd", task="t", seed=0) as recording:
        recording.log_scene(scene)
        world, q = PlanningWorld.of(scene), scene.robot().start
        recording.log_world(world)
        with recording.queries("where it stands"):
            homes = np.where(world.cover.link > 0, 0, -1)
            answer = IKResult(Status.SOLVED, "ikspark", q=q, cuboids=homes, free_space=world.free_space)
            report(world.problem(world.robot.robot.fk(q)), answer)
        recording.log_states(np.array([0.0, 0.1]), np.array([scene.initial_qpos()] * 2))
        recording.set_result({"task": "t", "achieved": True, "status": "ACHIEVED"})
    seen = review(tmp_path / "r.rrd")
    assert [row.link for row in seen.cuboids] == ["foot/body 1"]
    assert not any("\\" in row.name for row in seen.metrics)
