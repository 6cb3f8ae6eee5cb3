"""Small mechanisms by chance: all joint kinds, trees and loops, with a configuration at which every tie holds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from workcell.model.mechanism.mechanism import Closure, Frame, Joint, JointKind, Mechanism
from workcell.model.mechanism.placing import place
from workcell.pose import Array, Pose


def unit(rng: np.random.Generator, size: int) -> Array:
    vector = rng.standard_normal(size)
    return vector / np.linalg.norm(vector)


def pose(rng: np.random.Generator) -> Pose:
    return Pose(rng.uniform(-0.5, 0.5, 3), unit(rng, 4))


def joint(rng: np.random.Generator, k: int, kind: JointKind, parent: int) -> tuple[Joint, Array]:
    """A joint, and a value within its limits."""
    if kind == "free":
        value = np.concatenate([rng.uniform(-1, 1, 3), unit(rng, 4)])
        return Joint(f"j{k}", kind, 0, Pose.identity(), np.zeros(3)), value
    T = pose(rng)
    if kind == "ball":
        return Joint(f"j{k}", kind, parent, T, np.zeros(3), 0.0, np.pi if k % 2 else 2.5), small_turn(
            rng, 2.4
        )
    lower, upper = (-0.4, 0.7) if kind == "slide" else (-1.2, 2.0)
    if kind == "hinge" and k % 3 == 2:
        lower, upper = -np.inf, np.inf
    value = rng.uniform(max(lower, -3.0), min(upper, 3.0), 1)
    return Joint(f"j{k}", kind, parent, T, unit(rng, 3), lower, upper), value


def small_turn(rng: np.random.Generator, most: float) -> Array:
    half = 0.5 * rng.uniform(0, most)
    return np.concatenate([[np.cos(half)], np.sin(half) * unit(rng, 3)])


def mechanism_of(
    rng: np.random.Generator, kinds: Sequence[JointKind], *, tree: bool = False, loop: str | None = None
) -> tuple[Mechanism, Array]:
    """A mechanism, and a configuration (size,) that closes its loop: a `connect` or `weld` of the last link."""
    made = [joint(rng, k, kind, int(rng.integers(0, k + 1)) if tree else k) for k, kind in enumerate(kinds)]
    joints = tuple(one for one, _ in made)
    q = np.concatenate([value for _, value in made])
    names = ("world", *(f"l{k}" for k in range(len(kinds))))
    frames = {f"f{k}": Frame(f"f{k}", k, pose(rng)) for k in range(len(names))}
    mechanism = Mechanism("chance", joints, names, frames=frames, home=q)
    if loop is None:
        return mechanism, q
    placed, F, last = place(mechanism, q), pose(rng), len(kinds)
    other = 0 if len(kinds) < 3 else 1
    T_world = Pose.from_rotation(placed.p[last], placed.R[last]) @ F
    G = Pose.from_rotation(placed.p[other], placed.R[other]).inverse() @ T_world
    closure = Closure(loop, loop, (last, other), (F, G))
    return Mechanism("chance", joints, names, (closure,), frames=frames, home=q), q
