"""All that moves in a scene, as one mechanism: who drives it, whether its loops close, what they leave free."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from workcell.errors import ModelError
from workcell.ik.mechanisms.polish import polish_mechanism
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.sampling import random_configuration, reach_of
from workcell.inspection.findings import Finding, beware, fact, wrong
from workcell.model.mechanism.following import CLOSED, close
from workcell.model.mechanism.from_model import mechanism_of
from workcell.model.mechanism.measuring import Tie, measure_of
from workcell.model.mechanism.mechanism import WORLD, JointKind, Mechanism
from workcell.model.mechanism.placing import missed, moved, place
from workcell.model.mechanism.redundancy import redundant_ties
from workcell.pose import Array

if TYPE_CHECKING:
    from workcell.model.scene import Scene

_TRIED = 20
"""Random configurations from which loops are tried to be closed that don't at the start."""
_NUDGE = 0.1
"""Radians and metres by which a configuration is moved, to look at ties in general position."""
_RANK = 1e-8
_WORDS: Mapping[JointKind, str] = {"hinge": "hinge", "slide": "slide", "ball": "ball", "free": "floating"}


def scene_mechanism_of(scene: Scene) -> Mechanism | ModelError | None:
    """What moves in a scene; why it can't be looked at as a mechanism; None where nothing moves."""
    if scene.mechanism is not None:
        return scene.mechanism.mechanism
    if not scene.model.njnt:
        return None
    try:
        return mechanism_of(scene.model, qpos=scene.initial_qpos(), name=scene.name, where=scene.path)
    except ModelError as error:
        return None if error.message.startswith("nothing moves here") else error


def moved_bodies(mechanism: Mechanism) -> frozenset[int]:
    """Ids of the bodies that its joints move."""
    assert mechanism.compiled is not None
    return frozenset(np.flatnonzero(mechanism.compiled.link_of_body != WORLD).tolist())


def driven_joints(mechanism: Mechanism) -> tuple[int, ...]:
    """Indices of the joints that actuators move, followers left out."""
    following = {follower.joint for follower in mechanism.followers}
    return tuple(k for k, joint in enumerate(mechanism.joints) if joint.driven and k not in following)


def mechanism_findings(
    mechanism: Mechanism | ModelError, *, serial: bool, told: bool = False
) -> Iterator[Finding]:
    """What there is to say of it.

    Args:
        mechanism: of a compiled model, or why there is none.
        serial: whether the scene has robots, which are answered without it where they are driven joints alone.
        told: whether its ball joints and floating bodies are told already.
    """
    if isinstance(mechanism, ModelError):
        said = beware if serial else wrong
        yield said("mechanism", f"it can't be asked as one mechanism: {mechanism.message}")
        return
    if serial and not (mechanism.closures or mechanism.sums):
        yield _summary(mechanism)
        return
    if not told:
        yield from _joints(mechanism)
    yield _summary(mechanism)
    for note in mechanism.notes:
        yield beware("tie", note)
    yield from _ties(mechanism)


def _summary(mechanism: Mechanism) -> Finding:
    kinds = [joint.kind for joint in mechanism.joints]
    listed = ", ".join(f"{kinds.count(kind)} {word}" for kind, word in _WORDS.items() if kind in kinds)
    driven, following = len(driven_joints(mechanism)), len({one.joint for one in mechanism.followers})
    passive = len(kinds) - driven - following
    return fact(
        "mechanism",
        f"as a mechanism: {len(kinds)} joints ({listed}); {driven} driven, {following} following, {passive} passive",
        joints=len(kinds), kinds={kind: kinds.count(kind) for kind in _WORDS}, driven=driven,
        following=following, passive=passive, ties=len(mechanism.closures),
    )  # fmt: skip


def _joints(mechanism: Mechanism) -> Iterator[Finding]:
    """Ball joints and floating bodies: the others are told one by one already."""
    for joint in mechanism.joints:
        if joint.kind == "ball":
            limit = f"turns by {joint.upper:.4f} rad at most" if np.isfinite(joint.upper) else "turns freely"
            yield fact("joint", f"{joint.name}: ball joint, {limit}; passive", joint=joint.name, kind="ball")
        elif joint.kind == "free":
            yield fact(
                "joint", f"{joint.name}: a floating body, which ties hold", joint=joint.name, kind="floating"
            )


