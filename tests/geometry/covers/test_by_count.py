import numpy as np
import pytest

from workcell.bench.geometry.covers import violations
from workcell.errors import InputError
from workcell.geometry.covers.by_count import by_count, cover_metrics, sphere_budget
from workcell.geometry.covers.outer import cover_of, model_cover
from workcell.geometry.pieces import model_pieces
from workcell.geometry.types import Piece, SphereCover
from workcell.model.loading.compiled import link_bodies
from workcell.model.loading.load import load_compiled
from workcell.pose import Pose

BALL = Piece("ball", "sphere", Pose.identity(), np.array([0.1]))
ROD = Piece("rod", "capsule", Pose.identity(), np.array([0.04, 0.2]))


def test_metrics_of_a_ball_in_a_ball():
    outer = SphereCover(np.zeros(1), np.zeros((1, 3)), np.array([0.12]), "outer", np.array([0.02]))
    inner = SphereCover(np.zeros(1), np.zeros((1, 3)), np.array([0.05]), "inner")
    metrics = cover_metrics([[BALL]], outer)
    assert (metrics.count, metrics.overshoot_max, metrics.overshoot_mean) == (1, 0.02, 0.02)
    assert metrics.volume == pytest.approx(4 / 3 * np.pi * 1e-3, rel=0.02)
    assert metrics.sphere_volume == pytest.approx(1.2**3 * metrics.volume, rel=0.02)
    assert metrics.share == 1.0
    assert cover_metrics([[BALL]], inner).share == pytest.approx(0.125, abs=0.01)


def test_links_without_spheres_count_as_empty():
    inner = SphereCover(np.zeros(1), np.zeros((1, 3)), np.array([0.0999]), "inner")
    assert cover_metrics([[BALL], [BALL]], inner).share == pytest.approx(0.5, abs=0.01)


def test_more_spheres_stick_out_less():
    few, many = (by_count(n, lambda size: cover_of([ROD], size)) for n in (1, 4))
    assert len(few) == 1 and 1 < len(many) <= 4
    assert few.overshoot.max() > 2 * many.overshoot.max()
    # one ball must reach from the middle to the end: 0.24 m, of which 0.04 m are inside
    assert few.overshoot.max() == pytest.approx(0.2, rel=0.06)


@pytest.mark.parametrize("kind", ["outer", "inner"])
def test_random_points_find_nothing_wrong_with_a_robots_cover(kind):
    model, robot = load_compiled("ur10")[:2]
    cover = model_cover(model, robot, kind=kind, count=22 if kind == "inner" else None)
    assert len(cover) <= 60
    bodies = [[], *map(list, link_bodies(model, robot)[1:])]
    assert violations(model, bodies, cover, 6000, np.random.default_rng(1)) == 0
    off = 0.01 if kind == "inner" else -0.01
    broken = SphereCover(cover.link, cover.centre, cover.radius + off, cover.kind)
    assert violations(model, bodies, broken, 6000, np.random.default_rng(1)) > 0


def test_what_a_count_means():
    links = [[BALL]] * 7
    assert [sphere_budget(name, links) for name in ("low", "mid", "high")] == [7, 10, 22]
    assert sphere_budget("low") == 5 and sphere_budget(9, links) == 9
    with pytest.raises(InputError, match=r"can't cover 7 links.*7 or more"):
        sphere_budget(6, links)
    with pytest.raises(InputError, match=r"unknown density 'fine'.*low, mid, high"):
        sphere_budget("fine", links)


def test_an_outer_cover_has_no_share():
    model, robot = load_compiled("ur10")[:2]
    with pytest.raises(InputError, match="has no share"):
        model_cover(model, robot, share=0.5)


def test_robots_take_sixty_spheres_or_fewer_at_two_centimetres():
    for name in ("sawyer", "iiwa14"):
        model, robot = load_compiled(name)[:2]
        cover = model_cover(model, robot, overshoot=0.02)
        assert len(cover) <= 60 and cover.overshoot.max() <= 0.02 + 1e-9
        moving = [link for link, pieces in enumerate(model_pieces(model, robot)) if link and pieces]
        assert set(cover.link) == set(moving)
