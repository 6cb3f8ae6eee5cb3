"""Time a path: as fast as the speeds and accelerations of joints and tool allow, at rest at both ends.

With `dynamics=` torques are kept as well; without it only kinematics counts.
"""

import numpy as np

from workcell import Path, load_robot, retime

robot = load_robot("sawyer")
home = robot.home
over = home + np.array([0.9, 0.3, -0.2, -0.4, 0.1, 0.3, 0.0])  # radians
there = home + np.array([1.4, 0.0, 0.2, 0.2, -0.2, 0.0, 0.5])
path = Path(robot, np.stack([home, over, there]))

for speed in (None, 0.5, 0.25):  # metres a second of the tool
    motion = retime(path, tool_speed=speed)
    tool = np.stack([robot.fk(q).position for q in motion.q])
    fastest = np.linalg.norm(np.diff(tool, axis=0), axis=1).max() / motion.dt
    share = np.abs(motion.qd / robot.velocity).max()
    print(
        f"{'as fast as it goes' if speed is None else f'tool at most {speed} m/s':23} {motion.duration:5.2f} s, "
        f"tool up to {fastest:.2f} m/s, joints up to {share:4.0%} of their speed limit, {len(motion)} samples"
    )
