"""Where a mechanism's links are, for whoever judges: products of exponentials, sharing nothing with `placing`.

Every joint is a motion of the world in which all joints are at zero (Lynch and Park, Modern Robotics, section 4.1): a
hinge turns about its axis there, a ball about its point, and a floating body's is its pose.
"""

from __future__ import annotations

import numpy as np

from workcell.identity_cache import ByIdentity
from workcell.ik.judge.exact import rotations, skew
from workcell.model.mechanism.mechanism import Mechanism
from workcell.pose import Array


class ExactMechanism:
    """World poses of a mechanism's links.

    Attributes:
        zero: (links, 4, 4) the links with all joints at zero.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self.zero = np.tile(np.eye(4), (mechanism.link_count, 1, 1))
        for k, joint in enumerate(mechanism.joints):
            if joint.kind != "free":  # its motion is a pose in the world
                self.zero[k + 1] = self.zero[joint.parent] @ joint.T_parent_joint.matrix

    def links(self, q: Array) -> tuple[Array, Array]:
        """Rotations (links, 3, 3) and places (links, 3) of the links in the world at `q` (size,)."""
        motion = np.tile(np.eye(4), (self.mechanism.link_count, 1, 1))
        for k, (joint, at) in enumerate(zip(self.mechanism.joints, self.mechanism.value_slices, strict=True)):
            values, R, p = q[at], self.zero[k + 1, :3, :3], self.zero[k + 1, :3, 3]
            screw = np.eye(4)
            if joint.kind == "free":
                screw[:3, :3], screw[:3, 3] = rotations(values[None, 3:])[0], values[:3]
            elif joint.kind == "slide":
                screw[:3, 3] = values[0] * (R @ joint.axis)
            else:
                if joint.kind == "hinge":
                    K = skew(R @ joint.axis)
                    turn = np.eye(3) + np.sin(values[0]) * K + (1.0 - np.cos(values[0])) * (K @ K)
                else:
                    turn = R @ rotations(values[None])[0] @ R.T
                screw[:3, :3], screw[:3, 3] = turn, p - turn @ p
            motion[k + 1] = motion[joint.parent] @ screw
        T = motion @ self.zero
        return T[:, :3, :3], T[:, :3, 3]

    def frames(self, names: tuple[str, ...], q: Array) -> dict[str, tuple[Array, Array]]:
        """World rotation (3, 3) and place (3,) of frames at `q` (size,)."""
        R, p = self.links(q)
        found = {}
        for name in names:
            frame = self.mechanism.frame(name)
            link, T = frame.link, frame.T_link_frame
            found[name] = R[link] @ T.rotation, R[link] @ T.position + p[link]
        return found


_made = ByIdentity()


def exact_mechanism(mechanism: Mechanism) -> ExactMechanism:
    """The mechanism's kinematics, remembered."""
    made: ExactMechanism = _made.get((mechanism,), lambda: ExactMechanism(mechanism))
    return made
