"""Arms in which joints follow others: MJCF with polynomials, chains of them, references, hinges and slides."""

import mujoco
import numpy as np

BODY = """
<body name="b{k}" pos="{pos}" quat="{quat}">
  <joint name="j{k}" type="{kind}" axis="{axis}" pos="{anchor}" ref="{ref}" {limits}/>
  <geom name="g{k}" type="capsule" fromto="0 0 0.03 0 0 0.12" size="0.02" mass="0.8"/>
"""


def words(values):
    return " ".join(f"{v:.17g}" for v in np.atleast_1d(values))


def coupled_arm(seed, joints=7, followers=2, *, bent=False, slides=True, every=True):
    """MJCF of a random arm: (text, followers' names). Joints that follow have no actuator unless `every`."""
    rng = np.random.default_rng(seed)
    order = [int(k) for k in rng.permutation(joints)]
    following = order[:followers]
    bodies, equalities, motors = [], [], []
    refs = rng.uniform(-0.3, 0.3, joints)
    for k in range(joints):
        axis = rng.normal(size=3)
        slide = slides and rng.random() < 0.25
        half = 0.15 if slide else rng.uniform(1.2, 2.8)
        refs[k] *= 0.2 if slide else 1.0
        wide = 4.0 if k in following else 1.0
        quat = np.concatenate([[1.0], 0.4 * rng.normal(size=3)])
        bodies.append(
            BODY.format(
                k=k,
                pos=words([0.02, 0.0, 0.16]) if k else "0 0 0.1",
                quat=words(quat / np.linalg.norm(quat)),
                kind="slide" if slide else "hinge",
                axis=words(axis),
                anchor=words(0.02 * rng.normal(size=3)),
                ref=words(refs[k]),
                limits=f'range="{words(refs[k] - wide * half)} {words(refs[k] + wide * half)}"',
            )
        )
        if k not in following or every:
            motors.append(f'<motor name="m{k}" joint="j{k}"/>')
    for i, k in enumerate(following):
        leader = order[i + 1]  # a chain of followers, which ends at a joint of its own
        row = [0.02 * rng.normal(), rng.choice([-1.0, -0.6, 0.5, 1.0]), 0.0, 0.0, 0.0]
        if bent:
            row[2:] = np.array([0.05, 0.01, 0.003]) * rng.normal(size=3)
        equalities.append(f'<joint joint1="j{k}" joint2="j{leader}" polycoef="{words(row)}"/>')
    text = (
        '<mujoco model="coupled"><compiler angle="radian"/><worldbody><body name="base">'
        '<geom name="foot" type="cylinder" size="0.06 0.03"/>'
        + "".join(bodies)
        + '<site name="tool" pos="0.02 0.01 0.15"/>'
        + "</body>" * (joints + 1)
        + f"</worldbody><actuator>{''.join(motors)}</actuator><equality>{''.join(equalities)}</equality></mujoco>"
    )
    return text, [f"j{k}" for k in following]


def planar(multiple=1.0, offset=0.0, limits=(-1.5, 1.5), follower=(-1.5, 1.5)):
    """A planar arm of two links of 0.3 m whose second joint follows the first."""
    return f"""
<mujoco model="planar"><compiler angle="radian"/><worldbody><body name="base"><geom type="box" size=".04 .04 .04"/>
  <body name="one" pos="0 0 .1"><joint name="j1" axis="0 0 1" range="{words(limits)}" damping="0.1"/>
    <geom name="upper" type="capsule" fromto=".02 0 0 .28 0 0" size=".02"/>
    <body name="two" pos=".3 0 0"><joint name="j2" axis="0 0 1" range="{words(follower)}" damping="0.1"/>
      <geom name="lower" type="capsule" fromto=".05 0 0 .3 0 0" size=".02"/><site name="tool" pos=".3 0 0"/>
    </body></body></body></worldbody>
  <equality><joint joint1="j2" joint2="j1" polycoef="{offset} {multiple} 0 0 0"/></equality>
  <actuator><motor name="m1" joint="j1"/></actuator></mujoco>
"""


def residuals(model, qpos):
    """(neq,) what MuJoCo itself says that is missing of each equality."""
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    return data.efc_pos[data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY]
