"""Random linkages as MuJoCo models: four-bars, grippers on two of them, slider-cranks, spatial ones.

Each has a configuration planted in it: lengths, where it stands in space and the joints' values are drawn, and the last
bar is what then closes the loop. So some cranks turn all round and others do not. What is asked of it, the planted
configuration does; what is asked of it out of reach lies beyond the sum of its lengths, or off the plane that its
points move in.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from workcell.bench.ik.mechanisms.answers import TIGHT
from workcell.ik.mechanisms.goals import FrameGoal, InRegion
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.model.loading.load import compile_spec
from workcell.model.mechanism.from_model import mechanism_of
from workcell.model.mechanism.measuring import measure_of
from workcell.model.mechanism.mechanism import Mechanism
from workcell.pose import Array

BARS = (0.15, 0.5)
"""Metres, shortest and longest bar that is drawn."""
SHORTEST = 0.08
"""Metres of the bar that closes a loop, at least."""
SLOPES = (1.0, -1.0, 0.5, -2.0, 1.5)
"""By which one finger of a gripper follows the other."""


@dataclass(frozen=True, slots=True)
class Drawing:
    """A model in MJCF, the values of its joints, the frame that is asked for, and how far from its base that can be."""

    body: str
    equality: str
    values: Mapping[str, Array]
    frame: str
    reach: float
    planar: bool = True
    opening: bool = False


@dataclass(frozen=True, slots=True)
class Linkage:
    """A mechanism, a configuration (size,) that answers the first question, and a second one that has no answer."""

    kind: str
    mechanism: Mechanism
    planted: Array
    within_reach: MechanismProblem
    out_of_reach: MechanismProblem


def linkage(kind: str, seed: int) -> Linkage:
    """One of a kind of `KINDS`."""
    import mujoco

    rng = np.random.default_rng(seed)
    drawing = KINDS[kind](rng)
    place, turn = rng.uniform(-0.5, 0.5, 3), _unit(rng, 4)
    text = f"""
    <mujoco>
      <compiler angle="radian" autolimits="true"/>
      <default><geom type="sphere" size="0.01" mass="0.1" contype="0" conaffinity="0"/></default>
      <worldbody>
        <body name="base" pos="{_told(place)}" quat="{_told(turn)}"><site name="base"/>{drawing.body}</body>
      </worldbody>
      <equality>{drawing.equality}</equality>
    </mujoco>"""
    model = compile_spec(mujoco.MjSpec.from_string(text), kind)
    mechanism = mechanism_of(model, name=f"{kind} {seed}")
    planted = mechanism.configuration(drawing.values)
    inside, outside = _asked(mechanism, drawing, planted, rng)
    return Linkage(kind, mechanism, planted, inside, outside)


def _asked(
    mechanism: Mechanism, drawing: Drawing, planted: Array, rng: np.random.Generator
) -> tuple[MechanismProblem, MechanismProblem]:
    """Where the frame is at the planted configuration, as a point or as an opening, and where it can't be."""
    places = measure_of(mechanism).frames(["base", drawing.frame], planted)
    R, origin = places["base"]
    point = places[drawing.frame][1]
    if drawing.opening:
        across = R[:, 0]
        here = float(across @ point)
        far = float(across @ origin) + drawing.reach + rng.uniform(0.05, 0.5)
        planes = [InRegion.plane(drawing.frame, across, offset) for offset in (here, far)]
        problems = [MechanismProblem(mechanism, regions=(plane,), tolerances=TIGHT) for plane in planes]
        return problems[0], problems[1]
    if drawing.planar and rng.uniform() < 0.5:
        away = point + rng.choice([-1.0, 1.0]) * rng.uniform(0.05, 0.3) * R[:, 2]
    else:
        away = origin + (drawing.reach + rng.uniform(0.05, 0.5)) * _unit(rng, 3)
    goals = [FrameGoal.at(drawing.frame, place) for place in (point, away)]
    problems = [MechanismProblem(mechanism, (goal,), tolerances=TIGHT) for goal in goals]
    return problems[0], problems[1]


