"""The judge of mechanisms: whether a configuration is an answer. It knows no solver; it awards `SOLVED`.

Where there is a compiled model, poses, ties and collisions are MuJoCo's (`workcell.model.mechanism.measuring`); else
they come from kinematics and distances that solvers don't have.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import ArrayLike

from workcell.errors import InputError
from workcell.identity_cache import ByIdentity
from workcell.ik.judge.exact import rotation_angle
from workcell.ik.mechanisms.clearance import SphereClearance
from workcell.ik.mechanisms.exact import exact_mechanism
from workcell.ik.mechanisms.goals import FrameGoal, InRegion
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.result import NAN, Measured
from workcell.ik.problem import STEP_SLACK, Clearance
from workcell.model.mechanism.measuring import Tie, measure_of, turn_of
from workcell.model.mechanism.mechanism import Mechanism
from workcell.model.robot import LIMIT_SLACK
from workcell.pose import Array

FARTHEST = 1e6
"""Metres and radians beyond which a number of a configuration can only be a mistake."""
User = Callable[[Array], list[str]]


def judge_mechanism(problem: MechanismProblem, q: ArrayLike, user: User | None = None) -> Measured:
    """Judge a configuration (size,); anything that is none is refused with the reason, not raised.

    Args:
        problem: what is asked.
        q: the configuration; quaternions may be off by what a door takes.
        user: says in words which of the problem's own `constraints` a configuration breaks; without it a problem that
            has some has no answer.

    Raises:
        ModelError: the compiled model holds what can't be measured; UnknownNameError: geoms that may touch are unknown.
    """
    judge: MechanismJudge = _judges.get((problem,), lambda: MechanismJudge(problem))
    return judge(q, user)


class MechanismJudge:
    """Judges any number of configurations for one problem; raises as `judge_mechanism`."""

    def __init__(self, problem: MechanismProblem) -> None:
        self.problem, self.mechanism = problem, problem.mechanism
        self._exact = exact_mechanism(self.mechanism)
        compiled = self.mechanism.compiled is not None
        self._measure = measure_of(self.mechanism, tuple(problem.touching)) if compiled else None
        self._spheres = SphereClearance(problem)
        named = [goal.frame for goal in problem.goals] + [region.frame for region in problem.regions]
        self._frames = tuple(dict.fromkeys(named))
        if problem.q_reference is not None:
            self._before = self._exact.links(problem.q_reference)[0]

    def __call__(self, q: ArrayLike, user: User | None = None) -> Measured:
        """Judge one configuration (size,)."""
        try:
            values = self.mechanism.configuration(np.asarray(q, dtype=float))
        except (TypeError, ValueError):
            return _refused("the configuration is not a list of numbers")
        except InputError as error:
            return _refused(error.message)
        if not np.abs(values).max() <= FARTHEST:
            return _refused(f"the configuration has numbers beyond {FARTHEST:g} metres and radians")
        places = (self._measure or self._exact).frames(self._frames, values)
        goals = [_goal_error(goal, *places[goal.frame]) for goal in self.problem.goals]
        regions = [_outside(region, *places[region.frame]) for region in self.problem.regions]
        ties = (*self._ties(values), *_followed(self.mechanism, values))
        beyond = self._beyond(values)
        clearance, looked_at = self._clearance(values)
        reasons = (
            *self._goal_reasons(goals),
            *self._region_reasons(regions),
            *self._tie_reasons(ties),
            *[_words_of_limit(*one) for one in beyond],
            *self._clearance_reasons(clearance),
            *self._overlap_reasons(values),
            *self._step_reasons(values),
            *self._user_reasons(values, user),
        )
        return Measured(
            position_error=max((away for away, _ in goals), default=0.0),
            rotation_error=max((turned for _, turned in goals), default=0.0),
            closure_error=max((tie.worst for tie in ties), default=0.0),
            region_error=max(regions, default=0.0),
            limit_error=max((_excess(*one[1:]) for one in beyond), default=0.0),
            clearance=clearance,
            looked_at=looked_at,
            reasons=reasons,
        )

    def _ties(self, q: Array) -> tuple[Tie, ...]:
        if self._measure is not None:
            return self._measure.ties(q)
        R, p = self._exact.links(q)
        found = []
        for closure in self.mechanism.closures:
            ends = [
                (R[link] @ frame.rotation, R[link] @ frame.position + p[link])
                for link, frame in zip(closure.links, closure.frames, strict=True)
            ]
            away = math.dist(ends[0][1].tolist(), ends[1][1].tolist())
            turned = rotation_angle(ends[0][0].T @ ends[1][0]) if closure.kind == "weld" else 0.0
            found.append(Tie(closure.name, away, turned))
        return tuple(found)

    def _beyond(self, q: Array) -> list[tuple[str, float, float, float]]:
        """Joints and sums outside their limits: name, value, lower, upper."""
        found = []
        for joint, at in zip(self.mechanism.joints, self.mechanism.value_slices, strict=True):
            if joint.kind == "free":
                continue
            value = turn_of(q[at]) if joint.kind == "ball" else float(q[at.start])
            found.append((f"joint {joint.name}", value, joint.lower, joint.upper))
        for total in self.mechanism.sums:
            value = _summed(self.mechanism, total.joints, total.multiples, q)
            if total.lower != total.upper:
                found.append((total.name, value, total.lower, total.upper))
        if self._measure is not None:
            known = {name for name, value, low, high in found if _excess(value, low, high) > 0.0}
            for name, value, low, high in self._measure.beyond(q):
                if f"joint {name}" not in known:
                    found.append((f"joint {name} of the compiled model", value, low, high))
        return [one for one in found if not _excess(*one[1:]) <= LIMIT_SLACK]

    def _clearance(self, q: Array) -> tuple[Clearance, int]:
        clearance, looked_at = Clearance(float("inf")), 0
        measured = self._measure is not None and self.problem.collisions
        if self._measure is not None and self.problem.collisions and len(self._measure.pairs):
            looked_at = len(self._measure.pairs)
            found = self._measure.distance(q)
            other = self._measure.contact(q) if found.distance >= 0.0 else None
            found = found if other is None else other
            clearance = Clearance(found.distance, found.pair, found.reason)
        if not self._spheres.looks(foreign_only=measured):
            return clearance, looked_at
        spheres, count = self._spheres(*self._exact.links(q), foreign_only=measured)
        return (spheres if spheres.distance < clearance.distance else clearance), looked_at + count

    def _goal_reasons(self, errors: list[tuple[float, float]]) -> list[str]:
        allowed, reasons = self.problem.tolerances, []
        for goal, (away, turned) in zip(self.problem.goals, errors, strict=True):
            if not away <= allowed.position:
                reasons.append(
                    f"{goal.frame} is {1e3 * away:.3g} mm from its goal (allowed {1e3 * allowed.position:g})"
                )
            if not turned <= allowed.rotation:
                reasons.append(
                    f"{goal.frame} is turned by {turned:.3g} rad from its goal (allowed {allowed.rotation:g})"
                )
        return reasons

    def _region_reasons(self, outside: list[float]) -> list[str]:
        allowed = self.problem.tolerances.region
        return [
            f"a point of {region.frame} is {1e3 * away:.3g} mm outside its {region.name} (allowed {1e3 * allowed:g})"
            for region, away in zip(self.problem.regions, outside, strict=True)
            if not away <= allowed
        ]

    def _tie_reasons(self, ties: tuple[Tie, ...]) -> list[str]:
        allowed = self.problem.tolerances.closure
        return [
            f"{tie.name} is missed by {tie.missed:.3g}"
            + (f", and by {tie.turned:.3g} rad" if tie.turned else "")
            + f" (allowed {allowed:g})"
            for tie in ties
            if not (tie.missed <= allowed and tie.turned <= allowed)
        ]

    def _clearance_reasons(self, clearance: Clearance) -> list[str]:
        margin, distance = self.problem.tolerances.safety_margin, clearance.distance
        if distance >= margin:
            return []
        if np.isnan(distance):
            return ["the clearance is not a number"]
        first, second = clearance.pair
        if distance < 0:
            return [f"{first} is {-1e3 * distance:.3g} mm inside {second}"]
        return [f"{first} is {1e3 * distance:.3g} mm from {second} (wanted {1e3 * margin:g})"]

    def _overlap_reasons(self, q: Array) -> list[str]:
        """What may touch is not to be inside each other."""
        measure, allowed = self._measure, self.problem.tolerances.overlap
        if measure is None or not self.problem.collisions or not len(measure.touching):
            return []
        found = measure.overlap(q)
        if found.distance >= -allowed:
            return []
        first, second = found.pair
        return [
            f"{first}, which may touch {second}, is {-1e3 * found.distance:.3g} mm inside it"
            f" (allowed {1e3 * allowed:g})"
        ]

    def _step_reasons(self, q: Array) -> list[str]:
        problem, reasons = self.problem, []
        if problem.q_reference is None:
            return []
        if problem.max_step is not None:
            moved, most = _moved(self.mechanism, problem.q_reference, q), np.asarray(problem.max_step)
            for joint, rate in zip(self.mechanism.joints, self.mechanism.rate_slices, strict=True):
                over = moved[rate] - most[rate]
                if not np.all(over <= STEP_SLACK):
                    worst = rate.start + int(np.argmax(over))
                    reasons.append(
                        f"joint {joint.name} moves by {moved[worst]:.4g} (allowed {most[worst]:.4g})"
                    )
        most_turn = problem.max_link_rotation
        if most_turn is not None:
            change = np.linalg.norm(self._exact.links(q)[0] - self._before, axis=(1, 2))
            reasons += [
                f"link {self.mechanism.link_names[k]} turns by {change[k]:.4g} (allowed {most_turn:.4g})"
                for k in np.flatnonzero(~(change <= most_turn + STEP_SLACK))
            ]
        return reasons

    def _user_reasons(self, q: Array, user: User | None) -> list[str]:
        if not self.problem.constraints:
            return []
        if user is None:
            return [f"nobody looked at {', '.join(one.name for one in self.problem.constraints)}"]
        return list(user(q))


def _refused(reason: str) -> Measured:
    return Measured(NAN, NAN, NAN, NAN, NAN, Clearance(NAN), 0, (reason,))


def _goal_error(goal: FrameGoal, R: Array, p: Array) -> tuple[float, float]:
    """Metres and radians that a frame has yet to go, as far as its goal asks."""
    away = 0.0 if goal.position is None else math.dist(p.tolist(), goal.position.tolist())
    turned = 0.0 if goal.rotation is None else rotation_angle(goal.rotation.T @ R)
    if goal.axis is not None and goal.direction is not None:
        axis = R @ goal.axis
        angle = math.atan2(
            float(np.linalg.norm(np.cross(axis, goal.direction))), float(axis @ goal.direction)
        )
        turned = max(turned, angle - goal.within)
    return away, turned


def _outside(region: InRegion, R: Array, p: Array) -> float:
    """Metres by which a point is outside its region."""
    over = region.A @ (R @ region.point + p) - region.b
    return float(np.max(np.where(region.equal, np.abs(over), np.maximum(over, 0.0))))


def _followed(mechanism: Mechanism, q: Array) -> list[Tie]:
    """What followers and held sums miss, by their numbers alone."""
    found = []
    for follower in mechanism.followers:
        value = float(q[mechanism.value_slices[follower.joint].start])
        x = 0.0 if follower.leader < 0 else float(q[mechanism.value_slices[follower.leader].start])
        wanted = float(polynomial.polyval(x, follower.coefficients[: 1 if follower.leader < 0 else None]))
        found.append(Tie(follower.name, abs(value - wanted)))
    for total in mechanism.sums:
        if total.lower == total.upper:
            found.append(
                Tie(total.name, abs(_summed(mechanism, total.joints, total.multiples, q) - total.lower))
            )
    return found


def _summed(mechanism: Mechanism, joints: tuple[int, ...], multiples: Array, q: Array) -> float:
    return float(sum(m * q[mechanism.value_slices[k].start] for k, m in zip(joints, multiples, strict=True)))


def _excess(value: float, lower: float, upper: float) -> float:
    return max(lower - value, value - upper, 0.0) if math.isfinite(value) else math.inf


def _words_of_limit(name: str, value: float, lower: float, upper: float) -> str:
    return f"{name} = {value:.6g} is outside [{lower:.6g}, {upper:.6g}]"


def _moved(mechanism: Mechanism, before: Array, q: Array) -> Array:
    """(dof,) how far each number of the tangent moves: of a ball the parts of its turn's rotation vector."""
    moved = np.zeros(mechanism.dof)
    for joint, at, rate in zip(mechanism.joints, mechanism.value_slices, mechanism.rate_slices, strict=True):
        if joint.kind in ("hinge", "slide"):
            moved[rate] = np.abs(q[at] - before[at])
            continue
        if joint.kind == "free":
            moved[rate.start : rate.start + 3] = np.abs(q[at][:3] - before[at][:3])
        w, v = _turn(before[at.stop - 4 : at.stop], q[at.stop - 4 : at.stop])
        length = float(np.linalg.norm(v))
        angle = 2.0 * math.atan2(length, abs(w))
        moved[rate.stop - 3 : rate.stop] = np.abs(v) * (angle / length if length > 0.0 else 0.0)
    return moved


def _turn(one: Array, two: Array) -> tuple[float, Array]:
    """Scalar and vector part of the quaternion that turns one into two, in the frame of one."""
    a, b, u, v = float(one[0]), float(two[0]), one[1:], two[1:]
    return a * b + float(u @ v), a * v - b * u - np.cross(u, v)


_judges = ByIdentity()
