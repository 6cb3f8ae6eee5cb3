"""A crank that pushes a block along a rail: one motor, two joints that nothing drives, one loop; as a task."""

from pathlib import Path

CELL = """
<mujoco model="crank">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <custom><numeric name="motor:velocity" data="3"/><numeric name="motor:acceleration" data="15"/></custom>
  <worldbody>
    <body name="crank" pos="0 0 0.3">
      <joint name="motor" axis="0 1 0" range="-2 2" limited="true" damping="0.01"/>
      <geom name="crank" type="capsule" fromto="0 0 0 0.1 0 0" size="0.01" mass="0.2"/>
      <body name="rod" pos="0.1 0 0">
        <joint name="elbow" axis="0 1 0"/>
        <geom name="rod" type="capsule" fromto="0 0 0 0.3 0 0" size="0.008" mass="0.2"/>
        <site name="end" pos="0.3 0 0"/>
      </body>
    </body>
    <body name="slider" pos="0.4 0 0.3">
      <joint name="rail" type="slide" axis="1 0 0"/>
      <geom name="slider" type="box" size="0.03 0.03 0.03" mass="0.5"/>
      <site name="block"/>
    </body>
    <body name="wall" pos="{wall} 0 0.3"><geom name="wall" type="box" size="0.01 0.1 0.1"/></body>
  </worldbody>
  <contact><exclude body1="rod" body2="slider"/></contact>
  <equality>
    <connect name="pin" body1="rod" body2="slider" anchor="0.3 0 0" solref="0.004 1" solimp="0.99 0.999 0.001"/>
  </equality>
  <actuator>{actuator}</actuator>
</mujoco>
"""
MOTOR = '<motor name="drive" joint="motor" ctrlrange="-20 20" ctrllimited="true"/>'
SERVO = '<position name="drive" joint="motor" kp="400" dampratio="1" ctrlrange="-2 2" ctrllimited="true"/>'

TASK = """
format = "workcell-task/1"
name = "crank"
cell = "cell.xml"

[mechanism]
name = "crank"
frames = ["block"]
{start}

[task]
"""


def write_task(folder: Path, *, wall: float = 0.6, actuator: str = MOTOR, start: str = "") -> Path:
    """The task file, its cell beside it; the wall's middle is `wall` metres along the rail."""
    (folder / "cell.xml").write_text(CELL.format(wall=wall, actuator=actuator))
    (folder / "crank.toml").write_text(TASK.format(start=start))
    return folder / "crank.toml"
