"""The proof between waypoints: never wrong, and it finds a graze that sampling misses."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from workcell.errors import InputError
from workcell.geometry.types import SphereCover
from workcell.ik.problem import Clearance
from workcell.model.scene import Scene
from workcell.motion.path import Path, Trajectory
from workcell.motion.proofs.on_model import (
    motion_bound,
    prove_by_halving,
    prove_path,
    prove_segment,
    trajectory_clearance,
)
from workcell.world.planning_world import PlanningWorld

angle = st.floats(-2.5, 2.5)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_motion_bound_holds_for_every_point_of_every_sphere(arm7, seed):
    rng = np.random.default_rng(seed)
    q, half = rng.uniform(-2, 2, 7), rng.uniform(0, 0.5, 7) * rng.integers(0, 2, 7)
    cover = SphereCover(np.arange(8), rng.uniform(-0.2, 0.2, (8, 3)), rng.uniform(0.01, 0.1, 8))
    bound = motion_bound(arm7, q, half, cover)
    surface = rng.normal(size=(8, 3))
    points = cover.centre + cover.radius[:, None] * surface / np.linalg.norm(surface, axis=1, keepdims=True)
    on_links = SphereCover(cover.link, points, np.full(8, 1e-6))
    before = on_links.centres_world(arm7.link_transforms(q))
    moved = q + half * rng.uniform(-1, 1, (200, 7))
    after = on_links.centres_world(arm7.link_transforms(moved))
    assert np.linalg.norm(after - before, axis=-1).max() <= bound + 1e-12


def test_motion_bound_of_one_joint_is_the_chord(planar):
    tip = SphereCover(np.array([3]), np.array([[0.4, 0.0, 0.0]]), np.array([1e-9]))
    bound = motion_bound(planar, np.zeros(3), np.array([0.5, 0.0, 0.0]), tip)
    assert bound == pytest.approx(2 * np.sin(0.25) * 1.2, abs=1e-8)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_a_proved_path_is_clear_at_every_dense_sample(planar, planar_cover, ball, seed):
    rng = np.random.default_rng(seed)
    path = Path(planar, rng.uniform(-2.0, 2.0, (3, 3)))
    truth = ball([rng.uniform(-1, 1), rng.uniform(-1, 1), 0.0], 0.1)
    proof = prove_path(path, truth, planar_cover)
    dense = truth.distances(path.at(np.linspace(0, 2, 2001))).min()
    if proof.proved:
        assert dense >= proof.margin - 1e-9 and proof.margin >= 0
    else:
        assert dense < 5e-3  # refused only where there is a collision, or as good as one
        assert np.isfinite(proof.failed_at) and proof.reason


def test_a_graze_between_samples_is_found(planar, planar_cover, ball):
    path = Path(planar, np.array([[-0.6, 0.0, 0.0], [0.6, 0.0, 0.0]]))
    radius = 0.02
    # The tip sphere's centre sweeps the arc of radius 1.15; the ball is 1 mm deep in its way at angle 0.123.
    reach = 1.15 + 0.06 + radius - 1e-3
    truth = ball([reach * np.cos(0.123), reach * np.sin(0.123), 0.0], radius)
    coarse = [truth(q).distance for q in path.at(np.linspace(0, 1, 9))]
    assert min(coarse) > 0
    proof = prove_path(path, truth, planar_cover)
    assert not proof.proved and "collision" in proof.reason
    assert -0.6 + 1.2 * proof.failed_at == pytest.approx(0.123, abs=0.03)


def test_the_floor_is_kept(planar, planar_cover, ball):
    truth = ball([1.4, 0.0, 0.0], 0.1)  # 9 cm off the outstretched arm
    a, b = [-0.3, 0.0, 0.0], [0.3, 0.0, 0.0]
    assert prove_segment(planar, a, b, truth, planar_cover, floor=0.08).proved
    refused = prove_segment(planar, a, b, truth, planar_cover, floor=0.10)
    assert not refused.proved and "below 100.00 mm" in refused.reason


def test_far_from_everything_one_query_is_enough(planar, planar_cover, ball):
    truth = ball([5.0, 0.0, 0.0], 0.1)
    assert prove_segment(planar, [-0.5] * 3, [0.5] * 3, truth, planar_cover).evaluations == 1


def test_a_nan_clearance_never_proves(planar, planar_cover):
    proof = prove_segment(planar, [0.0] * 3, [0.1] * 3, lambda q: Clearance(float("nan")), planar_cover)
    assert not proof.proved


def test_trajectory_slack_covers_the_bulge_between_samples(planar, planar_cover, ball):
    t = np.linspace(0, 1, 101)
    q = np.outer(np.sin(np.pi * t), [0.4, 0.0, 0.0])
    qd = np.outer(np.pi * np.cos(np.pi * t), [0.4, 0.0, 0.0])
    qdd = np.outer(-(np.pi**2) * np.sin(np.pi * t), [0.4, 0.0, 0.0])
    trajectory = Trajectory("arm", t, q, qd, qdd)
    # Out to 0.4 rad and back: the ball touches the arm only within 0.2 mm of the turning point.
    touch = 0.4 + 2 * np.arcsin((0.06 + 0.02 - 2e-4) / 2 / 1.15)
    truth = ball([1.15 * np.cos(touch), 1.15 * np.sin(touch), 0.0], 0.02)
    assert truth(q[0]).distance > 0
    assert not trajectory_clearance(planar, trajectory, truth, planar_cover, every=20).proved
    clear = ball([1.15 * np.cos(touch + 0.02), 1.15 * np.sin(touch + 0.02), 0.0], 0.02)
    assert trajectory_clearance(planar, trajectory, clear, planar_cover, every=2).proved


@pytest.mark.parametrize("spheres", ["inner", "none"])
def test_spheres_that_do_not_contain_the_robot_prove_nothing(planar, planar_cover, spheres):
    cover = planar_cover
    inner = SphereCover(cover.link, cover.centre, cover.radius, "inner")
    extent = (
        inner if spheres == "inner" else SphereCover(np.zeros(0, dtype=int), np.zeros((0, 3)), np.zeros(0))
    )
    q = np.zeros(planar.dof)
    with pytest.raises(InputError, match="contain the moving robot"):
        prove_segment(planar, q, q + 0.1, lambda _: Clearance(1.0, ("arm", "post")), extent)


def test_the_margin_leaves_room_for_the_tolerance_of_the_model_s_distances(tmp_path):
    """Distances found by iteration are as good as the judge's tolerance, not as the file's, here 1 cm."""
    (tmp_path / "cell.xml").write_text(
        '<mujoco><option ccd_tolerance="0.01"/><worldbody><site name="robot_mount"/>'
        '<geom name="post" type="cylinder" pos="1.5 0 0.5" size="0.05 0.5"/></worldbody></mujoco>'
    )
    world = PlanningWorld.of(Scene.load(tmp_path / "cell.xml", robot="iiwa14"))
    q = world.robot.start
    proof = prove_segment(world.robot.robot, q, q, world.clearance, world.cover)
    assert proof.proved
    assert proof.margin == pytest.approx(world.clearance(q).distance - 1e-6, abs=1e-9)


@pytest.mark.parametrize("edges", [[0.0, 2.0], [0.0, 1.0, 2.0], [0.0, 0.3, 1.7, 2.0]])
def test_whatever_loses_no_more_than_it_says_can_be_proved_by_halving(planar, edges):
    """A clearance that falls with the first joint, and is said to lose twice as much: 0.1 m are left at the end."""
    path = Path(planar, [[0.0, 0.0, 0.0], [0.4, 0.5, 0.0], [0.9, 0.0, 0.0]])

    def look(q, half):
        return Clearance(1.0 - q[0], ("arm", "wall")), 1.0 - q[0] - 2.0 * half[0]

    proof = prove_by_halving(path, look, edges, floor=0.05)
    assert proof.proved and 0.05 <= proof.margin <= 0.1 + 1e-12
    too_much = prove_by_halving(path, look, edges, floor=0.101)
    assert not too_much.proved and too_much.failed_at > 1.9 and "arm and wall" in too_much.reason
    strays = prove_by_halving(path, look, edges, floor=0.05, slack=[[0.0, 0.0, 0.0], [0.06, 0.0, 0.0]])
    assert not strays.proved
    given_up = prove_by_halving(path, look, edges, floor=0.05, max_evaluations=1)
    assert not given_up.proved and given_up.reason.startswith("no proof within")
