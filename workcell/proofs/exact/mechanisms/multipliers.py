"""The arrays of a certificate about a mechanism, each number in its place and of the right sign (12.4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from workcell.proofs.exact.certificates import Array, Certificate
from workcell.proofs.exact.mechanisms.question import Question
from workcell.proofs.exact.reading import RefusedError
from workcell.proofs.exact.spans import Span, length, span
from workcell.proofs.exact.vectors import Matrix, Vector, vector


@dataclass(frozen=True, slots=True)
class Multipliers:
    """All arrays as spans; `hangs` as they stand in the file."""

    axes: list[Vector]
    limits: list[Vector]
    turns: list[Matrix]
    steps: list[Matrix]
    chords: list[Span]
    closures: list[Vector]
    welds: list[Matrix]
    positions: list[Vector]
    rotations: list[Matrix]
    directions: list[Vector]
    cones: list[Span]
    regions: list[Span]
    links: list[Span]
    tolerances: tuple[float, ...]
    hangs: tuple[float, ...]
    size: Span


def read_multipliers(question: Question, certificate: Certificate) -> Multipliers:
    """A certificate's arrays.

    Raises:
        RefusedError: one breaks a rule of 12.4.
    """
    n, c, g = len(question.joints), len(question.ties), len(question.goals)
    shapes = {
        "axes": (n, 3), "limits": (n, 3), "turns": (n, 3, 3), "steps": (n, 3, 3), "chords": (n,),
        "closures": (c, 3), "welds": (c, 3, 3), "positions": (g, 3), "rotations": (g, 3, 3),
        "directions": (g, 3), "cones": (g,), "regions": (question.rows,), "links": (n + 1,),
        "tolerances": (4,), "hangs": (n + 1,),
    }  # fmt: skip
    found = dict(zip(shapes, certificate.arrays(**shapes), strict=True))
    for name, places in _places(question).items():
        _in_place(name, found[name], places)
    for name in ("chords", "cones", "links"):
        if min((*found[name].values, 0.0)) < 0:
            raise RefusedError(f"a multiplier of {name!r} is below zero")
    equal = [one for region in question.regions for one in region.equal]
    if any(value < 0 and not one for value, one in zip(found["regions"].values, equal, strict=True)):
        raise RefusedError("a multiplier of 'regions' is below zero")
    given = found["tolerances"].values
    if not all(asked <= value <= 1.0 for value, asked in zip(given, question.tolerances, strict=True)):
        raise RefusedError("the tolerances are narrower than asked for, or wider than one")
    names = [name for name in shapes if name not in ("tolerances", "hangs")]
    size = length(span(value) for name in names for value in found[name].values)
    if not size.surely_positive:
        raise RefusedError("all multipliers are zero")
    vectors = {
        name: [vector(row) for row in found[name].rows()] for name in names if _sides(found[name]) == 2
    }
    matrices = {name: _matrices(found[name]) for name in names if _sides(found[name]) == 3}
    numbers = {name: [span(v) for v in found[name].values] for name in names if _sides(found[name]) == 1}
    return Multipliers(
        vectors["axes"], vectors["limits"], matrices["turns"], matrices["steps"], numbers["chords"],
        vectors["closures"], matrices["welds"], vectors["positions"], matrices["rotations"],
        vectors["directions"], numbers["cones"], numbers["regions"], numbers["links"],
        given, found["hangs"].values, size,
    )  # fmt: skip


def _sides(array: Array) -> int:
    return len(array.shape)


def _matrices(array: Array) -> list[Matrix]:
    found: list[Matrix] = []
    for i in range(array.shape[0]):
        rows = [vector(array.values[9 * i + 3 * r : 9 * i + 3 * r + 3]) for r in range(3)]
        found.append((rows[0], rows[1], rows[2]))
    return found


def _places(question: Question) -> dict[str, list[bool]]:
    """Where the entries of an array multiply something."""
    joints, goals = question.joints, question.goals
    hinges = [joint.kind == "hinge" for joint in joints]
    stepping = question.steps is not None
    held = [question.link_rotation is not None] * (len(joints) + 1)
    for k, joint in enumerate(joints, 1):
        held[k] = held[k] or (stepping and joint.kind == "free")
    return {
        "axes": hinges,
        "limits": hinges,
        "chords": hinges,
        "turns": [joint.kind in ("hinge", "ball") for joint in joints],
        "steps": [stepping and joint.kind == "ball" for joint in joints],
        "welds": [tie.is_weld for tie in question.ties],
        "positions": [goal.position is not None for goal in goals],
        "rotations": [goal.rotation is not None for goal in goals],
        "directions": [goal.direction is not None and goal.within == 0.0 for goal in goals],
        "cones": [goal.direction is not None and goal.within > 0.0 for goal in goals],
        "links": held,
    }


def _in_place(name: str, array: Array, places: Sequence[bool]) -> None:
    width = len(array.values) // max(len(places), 1)
    for i, place in enumerate(places):
        if not place and any(array.values[width * i : width * (i + 1)]):
            raise RefusedError(f"a number of {name!r} multiplies nothing")
