"""A small bench: a Sawyer with a gripper, a brick on a plinth to pick up, and a pillar to bump into."""

import pytest

from workcell.model.scene import Scene

CELL = """
<mujoco model="bench">
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <site name="robot_mount"/>
    <site name="brick_place" pos="0.6 0.1 0.0"/>
    <body name="plinth"><geom name="plinth" type="box" pos="0.6 0.1 -0.25" size="0.1 0.1 0.25"/></body>
    <body name="pillar"><geom name="pillar" type="box" pos="0.45 -0.35 0.2" size="0.05 0.05 0.6"/></body>
  </worldbody>
</mujoco>
"""
BRICK = """
<mujoco model="brick">
  <worldbody>
    <body name="brick">
      <geom name="brick" type="box" pos="0 0 0.04" size="0.03 0.03 0.04" mass="0.3"/>
      <site name="grasp" pos="0 0 0.05" quat="0 1 0 0"/>
    </body>
  </worldbody>
</mujoco>
"""
TASK = """
format = "workcell-task/1"
name = "bench"
cell = "bench.xml"
[[robots]]
name = "sawyer"
model = "sawyer"
mount = "robot_mount"
gripper = "parallel_gripper"
gripper_site = "right_hand"
[[objects]]
name = "brick"
model = "brick.xml"
place = "brick_place"
[[goals]]
name = "grasp"
robot = "sawyer"
relative_to = "brick/grasp"
xyz = [0, 0, 0]
[[goals]]
name = "above"
robot = "sawyer"
relative_to = "brick/grasp"
xyz = [0, 0, -0.12]
"""


@pytest.fixture(scope="session")
def scene(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench")
    (folder / "bench.xml").write_text(CELL)
    (folder / "brick.xml").write_text(BRICK)
    (folder / "bench.toml").write_text(TASK)
    return Scene.load(folder / "bench.toml")


@pytest.fixture(scope="session")
def robot(scene):
    return scene.robot().robot
