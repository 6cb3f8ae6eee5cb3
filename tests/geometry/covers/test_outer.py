import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.geometry.shapes import BOUNDED, points_inside, random_piece
from workcell.errors import InputError, UnknownNameError
from workcell.geometry.covers.outer import (
    attached_cover,
    cover_pieces,
    merge_covers,
    overshoots,
    robot_cover,
)
from workcell.geometry.covers.proof import prove_cover
from workcell.geometry.covers.tighten import tighten
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.pieces import robot_pieces
from workcell.geometry.types import Piece, SphereCover
from workcell.model.scene import Scene
from workcell.pose import Pose

OVERSHOOT = 0.02


def largest_gap(points, centres, radii):
    """How far the points are outside all spheres."""
    gaps = np.full(len(points), np.inf)
    for centre, radius in zip(centres, radii, strict=True):
        gaps = np.minimum(gaps, np.linalg.norm(points - centre, axis=1) - radius)
    return gaps.max()


@pytest.mark.parametrize("kind", BOUNDED)
def test_covers_hold_the_piece_and_stick_out_by_no_more_than_asked(kind):
    rng = np.random.default_rng(5)
    piece = random_piece(rng, kind, small=0.03, large=0.1)
    centres, radii, measured = cover_pieces([piece], OVERSHOOT)
    assert prove_cover([piece], centres, radii) is None
    assert largest_gap(points_inside(rng, piece, 100_000), centres, radii) <= 0
    assert measured.max() <= OVERSHOOT + 1e-9
    direction = rng.normal(size=(len(radii), 200, 3))
    direction /= np.linalg.norm(direction, axis=2, keepdims=True)
    outermost = ObstacleArrays([piece]).distances(centres[:, None] + radii[:, None, None] * direction).max()
    assert outermost <= measured.max() + 1e-9


def test_one_cover_serves_several_pieces():
    pieces = [
        Piece("a", "capsule", Pose.identity(), np.array([0.05, 0.1])),
        Piece("b", "cylinder", Pose(np.zeros(3), [2**-0.5, 2**-0.5, 0, 0]), np.array([0.045, 0.06])),
    ]
    centres, radii, _ = cover_pieces(pieces, OVERSHOOT)
    alone = sum(len(cover_pieces([piece], OVERSHOOT)[1]) for piece in pieces)
    assert len(radii) < alone
    assert prove_cover(pieces, centres, radii) is None


def test_table_top_takes_no_more_than_the_square_lattice():
    table = Piece("table", "box", Pose.identity(), np.array([0.75, 0.4, 0.02]))
    centres, radii, measured = cover_pieces([table], OVERSHOOT)
    assert len(radii) <= 31 * 17 + 62
    assert measured.max() <= OVERSHOOT + 1e-9
    assert prove_cover([table], centres, radii) is None


@given(st.integers(0, 2**32 - 1), st.sampled_from(BOUNDED))
@settings(max_examples=30, deadline=None)
def test_a_sphere_in_the_wrong_place_is_caught(seed, kind):
    """One ball around the piece that just fails to hold its farthest point."""
    rng = np.random.default_rng(seed)
    piece = random_piece(rng, kind)
    centre = piece.pose.position + rng.normal(size=3) * 0.02
    points = points_inside(rng, piece, 3000)
    reach = np.linalg.norm(points - centre, axis=1).max()
    cell = prove_cover([piece], centre[None], [reach - 1e-3])
    assert cell is not None and cell.piece == piece.name
    corner_gap = np.linalg.norm(np.abs(cell.centre - centre) + cell.half) - (reach - 1e-3)
    assert corner_gap > 0
    if cell.certain:
        assert ObstacleArrays([piece]).distances(cell.centre)[0] <= 0 and cell.gap > 0


def test_every_sphere_shrunk_by_a_millimetre_is_caught_where_it_matters():
    rng = np.random.default_rng(8)
    piece = Piece("can", "cylinder", Pose.identity(), np.array([0.06, 0.12]))
    centres, radii, _ = cover_pieces([piece], OVERSHOOT)
    points = points_inside(rng, piece, 100_000)
    matters = 0
    for index in range(len(radii)):
        smaller = np.where(np.arange(len(radii)) == index, radii - 1e-3, radii)
        if largest_gap(points, centres, smaller) > 0:
            cell = prove_cover([piece], centres, smaller)
            assert cell is not None and cell.piece == "can"
            matters += 1
    assert matters == len(radii)


def test_exact_covers_without_slack_are_accepted():
    ball = Piece("ball", "sphere", Pose.from_xyz([1, 2, 3]), np.array([0.1]))
    assert prove_cover([ball], [[1, 2, 3]], [0.1]) is None
    assert prove_cover([ball], [[1, 2, 3]], [0.0999]) is not None
    assert prove_cover([ball], np.zeros((0, 3)), []) is not None


