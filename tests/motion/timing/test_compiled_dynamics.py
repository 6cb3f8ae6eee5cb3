"""Torques of models with passive forces: MuJoCo's forward dynamics turn them into the motion that was asked for."""

import mujoco
import numpy as np
import pytest

from workcell.errors import ModelError
from workcell.model.scene import Scene
from workcell.motion.path import Path, Trajectory
from workcell.motion.timing.compiled_dynamics import CompiledDynamics, lacks
from workcell.motion.timing.retime import retime
from workcell.motion.timing.torque_limits import TooWeakError, TorqueLimits
from workcell.motion.timing.torques import ChainDynamics
from workcell.pose import Pose
from workcell.simulate.simulation import Simulation

KINDS = ("gravcomp", "spring", "friction", "damping", "armature", "tendon", "fluid", "motor", "flags")


def arm(
    rng: np.random.Generator,
    kinds=(),
    *,
    effort: float = 400.0,
    thing: str = "",
    held: str = "",
    actuator_lifts: bool = False,
    passive: str = "",
) -> str:
    """MJCF of a random arm of three joints with passive forces of some kinds, whose tool is at its last link."""
    drawn = {
        "gravcomp": lambda: ("", f'gravcomp="{rng.uniform(0.2, 1.2):.3f}"'),
        "spring": lambda: (
            f'stiffness="{rng.uniform(5, 40):.2f}" springref="{rng.uniform(-1, 1):.2f}"',
            "",
        ),
        "friction": lambda: (f'frictionloss="{rng.uniform(1, 8):.2f}"', ""),
        "damping": lambda: (f'damping="{rng.uniform(0, 3):.2f} {rng.uniform(0, 2):.2f}"', ""),
        "armature": lambda: (f'armature="{rng.uniform(0.01, 0.5):.3f}"', ""),
    }
    text, close, drives, limits = "", "", "", ""
    kinds_of_joint = ["hinge", "hinge", rng.choice(["hinge", "slide"])]
    for k, kind in enumerate(kinds_of_joint):
        on_joint, on_body = (
            map(" ".join, zip(*[drawn[name]() for name in kinds if name in drawn], strict=True))
            if (any(name in drawn for name in kinds))
            else ("", "")
        )
        lifted = 'actuatorgravcomp="true"' if actuator_lifts else ""
        axis = " ".join(f"{x:.3f}" for x in rng.normal(size=3))
        place = " ".join(f"{x:.3f}" for x in rng.uniform(-0.1, 0.3, 3))
        text += f"""<body name="l{k}" pos="{place}" {on_body}><joint name="j{k}" type="{kind}" axis="{axis}"
          range="-2 2" ref="{rng.uniform(-0.3, 0.3):.2f}" {on_joint} {lifted} {passive}/>
          <geom type="capsule" fromto="0 0 0 .1 .05 .2" size=".03" mass="{rng.uniform(0.5, 3):.2f}"/>"""
        close += "</body>"
        gear = rng.uniform(0.5, 20)
        own = f'armature="{0.3 / gear**2:.5f}" damping="{2 / gear**2:.5f}"' if "motor" in kinds else ""
        drives += (
            f'<motor joint="j{k}" gear="{gear:.3f}" {own} ctrlrange="{-effort / gear} {effort / gear}"/>'
        )
        limits += f'<numeric name="j{k}:velocity" data="2"/><numeric name="j{k}:acceleration" data="6"/>'
    option = 'density="900" viscosity="0.5" wind="0.5 0 0.2"' if "fluid" in kinds else ""
    flags = '<flag gravity="disable" damper="disable"/>' if "flags" in kinds else ""
    tendon = ""
    if "tendon" in kinds:
        tendon = f"""<tendon><fixed name="t" stiffness="{rng.uniform(3, 20):.2f}" springlength="0.1" armature="0.05"
          damping="{rng.uniform(0, 2):.2f}" frictionloss="{rng.uniform(0, 3):.2f}"><joint joint="j0" coef="1"/>
          <joint joint="j1" coef="-0.7"/></fixed><spatial name="s" stiffness="30" springlength="0.2">
          <site site="anchor"/><site site="tool"/></spatial></tendon>"""
    return f"""<mujoco><compiler angle="radian"/><option {option}>{flags}</option>
      <worldbody><site name="anchor" pos=".5 .2 1"/>{text}<site name="tool" pos=".1 .05 .2"/>{held}{close}{thing}
      </worldbody><custom>{limits}</custom><actuator>{drives}</actuator>{tendon}</mujoco>"""


