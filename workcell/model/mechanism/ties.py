"""What ties the joints of a compiled model: connects, welds, couplings and fixed tendons."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import Polynomial

from workcell.errors import ModelError
from workcell.model.loading.couplings import Leaders, leaders, locked_values
from workcell.model.loops.closing import TOLERANCE
from workcell.model.loops.elements import Element, loop_elements, tendon_limits
from workcell.model.mechanism.closures import closure_of
from workcell.model.mechanism.mechanism import Closure, Follower, JointSum
from workcell.model.mechanism.walking import Walk, joint_label
from workcell.pose import Array

if TYPE_CHECKING:
    import mujoco

_SAME = 1e-12
"""Metres (radians) by which two constraints may differ that say the same."""


class Ties:
    """The ties of a mechanism.

    Args:
        model: compiled model.
        walk: its joints.
        index: places in the mechanism of the joints that move, by id.
        start: (nq,) raw positions of what does not.
        where: the file, for messages.

    Attributes:
        closures, followers, sums: each said once.
        notes: of constraints that say what others say already, in words.

    Raises:
        ModelError: a constraint that can't be looked at, or can't be kept whatever the joints do.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        walk: Walk,
        index: Mapping[int, int],
        start: Array,
        where: str | Path | None,
    ) -> None:
        self._model, self._walk, self._index, self._start, self._where = model, walk, index, start, where
        self.closures: list[Closure] = []
        self.sums: list[JointSum] = []
        self.followers: list[Follower] = []
        self.notes: list[str] = []
        for element in loop_elements(model):
            if element.unsupported:
                raise ModelError(f"{element.name}: {element.unsupported} are not supported", where=where)
            if element.points is not None:
                self._closure(element)
            else:
                assert element.multiples is not None
                self._sum(
                    element.name, element.joints, element.multiples, element.total, element.total, element.id
                )
        for limit in tendon_limits(model):
            if limit.multiples is None:
                raise ModelError(
                    f"the limits of {limit.name}: only those of fixed tendons are supported", where=where
                )
            self._sum(limit.name, limit.joints, limit.multiples, limit.lower, limit.upper, -1)
        self._follow()

    def _closure(self, element: Element) -> None:
        closure = closure_of(element, self._walk.link_of_body, self._walk.T_link_body)
        if closure.links[0] == closure.links[1]:
            self._rigid(element, closure)
            return
        for known in self.closures:
            if known.kind == closure.kind and _same_closure(known, closure):
                self.notes.append(f"{closure.name} says what {known.name} says already")
                return
        self.closures.append(closure)

    def _rigid(self, element: Element, closure: Closure) -> None:
        """A constraint between two bodies of one link: it holds, or it never does."""
        one, two = closure.frames
        away, turned = one.error_to(two)
        if closure.kind == "connect":
            turned = 0.0
        if not element.joints and not (away <= TOLERANCE and turned <= TOLERANCE):
            raise ModelError(
                f"{element.name} is a loop that can't close: no joint is between its two bodies, "
                f"and they are {1e3 * away:.3g} mm and {turned:.3g} rad apart",
                where=self._where,
                remedy="let a joint move one of them, or leave the constraint out",
            )
        if not element.joints:
            self.notes.append(f"{element.name} ties bodies that no joint moves against each other")

    def _sum(
        self,
        name: str,
        joints: Sequence[int],
        multiples: Array,
        lower: float,
        upper: float,
        equality: int,
    ) -> None:
        """Joints that stay where they begin go over into the numbers."""
        kept, factors, fixed = [], [], 0.0
        for joint, multiple in zip(joints, multiples, strict=True):
            if joint in self._index:
                kept.append(self._index[joint])
                factors.append(float(multiple))
            else:
                fixed += float(multiple) * float(self._start[self._model.jnt_qposadr[joint]])
        if not kept:
            return
        if not lower <= upper:
            raise ModelError(
                f"the limits of {name} are [{lower:g}, {upper:g}]",
                where=self._where,
                remedy="the lower limit, then the upper one",
            )
        found = JointSum(name, tuple(kept), np.array(factors), lower - fixed, upper - fixed, equality)
        for known in self.sums:
            if self._again(known, found):
                return
        self.sums.append(found)

    def _again(self, known: JointSum, found: JointSum) -> bool:
        """Whether a sum says what another says already; raises ModelError where no joint values keep both."""
        if known.joints != found.joints:
            return False
        ratio = float(found.multiples[0] / known.multiples[0]) if known.multiples[0] else 0.0
        if not ratio or np.abs(found.multiples - ratio * known.multiples).max() > _SAME:
            return False
        low, high = sorted((ratio * known.lower, ratio * known.upper))
        if max(low, found.lower) > min(high, found.upper) + TOLERANCE:
            raise ModelError(
                f"{known.name} and {found.name} contradict each other: "
                f"a sum is to be in [{low:g}, {high:g}] and in [{found.lower:g}, {found.upper:g}]",
                where=self._where,
            )
        if found.lower - _SAME <= low and high <= found.upper + _SAME:
            self.notes.append(f"{found.name} says what {known.name} says already")
            return True
        return False

    def _follow(self) -> None:
        model, index = self._model, self._index
        held, follows = locked_values(model), leaders(model)
        for joint, known in follows.items():
            for leader, polynomial in known:
                names = joint_label(model, joint), joint_label(model, leader)
                name = f"{names[0]} follows {names[1]}"
                if joint in held and leader in held:
                    self._both_held(name, held[joint], float(polynomial(held[leader])))
                elif joint in index and leader in index:
                    row = np.array(polynomial.trim(0.0).coef, dtype=float)
                    self.followers.append(Follower(name, index[joint], index[leader], row))
                elif joint in index:
                    value = float(polynomial(float(self._start[model.jnt_qposadr[leader]])))
                    self.followers.append(Follower(name, index[joint], -1, np.array([value])))
                elif leader in index:
                    self._led(name, joint, leader, polynomial)
        self._contradictions(follows)

    def _both_held(self, name: str, value: float, wanted: float) -> None:
        if abs(value - wanted) > TOLERANCE:
            raise ModelError(
                f"{name}, and is held at {value:g} where that asks for {wanted:g}", where=self._where
            )

    def _led(self, name: str, joint: int, leader: int, polynomial: Polynomial) -> None:
        """A joint that stays where it begins, and says where the one is that it follows."""
        value = float(self._start[self._model.jnt_qposadr[joint]])
        row = polynomial.trim(0.0).coef
        if len(row) != 2:
            raise ModelError(
                f"{name}, and stays where it begins",
                where=self._where,
                remedy="let both of them move, or neither",
            )
        self.followers.append(
            Follower(name, self._index[leader], -1, np.array([(value - float(row[0])) / float(row[1])]))
        )

    def _contradictions(self, follows: Leaders) -> None:
        """Raise ModelError for two couplings of one joint with one leader that differ by a number."""
        for joint, known in follows.items():
            for leader, polynomial in known:
                for other, row in known:
                    apart = (polynomial - row).coef if other == leader else np.zeros(1)
                    if abs(apart[0]) > _SAME and not np.any(np.abs(apart[1:]) > _SAME):
                        raise ModelError(
                            f"two couplings of joint {joint_label(self._model, joint)!r} with "
                            f"{joint_label(self._model, leader)!r} contradict each other: "
                            f"they differ by {abs(apart[0]):g}",
                            where=self._where,
                        )


def _same_closure(one: Closure, two: Closure) -> bool:
    """Whether two closures of one kind tie the same places of the same links."""
    if sorted(one.links) != sorted(two.links):
        return False
    if one.links != two.links:
        two = replace(two, links=two.links[::-1], frames=two.frames[::-1])
    if one.kind == "connect":
        return all(
            np.abs(a.position - b.position).max() <= _SAME
            for a, b in zip(one.frames, two.frames, strict=True)
        )
    (F, G), (H, K) = one.frames, two.frames
    away, turned = (F @ G.inverse()).error_to(H @ K.inverse())
    return away <= _SAME and turned <= _SAME
