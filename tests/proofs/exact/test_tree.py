"""Trees of joint boxes: arms whose solutions are known in closed form, and trees that lie."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.proofs.exact.documents import DOWN, about_z, planar, problem, tree
from tests.proofs.exact.planting import planted
from workcell.proofs.exact.reading import RefusedError
from workcell.proofs.exact.tree import walk
from workcell.proofs.exact.tree.fixed import ONE, TRIG_ERROR, cos_sin, root_down, root_up
from workcell.proofs.exact.verdicts import check

BALL = {"spheres": [{"centre": [0.0, 0.45, 0.0], "radius": 0.1}]}


@given(st.lists(st.integers(-100 * ONE, 100 * ONE), min_size=1, max_size=50))
def test_cosines_of_whole_numbers_are_as_near_as_they_say(angles):
    cosine, sine = cos_sin(np.array(angles))
    for k, angle in enumerate(angles):
        assert abs(cosine[k] - math.cos(angle / ONE) * ONE) <= TRIG_ERROR
        assert abs(sine[k] - math.sin(angle / ONE) * ONE) <= TRIG_ERROR


@given(st.lists(st.integers(0, 2**62), min_size=1, max_size=50))
def test_roots_of_whole_numbers_are_on_their_side(squares):
    numbers = np.array(squares)
    above, below = root_up(numbers), root_down(numbers)
    for k, square in enumerate(squares):
        assert below[k] == math.isqrt(square)
        assert int(above[k]) ** 2 >= square > (int(above[k]) - 1) ** 2 or square == above[k] == 0


def test_one_joint(tmp_path):
    robot = planar((0.5,), limit=1.0)
    for angle, reachable in ((0.9, True), (1.0, True), (1.002, False), (1.2, False), (-2.0, False)):
        target = (0.5 * math.cos(angle), 0.5 * math.sin(angle), 0.0)
        asked = problem(tmp_path, robot, target, about_z(angle))
        if reachable:
            with pytest.raises(RefusedError, match="not excluded"):
                check(asked, tree(asked))
        else:
            check(asked, tree(asked))


@pytest.mark.parametrize("elbow", [1, -1])
def test_two_joints_with_one_of_two_elbows_outside_the_limits(tmp_path, elbow):
    """The target's angle fixes the elbow: the other one has another angle."""
    first, second = 0.4 * elbow, 0.9 * elbow
    target = (
        0.5 * math.cos(first) + 0.4 * math.cos(first + second),
        0.5 * math.sin(first) + 0.4 * math.sin(first + second),
        0.0,
    )
    for limit, reachable in ((0.91, True), (0.89, False)):
        asked = problem(tmp_path, planar((0.5, 0.4), limit=limit), target, about_z(first + second))
        if reachable:
            with pytest.raises(RefusedError, match="not excluded"):
                check(asked, tree(asked))
        else:
            check(asked, tree(asked))


def test_three_joints_reach_two_ways_and_a_ball_blocks_one(tmp_path):
    robot = planar((0.5, 0.4, 0.2), limit=2.5, spheres=[(1, 0.45, 0.0, 0.0, 0.04)])
    # wrist at (0.4, 0.5): the elbow is at (0, 0.5), its sphere inside the ball, or at its mirror image, q_1 = 0.2213
    asked = problem(tmp_path, robot, (0.6, 0.5, 0.0), DOWN, BALL)
    both = tree(asked, (0.0, -1.0, -2.0), (0.8,), [(0, 0)])
    with pytest.raises(RefusedError, match="not excluded"):
        check(asked, both)
    robot["joints"][0]["lower"] = 0.23
    asked = problem(tmp_path, robot, (0.6, 0.5, 0.0), DOWN, BALL)
    check(asked, tree(asked, (0.0, -1.0, -2.0), (0.8,), [(0, 0)]))
    check(asked, tree(asked, (-2.0,), (), [(0, 0)]))
    with pytest.raises(RefusedError, match="not excluded"):
        check(asked, tree(asked, (0.0, -1.0, -1.0), (0.8,)))
    clear = {
        "spheres": [
            {"centre": [0.0, 0.45, 0.0], "radius": 1e-9},
            {"centre": [0.2, 0.45, 0.0], "radius": 0.15},
        ]
    }
    asked = problem(tmp_path, robot, (0.6, 0.5, 0.0), DOWN, clear)
    with pytest.raises(RefusedError, match="not excluded"):
        check(asked, tree(asked, (-2.0,), (), [(0, 1)]))