def test_robot_cover_of_the_shelf_cell():
    scene = Scene.load("shelf_grasp")
    robot = scene.robot()
    cover = robot_cover(scene.model, robot, overshoot=0.04)
    assert cover.kind == "outer" and cover.link.min() == 1 and cover.link.max() == robot.robot.dof
    rng = np.random.default_rng(0)
    for link, pieces in enumerate(robot_pieces(scene.model, robot)):
        mine = cover.link == link
        if link == 0:
            continue
        assert prove_cover(pieces, cover.centre[mine], cover.radius[mine]) is None
        for piece in pieces:
            assert largest_gap(points_inside(rng, piece, 5000), cover.centre[mine], cover.radius[mine]) <= 0
        assert overshoots(pieces, cover.centre[mine], cover.radius[mine]).max() <= 0.04 + 1e-9


def test_attached_object_moves_with_the_tool():
    scene = Scene.load("shelf_grasp")
    robot = scene.robot()
    T_tool_object = Pose(np.array([0.01, 0.02, 0.03]), [0.5, 0.5, 0.5, 0.5])
    cover = attached_cover(scene, robot, "cup", T_tool_object, overshoot=0.03)
    assert set(cover.link) == {robot.robot.tool().link}
    where = robot.robot.fk(robot.start) @ T_tool_object
    centres = cover.centres_world(robot.robot.link_transforms(robot.start))
    local = where.inverse().apply(centres)
    assert local.min() > -0.1 and local.max() < 0.15  # the cup stands at its own origin
    merged = merge_covers(cover, cover)
    assert len(merged) == 2 * len(cover) and merged.kind == "outer" and len(merged.source) == len(merged)
    with pytest.raises(UnknownNameError, match="cupp"):
        attached_cover(scene, robot, "cupp", T_tool_object)


def test_what_has_no_cover_is_refused():
    ground = Piece("ground", "halfspace", Pose.identity(), np.zeros(0))
    with pytest.raises(InputError, match=r"ground.*half-space"):
        cover_pieces([ground], OVERSHOOT)
    with pytest.raises(InputError, match="overshoot"):
        cover_pieces([Piece("b", "sphere", Pose.identity(), np.array([0.1]))], 0.0)


def test_covers_of_different_kinds_are_not_merged() -> None:
    outer = SphereCover(np.array([0]), np.zeros((1, 3)), np.array([0.1]), kind="outer")
    inner = SphereCover(np.array([0]), np.zeros((1, 3)), np.array([0.1]), kind="inner")
    with pytest.raises(InputError, match="inner and outer spheres can't be merged"):
        merge_covers(outer, inner)


def _can_with_a_handle():
    return [
        Piece("can", "cylinder", Pose.identity(), np.array([0.05, 0.06])),
        Piece("handle", "capsule", Pose.from_xyz([0.07, 0, 0]), np.array([0.01, 0.03])),
        Piece("lid", "box", Pose.from_xyz([0, 0, 0.065]), np.array([0.04, 0.04, 0.005])),
    ]


def _robot_link():
    scene = Scene.load("shelf_grasp")
    return robot_pieces(scene.model, scene.robot())[4]


@pytest.mark.parametrize("make", [_can_with_a_handle, _robot_link])
def test_any_sphere_shrunk_by_a_millimetre_is_caught(make):
    pieces = make()
    centres, radii, _ = cover_pieces(pieces, OVERSHOOT)
    assert prove_cover(pieces, centres, radii) is None
    for index in range(len(radii)):
        smaller = np.where(np.arange(len(radii)) == index, radii - 1e-3, radii)
        cell = prove_cover(pieces, centres, smaller)
        assert cell is not None
        assert cell.piece in {piece.name for piece in pieces}
        if cell.certain:
            assert ObstacleArrays(pieces).nearest(cell.centre)[0] <= 1e-9
            assert (np.linalg.norm(cell.centre - centres, axis=1) > smaller).all()


def test_superfluous_spheres_are_dropped_and_the_rest_shrunk():
    ball = Piece("ball", "sphere", Pose.identity(), np.array([0.1]))
    centres = np.array([[0.0, 0, 0], [0.02, 0, 0], [0, 0.01, 0]])
    left, radii = tighten([ball], centres, np.array([0.15, 0.15, 0.15]), resolution=5e-5)
    assert len(radii) == 1
    away = np.linalg.norm(left[0])
    assert radii[0] == pytest.approx(0.1 + away, abs=2e-4) and radii[0] >= 0.1 + away - 1e-12


def test_a_sphere_is_its_own_cover_and_two_are_tightened_in_few_cells() -> None:
    """All of a sphere's surface is equally far from its centre: to resolve it finely would take forever."""
    pieces = [
        Piece("a", "sphere", Pose.from_xyz([0.3, 0.0, 0.0]), np.array([0.25])),
        Piece("b", "sphere", Pose.from_xyz([0.3, 0.0, 0.2]), np.array([0.12])),
    ]
    centres, radii, overshoot = cover_pieces(pieces[:1], 0.02)
    assert centres.tolist() == [[0.3, 0.0, 0.0]] and 0.25 <= radii[0] < 0.2502 and overshoot[0] < 2e-4
    centres, radii, overshoot = cover_pieces(pieces, 0.02)
    assert prove_cover(pieces, centres, radii) is None and overshoot.max() <= 0.02 and len(radii) <= 3
