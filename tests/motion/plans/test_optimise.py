"""Optimised paths: as short as known geometry allows, never longer with more means, proved all along."""

from itertools import pairwise

import numpy as np
import pytest

from tests.ik import arms
from workcell.errors import InputError
from workcell.geometry.types import Piece, SphereCover
from workcell.ik.problem import Budget, IKProblem
from workcell.motion.body import BodyClearance, Upright, pack_body
from workcell.motion.plans.compiled import Effort, search
from workcell.motion.plans.optimise import optimise, path_length
from workcell.motion.plans.to_pose import plan_to_pose
from workcell.motion.proofs.judge import judge_path
from workcell.pose import Pose

START, GOAL = np.array([-1.0, 0.0]), np.array([1.0, 0.0])
RADIUS = 0.05


def samples(count, **options):
    """An effort that only samples end, so that nothing else decides the result."""
    return Effort(optimise_s=np.inf, optimise_iterations=count, **options)


@pytest.fixture(scope="module")
def gantry():
    """A point of 5 cm in the plane: two sliding joints."""
    return arms.gantry(RADIUS)


def square(x=0.0, y=0.0, half=0.3):
    return Piece("square", "box", Pose.from_xyz([x, y, 0.0]), [half, half, 1.0])


def around(x, corner_x, corner_y):
    """The shortest way of a ball from (-x, 0) to (x, 0) over two corners: tangents, arcs about them, and the top."""
    reach = np.hypot(x - corner_x, corner_y)
    tangent = np.sqrt(reach**2 - RADIUS**2)
    turn = np.arctan2(corner_y, x - corner_x) + np.arcsin(RADIUS / reach)
    return 2 * (tangent + RADIUS * turn) + 2 * corner_x


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_around_a_square_it_comes_ever_nearer_to_the_shortest_way(gantry, seed):
    body = pack_body(*gantry, (square(),))
    shortest = around(1.0, 0.3, 0.3)
    found = search(body, START, [GOAL], Effort(shortcuts=0, pulls=0), seed=seed)
    excess = []
    for count in (0, 100, 1000, 10000):
        better = optimise(body, START, [GOAL], found.path, found.goal, samples(count), seed)
        excess.append(path_length(better.paths[-1]) / shortest - 1)
    assert better.lower_bound == 2.0
    assert excess == sorted(excess, reverse=True) and excess[-1] >= -1e-12
    assert excess[1] < 0.02 and excess[2] < 0.01 and excess[3] < 0.003


def test_it_leaves_the_wrong_side(gantry):
    """The path given goes round the far side of a square that is off the line; no shortcut leads to the other."""
    body = pack_body(*gantry, (square(y=0.2, half=0.45),))
    far = np.array([START, [-0.6, 0.8], [0.6, 0.8], GOAL])
    better = optimise(body, START, [GOAL], far, 0, samples(4000), seed=1)
    assert better.paths[0][1, 1] > 0 > better.paths[-1][1, 1]
    shortest = around(1.0, 0.45, 0.25)
    assert shortest <= path_length(better.paths[-1]) < 1.005 * shortest


def test_the_nearer_of_two_goals_is_found(gantry):
    body = pack_body(*gantry, (square(),))
    goals = np.array([GOAL, [-1.0, 0.5]])
    found = search(body, START, goals[:1], seed=0)
    better = optimise(body, START, goals, found.path, 0, samples(500))
    assert better.goals[-1] == 1 and path_length(better.paths[-1]) == pytest.approx(0.5)
    assert better.lower_bound == pytest.approx(0.5) and better.iterations < 500


