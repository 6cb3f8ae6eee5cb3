"""Arms with passive loops, of random sizes, as MJCF texts."""

import mujoco
import numpy as np


def parallel_arm(rng, cell="", extra="", equality=None):
    """Two driven hinges; a rod beside the upper arm keeps a bracket parallel to the base, wherever that stands."""
    x, y, z = rng.uniform(-0.15, -0.08), rng.uniform(0.03, 0.08), rng.uniform(0.2, 0.35)
    euler = " ".join(map(str, rng.uniform(-40, 40, 3)))
    ref = rng.uniform(-0.3, 0.3)
    equality = equality or f'<connect name="joint" body1="rod" body2="bracket" anchor="0 0 {z}"/>'
    return f"""
<mujoco><compiler angle="radian" eulerseq="xyz"/>
  <worldbody>{cell}
    <body name="base" pos="{rng.uniform(-0.2, 0.2)} 0 0" euler="{euler}">
      <geom name="foot" type="box" size=".03 .03 .02" pos="0 0 -.05"/>
      <body name="upper"><joint name="j1" axis="0 1 0" range="-1.2 1.2"/>
        <geom name="upper" type="capsule" fromto="0 0 .05 0 0 {z - 0.03}" size=".015"/>
        <body name="fore" pos="0 0 {z}"><joint name="j2" axis="0 1 0" range="-2 2" ref="{ref}"/>
          <geom name="fore" type="capsule" fromto=".05 0 0 .25 0 0" size=".015"/>
          <site name="tool" pos=".25 0 0"/></body>
        <body name="bracket" pos="0 0 {z}"><joint name="pb" axis="0 1 0" range="-3 3"/>
          <geom name="bracket" type="capsule" fromto="-.02 {y} 0 {x} {y} 0" size=".008" mass=".2"/>{extra}</body>
      </body>
      <body name="rod" pos="{x} {y} 0"><joint name="pr" axis="0 1 0" range="-3 3"/>
        <geom name="rod" type="capsule" fromto="0 0 .05 0 0 {z - 0.03}" size=".01" mass=".2"/></body>
    </body>
  </worldbody>
  <equality>{equality}</equality>
  <actuator><motor joint="j1"/><motor joint="j2"/></actuator>
</mujoco>"""


def four_bar(rng):
    """A driven crank, a coupler and a rocker whose lengths meet where the model is assembled, at random angles."""
    rocker = c = b = 0.0
    while not (rocker > 0.15 and 0.5 < c - b < 2.6):  # away from where coupler and rocker are in line
        crank, coupler = rng.uniform(0.15, 0.3), rng.uniform(0.3, 0.5)
        a, b = rng.uniform(0.8, 2.2), rng.uniform(-0.4, 0.4)
        tip = crank * np.array([np.cos(a), np.sin(a)]) + coupler * np.array([np.cos(b), np.sin(b)])
        far = np.array([rng.uniform(0.4, 0.6), 0.0])
        rocker, c = np.linalg.norm(tip - far), np.arctan2(tip[1], tip[0] - far[0])
    # in the plane of x and y; each link lies along its own x axis, turned as a child of the one before
    return f"""
<mujoco><compiler angle="radian"/>
  <worldbody><body name="base" euler="{rng.uniform(-1, 1)} {rng.uniform(-1, 1)} 0">
    <geom name="foot" type="sphere" size=".02" pos="0 0 -.3"/>
    <body name="crank" euler="0 0 {a}"><joint name="j" axis="0 0 1" range="-3 3"/>
      <geom name="crank" type="capsule" fromto="0.03 0 0 {crank - 0.03} 0 0" size=".01"/>
      <site name="tool" pos="{crank} 0 .1"/>
      <body name="coupler" pos="{crank} 0 0" euler="0 0 {b - a}"><joint name="p" axis="0 0 1"/>
        <geom name="coupler" type="capsule" fromto=".03 0 0 {coupler - 0.03} 0 0" size=".01"/></body></body>
    <body name="rocker" pos="{far[0]} 0 0" euler="0 0 {c}"><joint name="r" axis="0 0 1"/>
      <geom name="rocker" type="capsule" fromto=".03 0 0 {rocker - 0.03} 0 0" size=".01"/></body>
  </body></worldbody>
  <equality><connect name="pin" body1="coupler" body2="rocker" anchor="{coupler} 0 0"/></equality>
  <actuator><motor joint="j"/></actuator>
</mujoco>"""


def linked_gripper(rng):
    """An arm of one hinge; each of its two fingers hangs on a crank, which a tendon drives, and a parallel rod."""
    fingers, connects, length = "", "", rng.uniform(0.05, 0.08)
    for side, y in (("l", 0.03), ("r", -0.03)):
        way = 1 if y > 0 else -1
        fingers += f"""
        <body name="crank_{side}" pos="0 {y} 0"><joint name="c_{side}" axis="{-way} 0 0" range="-.6 .2"/>
          <geom name="crank_{side}" type="capsule" fromto="0 0 .01 0 0 {length - 0.01}" size=".004" mass=".02"/>
          <body name="finger_{side}" pos="0 0 {length}"><joint name="f_{side}" axis="1 0 0"/>
            <geom name="finger_{side}" type="box" size=".01 .004 .02" pos="0 0 .03" mass=".02"/></body></body>
        <body name="rod_{side}" pos="0 {5 * y / 3} 0"><joint name="r_{side}" axis="1 0 0"/>
          <geom name="rod_{side}" type="capsule" fromto="0 0 .01 0 0 {length - 0.01}" size=".003" mass=".02"/></body>"""
        connects += f'<connect name="{side}" body1="rod_{side}" body2="finger_{side}" anchor="0 0 {length}"/>'
    return f"""
<mujoco><compiler angle="radian"/>
  <worldbody><body name="base"><geom name="foot" type="sphere" size=".02" pos="0 0 -.3"/>
    <body name="arm"><joint name="j" axis="0 0 1" range="-1 1"/>
      <geom name="arm" type="box" size=".02 .02 .02" pos="0 0 -.1"/>
      {fingers}<site name="tool" pos="0 0 .1"/></body></body></worldbody>
  <equality>{connects}</equality>
  <tendon><fixed name="grip"><joint joint="c_l" coef=".5"/><joint joint="c_r" coef=".5"/></fixed></tendon>
  <actuator><motor joint="j"/><position name="gripper" tendon="grip" kp="10" ctrlrange="-.6 .2"/></actuator>
</mujoco>"""


def demanded(model, qpos):
    """The largest residual of the equality constraints by plain MuJoCo at raw positions."""
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    rows = data.efc_type[: data.nefc] == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    return float(np.abs(data.efc_pos[: data.nefc][rows]).max())


def nearest(model, qpos, ignored=()):
    """The deepest contact of plain MuJoCo at raw positions, without pairs of geoms by name; metres, or 1."""
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    depths = [
        contact.dist
        for contact in data.contact
        if {model.geom(int(g)).name for g in contact.geom} not in [set(pair) for pair in ignored]
    ]
    return min(depths, default=1.0)
