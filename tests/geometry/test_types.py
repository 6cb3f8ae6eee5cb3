"""What covers tell of themselves: spheres less their overshoot."""

import numpy as np

from workcell.geometry.packing import pack_cover
from workcell.geometry.types import SphereCover
from workcell.model.loading.load import load_robot


def cover(overshoot=None):
    return SphereCover(np.array([1, 0, 1]), np.eye(3), [0.1, 0.2, 0.05], "outer", overshoot, ("a", "b", "c"))


def test_spheres_without_overshoot_are_the_same_but_smaller():
    outer = cover([0.02, 0.0, 0.08])  # the last is all overshoot: its centre lies outside
    bare = outer.without_overshoot()
    assert np.array_equal(outer.bare_radius, [0.1 - 0.02, 0.2, 0.0])
    assert np.array_equal(bare.radius[:2], outer.bare_radius[:2]) and 0 < bare.radius[2] < 1e-4
    assert bare.kind == "given" and not np.any(bare.overshoot) and bare.source == outer.source
    assert np.array_equal(bare.centre, outer.centre) and np.array_equal(bare.link, outer.link)


def test_they_are_made_once_and_where_nothing_sticks_out_nothing_is_made():
    outer, tight = cover([0.02, 0.0, 0.08]), cover()
    bare = outer.without_overshoot()
    assert outer.without_overshoot() is bare and bare.without_overshoot() is bare
    assert tight.without_overshoot() is tight


def test_packed_they_are_sorted_by_link_with_what_is_left_of_their_radii():
    robot, outer = load_robot("ur10"), cover([0.02, 0.0, 0.08])
    whole, shrunk = pack_cover(robot, outer)[0], pack_cover(robot, outer, shrunk=True)[0]
    assert np.array_equal(whole[:, 4], [1, 0, 2]) and np.array_equal(whole[:, :3], shrunk[:, :3])
    assert np.array_equal(whole[:, 3], outer.radius[[1, 0, 2]])
    assert np.array_equal(shrunk[:, 3], outer.bare_radius[[1, 0, 2]])
