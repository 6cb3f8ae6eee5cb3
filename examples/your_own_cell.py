"""Describe a cell of your own in MJCF, put a robot and a goal into it, and ask for a configuration.

The robot stands at the site `robot_mount`; what MuJoCo collides is what the arm keeps clear of.
"""

import tempfile
from pathlib import Path

from workcell import PlanningWorld, Scene, solve

CELL = """<mujoco>
  <worldbody>
    <site name="robot_mount" pos="0 0 0.5"/>
    <geom name="pedestal" type="box" pos="0 0 0.24" size="0.15 0.15 0.24"/>
    <geom name="table" type="box" pos="0.8 0 0.4" size="0.4 0.6 0.02"/>
    <geom name="shelf" type="box" pos="0.9 0 0.95" size="0.3 0.5 0.02"/>
  </worldbody>
</mujoco>"""
TASK = """format = "workcell-task/1"
name = "my_task"
cell = "my_cell.xml"

[[robots]]
name = "arm"
model = "iiwa14"
mount = "robot_mount"

[[goals]]
name = "between"
robot = "arm"
xyz = [0.6, 0.1, 0.65]
quat_wxyz = [0.5, 0.5, 0.5, 0.5]
"""

with tempfile.TemporaryDirectory() as folder:
    (Path(folder) / "my_cell.xml").write_text(CELL)
    task = Path(folder) / "my_task.toml"
    task.write_text(TASK)
    scene = Scene.load(task)
world = PlanningWorld.of(scene)
print(
    f"{len(world.cover)} spheres, {len(world.obstacles)} pieces, {len(world.free_space)} free-space cuboids"
)

result = solve(world.problem(scene.goal("between").pose, margin=0.01), seed=0)  # a centimetre from everything
print(f"{result.status.value}: {result.status.sentence}")
if result.solved:
    distance = world.clearance(result.q)
    print(f"{1e3 * distance.distance:.1f} mm clear, nearest: {distance.pair[0]} to {distance.pair[1]}")
