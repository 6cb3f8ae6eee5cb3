"""How well the controllers track: with the true model, with misjudged masses, noisy sensors and pushes."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from workcell.bench.rows import Bench, Row
from workcell.model.collision_model import CollisionModel
from workcell.model.scene import Scene
from workcell.motion.path import Path as JointPath
from workcell.motion.path import Trajectory
from workcell.motion.timing.retime import retime
from workcell.simulate.controller import CONTROLLERS
from workcell.simulate.imperfections import Imperfections, Pulse
from workcell.simulate.simulation import Settings, Simulation

_STROKE = 0.6
"""Radians that each joint moves at most."""
_TOOL_SPEED = 0.5
_CLEAR = 0.01
"""Metres that the motions keep, at twenty places on the way."""

_CELL = (
    '<mujoco><option timestep="0.002" integrator="implicitfast"/>'
    '<worldbody><site name="robot_mount"/></worldbody></mujoco>'
)
_WEIGHT = """<mujoco><worldbody><body name="weight">
<geom type="cylinder" size="0.04 0.04" mass="{mass}" contype="0" conaffinity="0"/></body></worldbody></mujoco>"""
_TASK = """format = "workcell-task/1"
cell = "cell.xml"
[[robots]]
name = "{robot}"
model = "{robot}"
gripper = "parallel_gripper"
gripper_site = "{site}"
[[objects]]
name = "weight"
model = "weight.xml"
place = "robot_mount"
"""


@dataclass(frozen=True, slots=True)
class _Arm:
    """A robot, where its gripper goes, and half of the payload that its maker rates it for (kg)."""

    robot: str
    site: str
    payload: float


_ARMS = (
    _Arm("sawyer", "right_hand", 2.0),
    _Arm("ur10", "tool0", 5.0),
    _Arm("iiwa14", "attachment_site", 7.0),
)


def _cases(hand: str, seed: int) -> dict[str, Imperfections]:
    pulse = Pulse(hand, (0.0, 20.0, 0.0), start=0.4, duration=0.1)
    return {
        "true": Imperfections(),
        "payload+10%": Imperfections(payload_error=0.1),
        "payload-10%": Imperfections(payload_error=-0.1),
        "links+-10%": Imperfections(link_error=0.1, seed=seed),
        "noise": Imperfections(noise_q=2e-5, noise_qd=1e-3, seed=seed),
        "push20N": Imperfections(pulses=(pulse,)),
    }


def _scene(arm: _Arm) -> Scene:
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        (home / "cell.xml").write_text(_CELL)
        (home / "weight.xml").write_text(_WEIGHT.format(mass=arm.payload))
        (home / "task.toml").write_text(_TASK.format(robot=arm.robot, site=arm.site))
        scene = Scene.load(home / "task.toml")
    robot = scene.robot()
    return scene.moved({"weight": robot.robot.fk(robot.start)})


def motions(scene: Scene, n: int, seed: int) -> Iterator[Trajectory]:
    """There and back: from the start to a random configuration near it, clear of the robot itself on the way."""
    robot, rng = scene.robot().robot, np.random.default_rng(seed)
    start, model = scene.robot().start, CollisionModel(scene)
    while n > 0:
        goal = np.clip(start + rng.uniform(-_STROKE, _STROKE, robot.dof), robot.lower, robot.upper)
        way = JointPath(robot, np.stack([start, goal, start]))
        if all(model.distance(q).distance > _CLEAR for q in way.at(np.linspace(0.0, 1.0, 20))):
            yield retime(way, tool_speed=_TOOL_SPEED)
            n -= 1


def tracking(n: int, seed: int, sets: Path | None) -> list[Row]:
    """`n` motions there and back at 0.5 m/s, for every arm, controller and case.

    Each with half the rated payload in the hand. Guards are off: what is reported is the largest distance of
    the tool from its reference, at any control step.
    """
    rows: list[Row] = []
    free = Settings(stop_on_contact=False, max_error_m=np.inf, max_error_rad=np.inf)
    for arm in _ARMS:
        scene = _scene(arm)
        moves = list(motions(scene, n, seed))
        hand = scene.robot().prefix + "gripper/gripper"
        for case, imperfections in _cases(hand, seed).items():
            for controller in CONTROLLERS:
                errors, saturated = [], 0
                for motion in moves:
                    simulation = Simulation(
                        scene, controller=controller, imperfections=imperfections, settings=free
                    )
                    simulation.attach("weight")
                    simulation.execute(motion)
                    result = simulation.result()
                    errors.append(1e3 * result.max_tracking_error_m)
                    saturated += result.saturated_steps
                rows.append(
                    {
                        "row": f"{arm.robot}/{case}/{controller}",
                        "n": n,
                        "payload_kg": arm.payload,
                        "tracking_error_mm_mean": float(np.mean(errors)),
                        "tracking_error_mm_max": float(np.max(errors)),
                        "saturated_steps": saturated,
                        "paper": None,
                    }
                )
    return rows


BENCHES = [
    Bench(
        "tracking", 5, "both controllers with half the rated payload, and with what they don't know", tracking
    )
]
