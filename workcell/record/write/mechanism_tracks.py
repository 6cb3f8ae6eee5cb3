"""A mechanism in a recording: the frames that are watched, with their ways, and the spheres of its links."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from workcell.geometry.types import SphereCover
from workcell.model.scene_mechanism import SceneMechanism
from workcell.pose import Array
from workcell.record.write.rrd import entity
from workcell.record.write.tracks import Track

FRAMES, TRACES, PLANS = "frames", "traces", "plans"
"""Below a mechanism's entity, by frame: its axes, its executed way, and its planned way."""


def below(moving: SceneMechanism, group: str, frame: str) -> str:
    """The entity of a frame's axes, trace or plan."""
    return f"world/robots/{entity(moving.name)}/{group}/{entity(frame)}"


def frame_tracks(moving: SceneMechanism) -> Iterator[tuple[Track, str]]:
    """For each frame that is watched its track, and the entity of its trace."""
    for name in moving.frames:
        frame = moving.mechanism.frame(name)
        body = body_on(moving, frame.link)
        offset = moving.compiled.T_link_body[body].inverse() @ frame.T_link_frame
        yield Track(below(moving, FRAMES, name), body, offset), below(moving, TRACES, name)


def body_on(moving: SceneMechanism, link: int) -> int:
    """The first body (id) that a link carries."""
    return int(np.flatnonzero(moving.compiled.link_of_body == link)[0])


def link_spheres(
    moving: SceneMechanism, cover: SphereCover, carriers: Mapping[int, str]
) -> Iterator[tuple[str, Array, Array, str]]:
    """For each link of a cover: the entity of its spheres, centres (m, 3), radii (m,), and the entity they follow.

    Args:
        moving: whose links the cover counts.
        cover: spheres in link frames.
        carriers: entities of the bodies that are drawn, by id.
    """
    compiled = moving.compiled
    for link in np.unique(cover.link).tolist():
        bodies = np.flatnonzero(compiled.link_of_body == link).tolist()
        body = next((body for body in bodies if body in carriers), None)
        if body is None or link == 0:
            continue
        mine = cover.link == link
        centres = compiled.T_link_body[body].inverse().apply(cover.centre[mine])
        path = (
            f"world/robots/{entity(moving.name)}/spheres/{entity(moving.mechanism.link_names[link])}_{link}"
        )
        yield path, centres, cover.radius[mine], carriers[body]


def described(moving: SceneMechanism) -> dict[str, Any]:
    """What a review says about it: the joints that motors move, all others, and what ties them."""
    joints = [moving.mechanism.joints[k] for k in moving.motors]
    driven = set(moving.motors)
    return {
        "joints": list(moving.motor_names),
        "lower": [joint.lower for joint in joints],
        "upper": [joint.upper for joint in joints],
        "tool": ", ".join(moving.frames),
        "passive": [joint.name for k, joint in enumerate(moving.mechanism.joints) if k not in driven],
        "closures": [closure.name for closure in moving.mechanism.closures],
    }
