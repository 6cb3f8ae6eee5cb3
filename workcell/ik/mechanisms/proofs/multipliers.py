"""The numbers of a certificate about a mechanism: what each tie, limit and goal is multiplied by."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from workcell.ik.claims.form import Shape
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.pose import Array


@dataclass(frozen=True, slots=True)
class Multipliers:
    """All that is multiplied; n joints, c ties, g goals, r rows of regions one after the other, n + 1 links.

    Attributes:
        axes: (n, 3) of the axes that neighbouring links share; of hinges.
        limits: (n, 3) of the cones that hold the hinges' limits.
        chords: (n,) of half-spaces that hold the limits of hinges next to a link whose rotation is known; not below 0.
        turns: (n, 3, 3) of the cones that hold rotations near those in the middle of their range; of hinges and balls.
        steps: (n, 3, 3) of the cones that hold balls near the reference.
        closures: (c, 3) of places that coincide. welds: (c, 3, 3) of rotations that do.
        positions: (g, 3), rotations: (g, 3, 3), directions: (g, 3) of the goals.
        cones: (g,) of directions within an angle; not below 0.
        regions: (r,) of the rows; not below 0 but where they are equalities.
        links: (n + 1,) of the bounds on how far links (floating bodies among them) are turned from the reference; not
            below 0.
    """

    axes: Array
    limits: Array
    chords: Array
    turns: Array
    steps: Array
    closures: Array
    welds: Array
    positions: Array
    rotations: Array
    directions: Array
    cones: Array
    regions: Array
    links: Array

    @staticmethod
    def none(problem: MechanismProblem) -> Multipliers:
        """All zero."""
        return Multipliers(**{name: np.zeros(shape) for name, shape in _sizes(problem).items()})

    @staticmethod
    def of(data: Mapping[str, Array]) -> Multipliers:
        """From a certificate's arrays, which have the right shapes."""
        return Multipliers(**{field.name: np.asarray(data[field.name]) for field in fields(Multipliers)})

    def parts(self) -> dict[str, Array]:
        """The arrays by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def shifted(self, exponent: int) -> Multipliers:
        """All numbers times a power of two."""
        return Multipliers(**{name: np.ldexp(part, exponent) for name, part in self.parts().items()})

    def scaled(self) -> Multipliers | None:
        """The same proof times a power of two, its largest number near one; None if all numbers are zero."""
        largest = max(float(np.abs(part).max(initial=0.0)) for part in self.parts().values())
        return self.shifted(-math.frexp(largest)[1]) if largest > 0.0 else None

    def length(self) -> float:
        """Euclidean length of all that is multiplied."""
        return math.sqrt(math.fsum(float(np.sum(part * part)) for part in self.parts().values()))


def _sizes(problem: MechanismProblem) -> dict[str, tuple[int, ...]]:
    n, c, g = len(problem.mechanism.joints), len(problem.mechanism.closures), len(problem.goals)
    return {
        "axes": (n, 3),
        "limits": (n, 3),
        "chords": (n,),
        "turns": (n, 3, 3),
        "steps": (n, 3, 3),
        "closures": (c, 3),
        "welds": (c, 3, 3),
        "positions": (g, 3),
        "rotations": (g, 3, 3),
        "directions": (g, 3),
        "cones": (g,),
        "regions": (sum(len(region.b) for region in problem.regions),),
        "links": (n + 1,),
    }


def shapes(problem: MechanismProblem) -> dict[str, Shape]:
    """Of the arrays of a certificate: the multipliers, the tolerances that are covered, and how nodes hang."""
    return {**_sizes(problem), "tolerances": (4,), "hangs": (len(problem.mechanism.joints) + 1,)}


def misplaced(problem: MechanismProblem, m: Multipliers) -> str | None:
    """Why a multiplier stands where there is nothing to multiply, or has the wrong sign; None if all are in place."""
    joints, goals = problem.mechanism.joints, problem.goals
    hinges = np.array([joint.kind == "hinge" for joint in joints], dtype=bool)
    loose = np.array([goal.direction is not None and goal.within > 0.0 for goal in goals], dtype=bool)
    exact = np.array([goal.direction is not None and not goal.within > 0.0 for goal in goals], dtype=bool)
    held = np.full(len(joints) + 1, problem.max_link_rotation is not None)
    stepping = np.array(
        [problem.max_step is not None and joint.kind == "ball" for joint in joints], dtype=bool
    )
    if problem.max_step is not None:
        held[1:] |= [joint.kind == "free" for joint in joints]
    places: list[tuple[str, NDArray[np.bool_]]] = [
        ("axes", hinges),
        ("limits", hinges),
        ("chords", hinges),
        ("turns", np.array([joint.kind in ("hinge", "ball") for joint in joints], dtype=bool)),
        ("steps", stepping),
        ("welds", np.array([closure.kind == "weld" for closure in problem.mechanism.closures], dtype=bool)),
        ("positions", np.array([goal.position is not None for goal in goals], dtype=bool)),
        ("rotations", np.array([goal.rotation is not None for goal in goals], dtype=bool)),
        ("directions", exact),
        ("cones", loose),
        ("links", held),
    ]
    for name, place in places:
        if bool(np.any(getattr(m, name)[~place] != 0.0)):
            return f"a number of {name!r} multiplies nothing"
    equal = np.concatenate([np.zeros(0, dtype=bool), *(region.equal for region in problem.regions)])
    for name in ("chords", "cones", "links"):
        if not bool(np.all(getattr(m, name) >= 0.0)):
            return f"a multiplier of an inequality is negative: {name!r}"
    if not bool(np.all(m.regions[~equal] >= 0.0)):
        return "a multiplier of an inequality is negative: 'regions'"
    return None
