"""Spheres of a mechanism hold its geometry wherever it is, and the right ones must keep apart."""

import mujoco
import numpy as np
import pytest

from tests.model.mechanism.trees import compiled, data_at, random_q
from workcell.errors import InputError, ModelError
from workcell.geometry.covers.mechanisms import apart_pairs, fitted_cover, mechanism_cover, sphere_geoms
from workcell.geometry.pieces import mechanism_pieces
from workcell.model.mechanism.from_model import mechanism_of
from workcell.model.mechanism.measuring import MechanismMeasure
from workcell.model.mechanism.of_robot import of_robot
from workcell.model.mechanism.placing import place
from workcell.model.scene import robot_scene

TEXT = """<mujoco><compiler angle="radian"/><worldbody>
  <geom name="table" type="box" size="1 1 .05" pos="0 0 -1"/>
  <body name="one" pos="0 0 .2"><joint name="a" axis="0 0 1"/><joint name="s" type="slide" axis="1 0 0" range="-1 1"/>
    <geom name="upper" type="box" size=".3 .05 .04" pos=".3 0 0"/>
    <geom name="paint" type="sphere" size=".5" contype="0" conaffinity="0"/>
    <body name="two" pos=".7 0 0"><joint name="b" type="ball"/>
      <geom name="fore" type="capsule" fromto="0 0 0 .4 0 0" size=".05"/>
      <body name="three" pos=".5 0 0"><joint name="c" axis="0 1 0"/>
        <geom name="hand" type="cylinder" size=".06 .1" pos=".1 0 0"/></body></body></body>
  <body name="cup" pos="0 1 0"><freejoint name="f"/><geom name="cup" type="sphere" size=".1"/></body>
  </worldbody></mujoco>"""
NAMES = ["a", "s", "b", "c", "f"]


def mechanism():
    return mechanism_of(compiled(TEXT), moving=NAMES)


