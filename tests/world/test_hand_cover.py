"""Covers of grippers whose fingers have joints of their own, closed or not, with and without a keyframe."""

import mujoco
import numpy as np
import pytest

from workcell.model.scene import Scene
from workcell.pose import Pose
from workcell.world.planning_world import PlanningWorld

ARM = """
<mujoco model="mast"><worldbody><body name="mast">
  <joint name="turn" axis="0 0 1" range="-3 3"/><geom type="box" size="0.05 0.05 0.05"/>
  <site name="tool" pos="0 0 0.05"/>
</body></worldbody><actuator><motor joint="turn"/></actuator></mujoco>
"""
FINGER = """
<body name="{side}" pos="0 {y} 0.03">
  <joint name="{side}" axis="1 0 0" range="-1 1"/><geom type="capsule" fromto="0 0 0 0 0 0.06" size="0.01"/>
  <body name="{side}_tip" pos="0 0 0.07">
    <joint name="{side}_tip" axis="1 0 0" range="-1.5 1.5"/>
    <geom name="{side}_tip" type="capsule" fromto="0 0 0.01 0 0 0.07" size="0.01"/>
  </body>
</body>
"""
HAND = """
<mujoco model="hand"><worldbody><body name="palm">
  <geom type="box" size="0.05 0.08 0.02"/><site name="tool" pos="0 0 0.1"/>
  {left}{right}
</body></worldbody>
<tendon><fixed name="both"><joint joint="left" coef="1"/></fixed></tendon>
<actuator><position name="gripper" tendon="both" kp="10" ctrlrange="-1 1"/></actuator>{key}</mujoco>
"""
KEY = '<keyframe><key name="home" qpos="-0.6 1.2 0.6 -1.2"/></keyframe>'
TASK = """
format = "workcell-task/1"
name = "hand"
cell = "cell.xml"
[[robots]]
name = "mast"
model = "mast.xml"
mount = "robot_mount"
gripper = "hand.xml"
gripper_site = "tool"
[[objects]]
name = "bar"
model = "bar.xml"
place = "place"
"""
CELL = '<mujoco><worldbody><site name="robot_mount"/><site name="place" pos="1 1 1"/></worldbody></mujoco>'
BAR = (
    '<mujoco><worldbody><body name="bar"><geom type="box" size="0.02 0.02 0.02"/></body></worldbody></mujoco>'
)


def load(folder, key):
    fingers = {side: FINGER.format(side=side, y=y) for side, y in (("left", 0.06), ("right", -0.06))}
    files = {"mast": ARM, "hand": HAND.format(**fingers, key=key), "cell": CELL, "bar": BAR}
    for name, text in files.items():
        (folder / f"{name}.xml").write_text(text)
    (folder / "hand.toml").write_text(TASK)
    return Scene.load(folder / "hand.toml")


def covered(world):
    """Whether points on the surfaces of the finger tips, placed by MuJoCo, lie in the cover."""
    model, data = world.scene.model, mujoco.MjData(world.scene.model)
    data.qpos[:] = world.collision.full_qpos(world.robot.start)
    mujoco.mj_kinematics(model, data)
    centres = world.cover.centres_world(world.robot.robot.link_transforms(world.robot.start))
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    ring = np.stack([0.01 * np.cos(angle), 0.01 * np.sin(angle), np.zeros(12)], axis=1)
    local = np.concatenate([ring + np.array([0, 0, z]) for z in np.linspace(-0.03, 0.03, 7)])
    inside = []
    for side in ("left", "right"):
        geom = data.geom(f"mast/gripper/{side}_tip")
        points = geom.xpos + local @ geom.xmat.reshape(3, 3).T
        away = np.linalg.norm(points[:, None] - centres, axis=2) - world.cover.radius
        inside.append(away.min(axis=1) <= 1e-9)
    return bool(np.all(inside))


@pytest.mark.parametrize("key", [KEY, ""])
def test_the_cover_contains_the_tips_of_fingers_with_two_joints(tmp_path, key):
    scene = load(tmp_path, key)
    assert [value for _, value in scene.robot().fingers] == ([-0.6, 1.2, 0.6, -1.2] if key else [0.0] * 4)
    world = PlanningWorld.of(scene)
    assert covered(world)
    assert covered(world.holding("bar", Pose.from_xyz([0, 0, 0.02])))
    assert covered(PlanningWorld.of(scene, opening=0.3))