def load(tmp_path, text: str, name: str = "arm") -> Scene:
    path = tmp_path / f"{name}.xml"
    path.write_text(text)
    return Scene.load(path)


def unit(v):
    return v / np.linalg.norm(v)


def random_motion(scene: Scene, rng: np.random.Generator, n: int = 6):
    chain = scene.robot().robot
    return (
        chain.random_configuration(rng, n),
        rng.normal(size=(n, chain.dof)),
        3 * rng.normal(size=(n, chain.dof)),
    )


def accelerations(scene: Scene, q, qd, torque):
    """(n,) by forward dynamics on the compiled model, its motors commanded to produce the torques."""
    model, robot = scene.model, scene.robot()
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    model.opt.tolerance, model.opt.iterations = 1e-14, 500
    model.actuator_ctrllimited[:] = 0
    data = mujoco.MjData(model)
    data.qpos[:] = scene.initial_qpos()
    data.qpos[robot.qpos_addresses], data.qvel[robot.dof_addresses] = q, qd
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_passive(model, data)
    lifts = (
        model.jnt_actgravcomp[model.dof_jntid[robot.dof_addresses]] * data.qfrc_gravcomp[robot.dof_addresses]
    )
    data.ctrl[robot.actuator_ids] = (torque - lifts) / model.actuator_gear[robot.actuator_ids, 0]
    mujoco.mj_forward(model, data)
    return np.array(data.qacc[robot.dof_addresses])


@pytest.mark.parametrize("seed", range(30))
def test_forward_dynamics_return_the_motion(seed, tmp_path):
    rng = np.random.default_rng(seed)
    kinds = [kind for k, kind in enumerate(KINDS) if k == seed % len(KINDS) or rng.random() < 0.3]
    scene = load(tmp_path, arm(rng, kinds, actuator_lifts=seed % 3 == 0))
    q, qd, qdd = random_motion(scene, rng)
    dynamics = ChainDynamics(scene)
    assert dynamics.lacking or set(kinds) <= {"armature"}
    torques = dynamics.at(q, qd, qdd)
    for k in range(len(q)):
        assert accelerations(scene, q[k], qd[k], torques[k]) == pytest.approx(qdd[k], abs=1e-5)


