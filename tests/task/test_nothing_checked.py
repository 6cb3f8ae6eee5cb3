"""A whole run of a robot without collision geometry: nothing in it is called clear, and its review says so."""

from workcell.record.read.review import review
from workcell.task.run import run_task

ARM = """
<mujoco><worldbody><body name="base"><geom type="box" size=".05 .05 .05" contype="0" conaffinity="0"/>
<body name="l1" pos="0 0 .1"><joint name="j1" axis="0 0 1" range="-170 170"/>
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1" contype="0" conaffinity="0"/>
<body name="l2" pos=".3 0 0"><joint name="j2" axis="0 1 0" range="-120 120"/>
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1" contype="0" conaffinity="0"/>
<site name="tool" pos=".3 0 0"/></body></body></body></worldbody>
<custom><numeric name="j1:velocity" data="2"/><numeric name="j2:velocity" data="2"/>
<numeric name="j1:acceleration" data="5"/><numeric name="j2:acceleration" data="5"/></custom>
<actuator><motor name="m1" joint="j1"/><motor name="m2" joint="j2"/></actuator></mujoco>
"""
TASK = """
format = "workcell-task/1"
cell = "cell.xml"
robots = [{name = "arm", model = "arm.xml", mount = "robot_mount"}]
goals = [{name = "there", xyz = [0.1, 0.5, 0.2]}]
"""
SCRIPT = """
import numpy as np
from workcell import PlanningWorld

def run(job):
    world = PlanningWorld.of(job.scene)
    job.log_world(world)
    path = job.move(world, world.robot.start, np.array([1.0, 0.3]), "going")
    motion = job.retime(world, path, 0.5, "going")
    simulation = job.simulation()
    simulation.execute(motion, "going")
    job.judge(simulation, {})
"""


def test_a_run_that_looked_at_nothing_says_so(tmp_path) -> None:
    (tmp_path / "arm.xml").write_text(ARM)
    (tmp_path / "cell.xml").write_text(
        '<mujoco><worldbody><site name="robot_mount"/><geom name="post" size=".1" pos=".4 0 .1"/></worldbody></mujoco>'
    )
    (tmp_path / "task.toml").write_text(TASK)
    (tmp_path / "task.py").write_text(SCRIPT)
    said: list[str] = []
    result = run_task(tmp_path / "task.toml", out=tmp_path / "out", say=said.append)
    assert result.achieved, said
    assert result.sentence.endswith(
        "Collisions were not checked: there is no collision geometry that could meet."
    )
    assert result.summary["min_clearance_m"] is None and not result.summary["conditions"]
    told = "\n".join(said)
    assert "mm clear" not in told and "proved" not in told
    assert told.count("not checked for collisions, as there is no collision geometry that could meet") == 3
    assert "no contact and no clearance is looked at" in told
    found = {check.name: check for check in review(result.recording).checks}
    assert found["clearance"].passed and found["clearance"].finding.startswith("not measured")
    assert "evidence" not in found