def _four_bar(rng: np.random.Generator, name: str = "") -> Drawing:
    """Crank and rocker on the base, tied by a coupler with a point on it."""
    a, b, d = rng.uniform(*BARS, 3)
    crank, coupler = rng.uniform(-np.pi, np.pi, 2)
    away = a * _along(crank) + b * _along(coupler) - [d, 0.0]
    c, rocker = float(np.hypot(*away)), float(np.arctan2(away[1], away[0]))
    if c < SHORTEST:
        return _four_bar(rng, name)
    point = rng.uniform(-0.5, 1.2, 2) * [b, b]
    values = {f"{name}crank": crank, f"{name}coupler": _turn(coupler - crank), f"{name}rocker": rocker}
    body = f"""
    <body name="{name}crank">{_hinge(f"{name}crank", crank, rng)}<geom/>
      <body name="{name}coupler" pos="{a} 0 0">{_hinge(f"{name}coupler", _turn(coupler - crank), rng)}<geom/>
        <site name="{name}coupler_end" pos="{b} 0 0"/>
        <site name="{name}point" pos="{point[0]} {point[1]} {rng.uniform(-0.1, 0.1)}"/>
      </body>
    </body>
    <body name="{name}rocker" pos="{d} 0 0">{_hinge(f"{name}rocker", rocker, rng)}<geom/>
      <site name="{name}rocker_end" pos="{c} 0 0"/>
    </body>"""
    tie = f'<connect name="{name}loop" site1="{name}coupler_end" site2="{name}rocker_end"/>'
    reach = a + float(np.hypot(*point)) + 0.1
    return Drawing(body, tie, _as_arrays(values), f"{name}point", reach)


def _gripper(rng: np.random.Generator) -> Drawing:
    """Two fingers on parallel bars, mirror images of each other; one crank follows the other by a multiple."""
    bar, apart, half, long = rng.uniform((0.05, 0.02, 0.01, 0.05), (0.12, 0.05, 0.05, 0.12))
    slope = float(rng.choice(SLOPES))
    left = rng.uniform(-0.6, 0.6)
    right = slope * left
    # the right side is turned half round y, so its hinges turn the other way; those of slopes < 0 are turned back
    way = 1.0 if slope > 0 else -1.0
    sides = {"left": ("", 1.0, left), "right": ('quat="0 0 1 0"', way, right)}
    body = "".join(_finger(name, *one, bar, apart, half, long) for name, one in sides.items())
    ties = "".join(
        f'<connect name="{side}_loop" site1="{side}_finger_end" site2="{side}_rocker_end"/>' for side in sides
    )
    follow = f'<joint name="mimic" joint1="right_crank" joint2="left_crank" polycoef="0 {slope} 0 0 0"/>'
    values: dict[str, float] = {}
    for side, (_, _, angle) in sides.items():
        values |= {f"{side}_crank": angle, f"{side}_rocker": angle, f"{side}_finger": -angle}
    frame, opening = ("left_tip", True) if rng.uniform() < 0.5 else ("right_tip", False)
    reach = half + 2.0 * bar + 2.0 * apart + long
    return Drawing(body, ties + follow, _as_arrays(values), frame, reach, opening=opening)


def _finger(
    side: str, turned: str, way: float, angle: float, bar: float, apart: float, half: float, long: float
) -> str:
    """A finger that stays parallel: two bars of one length on the base, along y at zero."""
    axis = f'type="hinge" axis="0 0 {way}"'
    limits = 'range="-1.4 1.4"' if side == "left" else ""
    return f"""
    <body name="{side}_side" {turned}>
      <body name="{side}_crank" pos="{half} 0 0"><joint name="{side}_crank" {axis} {limits}/><geom/>
        <body name="{side}_finger" pos="0 {bar} 0"><joint name="{side}_finger" {axis}/><geom/>
          <site name="{side}_finger_end" pos="{apart} 0 0"/>
          <site name="{side}_tip" pos="0 {long} 0"/>
        </body>
      </body>
      <body name="{side}_rocker" pos="{half + apart} 0 0"><joint name="{side}_rocker" {axis}/><geom/>
        <site name="{side}_rocker_end" pos="0 {bar} 0"/>
      </body>
    </body>"""