@pytest.mark.parametrize(
    "obstacles",
    [
        {"boxes": [{"centre": [0.3, 0.3, 0.1], "half": [0.1, 0.1, 0.12], "quat": about_z(0.3)}]},
        {"cylinders": [{"centre": [0.3, 0.3, 0], "quat": [1, 0.1, 0, 0], "radius": 0.1, "half_length": 0.2}]},
        {"boxes": [{"centre": [0.3, 0.3, -1000.0], "half": [900.0, 900.0, 1000.0]}]},
    ],
)
def test_every_sort_of_obstacle(tmp_path, obstacles):
    robot = planar((0.5, 0.4), limit=2.0, spheres=[(2, 0.0, 0.0, 0.0, 0.05)])
    first = math.pi / 4
    target = (0.5 * math.cos(first) + 0.4 * math.cos(1.5), 0.5 * math.sin(first) + 0.4 * math.sin(1.5), 0.0)
    blocked = problem(tmp_path, robot, target, about_z(1.5), obstacles)
    check(blocked, tree(blocked, (-2.0,), (), [(0, 0)]))
    for sort in obstacles.values():
        sort[0]["centre"][2] -= 0.31
    clear = problem(tmp_path, robot, target, about_z(1.5), obstacles)
    with pytest.raises(RefusedError, match="not excluded"):
        check(clear, tree(clear, (-2.0,), (), [(0, 0)]))


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**9), st.integers(1, 6))
def test_no_planted_configuration_is_proved_away(tmp_path_factory, seed, n):
    """Arms of any shape with a target that one of their configurations reaches: no tree is accepted."""
    rng = np.random.default_rng(seed)
    asked, q = planted(tmp_path_factory.mktemp("planted"), rng, n)
    nodes, splits = random_tree(asked, rng)
    with pytest.MonkeyPatch.context() as patch, pytest.raises(RefusedError):
        patch.setattr(walk, "PIECES_BEYOND", 1000)
        patch.setattr(walk, "PIECES_A_LEAF", 50)
        check(asked, tree(asked, nodes, splits))
    assert len(q) == n


def random_tree(asked, rng, inner=6):
    """Nodes in pre-order with splits anywhere in the root."""
    nodes, splits, waiting = [], [], 1
    while waiting:
        if inner and rng.uniform() < 0.7:
            k = int(rng.integers(len(asked.arm.joints)))
            nodes.append(float(k))
            splits.append(rng.uniform(asked.arm.joints[k].lower, asked.arm.joints[k].upper))
            inner, waiting = inner - 1, waiting + 1
        else:
            nodes.append(-1.0)
            waiting -= 1
    return nodes, splits


def test_whole_turns(tmp_path):
    robot = planar((0.5,), limit=10.0)
    asked = problem(tmp_path, robot, (0.6, 0.0, 0.0))
    turn = 2 * math.pi
    check(asked, tree(asked, root=[[1.0], [1.0 + turn]]))
    for root in ([[0.0], [6.28]], [[-10.0], [-4.0]], [[-9.9], [-9.9 + 6.2831853]], [[-200.0], [200.0]]):
        with pytest.raises(RefusedError, match="root"):
            check(asked, tree(asked, root=root))


@pytest.mark.parametrize(
    "changes",
    [
        {"nodes": (-3.0,)},
        {"nodes": (-4.0,)},
        {"nodes": (-1.0, -1.0)},
        {"nodes": (-1.0, 0.0, -1.0), "splits": (0.0,)},
        {"nodes": (0.0, 0.0, -1.0), "splits": (0.0,)},
        {"nodes": (0.0, -1.0, -1.0)},
        {"nodes": (1.0, -1.0, -1.0), "splits": (0.0,)},
        {"nodes": (0.5, -1.0, -1.0), "splits": (0.0,)},
        {"nodes": (1e50, -1.0, -1.0), "splits": (0.0,)},
        {"nodes": (0.0, -1.0, -1.0), "splits": (4.0,)},
        {"nodes": (0.0, -1.0, -1.0), "splits": (1e40,)},
        {"nodes": (-2.0,)},
        {"nodes": (-1.0,), "named": [(0, 0)]},
        {"nodes": (-2.0,), "named": [(1, 0)]},
        {"nodes": (-2.0,), "named": [(0, 1)]},
        {"nodes": (-2.0,), "named": [(0, -1)]},
        {"nodes": (-2.0,), "named": [(0, 0)], "clearance": 2e-5},
        {"nodes": (-2.0,), "named": [(0, 0)], "clearance": -1e-9},
        {"inflation": [1e-5, 1e-3]},
        {"inflation": [2.0, 1e-3]},
        {"seal": [0.0] * 7},
        {"tree": {"shape": [0], "values": []}},
    ],
)
def test_arrays_that_break_a_rule_are_refused(tmp_path, changes):
    robot = planar((0.5,), spheres=[(1, 0.4, 0.0, 0.0, 0.05)])
    asked = problem(tmp_path, robot, (0.6, 0.0, 0.0), DOWN, BALL)
    check(asked, tree(asked))
    with pytest.raises(RefusedError):
        check(asked, tree(asked, **changes))


def test_what_is_said_of_a_tree_is_compared(tmp_path):
    asked = problem(tmp_path, planar((0.5,)), (0.6, 0.0, 0.0))
    good = tree(asked)
    check(asked, good)
    for change in ({"margin": 1.001e-4}, {"scope": "geometry"}, {"statement": good["statement"].upper()}):
        with pytest.raises(RefusedError):
            check(asked, good | change)
