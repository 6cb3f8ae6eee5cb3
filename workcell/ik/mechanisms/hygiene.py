"""Questions that make no sense are refused by name before anything is solved; what is odd but allowed is noted.

Refused: regions that are empty, contacts and goals that no rigid link can keep together, goals on what nothing moves.
Noted: regions without an end, and goals and rows that say nothing new. What is refused is so by more than the
problem's tolerances; that nothing was refused does not mean that there is an answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from scipy.optimize import linprog, nnls

from workcell.errors import InputError
from workcell.ik.mechanisms.consistency import check_goals
from workcell.ik.mechanisms.goals import InRegion
from workcell.ik.mechanisms.known import SAME, Known
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.pose import Array


def check_problem(problem: MechanismProblem) -> tuple[str, ...]:
    """Look at goals and regions; what is odd but allowed, in words.

    Raises:
        InputError: goals, regions or both contradict each other, a region is empty, or a link that nothing moves is
            asked to be elsewhere; named.
    """
    notes, known = check_goals(problem)
    return notes + check_regions(problem, known)


def check_regions(problem: MechanismProblem, known: dict[int, Known] | None = None) -> tuple[str, ...]:
    """Look at the regions, by themselves, together, and with what goals say of their links; see `check_problem`."""
    known = check_goals(problem)[1] if known is None else known
    notes: list[str] = []
    links: dict[int, list[_Placed]] = {}
    for r, region in enumerate(problem.regions):
        frame = problem.mechanism.frame(region.frame)
        name = f"{region.name} {r} of {region.frame!r}"
        outside = 0.0 if _has_a_middle(region) else least_outside([region])
        if outside > problem.tolerances.region:
            raise InputError(f"it is empty: every point is {outside:.3g} m outside", where=name)
        notes += _notes(name, region)
        placed = _Placed(name, region, frame.T_link_frame.apply(region.point))
        links.setdefault(frame.link, []).append(placed)
    for link, regions in links.items():
        facts = known.get(link, Known(problem.mechanism.link_names[link]))
        free = [one for one in regions if not _at_known_place(problem, facts, one, notes)]
        _together(problem, facts, free)
    return tuple(notes)


class _Placed:
    """A region, its name, and where on its link (3,) the point is."""

    def __init__(self, name: str, region: InRegion, local: Array) -> None:
        self.name, self.region, self.local = name, region, local


def least_outside(regions: Sequence[InRegion], apart: Array | None = None) -> float:
    """The least distance (metres) by which points, one for each region, must be outside them; 0: they can be inside.

    Args:
        regions: with unit normals.
        apart: (k, k) how far from each other the points are at most, along each axis; None: anywhere.
    """
    k = len(regions)
    rows, ends = [], []
    for i, region in enumerate(regions):
        for sign, chosen in ((1.0, slice(None)), (-1.0, np.asarray(region.equal, dtype=bool))):
            A = sign * region.A[chosen]
            part = np.zeros((len(A), 3 * k + 1))
            part[:, 3 * i : 3 * i + 3], part[:, -1] = A, -1.0
            rows.append(part)
            ends.append(sign * region.b[chosen])
    for i, j in combinations(range(k), 2) if apart is not None else ():
        assert apart is not None
        for sign in (1.0, -1.0):
            part = np.zeros((3, 3 * k + 1))
            part[:, 3 * i : 3 * i + 3], part[:, 3 * j : 3 * j + 3] = sign * np.eye(3), -sign * np.eye(3)
            rows.append(part)
            ends.append(np.full(3, apart[i, j]))
    cost = np.zeros(3 * k + 1)
    cost[-1] = 1.0
    bounds = [(None, None)] * (3 * k) + [(0.0, None)]
    found = linprog(cost, np.vstack(rows), np.concatenate(ends), bounds=bounds, method="highs")
    return float(found.fun) if found.status == 0 else 0.0


def _has_a_middle(region: InRegion) -> bool:
    """Whether the point closest to all its planes, and on those that it is to be on, is in a region: most often."""
    weight = np.where(region.equal, 1e6, 1.0)
    point = np.linalg.lstsq(region.A * weight[:, None], region.b * weight, rcond=None)[0]
    over = region.A @ point - region.b
    return bool(np.all(np.where(region.equal, np.abs(over), over) < SAME))


def is_bounded(region: InRegion) -> bool:
    """Whether a region that is not empty has an end in every direction."""
    if np.linalg.matrix_rank(region.A) < 3:
        return False
    rows = np.vstack([region.A, -region.A[np.asarray(region.equal, dtype=bool)]])
    # bounded just when positive multiples of the rows, each at least one, add up to zero (Stiemke)
    _, left = nnls(rows.T, -rows.sum(axis=0))
    return bool(left < SAME * len(rows))


def _notes(name: str, region: InRegion) -> list[str]:
    """A region without an end, where it is more than planes, and rows that others make needless."""
    notes = []
    if not np.all(region.equal) and not is_bounded(region):
        notes.append(f"{name}: it has no end in some direction")
    for i, j in combinations(range(len(region.b)), 2):
        if np.linalg.norm(region.A[i] - region.A[j]) < SAME:
            both = bool(region.equal[i] and region.equal[j])
            looser = j if both or region.b[j] >= region.b[i] else i
            if both or not region.equal[looser]:
                notes.append(f"{name}: row {looser} says nothing new")
    return notes


def _at_known_place(problem: MechanismProblem, facts: Known, placed: _Placed, notes: list[str]) -> bool:
    """Whether goals, or that nothing moves it, say where a region's point is; refused where it is outside."""
    found = facts.world(placed.local)
    if found is None:
        return False
    tolerances, region = problem.tolerances, placed.region
    slack = tolerances.region + facts.metres(found[1], tolerances)
    over = region.A @ found[0] - region.b
    outside = float(np.max(np.where(region.equal, np.abs(over), over)))
    if outside > slack:
        raise InputError(
            f"its point is {outside:.3g} m outside, by what is known of link {facts.name!r}: {found[2]}",
            where=placed.name,
            remedy="a region and goals that hold together",
        )
    notes.append(f"{placed.name}: it says nothing new of link {facts.name!r}: {found[2]}")
    return True


