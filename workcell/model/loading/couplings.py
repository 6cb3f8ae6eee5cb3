"""What a compiled model's equality constraints say of single joints: which follow others, and which are locked.

MuJoCo's polynomials are in deviations from the reference positions; here they are of the joints' values. Couplings
that a `Robot` can't have (of joints that aren't on the way to its tool, in circles, two for one joint) are refused by
the joint's name.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import Polynomial

from workcell.errors import ModelError
from workcell.model.coupling import Coupling, preimage, value_range
from workcell.model.loading.actuators import actuator_of_joint
from workcell.model.robot import LIMIT_SLACK
from workcell.pose import Array

if TYPE_CHECKING:
    import mujoco

Leaders = dict[int, list[tuple[int, Polynomial]]]
"""By joint (id): the joints that it follows (one, in what can be honoured), and its value as a polynomial of theirs."""
_TURN = 2 * np.pi
_SOFT = (0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)
"""MuJoCo's own `solref` and `solimp`: what a constraint has whose file says nothing of how hard it is."""
HARD = (0.005, 1.0), (0.999, 0.9999, 0.001, 0.5, 2.0)
"""As hard as MuJoCo steps well with."""


def locked_values(model: mujoco.MjModel) -> dict[int, float]:
    """Joints (ids) that an equality constraint holds at one value, alone or by a joint that is held; and that value.

    Constraints that are inactive at the start don't count.

    Raises:
        ModelError: two that contradict each other.
    """
    held: dict[int, float] = {}
    for joint, leader, polynomial in _constraints(model):
        if leader >= 0:
            continue
        value = float(polynomial(0.0))
        if abs(held.setdefault(joint, value) - value) > LIMIT_SLACK:
            raise ModelError(
                f"two equality constraints hold joint {model.joint(joint).name!r} at {held[joint]:g} and {value:g}"
            )
    follows = leaders(model)
    for joint in follows:
        found = _root(follows, joint)
        if isinstance(found, tuple) and found[0] in held:
            held.setdefault(joint, float(found[1](held[found[0]])))
    return held


def harden(model: mujoco.MjModel, joints: Collection[int]) -> None:
    """Make the couplings among some joints (ids) hard, in place, where the file says nothing of how hard they are.

    With MuJoCo's own numbers a joint that follows lags by some thousandths of a radian under its link's weight.
    """
    import mujoco

    for equality in range(model.neq):
        pair = int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])
        if model.eq_type[equality] != mujoco.mjtEq.mjEQ_JOINT or not set(pair) <= {*joints, -1}:
            continue
        soft = np.allclose(model.eq_solref[equality], _SOFT[0]) and np.allclose(
            model.eq_solimp[equality], _SOFT[1]
        )
        if soft and pair[0] in joints:
            model.eq_solref[equality], model.eq_solimp[equality] = HARD


def settled(model: mujoco.MjModel, values: dict[int, float]) -> dict[int, float]:
    """Values of joints (by id), those that follow another of them, or are held, put where they belong."""
    held, follows, placed = locked_values(model), leaders(model), dict(values)
    for joint in values:
        found = _root(follows, joint)
        if joint in held:
            placed[joint] = held[joint]
        elif isinstance(found, tuple) and found[0] != joint and found[0] in values:
            placed[joint] = float(found[1](values[found[0]]))
    return placed


def leaders(model: mujoco.MjModel) -> Leaders:
    """The joints that follow others, by an active equality constraint; one that is said twice counts once."""
    found: Leaders = {}
    for joint, leader, polynomial in _constraints(model):
        if leader >= 0:
            known = found.setdefault(joint, [])
            if not any(other == leader and _same(row, polynomial) for other, row in known):
                known.append((leader, polynomial))
    return found


def _same(one: Polynomial, two: Polynomial) -> bool:
    return bool(np.allclose((one - two).coef, 0.0, atol=1e-12))


def _constraints(model: mujoco.MjModel) -> list[tuple[int, int, Polynomial]]:
    """Active couplings of single joints: joint, its leader (-1: none), its value as a polynomial of the leader's."""
    import mujoco

    found = []
    for equality in range(model.neq):
        if model.eq_type[equality] != mujoco.mjtEq.mjEQ_JOINT or not model.eq_active0[equality]:
            continue
        joint, leader = int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])
        data = np.array(model.eq_data[equality, :5])
        if leader < 0:
            polynomial = Polynomial(data[:1])
        else:
            reference = float(model.qpos0[model.jnt_qposadr[leader]])
            polynomial = Polynomial(data)(Polynomial([-reference, 1.0]))
        found.append((joint, leader, polynomial + float(model.qpos0[model.jnt_qposadr[joint]])))
    return found


