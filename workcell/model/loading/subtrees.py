"""What belongs to what in a compiled model: by subtree and id, never by name."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from workcell.model.loading.actuators import actuator_targets

if TYPE_CHECKING:
    import mujoco


Whose = tuple[str, str]
"""A kind, `robot` or `object`, and a name."""


@dataclass(frozen=True, slots=True)
class Members:
    """The bodies of one robot or object in a compiled model.

    Attributes:
        roots: ids of its root bodies.
        own: all its bodies, a gripper's included.
        guests: bodies of others, such as an object fixed to a robot's hand, that its bodies carry.
    """

    roots: tuple[int, ...]
    own: frozenset[int]
    guests: frozenset[int] = frozenset()


def members(model: mujoco.MjModel, roots: Mapping[Whose, Sequence[int]]) -> dict[Whose, Members]:
    """The bodies below each one's roots; where one's roots lie below another's, they are guests there.

    Args:
        model: the compiled model.
        roots: ids of the root bodies, by whom they belong to.
    """
    owner_of_root = {root: name for name, several in roots.items() for root in several}
    owner: list[Whose | None] = [None] * model.nbody
    for body in range(1, model.nbody):  # parents come first
        owner[body] = owner_of_root.get(body, owner[int(model.body_parentid[body])])
    found = {}
    for name, several in roots.items():
        own = frozenset(body for body, whose in enumerate(owner) if whose == name)
        found[name] = Members(tuple(several), own, subtree(model, several) - own)
    return found


def subtree(model: mujoco.MjModel, roots: Iterable[int]) -> frozenset[int]:
    """Some bodies and all below them."""
    inside = set(roots)
    for body in range(1, model.nbody):  # parents come first
        if int(model.body_parentid[body]) in inside:
            inside.add(body)
    return frozenset(inside)


def path_to(model: mujoco.MjModel, body: int, bodies: Collection[int]) -> list[int]:
    """The bodies from the topmost of `bodies` down to one of them."""
    path = []
    while body in bodies:
        path.append(body)
        body = int(model.body_parentid[body])
    return path[::-1]


def joints_of(model: mujoco.MjModel, body: int) -> range:
    """Ids of a body's joints, in the order in which they move it."""
    first = int(model.body_jntadr[body])
    return range(first, first + int(model.body_jntnum[body])) if first >= 0 else range(0)


def bodies_of_links(
    model: mujoco.MjModel, joints: Sequence[int], bodies: Iterable[int]
) -> tuple[tuple[int, ...], ...]:
    """For each link of a robot, base first, the bodies that it carries (a gripper's fingers with the hand).

    Args:
        model: the compiled model.
        joints: ids of the robot's joints, in order: of several in one body the last carries it.
        bodies: which bodies to sort; one that no joint moves goes to the base.
    """
    moved = {int(model.jnt_bodyid[joint]): k + 1 for k, joint in enumerate(joints)}
    links: list[list[int]] = [[] for _ in range(len(joints) + 1)]
    for body in sorted(bodies):
        ancestor = body
        while ancestor > 0 and ancestor not in moved:
            ancestor = int(model.body_parentid[ancestor])
        links[moved.get(ancestor, 0)].append(body)
    return tuple(tuple(link) for link in links)


def actuators_of(model: mujoco.MjModel, bodies: Collection[int]) -> tuple[int, ...]:
    """Ids of the actuators all of whose joints, sites and bodies belong to some bodies."""
    found = []
    for actuator in range(model.nu):
        targets = actuator_targets(model, actuator)
        if targets and all(body in bodies for body in targets):
            found.append(actuator)
    return tuple(found)