@pytest.mark.parametrize("seed", range(8))
def test_a_chain_that_lacks_nothing_has_the_compiled_models_torques(seed, tmp_path):
    rng = np.random.default_rng(seed)
    scene = load(tmp_path, arm(rng, ["armature"] if seed % 2 else []))
    robot, motion = scene.robot(), random_motion(scene, rng)
    dynamics, compiled = ChainDynamics(scene), CompiledDynamics(scene, robot)
    assert dynamics.lacking == lacks(scene, robot) == ()
    assert dynamics.at(*motion) == pytest.approx(compiled.at(*motion), abs=1e-9)
    assert dynamics.rigid(*motion) == pytest.approx(compiled.rigid(*motion), abs=1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_what_the_hand_carries_counts_with_all_that_acts_on_it(seed, tmp_path):
    rng = np.random.default_rng(seed)
    lift = f'gravcomp="{rng.uniform(0.2, 1):.2f}"' if seed % 2 else ""
    kinds = ["spring", "fluid"] if seed % 4 > 1 else ["spring"]
    body = '<geom type="box" size=".05 .08 .03" mass="1.5" pos="0.02 0 0.01"/>'
    grip = Pose(rng.uniform(-0.1, 0.1, 3), unit(rng.normal(size=4)))
    at = " ".join(map(str, (grip.position + np.array([0.1, 0.05, 0.2])).tolist()))
    quat = " ".join(map(str, grip.quat_wxyz.tolist()))
    draw = np.random.default_rng(seed)
    fixed = load(
        tmp_path,
        arm(draw, kinds, held=f'<body name="thing" pos="{at}" quat="{quat}" {lift}>{body}</body>'),
        "fixed",
    )
    (tmp_path / "thing.xml").write_text(
        f'<mujoco><worldbody><body name="thing" {lift}>{body}</body></worldbody></mujoco>'
    )
    (tmp_path / "arm.xml").write_text(arm(np.random.default_rng(seed), kinds))
    (tmp_path / "cell.xml").write_text(
        f"""<mujoco><option {
            'density="900" viscosity="0.5" wind="0.5 0 0.2"' if "fluid" in kinds else ""
        }/><worldbody><site name="robot_mount"/></worldbody></mujoco>"""
    )
    (tmp_path / "carry.toml").write_text(
        'format = "workcell-task/1"\ncell = "cell.xml"\n[[robots]]\nname = "arm"\nmodel = "arm.xml"\n'
        'mount = "robot_mount"\n'
        '[[objects]]\nname = "thing"\nmodel = "thing.xml"\nplace = "robot_mount"\n'
    )
    free = Scene.load(tmp_path / "carry.toml")
    motion = random_motion(fixed, rng)
    expected = ChainDynamics(fixed).at(*motion)
    assert ChainDynamics(free, attached=("thing", grip)).at(*motion) == pytest.approx(expected, abs=1e-7)
    half = [ChainDynamics(free, attached=("thing", grip), share=share).at(*motion) for share in (0.0, 0.5)]
    assert 2 * half[1] - half[0] == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize("kind", ["gravcomp", "spring", "friction", "tendon", "fluid", "motor"])
def test_a_motion_within_torques_is_one_by_the_compiled_model(kind, tmp_path):
    """Retimed within limits that bind; MuJoCo's own inverse dynamics keep them, and they are used."""
    rng = np.random.default_rng(5)
    scene = load(tmp_path, arm(rng, [kind]))
    chain, dynamics = scene.robot().robot, ChainDynamics(scene)
    path = Path(chain, np.array([[0.0, 0.0, 0.0], [0.4, -0.5, 0.3], [0.9, -0.2, 0.6]]))
    zero = np.zeros((len(path.configurations), 3))
    holding = np.abs(dynamics.rigid(path.configurations, zero, zero)) + np.abs(
        dynamics.dry(path.configurations, zero + 1.0)
    )
    effort = (1.5 if kind in ("motor", "fluid") else 1.15) * holding.max(axis=0) + 0.3
    trajectory = retime(path, dynamics=dynamics, effort=effort)
    assert trajectory.duration >= retime(path).duration - 0.01
    shares = np.abs(dynamics.at(trajectory.q, trajectory.qd, trajectory.qdd)) / effort
    assert 0.85 < shares.max() <= 1.0 + 1e-3


def test_a_joint_too_weak_for_its_own_friction_is_named(tmp_path):
    scene = load(tmp_path, arm(np.random.default_rng(1), ["friction", "gravcomp"]))
    path = Path(scene.robot().robot, np.array([[0.0, 0.0, 0.0], [0.1, 0.1, 0.1]]))
    dynamics = ChainDynamics(scene)
    still = np.abs(dynamics.rigid(path.configurations, 0 * path.configurations, 0 * path.configurations)).max(
        axis=0
    )
    with pytest.raises(TooWeakError, match="to move against dry friction along the path"):
        retime(path, dynamics=dynamics, effort=still + 0.5)
    assert TorqueLimits.of(dynamics).effort == pytest.approx(400.0, abs=0.1)


@pytest.mark.parametrize("kinds", [["gravcomp"], ["friction"], ["spring", "tendon"], ["motor", "damping"]])
@pytest.mark.parametrize("actuator_lifts", [False, True])
def test_the_simulation_spends_what_was_predicted(kinds, actuator_lifts, tmp_path):
    rng = np.random.default_rng(3)
    scene = load(tmp_path, arm(rng, kinds, actuator_lifts=actuator_lifts))
    dynamics = ChainDynamics(scene)
    path = Path(scene.robot().robot, np.array([scene.robot().start, [0.4, -0.5, 0.3], [0.9, -0.2, 0.6]]))
    trajectory = retime(path, dynamics=dynamics)
    simulation = Simulation(scene)
    assert simulation.execute(trajectory)
    execution = simulation.result()
    assert execution.stop is None
    predicted = dynamics.use(trajectory, every=1).peak
    spent = np.abs(execution.torque).max(axis=0)
    assert spent == pytest.approx(predicted, rel=0.05, abs=0.5)
    assert execution.tracking_error_m.max() < 5e-4


def test_a_spring_that_yields_is_refused_by_name(tmp_path):
    scene = load(tmp_path, arm(np.random.default_rng(0), ["spring"], passive='springyield="0.5"'))
    with pytest.raises(ModelError, match="spring of joint 'j0' yields"):
        ChainDynamics(scene)


def test_one_sample_of_a_motion(tmp_path):
    """`use` reports the compiled model's torque."""
    scene = load(tmp_path, arm(np.random.default_rng(0), ["gravcomp"]))
    q = np.zeros((2, 3))
    use = ChainDynamics(scene).use(Trajectory("arm", np.array([0, 0.1]), q, q, q))
    data = mujoco.MjData(scene.model)
    scene.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    data.qpos[:] = 0
    mujoco.mj_inverse(scene.model, data)
    assert use.peak == pytest.approx(np.abs(data.qfrc_inverse))
