"""Which links turn together, which rotations are known, and which links can only turn about one direction.

Links tied by slides, welds and locked hinges share one rotation: a node. The world and links whose rotation a goal
fixes are known. A node that hangs on a known one by hinges of one direction is planar: `R = P Rz(phi) S`. What is left
needs a PSD block. Without this the relaxation has no interior point, which interior-point methods need.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from workcell.errors import ModelError
from workcell.ik.ikspark.lift import frame_with_z
from workcell.model.mechanism.mechanism import WORLD, Joint, Mechanism
from workcell.pose import Array, axis_angle_to_matrix

_SAME = 1e-9
"""Difference of rotations that are one."""
_PARALLEL = 1e-12
"""Sine below which two axes are one direction but for rounding."""
_FLIP = np.diag([1.0, -1.0, -1.0])


@dataclass(frozen=True, slots=True)
class Node:
    """Links that turn together.

    Attributes:
        kind: `known`, `planar` or `full`.
        P, S: of a planar node `R = P Rz(phi) S`; of a known one P is its rotation.
        side: of a planar node the known node that it hangs on; -2 or less: a goal gives its direction.
    """

    kind: Literal["known", "planar", "full"]
    P: Array = field(default_factory=lambda: np.eye(3))
    S: Array = field(default_factory=lambda: np.eye(3))
    side: int = -1


@dataclass(frozen=True, slots=True)
class Nodes:
    """The nodes of a mechanism.

    Attributes:
        nodes: all of them; node 0 is the world's.
        of_link: (links,) the node of each link.
        C: (links, 3, 3) `R_link = R_node C`.
    """

    nodes: tuple[Node, ...]
    of_link: NDArray[np.int64]
    C: Array


def find_nodes(
    mechanism: Mechanism,
    interval: Array,
    goals: Mapping[int, Array],
    directions: Sequence[tuple[int, Array, Array]] = (),
) -> Nodes:
    """The nodes of a mechanism.

    Args:
        mechanism: the mechanism.
        interval: (joints, 2) limits of its hinges and slides.
        goals: rotations (3, 3) of links that goals fix.
        directions: links, axes (3,) in them, and the directions (3,) in the world that goals give these.

    Raises:
        ModelError: links that are tied to each other in two ways that contradict each other.
    """
    of_link, C = _together(mechanism, interval)
    known: dict[int, Array] = {0: np.eye(3)}
    for link, R in goals.items():
        known.setdefault(int(of_link[link]), R @ C[link].T)
    pointing: dict[int, Node] = {}
    for number, (link, axis, direction) in enumerate(directions):
        P, S = frame_with_z(direction), frame_with_z(C[link] @ axis).T
        pointing.setdefault(int(of_link[link]), Node("planar", P, S, -2 - number))
    nodes = _planar(mechanism, of_link, C, known, pointing)
    return Nodes(tuple(nodes), of_link, C)


def _together(mechanism: Mechanism, interval: Array) -> tuple[NDArray[np.int64], Array]:
    """Links that share a rotation."""
    ties: dict[int, list[tuple[int, Array, str]]] = {}
    for one, two, M, name in _fixed(mechanism, interval):
        ties.setdefault(one, []).append((two, M, name))
        ties.setdefault(two, []).append((one, M.T, name))
    of_link = np.full(mechanism.link_count, -1, dtype=np.int64)
    C = np.tile(np.eye(3), (mechanism.link_count, 1, 1))
    count = 0
    for root in range(mechanism.link_count):
        if of_link[root] >= 0:
            continue
        of_link[root], queue = count, deque([root])
        while queue:
            here = queue.popleft()
            for other, M, name in ties.get(here, []):
                turned = C[here] @ M
                if of_link[other] < 0:
                    of_link[other], C[other] = count, turned
                    queue.append(other)
                elif np.abs(C[other] - turned).max() > _SAME:
                    raise ModelError(
                        f"{name} can't be kept: the links that it ties are held in another rotation",
                        where=mechanism.name,
                        remedy="a loop that closes",
                    )
        count += 1
    return of_link, C


def _fixed(mechanism: Mechanism, interval: Array) -> Iterator[tuple[int, int, Array, str]]:
    """(one link, another, M, name) with `R_other = R_one M` always."""
    for k, joint in enumerate(mechanism.joints):
        if joint.kind == "slide":
            yield joint.parent, k + 1, joint.T_parent_joint.rotation, f"joint {joint.name!r}"
        elif joint.kind == "hinge" and interval[k, 0] == interval[k, 1]:
            turn = axis_angle_to_matrix(joint.axis, interval[k, 0])
            yield joint.parent, k + 1, joint.T_parent_joint.rotation @ turn, f"joint {joint.name!r}"
        elif joint.kind == "ball" and joint.upper == 0.0:
            yield joint.parent, k + 1, joint.T_parent_joint.rotation, f"joint {joint.name!r}"
    for closure in mechanism.closures:
        if closure.kind == "weld":
            F, G = closure.frames
            yield closure.links[0], closure.links[1], F.rotation @ G.rotation.T, closure.name


def _planar(
    mechanism: Mechanism,
    of_link: NDArray[np.int64],
    C: Array,
    known: Mapping[int, Array],
    pointing: Mapping[int, Node],
) -> list[Node]:
    """Known nodes, and outwards from them those that hang by hinges of one direction; the nearest source counts."""
    nodes = [Node("full") for _ in range(int(of_link.max()) + 1)]
    for node, given in pointing.items():
        nodes[node] = given
    for node, R in known.items():
        nodes[node] = Node("known", R)
    edges: dict[int, list[tuple[Joint, int, int]]] = {}
    for k, joint in enumerate(mechanism.joints):
        if joint.kind == "hinge" and of_link[joint.parent] != of_link[k + 1]:
            for node in (of_link[joint.parent], of_link[k + 1]):
                edges.setdefault(int(node), []).append((joint, joint.parent, k + 1))
    queue = deque([*known, *(node for node in pointing if node not in known)])
    while queue:
        here = queue.popleft()
        for joint, parent, child in edges.get(here, []):
            down = int(of_link[parent]) == here
            other = int(of_link[child if down else parent])
            if nodes[other].kind != "full":
                continue
            found = _beyond(nodes[here], here, joint, C[parent], C[child], down)
            if found is not None:
                nodes[other] = found
                queue.append(other)
    return nodes


def _beyond(node: Node, index: int, joint: Joint, C_parent: Array, C_child: Array, down: bool) -> Node | None:
    """The node on the other side of a hinge, if it is planar too."""
    F = frame_with_z(joint.axis)
    # the joint's frame with z along the axis, in either node
    parent, child = C_parent @ joint.T_parent_joint.rotation @ F, C_child @ F
    near, far = (parent, child) if down else (child, parent)
    if node.kind == "known":
        return Node("planar", node.P @ near, far.T, index)
    M = node.S @ near
    if np.hypot(M[0, 2], M[1, 2]) > _PARALLEL:
        return None
    return Node("planar", node.P, (np.eye(3) if M[2, 2] > 0 else _FLIP) @ far.T, node.side)


def is_world(nodes: Nodes, link: int) -> bool:
    """Whether a link turns with the world."""
    return int(nodes.of_link[link]) == int(nodes.of_link[WORLD])
