"""Where passive joints are when loops are closed: Newton's method, continuously from the assembly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from workcell.model.loops.elements import Element
from workcell.pose import Array

if TYPE_CHECKING:
    import mujoco

TOLERANCE = 1e-6
"""Metres (radians) by which what a loop demands may be missed in a configuration that counts as closed."""
_STEP = 0.3
"""Radians or metres that the joints of a loop move at most from one solution to the next."""
_HALVINGS = 256
"""How much smaller than the first ones steps may become."""
_ITERATIONS, _CONVERGED = 12, 1e-12
_SAME = 1e-6
"""Radians (metres) by which solutions may differ that are one."""
_DIFFERENCE = 1e-5
"""Radians (metres) of the steps of difference quotients."""
_RANK = 1e-9
"""Singular values below this share of the largest are zero."""


@dataclass(frozen=True, slots=True)
class Closed:
    """Values (k,) of the passive joints, and by how much demands are missed; beyond `TOLERANCE` it is not closed."""

    values: Array
    missed: float


class LoopSystem:
    """The equations of some elements in a compiled model, and their derivatives, at any raw positions.

    Args:
        model: compiled model.
        elements: the constraints.
        passive: ids of the k joints, hinges and slides, that are to be found.
        given: ids of the joints, hinges and slides, that the elements depend on as well.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        elements: Sequence[Element],
        passive: Sequence[int],
        given: Sequence[int],
    ) -> None:
        import mujoco

        self._mujoco, self._model, self.elements = mujoco, model, tuple(elements)
        self._data = mujoco.MjData(model)
        self.passive, self.given = np.array(passive, dtype=int), np.array(given, dtype=int)
        self.passive_qpos = np.asarray(model.jnt_qposadr)[self.passive]
        self.given_qpos = np.asarray(model.jnt_qposadr)[self.given]
        self.passive_dofs, self.given_dofs = (
            np.asarray(model.jnt_dofadr)[joints] for joints in (self.passive, self.given)
        )
        self._columns = np.concatenate([self.passive_dofs, self.given_dofs])
        self._jacobian = np.zeros((3, model.nv))

    def at(self, qpos: Array) -> tuple[Array, Array, Array]:
        """What the demands miss (r,), and its derivatives by the passive (r, k) and the given joints (r, d).

        Args:
            qpos: (nq,) raw positions.
        """
        data = self._data
        data.qpos[:] = qpos
        self._mujoco.mj_kinematics(self._model, data)
        self._mujoco.mj_comPos(self._model, data)
        missed, rows = [], []
        for element in self.elements:
            if element.points is None:
                missed.append(self._sum(element, qpos))
                rows.append(self._of_sum(element))
                continue
            ends, slopes = [], []
            for body, points in zip(element.bodies, element.points, strict=True):
                placed = data.xpos[body] + points @ data.xmat[body].reshape(3, 3).T
                ends.append(placed.ravel())
                slopes.append(np.vstack([self._slope(point, body) for point in placed]))
            missed.append(ends[0] - ends[1])
            rows.append((slopes[0] - slopes[1])[:, self._columns])
        J, k = np.vstack(rows), len(self.passive)
        return np.concatenate(missed), J[:, :k], J[:, k:]

    def _sum(self, element: Element, qpos: Array) -> Array:
        addresses = np.asarray(self._model.jnt_qposadr)[list(element.joints)]
        return np.array([element.multiples @ qpos[addresses] - element.total])

    def _of_sum(self, element: Element) -> Array:
        row = np.zeros(self._model.nv)
        row[np.asarray(self._model.jnt_dofadr)[list(element.joints)]] = element.multiples
        columns: Array = row[None, self._columns]
        return columns

    def _slope(self, point: Array, body: int) -> Array:
        self._mujoco.mj_jac(self._model, self._data, self._jacobian, None, point, body)
        return self._jacobian.copy()

    def close(self, qpos: Array) -> Closed:
        """The passive joints where the loops are closed with all else at `qpos` (nq,), reached from the assembly.

        The given joints go straight from where the model is assembled (`qpos0`) to where they are; the passive ones
        follow. Same positions, same answer.
        """
        begin, here = np.array(self._model.qpos0), np.array(qpos, dtype=float)
        end = here[self.given_qpos]
        for addresses in (self.passive_qpos, self.given_qpos):
            here[addresses] = begin[addresses]
        missed = self._newton(here)
        if missed is not None:
            missed = self._follow(here, end)
        if missed is None:
            here[self.given_qpos] = end
            missed = max(float(np.abs(self.at(here)[0]).max()), 2 * TOLERANCE)
        return Closed(here[self.passive_qpos], missed)

    def follows(self, one: Array, two: Array) -> bool:
        """Whether the passive joints, on the straight line of the given ones, go from raw positions to others."""
        here = np.array(one, dtype=float)
        missed = self._follow(here, two[self.given_qpos])
        aside = np.abs(here[self.passive_qpos] - two[self.passive_qpos]).max(initial=0.0)
        return missed is not None and bool(aside < _SAME)

    def _follow(self, here: Array, end: Array) -> float | None:
        """Move the given joints in `here` to `end`, straight, and the passive ones along; None: that leads nowhere.

        Else what the demands miss there.
        """
        start, missed = here[self.given_qpos], 0.0
        done, step = 0.0, 1.0 / max(1.0, np.ceil(np.abs(end - start).max(initial=0.0) / _STEP))
        shortest = step / _HALVINGS
        while done < 1.0:
            ahead = min(1.0, done + step)
            found = self._step(here, start + ahead * (end - start))
            if found is not None:
                missed, done = found, ahead
            elif step <= shortest:
                return None
            else:
                step *= 0.5
        return missed

    def _step(self, here: Array, target: Array) -> float | None:
        """Follow the given joints to `target`; None, with `here` as before, where that leads nowhere.

        Else what the demands miss there.
        """
        before = here.copy()
        _, by_passive, by_given = self.at(here)
        change = target - here[self.given_qpos]
        tangent = -np.linalg.lstsq(by_passive, by_given @ change, rcond=_RANK)[0]
        here[self.given_qpos] = target
        here[self.passive_qpos] += tangent
        found = self._newton(here)
        aside = np.abs(here[self.passive_qpos] - before[self.passive_qpos] - tangent).max(initial=0.0)
        length = np.abs(np.concatenate([change, tangent])).max(initial=0.0)
        if (
            found is None or length > 2 * _STEP or aside > 0.5 * length
        ):  # far from its tangent: another branch
            here[:] = before
            return None
        return found

    def _newton(self, here: Array) -> float | None:
        """Move the passive joints in `here` to where the demands are kept; None where they don't get there.

        Else what the demands still miss.
        """
        before = np.inf
        for _ in range(_ITERATIONS):
            missed, by_passive, _ = self.at(here)
            worst = float(np.abs(missed).max(initial=0.0))
            if worst < _CONVERGED or (worst < TOLERANCE and worst >= 0.5 * before):
                return worst
            before = worst
            here[self.passive_qpos] -= np.linalg.lstsq(by_passive, missed, rcond=_RANK)[0]
        return None

    def ratios(self, qpos: Array) -> Array:
        """(k, d) how fast passive joints move for each given one, at raw positions with the loop closed."""
        _, by_passive, by_given = self.at(qpos)
        found: Array = np.negative(np.linalg.lstsq(by_passive, by_given, rcond=_RANK)[0])
        return found

    def drift(self, qpos: Array, qvel: Array) -> Array:
        """(k,) accelerations of the passive joints where the given ones go on with the velocities that they have."""
        speed = float(np.abs(qvel[self._columns]).max(initial=0.0))
        if speed == 0.0:
            return np.zeros(len(self.passive))
        step, velocity, changed = _DIFFERENCE / speed, qvel[self._columns], []
        for sign in (1.0, -1.0):
            there = np.array(qpos)
            there[self.passive_qpos] += sign * step * qvel[self.passive_dofs]
            there[self.given_qpos] += sign * step * qvel[self.given_dofs]
            _, by_passive, by_given = self.at(there)
            changed.append(np.hstack([by_passive, by_given]) @ velocity)
        bend = (changed[0] - changed[1]) / (2 * step)
        found: Array = np.negative(np.linalg.lstsq(self.at(qpos)[1], bend, rcond=_RANK)[0])
        return found
