"""The paper's optimisers: one frame's objective minimised by NLopt, for comparison (section 5.6 of RelaxedIK).

The extra is `workcell[live]`. Of the paper's constraints the velocity limits are bounds of the joints.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Literal, Protocol

import numpy as np

from workcell.errors import InputError, UnknownNameError
from workcell.pose import Array

OPTIMISERS: Mapping[str, str] = MappingProxyType(
    {
        "slsqp": "LD_SLSQP",
        "mma": "LD_MMA",
        "ccsaq": "LD_CCSAQ",
        "cobyla": "LN_COBYLA",
        "bobyqa": "LN_BOBYQA",
    }
)
"""NLopt's name of each; those that begin with LD ask for gradients."""
Gradient = Literal["analytic", "differences"]
CLOSE = 1e-7
"""Relative change of the objective, and radians of the joints, below which a search ends."""
MOST = 500
"""Values of the objective that a search asks for."""
_APART = 1e-6
"""Radians between the two values of a central difference, halved."""


class FrameObjective(Protocol):
    """What one frame minimises over configurations (n,)."""

    def value(self, q: Array) -> float:
        """At q (n,)."""

    def value_and_gradient(self, q: Array) -> tuple[float, Array]:
        """At q (n,), with the gradient (n,)."""

    def bounds(self) -> tuple[Array, Array]:
        """(n,) and (n,): where the frame's configurations are."""


class Minimiser:
    """One of NLopt's optimisers, for objectives of n joints.

    Args:
        name: one of `OPTIMISERS`.
        dof: n.
        gradient: the objective's own, or by central differences; those without gradients take none.
        most: values of the objective that a search may ask for.

    Raises:
        UnknownNameError: no such optimiser. InputError: NLopt is not installed.
    """

    def __init__(self, name: str, dof: int, *, gradient: Gradient = "analytic", most: int = MOST) -> None:
        if name not in OPTIMISERS:
            raise UnknownNameError("optimiser", name, OPTIMISERS, where="optimiser")
        nlopt = _nlopt()
        self._search = nlopt.opt(getattr(nlopt, OPTIMISERS[name]), dof)
        self._search.set_min_objective(self._asked)
        self._search.set_ftol_rel(CLOSE)
        self._search.set_xtol_abs(CLOSE)
        self._search.set_maxeval(most)
        self._stuck = (nlopt.RoundoffLimited, nlopt.ForcedStop, RuntimeError)
        self._differences = gradient == "differences"
        self._objective: FrameObjective | None = None
        self._best, self._best_value = np.zeros(dof), np.inf
        self.evaluations = 0

    def __call__(self, objective: FrameObjective, q: Array) -> Array:
        """The best configuration (n,) that was seen from q (n,) on; never worse than q within the bounds."""
        lower, upper = objective.bounds()
        begin = np.clip(q, lower, upper)
        self._objective, self.evaluations = objective, 0
        self._best, self._best_value = begin.copy(), objective.value(begin)
        self._search.set_lower_bounds(lower)
        self._search.set_upper_bounds(upper)
        # gradient-free searches begin with steps of this size
        self._search.set_initial_step(np.maximum(0.25 * (upper - lower), 1e-9))
        try:
            self._search.optimize(begin)
        except self._stuck:
            pass  # what is best was kept
        finally:
            self._objective = None
        return self._best

    def _asked(self, q: Array, gradient: Array) -> float:
        assert self._objective is not None
        self.evaluations += 1
        if gradient.size == 0:
            value = self._objective.value(q)
        elif self._differences:
            value = self._objective.value(q)
            gradient[:] = self._by_differences(q)
        else:
            value, gradient[:] = self._objective.value_and_gradient(q)
        if value < self._best_value:
            self._best_value = value
            self._best[:] = q
        return float(value)

    def _by_differences(self, q: Array) -> Array:
        assert self._objective is not None
        ask, rates = self._objective.value, np.empty(len(q))
        for k in range(len(q)):
            aside = np.zeros(len(q))
            aside[k] = _APART
            rates[k] = (ask(q + aside) - ask(q - aside)) / (2.0 * _APART)
        return rates


def installed() -> bool:
    """Whether the extra is there."""
    return importlib.util.find_spec("nlopt") is not None


def _nlopt() -> Any:
    try:
        import nlopt
    except ImportError:
        raise InputError(
            "NLopt is not installed", where="optimiser", remedy="pip install 'workcell[live]'"
        ) from None
    return nlopt
