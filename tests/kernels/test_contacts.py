"""Pairs below a margin, and their gradients, against the judge's distances and finite differences."""

from __future__ import annotations

import numpy as np
import pytest

from tests.ik.arms import beads, distant_pairs, gap_of_pairs, random_arm, seven
from workcell.geometry.packing import pack_arm
from workcell.geometry.types import Piece
from workcell.ik.judge.exact import ExactDistances, ExactKinematics, smallest_clearance
from workcell.ik.problem import IKProblem
from workcell.ik.shared.packing import pack_world
from workcell.jit import kernel
from workcell.kernels.chain import forward
from workcell.kernels.constants import FAR
from workcell.kernels.contacts import collect, contact_row, room
from workcell.pose import Pose


@kernel
def nearest_pairs(arm, world, q, gap, gradient):
    """For configurations q (b, n) the smallest gap (b,) and its gradient (b, n); `FAR` and zeros where nothing is."""
    T, contacts = np.empty((q.shape[1] + 2, 12)), room()
    for i in range(q.shape[0]):
        forward(arm.frames, q[i], T)
        gap[i] = collect(world, T, FAR, -1e300, contacts)
        gradient[i] = 0.0
        if gap[i] < FAR:
            # a second pass keeps the nearest pair alone: the first may have had more than there is room for
            collect(world, T, gap[i] + 1e-12, -1e300, contacts)
            contact_row(arm.frames, T, contacts.rows, 0, gradient[i])


def smallest_gaps(problem, q):
    """The smallest gap (b,) between a problem's spheres and obstacles, or two of its spheres; its gradient (b, n)."""
    gap, gradient = np.empty(len(q)), np.empty(q.shape)
    nearest_pairs(pack_arm(problem.robot), pack_world(problem), q, gap, gradient)
    return gap, gradient


def random_pose(rng, spread=0.6) -> Pose:
    quat = rng.normal(size=4)
    return Pose(spread * rng.normal(size=3), quat / np.linalg.norm(quat))


def one_of_each(rng) -> tuple[Piece, ...]:
    sizes = {"box": 3, "sphere": 1, "capsule": 2, "cylinder": 2, "ellipsoid": 3, "halfspace": 0}
    pieces = [Piece(kind, kind, random_pose(rng), rng.uniform(0.05, 0.3, n)) for kind, n in sizes.items()]
    hull = Piece("hull", "hull", random_pose(rng), np.zeros(0), 0.2 * rng.normal(size=(12, 3)))
    return (*pieces, hull)


@pytest.mark.parametrize("kind", range(7))
def test_gaps_equal_the_judges_distances(kind):
    rng = np.random.default_rng(kind)
    for sliding in (False, True):
        robot = random_arm(rng, 6, sliding)
        cover = beads(robot, 0.03)
        q = robot.random_configuration(rng, 60)
        piece = one_of_each(rng)[kind]
        gap, _ = smallest_gaps(IKProblem(robot, Pose.identity(), (piece,), cover), q)
        kinematics, distances = ExactKinematics(robot), ExactDistances((piece,))
        expected = [smallest_clearance(cover, *kinematics.links(row), distances)[0] for row in q]
        assert np.allclose(gap, expected, atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_gaps_over_many_pieces_and_their_gradients(seed):
    rng = np.random.default_rng(seed)
    robot = random_arm(rng, 7, sliding=seed > 0)
    problem = IKProblem(robot, Pose.identity(), one_of_each(rng), beads(robot, 0.03))
    q = robot.random_configuration(rng, 40)
    gap, gradient = smallest_gaps(problem, q)
    step, smooth = 1e-6, np.ones(len(q), dtype=bool)
    numeric = np.empty_like(q)
    for k in range(7):
        ahead, behind = q.copy(), q.copy()
        ahead[:, k] += step
        behind[:, k] -= step
        g_ahead, g_behind = smallest_gaps(problem, ahead)[0], smallest_gaps(problem, behind)[0]
        numeric[:, k] = (g_ahead - g_behind) / (2 * step)
        smooth &= np.abs(g_ahead + g_behind - 2 * gap) < 1e-9
    assert smooth.sum() > 25
    assert np.allclose(gradient[smooth], numeric[smooth], atol=1e-5)


def test_nothing_to_collide_with():
    robot = seven()
    gap, gradient = smallest_gaps(IKProblem(robot, Pose.identity()), robot.home[None])
    assert gap[0] == 1000.0 and not gradient.any()


@pytest.mark.parametrize("sliding", [False, True])
def test_gaps_and_gradients_of_pairs(sliding):
    rng = np.random.default_rng(1)
    robot = random_arm(rng, 7, sliding)
    cover = beads(robot, 0.03)
    problem = IKProblem(robot, robot.fk(np.zeros(7)), (), cover, self_collision=distant_pairs(cover))
    q = robot.random_configuration(rng, 20)
    gap, gradient = smallest_gaps(problem, q)
    np.testing.assert_allclose(gap, [gap_of_pairs(problem, row) for row in q], atol=1e-12)
    step = 1e-6
    for k in range(7):
        moved = step * np.eye(7)[k]
        slope = (smallest_gaps(problem, q + moved)[0] - smallest_gaps(problem, q - moved)[0]) / (2 * step)
        np.testing.assert_allclose(gradient[:, k], slope, atol=1e-6)
