"""The link of a URDF that the tool is, where the file has no sites to say so: whatever order its links stand in."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import mujoco


def tool_link(spec: mujoco.MjSpec) -> mujoco.MjsBody:
    """The farthest link that all of the chain's joints carry.

    The chain goes on from its base as long as joints lead on to one side only. Where it parts after a joint, as a hand
    does into fingers, it ends. Of the links that are fixed to its last one the farthest is the tool; of several a frame
    without geometry, and of those the first by name. Where it parts before any joint, as a torso does into arms, the
    link is taken to which the most joints lead, the first by name.
    """
    roots = sorted((body for body in spec.bodies if _parent(body) is None), key=lambda body: str(body.name))
    chains = [_last_link(root) for root in roots]
    moved = [link for link in chains if link is not None]
    if moved:
        return max(_fixed_to(moved[0]), key=_preference)
    return max(sorted(spec.bodies, key=lambda body: str(body.name)), key=_joints_to)


def _parent(body: mujoco.MjsBody) -> mujoco.MjsBody | None:
    parent = body.parent
    return None if parent is None or parent.name == "world" else parent


def _last_link(root: mujoco.MjsBody) -> mujoco.MjsBody | None:
    """The link in which a chain ends; None where it parts before any joint, or has none."""
    link, joints = root, len(list(root.joints))
    while True:
        onward = [body for body in _fixed_to(link) for body in body.bodies if _moves(body)]
        if len(onward) != 1:
            return link if joints else None
        link, joints = onward[0], joints + 1


def _moves(body: mujoco.MjsBody) -> bool:
    return bool(list(body.joints))


def _fixed_to(link: mujoco.MjsBody) -> list[mujoco.MjsBody]:
    """A link and all that is fixed to it, by name."""
    found, waiting = [], [link]
    while waiting:
        body = waiting.pop()
        found.append(body)
        waiting += [child for child in body.bodies if not _moves(child)]
    return sorted(found, key=lambda body: str(body.name))


def _preference(body: mujoco.MjsBody) -> tuple[int, bool]:
    return _depth(body), not list(body.geoms)


def _depth(body: mujoco.MjsBody) -> int:
    depth, at = 0, _parent(body)
    while at is not None:
        depth, at = depth + 1, _parent(at)
    return depth


def _joints_to(body: mujoco.MjsBody) -> tuple[int, int]:
    joints, at = len(list(body.joints)), _parent(body)
    while at is not None:
        joints, at = joints + len(list(at.joints)), _parent(at)
    return joints, _depth(body)
