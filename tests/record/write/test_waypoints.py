"""At which answered configuration a robot is: on straight stretches, there and back, and not beside them."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from workcell.pose import Array
from workcell.record.write.waypoints import OFF_WAY, Waypoint, Waypoints


def way(*points: Array) -> list[Waypoint]:
    """Steps along points; the first point is where the robot stands, which nobody asked for."""
    return [
        Waypoint("way", "ikspark", np.array(q), np.array(p), None, None)
        for p, q in itertools.pairwise(points)
    ]


def chained(*waypoints: Waypoint) -> Waypoints:
    found = Waypoints()
    for waypoint in waypoints:
        found.add(waypoint)
    return found


A, B, C = (np.array(point) for point in ([0.0, 0.0, 0.0], [0.2, 0.1, 0.0], [0.2, 0.1, 0.3]))


def test_the_nearer_end_of_the_stretch_counts() -> None:
    first, second = way(A, B, C)
    known = chained(first, second)
    share = np.linspace(0.0, 1.0, 21)[:, None]
    there = known.along(A + share * (B - A))
    assert all(found is first for found in there), (
        "nobody asked for the start: the step from it is the only one"
    )
    on = known.along(B + share * (C - B))
    assert [found is second for found in on] == [bool(s > 0.49) for s in share[:, 0]]
    back = known.along(C + share * (B - C))
    assert [found is first for found in back] == [bool(s > 0.51) for s in share[:, 0]]


def test_a_way_followed_outwards_from_its_goal_is_known_inwards() -> None:
    goal = Waypoint("goal", "ikspark", C, C, None, None)
    out = way(C, B, A)
    known = chained(goal, *out)
    at = known.along(np.array([A, 0.6 * B, 0.4 * B + 0.6 * C, C]))
    assert [found is waypoint for found, waypoint in zip(at, (out[1], out[0], goal, goal), strict=True)] == [
        True
    ] * 4


def test_beside_the_ways_there_is_none() -> None:
    known = chained(*way(A, B, C))
    aside = np.array(
        [0.5 * B + [0, 0, 2 * OFF_WAY], 0.5 * B + [0, 0, 0.5 * OFF_WAY], C + np.array([0.05, 0, 0]), C]
    )
    assert [found is None for found in known.along(aside)] == [True, False, True, False]
    assert Waypoints().along(aside) == [None] * 4


INWARDS = np.concatenate(
    [A + np.linspace(0, 1, 31)[:, None] * (B - A), B + np.linspace(0, 1, 31)[1:, None] * (C - B)]
)


@pytest.mark.parametrize("planned", ["inwards", "outwards from the goal"])
def test_in_and_back_out_the_same_way_the_second_way_is_the_one_back(planned: str) -> None:
    """Planned apart, with something else in the hand: a motion that turns round is on the way that begins there."""
    goal = Waypoint("goal", "ikspark", C, C, None, None)
    into, back = way(A, B, C) if planned == "inwards" else [goal, *way(C, B, A)], way(C, B, A)
    known = chained(*into, *back)
    assert all(any(found is waypoint for waypoint in into) for found in known.along(INWARDS))
    assert all(any(found is waypoint for waypoint in into) for found in known.along(np.array([C] * 20)))
    outwards = known.along(INWARDS[::-1])
    assert all(any(found is waypoint for waypoint in back) for found in outwards[17:])
    assert outwards[-1] is back[-1]


def test_what_nobody_asked_for_again_is_the_same_way_back() -> None:
    into = way(A, B, C)
    known = chained(*into)
    there, back = known.along(INWARDS), known.along(INWARDS[::-1])
    assert [id(found) for found in there] == [id(found) for found in back[::-1]]