@dataclass(frozen=True, slots=True)
class ChainLimits:
    """Limits of a chain's joints (m,) as the file has them, infinite where it has none; velocity and so on alike."""

    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    effort: Array


@dataclass(frozen=True, slots=True)
class ChainVariables:
    """The joints (places in the chain) that are variables, what the others follow, and limits (n,) of the variables."""

    joints: tuple[int, ...]
    coupling: Coupling | None
    limits: ChainLimits


def chain_variables(
    model: mujoco.MjModel,
    joints: Sequence[int],
    names: tuple[str, ...],
    own: ChainLimits,
    where: str | Path | None,
) -> ChainVariables:
    """Which of a chain's joints (ids, base first) are variables; the limits of those that follow tighten theirs.

    A joint that no other leads is a variable if something drives it; else a joint that follows it by a multiple, and
    is driven, takes its place.

    Args:
        model: the compiled model.
        joints: ids of the m joints, base first.
        names: m names for messages.
        own: the joints' own limits.
        where: the file, for messages.

    Raises:
        ModelError: a coupling that can't be honoured, with the joint's name.
    """
    held = locked_values(model)
    follows = {
        joint: found for joint, found in leaders(model).items() if joint not in held or joint in joints
    }
    follows = {joint: [pair for pair in found if pair[0] not in held] for joint, found in follows.items()}
    follows = {joint: found for joint, found in follows.items() if found}
    _refuse_strangers(model, follows, joints, where)
    place = {joint: k for k, joint in enumerate(joints)}
    roots = [_checked_root(model, follows, joint, where) for joint in joints]
    chosen: dict[int, tuple[int, Polynomial]] = {}
    for root in dict.fromkeys(root for root, _ in roots):
        members = [k for k, (other, _) in enumerate(roots) if other == root]
        chosen[root] = _driven(model, joints, members, roots, place[root], where)
    rows: list[Polynomial] = [p(chosen[root][1]) for root, p in roots]
    variables = tuple(sorted({k for k, _ in chosen.values()}))
    index = [variables.index(chosen[root][0]) for root, _ in roots]
    width = max(2, 1 + max(row.trim(0.0).degree() for row in rows))
    coefficients = np.zeros((len(joints), width))
    for k, row in enumerate(rows):
        kept = row.coef[:width]
        coefficients[k, : len(kept)] = kept
    for variable in variables:
        coefficients[variable] = np.eye(1, width, 1)[0]
    coupling = Coupling(names, np.array(index), coefficients, np.array(variables))
    limits = _tightened(model, joints, coupling, own, where)
    return ChainVariables(variables, coupling if len(variables) < len(joints) else None, limits)


def _root(follows: Leaders, joint: int) -> tuple[int, Polynomial] | str:
    """The joint at the beginning of a chain of couplings, and a joint's value as a polynomial of its value.

    In place of that a word: at which joint there is no chain, and why.
    """
    value, seen = Polynomial([0.0, 1.0]), {joint}
    while joint in follows:
        if len(follows[joint]) > 1:
            return "follows several joints"
        leader, polynomial = follows[joint][0]
        if leader in seen:
            return "follows itself by a circle of couplings"
        seen.add(leader)
        value, joint = value(polynomial), leader
    return joint, value


def _checked_root(
    model: mujoco.MjModel, follows: Leaders, joint: int, where: str | Path | None
) -> tuple[int, Polynomial]:
    found = _root(follows, joint)
    if isinstance(found, str):
        raise ModelError(
            f"joint {model.joint(joint).name!r} {found}",
            where=where,
            remedy="one <equality><joint> (in a URDF one <mimic>) for each joint that follows, in no circle",
        )
    return found


def _refuse_strangers(
    model: mujoco.MjModel, follows: Leaders, joints: Sequence[int], where: str | Path | None
) -> None:
    for joint, leader in [(joint, leader) for joint, found in follows.items() for leader, _ in found]:
        if (joint in joints) != (leader in joints):
            raise ModelError(
                f"joint {model.joint(joint).name!r} follows {model.joint(leader).name!r}, "
                f"and only one of them is between the robot's base and its tool",
                where=where,
                remedy="workcell knows couplings of joints on the way to one tool; leave that constraint out",
            )