def _slider_crank(rng: np.random.Generator) -> Drawing:
    """A crank that moves a slider, off the crank's middle or not, by a rod."""
    a, crank, off = rng.uniform(*BARS), rng.uniform(-np.pi, np.pi), rng.choice([0.0, rng.uniform(-0.1, 0.1)])
    b = rng.uniform(0.2, 0.7)
    rise = off - a * np.sin(crank)
    if abs(rise) > 0.95 * b:
        return _slider_crank(rng)
    rod = float(np.arcsin(rise / b))
    travel = a * np.cos(crank) + b * np.cos(rod)
    frame = str(rng.choice(["slider", "point"]))
    values = {"crank": crank, "rod": _turn(rod - crank), "slider": travel}
    body = f"""
    <body name="crank">{_hinge("crank", crank, rng)}<geom/>
      <body name="rod" pos="{a} 0 0">{_hinge("rod", _turn(rod - crank), rng)}<geom/>
        <site name="rod_end" pos="{b} 0 0"/>
        <site name="point" pos="{rng.uniform(0.2, 0.8) * b} {rng.uniform(-0.1, 0.1)} 0"/>
      </body>
    </body>
    <body name="slider" pos="0 {off} 0">
      <joint name="slider" type="slide" axis="1 0 0" range="{travel - rng.uniform(0.05, 1)} {travel + 0.3}"/><geom/>
      <site name="slider"/>
    </body>"""
    tie = '<connect name="loop" site1="rod_end" site2="slider"/>'
    return Drawing(body, tie, _as_arrays(values), frame, a + b + 0.2)


def _spatial(rng: np.random.Generator) -> Drawing:
    """Crank and rocker about axes that are not parallel, tied by a coupler on a ball joint."""
    a, c = rng.uniform(*BARS, 2)
    crank, rocker = rng.uniform(-np.pi, np.pi, 2)
    there, turn = rng.uniform(-0.4, 0.4, 3), _unit(rng, 4)
    end = there + _rotated(turn, c * np.append(_along(rocker), 0.0))
    along = _rotated(_about_z(-crank), end - a * np.append(_along(crank), 0.0))
    b = float(np.linalg.norm(along))
    if b < SHORTEST:
        return _spatial(rng)
    ball = np.append(b + along[0], np.cross([1.0, 0.0, 0.0], along))
    values: dict[str, Array] = _as_arrays({"crank": crank, "rocker": rocker})
    values["ball"] = ball / np.linalg.norm(ball)
    body = f"""
    <body name="crank">{_hinge("crank", crank, rng)}<geom/>
      <body name="coupler" pos="{a} 0 0"><joint name="ball" type="ball"/><geom/>
        <site name="coupler_end" pos="{b} 0 0"/>
        <site name="point" pos="{rng.uniform(0.2, 0.8) * b} 0 0"/>
      </body>
    </body>
    <body name="rocker" pos="{_told(there)}" quat="{_told(turn)}">{_hinge("rocker", rocker, rng)}<geom/>
      <site name="rocker_end" pos="{c} 0 0"/>
    </body>"""
    tie = '<connect name="loop" site1="coupler_end" site2="rocker_end"/>'
    return Drawing(body, tie, values, "point", a + b, planar=False)


KINDS: Mapping[str, Callable[[np.random.Generator], Drawing]] = MappingProxyType(
    {"four-bar": _four_bar, "gripper": _gripper, "slider-crank": _slider_crank, "spatial": _spatial}
)
"""How each kind is drawn."""


def _hinge(name: str, value: float, rng: np.random.Generator) -> str:
    """A hinge about z, half of them with limits around a value."""
    low, high = value - rng.uniform(0.1, 2.0), value + rng.uniform(0.1, 2.0)
    limits = f'range="{low} {high}"' if rng.uniform() < 0.5 else ""
    return f'<joint name="{name}" type="hinge" axis="0 0 1" {limits}/>'


def _as_arrays(values: Mapping[str, float]) -> dict[str, Array]:
    return {name: np.array([value]) for name, value in values.items()}


def _turn(angle: float) -> float:
    return float((angle + np.pi) % (2.0 * np.pi) - np.pi)


def _along(angle: float) -> Array:
    return np.array([np.cos(angle), np.sin(angle)])


def _about_z(angle: float) -> Array:
    return np.array([np.cos(0.5 * angle), 0.0, 0.0, np.sin(0.5 * angle)])


def _rotated(quat: Array, v: Array) -> Array:
    w, u = quat[0], quat[1:]
    turned: Array = v + 2.0 * np.cross(u, w * v + np.cross(u, v))
    return turned


def _unit(rng: np.random.Generator, size: int) -> Array:
    v = rng.normal(size=size)
    unit: Array = v / np.linalg.norm(v)
    return unit


def _told(numbers: Array) -> str:
    return " ".join(repr(float(number)) for number in numbers)