def surface(model, geom, rng, count=200):
    """Points of a geom, in its frame."""
    size, kind = model.geom_size[geom], model.geom_type[geom]
    way = rng.normal(size=(count, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return way / np.abs(way).max(axis=1, keepdims=True) * size
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return size[0] * way
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return size[0] * way + np.array([0, 0, 1]) * rng.uniform(-size[1], size[1], (count, 1))
    flat = way * [1, 1, 0]
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    return size[0] * flat + np.array([0, 0, 1]) * rng.choice([-1, 1], (count, 1)) * size[1]


@pytest.mark.parametrize("overshoot", [0.03, 0.05])
def test_every_point_of_what_moves_is_in_a_sphere_of_its_link(overshoot):
    moves, rng = mechanism(), np.random.default_rng(0)
    cover = mechanism_cover(moves, overshoot=overshoot)
    model, links = moves.compiled.model, moves.compiled.link_of_body
    assert cover.kind == "outer" and 0 not in cover.link
    assert cover.overshoot.max() <= overshoot + 1e-9
    for _ in range(3):
        q = random_q(moves, rng)
        data, placed = data_at(moves, q), place(moves, q)
        centres = placed.points(cover.link, cover.centre)
        for name in ("upper", "fore", "hand", "cup"):
            geom = model.geom(name).id
            mine = cover.link == links[model.geom_bodyid[geom]]
            points = surface(model, geom, rng) @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
            away = np.linalg.norm(points[:, None] - centres[mine], axis=2) - cover.radius[mine]
            assert away.min(axis=1).max() < 1e-9


def test_pieces_are_in_their_links_frames_and_what_is_for_the_eye_is_none():
    moves, rng = mechanism(), np.random.default_rng(1)
    links = mechanism_pieces(moves)
    assert [[piece.name for piece in pieces] for pieces in links] == [
        ["table"],
        [],
        ["upper"],
        ["fore"],
        ["hand"],
        ["cup"],
    ]
    q = random_q(moves, rng)
    data, placed = data_at(moves, q), place(moves, q)
    for link, pieces in enumerate(links):
        for piece in pieces:
            where = placed.point(link, piece.pose.position)
            np.testing.assert_allclose(where, data.geom(piece.name).xpos, atol=1e-11)
            R = placed.R[link] @ piece.pose.rotation
            np.testing.assert_allclose(R, data.geom(piece.name).xmat.reshape(3, 3), atol=1e-11)
    chosen = mechanism_pieces(moves, {links[0][0].geom})
    assert [len(pieces) for pieces in chosen] == [1, 0, 0, 0, 0, 0]


def test_spheres_of_geoms_that_may_collide_keep_apart_and_no_others():
    moves, rng = mechanism(), np.random.default_rng(2)
    measure = MechanismMeasure(moves)
    cover = mechanism_cover(moves, overshoot=0.05)
    configurations = np.array([random_q(moves, rng) for _ in range(20)])
    found = apart_pairs(moves, cover, measure.pairs, configurations)
    geoms = sphere_geoms(moves, cover)
    named = {moves.compiled.model.geom(int(geom)).name: int(geom) for geom in np.unique(geoms)}
    assert set(named) == {"upper", "fore", "hand", "cup"}
    wanted = {
        ("upper", "hand"),
        ("upper", "cup"),
        ("fore", "cup"),
        ("hand", "cup"),
    }  # no parent with its child
    keys = {tuple(sorted((named[a], named[b]))) for a, b in wanted}
    every = np.concatenate([found.pairs, found.always])
    assert {tuple(sorted(pair)) for pair in geoms[every].tolist()} == keys
    count = {geom: int((geoms == geom).sum()) for geom in named.values()}
    assert len(every) == sum(count[a] * count[b] for a, b in keys)
    assert np.all(cover.link[found.pairs[:, 0]] < cover.link[found.pairs[:, 1]])
    assert (2, 4) in found.links and (2, 3) not in found.links


def test_pairs_that_spheres_can_not_tell_are_left_out():
    moves, rng = mechanism(), np.random.default_rng(3)
    cover, pairs = mechanism_cover(moves, overshoot=0.05), MechanismMeasure(moves).pairs
    at = moves.value_slices[moves.joint("f")]
    far, near = np.array(moves.home), np.array(moves.home)
    far[at.start : at.start + 3], near[at.start : at.start + 3] = [9, 9, 9], [1.2, 0.1, 0.2]
    known = apart_pairs(moves, cover, pairs, far[None], near[None])
    assert len(known.tolerated) > 0 and not len(known.always)
    always = apart_pairs(moves, cover, pairs, near[None])
    assert {*map(tuple, always.always.tolist())} == {*map(tuple, known.tolerated.tolist())}
    both = apart_pairs(moves, cover, pairs, np.array([near, far]))
    assert len(both.always) == 0 and len(both.pairs) == len(known.pairs) + len(known.tolerated)
    with pytest.raises(InputError, match="no configurations"):
        apart_pairs(moves, cover, pairs, np.zeros((0, moves.size)))
    assert rng is not None


def test_what_stands_gets_spheres_where_asked():
    moves = mechanism()
    table = moves.compiled.model.geom("table").id
    cover = mechanism_cover(moves, overshoot=0.2, standing={table})
    assert 0 in cover.link and set(np.array(cover.source)[cover.link == 0]) == {"table"}


def test_a_robot_s_mechanism_has_no_geometry():
    with pytest.raises(ModelError, match="no compiled model"):
        mechanism_pieces(of_robot(robot_scene("ur10").robot().robot))


def test_spheres_that_touch_where_nothing_does_get_smaller_by_their_overshoot_at_most():
    moves = mechanism()
    cover, pairs = mechanism_cover(moves, overshoot=0.05), MechanismMeasure(moves).pairs
    at = moves.value_slices[moves.joint("f")]
    near = np.array(moves.home)
    near[at.start : at.start + 3] = [1.25, 0.16, 0.2]  # the cup beside the forearm, a centimetre away
    assert 0.0 < MechanismMeasure(moves).distance(near).distance < 0.02
    tolerated = apart_pairs(moves, cover, pairs, moves.home[None], near[None]).tolerated
    assert len(tolerated) > 0
    fitted = fitted_cover(moves, cover, tolerated, near[None])
    less = cover.radius - fitted.radius
    assert less.max() > 0 and np.all(less <= cover.overshoot + 1e-15) and fitted.kind == "given"
    touched = np.zeros(len(cover), dtype=bool)
    touched[tolerated] = True
    assert not less[~touched].any()
    fewer = apart_pairs(moves, fitted, pairs, moves.home[None], near[None])
    assert len(fewer.tolerated) < len(tolerated)
    assert fitted_cover(moves, cover, tolerated[:0], near[None]) is cover