def _ties(mechanism: Mechanism) -> Iterator[Finding]:
    measure = measure_of(mechanism)
    if not (mechanism.closures or mechanism.followers or mechanism.sums):
        yield from _overlap(mechanism, mechanism.home)
        return
    q, worst = _closed(mechanism)
    begin = max(measure.ties(mechanism.home), key=lambda tie: tie.worst, default=Tie("", 0.0))
    if q is None:
        at_best = max(measure.ties(worst), key=lambda tie: tie.worst)
        yield wrong(
            "tie",
            f"the ties could not be closed, neither from where the model is assembled nor from {_TRIED} random "
            f"configurations: {at_best.name} is missed by {1e3 * at_best.worst:.3g} mm (mrad)",
            tie=at_best.name, missed=at_best.worst,
        )  # fmt: skip
        return
    if begin.worst <= CLOSED:
        yield fact(
            "tie",
            f"ties hold at the start: missed by {begin.worst:.1e} m (rad) at most, by MuJoCo's measure",
            missed=begin.worst,
        )
    else:
        yield beware(
            "tie",
            f"at the start {begin.name} is missed by {1e3 * begin.worst:.3g} mm (mrad), by MuJoCo's measure; a "
            "configuration that keeps all ties was found",
            tie=begin.name, missed=begin.worst,
        )  # fmt: skip
    yield from _freedom(mechanism, q)
    yield from _overlap(mechanism, q)


def _closed(mechanism: Mechanism) -> tuple[Array | None, Array]:
    """A configuration at which ties hold, near the start if there is one there; else the one that misses least."""
    found = close(mechanism, mechanism.home)
    if found.is_closed:
        return found.q, found.q
    rng, reach = np.random.default_rng(0), reach_of(mechanism)
    problem, best, least = MechanismProblem(mechanism, collisions=False), found.q, np.inf
    for trial in range(_TRIED + 1):
        begin = mechanism.home if trial == 0 else random_configuration(mechanism, rng, reach=reach)
        polished = polish_mechanism(problem, begin)
        if polished.worst <= CLOSED:
            return polished.q, polished.q
        if polished.worst < least:
            best, least = polished.q, polished.worst
    return None, best


def _freedom(mechanism: Mechanism, q: Array) -> Iterator[Finding]:
    """How many degrees of freedom ties leave, and which ties say nothing new, in general position near `q`."""
    nudge = np.random.default_rng(0).uniform(-_NUDGE, _NUDGE, mechanism.dof)
    nearby = polish_mechanism(MechanismProblem(mechanism, collisions=False), moved(mechanism, q, nudge))
    at = nearby.q if nearby.worst <= CLOSED else q
    held = [
        np.eye(mechanism.dof)[rate.start]
        for joint, rate in zip(mechanism.joints, mechanism.rate_slices, strict=True)
        if joint.lower == joint.upper and joint.kind in ("hinge", "slide")
    ]
    rows = np.vstack([missed(place(mechanism, at))[1], *held])
    taken = int(np.linalg.matrix_rank(rows, tol=_RANK))
    left, driven = mechanism.dof - taken, len(driven_joints(mechanism))
    yield fact(
        "mechanism",
        f"{left} degrees of freedom are left of {mechanism.dof}; {driven} joints are driven",
        dof=mechanism.dof, left=left, rows=len(rows), rank=taken,
    )  # fmt: skip
    if again := redundant_ties(mechanism, at):
        yield beware(
            "tie",
            f"say nothing that other ties don't say already: {', '.join(again)}",
            redundant=list(again),
        )


def _overlap(mechanism: Mechanism, q: Array) -> Iterator[Finding]:
    measure = measure_of(mechanism)
    if not len(measure.pairs):
        yield beware(
            "geometry", "no geometry of it can collide with anything: nothing is checked for collisions"
        )
        return
    found = measure.distance(q)
    if found.distance < 0.0:
        one, two = found.pair
        yield beware(
            "touching",
            f"as the mechanism begins, {one} is {-1e3 * found.distance:.3g} mm inside {two}",
            geoms=[one, two],
        )