def _together(problem: MechanismProblem, facts: Known, regions: list[_Placed]) -> None:
    """Regions of one link's points, which are as far from each other as they are on the link."""
    tolerances = problem.tolerances
    every = list(regions)
    for at, place_of, by in facts.points if regions else ():
        box = InRegion(
            by,
            np.vstack([np.eye(3), -np.eye(3)]),
            np.concatenate([place_of, -place_of]) + tolerances.position,
            np.zeros(3),
            np.zeros(6, dtype=bool),
        )
        every.append(_Placed(by, box, at))
    if len(every) < 2 or _outside(every) <= tolerances.region:
        return
    pairs = (pair for pair in combinations(every, 2) if _outside(pair) > tolerances.region)
    group = next(pairs, tuple(every))
    first, *others = [one.name for one in group]
    raise InputError(
        f"it contradicts {' and '.join(others)}: points of link {facts.name!r} would be "
        f"{_outside(group):.3g} m outside{_parallel(group)}",
        where=first,
        remedy="regions that one rigid link can be in together",
    )


def _outside(group: Sequence[_Placed]) -> float:
    local = np.array([one.local for one in group])
    apart = np.linalg.norm(local[:, None] - local[None], axis=-1)
    return least_outside([one.region for one in group], apart)


def _parallel(group: Sequence[_Placed]) -> str:
    """What there is to add of two planes for one point that are parallel."""
    if len(group) != 2 or np.linalg.norm(group[0].local - group[1].local) > SAME:
        return ""
    one, two = (placed.region for placed in group)
    for i in np.flatnonzero(one.equal):
        for j in np.flatnonzero(two.equal):
            if np.linalg.norm(np.cross(one.A[i], two.A[j])) < SAME:
                gap = abs(float(one.b[i] - np.sign(one.A[i] @ two.A[j]) * two.b[j]))
                return f": its planes are parallel, {gap:.6g} m apart"
    return ""
