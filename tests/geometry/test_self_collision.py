"""Which of a robot's own spheres are checked against each other, and which are left out with reason."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tests.ik.arms import beads, planar, random_arm
from workcell.errors import InputError
from workcell.geometry.engine import ClearanceEngine
from workcell.geometry.self_collision import self_collision_pairs
from workcell.geometry.types import SphereCover


def at_origins(robot, radius):
    """A sphere at the origin of each moving link."""
    n = robot.dof
    return SphereCover(np.arange(1, n + 1), np.zeros((n, 3)), np.full(n, radius))


def rows(pairs):
    return {tuple(row) for row in pairs.tolist()}


def test_a_pair_that_its_limits_keep_apart_is_proved():
    # Origins of links 1 and 3 are |0.5 + 0.4 exp(i q_2)| apart, 0.2593 m at the least for |q_2| <= 2.6.
    robot = planar((0.5, 0.4, 0.3), limit=2.6)
    for radius, kept in ((0.125, False), (0.135, True)):
        found = self_collision_pairs(robot, at_origins(robot, radius), samples=20)
        assert rows(found.pairs) == ({(0, 2)} if kept else set())
        assert rows(found.never) == (set() if kept else {(0, 2)})


def test_what_was_not_proved_is_kept_even_if_no_sample_touches():
    robot = planar((0.5, 0.4, 0.3), limit=2.6)
    cover = at_origins(robot, 0.13)  # touching only in the last hundredths before the limit
    found = self_collision_pairs(robot, cover, samples=1)
    assert rows(found.pairs) == {(0, 2)} and not len(found.always)
    assert len(self_collision_pairs(robot, at_origins(robot, 0.05), prove=False)) == 1


def test_pairs_that_always_touch_are_left_out():
    robot = planar((0.5, 0.4, 0.3, 0.2), limit=2.6)
    found = self_collision_pairs(robot, at_origins(robot, 0.5))
    assert (0, 2) in rows(found.always) and (0, 2) not in rows(found.pairs)
    listed = [rows(getattr(found, name)) for name in ("pairs", "always", "tolerated", "never")]
    assert set.union(*listed) == {(0, 2), (0, 3), (1, 3)} and sum(map(len, listed)) == 3


def test_pairs_that_touch_where_the_robot_is_free_are_tolerated():
    robot = planar((0.5, 0.4, 0.3), limit=2.6)
    cover = at_origins(robot, 0.2)
    folded = [0.0, 2.5, 0.0]
    assert rows(self_collision_pairs(robot, cover).pairs) == {(0, 2)}
    found = self_collision_pairs(robot, cover, known_free=folded)
    assert rows(found.tolerated) == {(0, 2)} and not len(found)
    later = self_collision_pairs(robot, cover).tolerating(robot, cover, [[0.0, 0.0, 0.0], folded])
    assert rows(later.tolerated) == {(0, 2)} and not len(later)


def test_adjacent_links_and_links_that_the_model_excludes_are_not_looked_at():
    robot = dataclasses.replace(planar((0.5, 0.4, 0.3, 0.2)), parents=np.array([0, 1, 1, 3]))
    every = self_collision_pairs(robot, beads(robot), prove=False)
    assert every.links == ((0, 2), (0, 3), (0, 4), (1, 4), (2, 3), (2, 4))
    some = self_collision_pairs(robot, beads(robot), links=[(4, 2), (1, 2)], prove=False)
    assert some.links == ((2, 4),)
    links = np.sort(beads(robot).link[some.pairs], axis=1)
    assert np.array_equal(np.unique(links, axis=0), [[2, 4]])
    held = self_collision_pairs(robot, beads(robot), links=[(4, 2), (1, 2)], carried=[3], prove=False)
    assert (rows(held.pairs) | rows(held.always)) - rows(some.pairs) == {(0, 3), (1, 3)}


@pytest.mark.parametrize("sliding", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_proved_pairs_never_touch(seed, sliding):
    rng = np.random.default_rng(seed)
    robot = dataclasses.replace(random_arm(rng, 6, sliding), parents=np.array([0, 1, 2, 2, 4, 5]))
    cover = beads(robot, 0.08)
    found = self_collision_pairs(robot, cover, samples=50)
    assert len(found.never) > 0 and len(found) > 0
    engine = ClearanceEngine(robot, cover, (), found.never)
    q = robot.random_configuration(rng, 20_000)
    ends = rng.uniform(size=q.shape)
    q = np.where(ends < 0.2, robot.lower, np.where(ends > 0.8, robot.upper, q))
    assert engine.self_clearances(q).min() > 0
    again = self_collision_pairs(robot, cover, samples=50)
    assert np.array_equal(again.pairs, found.pairs) and np.array_equal(again.never, found.never)


def test_what_touches_in_mujoco_touches_among_the_spheres():
    import mujoco

    from workcell.geometry.covers.outer import robot_cover
    from workcell.model.collision_model import CollisionModel
    from workcell.model.scene import Scene

    scene = Scene.load("shelf", robot="ur10")
    actor, model = scene.robot(), scene.model
    links = CollisionModel(scene).self_links
    cover = robot_cover(model, actor, overshoot=0.03)
    robot = actor.robot
    engine = ClearanceEngine(robot, cover, (), self_collision_pairs(robot, cover, links=links))
    link_of = {body: k for k, bodies in enumerate(actor.link_body_ids) for body in bodies if k > 0}
    data, hits = mujoco.MjData(model), 0
    for q in robot.random_configuration(np.random.default_rng(0), 300):
        data.qpos[:] = scene.initial_qpos()
        data.qpos[actor.qpos_addresses] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        bodies = [model.geom_bodyid[contact.geom] for contact in data.contact if contact.dist < 0]
        touching = [sorted(link_of.get(int(body), -1) for body in pair) for pair in bodies]
        own = [(a, b) for a, b in touching if 0 < a < b - 1]
        assert all(pair in links for pair in own)
        if own:
            hits += 1
            assert engine.clearance(q) < 0
    assert hits > 20


def test_bad_input_is_named():
    robot = planar((0.5, 0.4, 0.3))
    cover = at_origins(robot, 0.1)
    for links in ([(0, 9)], [(1, 1)], [(1, 2, 3)]):
        with pytest.raises(InputError, match="links"):
            self_collision_pairs(robot, cover, links=links)
    with pytest.raises(InputError, match="samples"):
        self_collision_pairs(robot, cover, samples=0)
    with pytest.raises(InputError, match="known_free"):
        self_collision_pairs(robot, cover, known_free=[np.nan, 0, 0])
    nobody = SphereCover(np.zeros(0, dtype=int), np.zeros((0, 3)), np.zeros(0))
    assert len(self_collision_pairs(robot, nobody)) == 0