def pillars(arm7):
    """An arm that has to turn past two pillars."""
    link = np.repeat(np.arange(1, 8), 2)
    cover = SphereCover(link, np.tile([[0.03, 0, 0], [0.1, 0, 0]], (7, 1)), np.full(14, 0.05))
    places = [[0.45 * np.cos(a), 0.45 * np.sin(a), 0.0] for a in (0.8, 1.6)]
    pieces = tuple(
        Piece(f"pillar {k}", "cylinder", Pose.from_xyz(xyz), [0.06, 2.0]) for k, xyz in enumerate(places)
    )
    start = np.array([0.0, -0.6, 0.0, 0.9, 0.0, 0.5, 0.0])
    goal = start + np.array([2.4, 0, 0, 0, 0, 0, 0])
    return cover, pieces, start, goal


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_length_never_rises_with_samples_and_every_path_is_clear(arm7, seed):
    cover, pieces, start, goal = pillars(arm7)
    body = pack_body(arm7, cover, pieces, floor=1e-4)
    found = search(body, start, [goal], seed=seed)
    last: tuple = ()
    for count in (0, 50, 400, 1500):
        better = optimise(body, start, [goal], found.path, found.goal, samples(count), seed)
        lengths = [path_length(path) for path in better.paths]
        assert lengths == sorted(lengths, reverse=True) and lengths[-1] >= better.lower_bound - 1e-12
        # more samples go on where fewer ended
        assert all(np.array_equal(a, b) for a, b in zip(last, better.paths, strict=False))
        assert len(better.paths) >= len(last)
        last = better.paths
    assert path_length(last[-1]) < path_length(found.path)
    clearance = BodyClearance(body, cover, pieces)
    for path in last:
        dense = [a + np.linspace(0, 1, 300)[:, None] * (b - a) for a, b in pairwise(path)]
        assert clearance.many(np.concatenate(dense)).min() >= 1e-4 - 1e-12
        assert np.array_equal(path[0], start) and np.array_equal(path[-1], goal)


def test_the_tool_stays_upright_on_shorter_paths_too(arm7):
    cover = pillars(arm7)[0]
    rng = np.random.default_rng(2)
    q = rng.uniform(-3, 3, (20000, 7))
    good = q[arm7.fk_transform(q)[:, 2, 0] > np.cos(0.4)][:6]
    upright = Upright(0.5, tool_axis=(1, 0, 0), direction=(0, 0, 1))
    body = pack_body(arm7, cover, (), upright=upright)
    # a goal that no straight line reaches
    ways = (search(body, good[0], [q], Effort(step=0.5, iterations=20000), seed=0) for q in good[1:])
    found = next(way for way in ways if way.path is not None and way.iterations > 0)
    goal = found.path[-1]
    better = optimise(body, good[0], [goal], found.path, 0, samples(600, step=0.5), seed=0)
    assert path_length(better.paths[-1]) < 0.9 * path_length(found.path)
    dense = [a + np.linspace(0, 1, 200)[:, None] * (b - a) for a, b in pairwise(better.paths[-1])]
    tilt = np.arccos(np.clip(arm7.fk_transform(np.concatenate(dense))[:, 2, 0], -1, 1))
    assert tilt.max() <= 0.5 + 1e-9


def test_paths_to_a_pose_get_shorter_over_many_goals(arm7):
    cover, pieces, start, goal = pillars(arm7)
    problem = IKProblem(arm7, arm7.fk(goal), pieces, cover)
    plain = plan_to_pose(problem, start, budget=Budget(5.0), seed=1)
    better = plan_to_pose(problem, start, budget=Budget(5.0), seed=1, effort=samples(1200))
    assert better.solved and better.proved and judge_path(problem, start, better.path).accepted
    stats = better.stats
    assert stats["first_length"] == plain.stats["length"] == pytest.approx(path_length(plain.path))
    assert stats["lower_bound"] <= stats["length"] < 0.9 * stats["first_length"]
    assert stats["length"] == pytest.approx(path_length(better.path)) and stats["optimise_iterations"] <= 1200
    again = plan_to_pose(problem, start, budget=Budget(5.0), seed=1, effort=samples(1200))
    assert np.array_equal(again.path, better.path)
    assert "lower_bound" not in plain.stats


def test_nonsense_is_refused(gantry):
    body = pack_body(*gantry, ())
    for effort in ({"optimise_s": -1.0}, {"optimise_s": float("nan")}, {"optimise_iterations": -1}):
        with pytest.raises(InputError, match=r"spent|negative"):
            Effort(**effort)
    line = np.stack([START, GOAL])
    for path, goal in ((line[::-1], 0), (line, 1), (line[:, :1], 0), (line[0], 0)):
        with pytest.raises(InputError, match="lead from the start"):
            optimise(body, START, [GOAL], path, goal)
    with pytest.raises(InputError, match="not finite"):
        optimise(body, START * np.nan, [GOAL], line, 0)
