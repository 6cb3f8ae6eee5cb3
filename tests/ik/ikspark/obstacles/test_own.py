"""The robot's own spheres are kept apart by rows that hold what they say, and of which no proof is made."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tests.ik.arms import beads, box, distant_pairs, gap_of_pairs
from tests.ik.lifted_arms import seven_axis
from workcell.ik.ikspark.instance import instance_of
from workcell.ik.ikspark.obstacles.own import OwnSpheres, own_pairs
from workcell.ik.ikspark.search import Search
from workcell.ik.ikspark.solver import solve_ikspark
from workcell.ik.judge.verify import verify
from workcell.ik.problem import Budget, Clearance, IKProblem
from workcell.pose import Array, Pose

BUDGET = Budget(20.0, effort=1.0)


def folded(count: int, radius: float = 0.12, seed: int = 1) -> Iterator[tuple[IKProblem, Array]]:
    """Poses of an arm with thick links that some configuration reaches without hitting itself."""
    robot, rng = seven_axis(), np.random.default_rng(seed)
    cover = beads(robot, radius)
    pairs = distant_pairs(cover)
    while count:
        q = robot.random_configuration(rng)
        problem = IKProblem(robot, robot.fk(q), cover=cover, self_collision=pairs)
        if verify(problem, q).accepted:
            count -= 1
            yield problem, q


def entangled(count: int) -> list[tuple[IKProblem, Array, int]]:
    """Those whose first answer hits itself: the problem, that configuration and the seed."""
    found = []
    for seed, (problem, _) in enumerate(folded(400)):
        first = solve_ikspark(replace(problem, self_collision=None), BUDGET, seed)
        if first.q is not None and first.stats["restarts"] == 1 and gap_of_pairs(problem, first.q) < 0.0:
            found.append((problem, first.q, seed))
        if len(found) == count:
            return found
    raise AssertionError("too few of them")


def between(problem: IKProblem, q: Array) -> Array:
    """(p,) metres between the centres of each pair at q (n,)."""
    assert problem.cover is not None and problem.self_collision is not None
    at = problem.cover.centres_world(problem.robot.link_transforms(q))
    one, two = problem.self_collision.T
    distances: Array = np.linalg.norm(at[one] - at[two], axis=1)
    return distances


def test_where_the_first_answer_hits_itself_another_is_found_by_rows() -> None:
    spent = {True: 0.0, False: 0.0}
    for problem, _, seed in entangled(8):
        for apart in spent:
            candidate = solve_ikspark(problem, BUDGET, seed, apart=apart)
            assert candidate.q is not None and verify(problem, candidate.q).accepted
            assert bool(candidate.stats["own_rows"]) == apart
            again = solve_ikspark(problem, BUDGET, seed, apart=apart)
            assert np.array_equal(candidate.q, again.q)
            spent[apart] += candidate.stats["sdps"]
    assert spent[True] < 1.2 * spent[False]


def test_rows_cut_off_their_point_and_say_how_far_centres_are_apart() -> None:
    for problem, q, seed in entangled(3):
        cover = problem.cover
        assert cover is not None and problem.self_collision is not None
        with instance_of(problem) as instance:
            own, lift = OwnSpheres(Search(problem, BUDGET, seed, local=False), instance), instance.lift
            x = lift.lift(q)
            assert own.cut(x) and len(own.rows) == 1
            assert own.rows[0] @ np.append(x, 1.0) < 0.0
            first = own.rows[0]
            assert own.turn() and not np.allclose(own.rows[0], first)
            assert own.rows[0] @ np.append(x, 1.0) < 0.0
            one, two = problem.self_collision.T
            needed = cover.radius[one] + cover.radius[two]
            met = np.argmin(between(problem, q) - needed)
            for other in (
                solve_ikspark(replace(problem, self_collision=None), BUDGET, k).q for k in range(8)
            ):
                assert other is not None
                gap = between(problem, other)[met] - needed[met]
                for row in (first, own.rows[0]):
                    # where a row holds, the pair that it is about is apart
                    assert row @ np.append(lift.lift(other), 1.0) < gap
            ahead = own.pushed(np.ones(lift.size))
            assert own.rows[0, :-1] @ ahead > own.rows[0, :-1] @ np.ones(lift.size)
            own.restart()
            assert not len(own.rows) and not own.turn()
            assert np.array_equal(own.pushed(np.ones(lift.size)), np.ones(lift.size))


def test_a_configuration_that_is_clear_breaks_no_row() -> None:
    problem, q = next(folded(1))
    with instance_of(problem) as instance:
        own = OwnSpheres(Search(problem, BUDGET, 0, local=False), instance)
        assert not own.cut(instance.lift.lift(q))
        hits = OwnSpheres(Search(problem, BUDGET, 0, local=False), instance, asked=False)
        assert not hits.cut(instance.lift.lift(np.zeros(7)))


def test_steps_keep_each_pair_on_the_side_where_it_is() -> None:
    problem, q, seed = entangled(1)[0]
    step = replace(problem, q_reference=q, max_step=0.5)
    with instance_of(step) as instance:
        own, x = OwnSpheres(Search(step, BUDGET, seed, local=False), instance), instance.lift.lift(q)
        assert own.cut(x) and not own.turn()
        # along the line between the centres a row is as much short as the spheres overlap
        assert abs(own.rows[0] @ np.append(x, 1.0) - gap_of_pairs(problem, q)) < 2e-4


def test_among_obstacles_both_are_kept() -> None:
    rows = 0.0
    for seed, (problem, q) in enumerate(folded(60, 0.1, seed=3)):
        rng = np.random.default_rng(seed)
        places = rng.uniform([-0.8, -0.8, -0.3], [0.8, 0.8, 1.3], (5, 3))
        boxes = tuple(box(f"box{i}", tuple(place), (0.08, 0.1, 0.12)) for i, place in enumerate(places))
        cell = replace(problem, obstacles=boxes)
        if not verify(cell, q).accepted:
            continue
        for cuboids in (True, False):
            candidate = solve_ikspark(cell, BUDGET, seed, cuboids=cuboids)
            assert candidate.certificate is None
            if candidate.q is not None:
                assert verify(cell, candidate.q).accepted
            rows += candidate.stats["own_rows"]
        if rows > 3.0:
            return
    raise AssertionError("no configuration among obstacles ever hit itself")


def test_no_proof_is_made_of_such_rows() -> None:
    # spheres so large that every configuration hits itself: that is no proof that the pose can't be reached
    problem, _ = next(folded(1))
    assert problem.cover is not None
    swollen = replace(problem, cover=replace(problem.cover, radius=np.full(len(problem.cover), 0.6)))
    candidate = solve_ikspark(swollen, Budget(20.0, effort=0.2), 0)
    assert candidate.stats["own_rows"] > 0 and candidate.q is None
    assert candidate.certificate is None and candidate.error is None
    far = replace(swollen, target=Pose.from_xyz([3.0, 0.0, 0.5]))
    proved = solve_ikspark(far, BUDGET, 0)
    assert proved.certificate is not None and proved.stats["own_rows"] == 0


class Model:
    """A checker that accepts one configuration and knows pairs of spheres."""

    def __init__(self, free: Array) -> None:
        self.free, self.asked = free, []

    def __call__(self, q: Array) -> Clearance:
        return Clearance(1.0 if np.allclose(q, self.free) else -1.0)

    def self_pairs(self, robot, cover, known_free):
        self.asked.append(known_free)
        return np.array([[0, 3]])


def test_pairs_are_the_problems_or_the_checkers() -> None:
    problem, q = next(folded(1))
    assert own_pairs(problem) is problem.self_collision
    bare = replace(problem, self_collision=None)
    assert not len(own_pairs(bare))
    assert not len(own_pairs(replace(bare, checker=lambda q: Clearance(1.0))))
    model = Model(q)
    assert own_pairs(replace(bare, checker=model)).tolist() == [[0, 3]] and model.asked == [None]
    near = replace(bare, checker=model, q_reference=q)
    assert own_pairs(near).tolist() == [[0, 3]]
    assert np.array_equal(model.asked[1], q[None])


def test_a_pair_that_does_not_move_is_left_to_the_judge() -> None:
    problem, q = next(folded(1))
    cover = problem.cover
    assert cover is not None
    standing = replace(cover, link=np.zeros(len(cover), dtype=np.int64))
    fixed = replace(problem, cover=standing, self_collision=np.array([[0, 1]]))
    with instance_of(fixed) as instance:
        own = OwnSpheres(Search(fixed, BUDGET, 0, local=False), instance)
        assert not own.cut(instance.lift.lift(q))
