"""Mechanisms for the tests of what asks about them."""

import mujoco
import numpy as np

from workcell.model.mechanism.from_model import mechanism_of
from workcell.model.mechanism.mechanism import Mechanism
from workcell.model.mechanism.placing import place

FOUR_BAR = """<mujoco><compiler angle="radian"/><worldbody>
  <body name="crank"><joint name="a" axis="0 0 1" range="-3 3"/><geom name="crank" size=".02" pos=".1 0 0"/>
    <body name="coupler" pos=".2 0 0"><joint name="b" axis="0 0 1"/><geom name="coupler" size=".02" pos=".2 0 0"/>
      <site name="tip" pos=".2 .1 0"/></body></body>
  <body name="rocker" pos=".5 0 0"><joint name="c" axis="0 0 1"/><geom name="rocker" size=".02" pos="0 .1 0"/></body>
  </worldbody>
  <equality><connect name="pin" body1="coupler" body2="rocker" anchor=".4 0 0"/></equality></mujoco>"""
"""Crank 0.2 m, coupler 0.4 m, ground 0.5 m; the rocker's pin, 0.1 m along its x axis, is where the crank lies along x:
it is assembled in line, so that the rocker is 0.1 m long."""

PLATFORM = """<mujoco><compiler angle="radian"/><worldbody>{base}
  <body name="plate" pos="0 0 .5"><freejoint name="plate"/><geom name="plate" type="cylinder" size=".2 .01"/>
    <site name="tool" pos="0 0 .05"/>{top}</body></worldbody><equality>{ties}</equality></mujoco>"""


def four_bar(**options):
    """A planar four-bar of general lengths, assembled."""
    text = FOUR_BAR.replace('pos=".5 0 0"', 'pos=".55 -.12 0"')
    return mechanism_of(mujoco.MjModel.from_xml_string(text), **options)


def platform():
    """Six legs of a ball, a slide and a connect each, under a floating plate."""
    base, top, ties = "", "", ""
    for k in range(6):
        a, b = np.pi / 3 * (k // 2 * 2) + (0.2 if k % 2 else -0.2), np.pi / 3 * ((k + 1) // 2 * 2 - 1)
        b += -0.2 if k % 2 else 0.2
        foot, head = 0.4 * np.array([np.cos(a), np.sin(a), 0]), 0.2 * np.array([np.cos(b), np.sin(b), 0])
        way = head + np.array([0, 0, 0.5]) - foot
        length = np.linalg.norm(way)
        z = " ".join(map(repr, (way / length).tolist()))
        text = " ".join(map(repr, foot.tolist()))
        base += (
            f'<body name="low{k}" pos="{text}"><joint name="ball{k}" type="ball"/>'
            f'<geom name="low{k}" size=".01" pos="0 0 -.1"/>'
            f'<body name="high{k}"><joint name="slide{k}" type="slide" axis="{z}" range="-.2 .2"/>'
            f'<geom name="high{k}" size=".01" pos="0 0 -.2"/></body></body>'
        )
        ties += (
            f'<connect name="leg{k}" body1="high{k}" body2="plate" '
            f'anchor="{" ".join(map(repr, way.tolist()))}"/>'
        )
    return mechanism_of(mujoco.MjModel.from_xml_string(PLATFORM.format(base=base, top=top, ties=ties)))


def frame_at(mechanism: Mechanism, name: str, q):
    """World rotation and place of a frame."""
    placed, frame = place(mechanism, np.asarray(q, dtype=float)), mechanism.frame(name)
    return (
        placed.R[frame.link] @ frame.T_link_frame.rotation,
        placed.point(frame.link, frame.T_link_frame.position),
    )