def _driven(
    model: mujoco.MjModel,
    joints: Sequence[int],
    members: list[int],
    roots: list[tuple[int, Polynomial]],
    root: int,
    where: str | Path | None,
) -> tuple[int, Polynomial]:
    """The variable (a place in the chain) of a group of joints, and their root's value as a polynomial of its value."""
    if actuator_of_joint(model, joints[root]) is not None:
        return root, Polynomial([0.0, 1.0])
    driven = [k for k in members if actuator_of_joint(model, joints[k]) is not None]
    for k in driven:
        row = roots[k][1].trim(0.0)
        if row.degree() == 1:
            offset, multiple = map(float, row.coef)
            return k, Polynomial([-offset / multiple, 1.0 / multiple])
    name = model.joint(joints[root]).name
    how = (
        f"{model.joint(joints[driven[0]]).name!r}, which is, follows it by no multiple"
        if driven
        else "nothing that follows it is"
    )
    raise ModelError(
        f"joint {name!r} is not actuated, and {how}",
        where=where,
        remedy=f"add an <actuator> with a <motor joint={name!r}>",
    )


def _tightened(
    model: mujoco.MjModel,
    joints: Sequence[int],
    coupling: Coupling,
    own: ChainLimits,
    where: str | Path | None,
) -> ChainLimits:
    """The variables' limits, within which every joint that follows keeps its own."""
    n = len(coupling.own)
    limits = ChainLimits(*(np.array(getattr(own, name)[coupling.own]) for name in ChainLimits.__slots__))
    bent = np.any(coupling.coefficients[:, 2:], axis=1)
    for wanted in (False, True):
        for k in coupling.followers:
            if bent[k] == wanted:
                _tighten(model, joints, coupling, own, limits, int(k), where)
        for v in range(n):
            name = model.joint(joints[coupling.own[v]]).name
            slide = not _is_hinge(model, joints[coupling.own[v]])
            if slide and not np.isfinite(limits.upper[v] - limits.lower[v]):
                raise ModelError(
                    f"slide joint {name!r} has no limits",
                    where=where,
                    remedy="give its range in the model file",
                )
            if not slide:
                limits.lower[v] = (
                    max(limits.lower[v], -_TURN) if np.isinf(limits.lower[v]) else limits.lower[v]
                )
                limits.upper[v] = (
                    min(limits.upper[v], _TURN) if np.isinf(limits.upper[v]) else limits.upper[v]
                )
    return limits


def _is_hinge(model: mujoco.MjModel, joint: int) -> bool:
    import mujoco

    return int(model.jnt_type[joint]) == int(mujoco.mjtJoint.mjJNT_HINGE)


def _tighten(
    model: mujoco.MjModel,
    joints: Sequence[int],
    coupling: Coupling,
    own: ChainLimits,
    limits: ChainLimits,
    k: int,
    where: str | Path | None,
) -> None:
    """Take from the limits of a joint's variable, in place, what the joint itself does not allow."""
    v, row = int(coupling.variable[k]), coupling.coefficients[k]
    low, high = float(limits.lower[v]), float(limits.upper[v])
    follower, leader = (model.joint(joints[j]).name for j in (k, coupling.own[v]))
    if np.isfinite(own.lower[k]) or np.isfinite(own.upper[k]):
        ways = preimage(row, low, high, float(own.lower[k]), float(own.upper[k]))
        if len(ways) != 1:
            what = "at no value" if not ways else f"in {len(ways)} ranges apart"
            raise ModelError(
                f"joint {follower!r} follows {leader!r}, and keeps its limits [{own.lower[k]:g}, {own.upper[k]:g}] "
                f"{what} of that joint's",
                where=where,
                remedy="limits of both that leave one range",
            )
        low, high = limits.lower[v], limits.upper[v] = ways[0]
    if not np.isfinite(high - low) and np.any(row[2:]):
        return
    ends = (low, high) if np.isfinite(high - low) else (0.0, 0.0)
    slopes, bends = (value_range(_derived(row, order), *ends) for order in (1, 2))
    steepest, most_bent = (max(map(abs, pair)) for pair in (slopes, bends))
    if steepest > 0:
        limits.velocity[v] = min(limits.velocity[v], own.velocity[k] / steepest)
        share = 0.5 if most_bent > 0 else 1.0
        limits.acceleration[v] = min(limits.acceleration[v], share * own.acceleration[k] / steepest)
        if most_bent == 0:
            limits.effort[v] = min(limits.effort[v], own.effort[k] * steepest)
    if most_bent > 0:
        limits.velocity[v] = min(limits.velocity[v], np.sqrt(0.5 * own.acceleration[k] / most_bent))


def _derived(row: Array, order: int) -> Array:
    return np.atleast_1d(Polynomial(row).deriv(order).coef)
