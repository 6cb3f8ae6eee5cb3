"""Elementary proofs: sharp where a closed form says so, never of a target in reach, and hard to forge."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.ik.arms import beads, box, planar, random_arm, seven
from workcell.geometry.types import Piece, SphereCover
from workcell.ik.certificate import Certificate
from workcell.ik.check import check_certificate
from workcell.ik.elementary.bounds import prove_impossible
from workcell.ik.judge.verify import verify
from workcell.ik.problem import Clearance, IKProblem, Tolerances
from workcell.pose import Pose


def _turned(at, angle=0.0):
    return Pose(np.array(at), np.array([np.cos(angle / 2), 0, 0, np.sin(angle / 2)]))


def test_beyond_a_planar_arm():
    # the last link's direction is the target's own: the elbow must come to the target minus 0.4 along x
    robot = planar((0.5, 0.4))
    problem = IKProblem(robot, _turned([0.95, 0.0, 0.0]))
    certificate = prove_impossible(problem)
    assert certificate is not None and certificate.kind == "reach" and certificate.scope == "kinematics"
    assert certificate.margin == pytest.approx(0.05 - 1e-3 - 1e-2 * 0.4, abs=1e-6)
    assert check_certificate(problem, certificate) is None
    assert prove_impossible(IKProblem(robot, _turned([0.9, 0.0, 0.0]))) is None


def test_the_tolerances_asked_for_are_covered_even_when_wider_ones_are_not():
    robot = planar((0.5, 0.4))
    problem = IKProblem(robot, _turned([0.902, 0.0, 0.0]))
    certificate = prove_impossible(problem)
    assert certificate is not None
    assert np.allclose(certificate.data["tolerances"], [1e-4, 1e-3, 0.0])
    assert check_certificate(problem, certificate) is None
    loose = replace(problem, tolerances=Tolerances(position=5e-3))
    assert prove_impossible(loose) is None


def test_nearer_than_a_long_link_allows():
    robot = planar((0.8, 0.2, 0.1))
    problem = IKProblem(robot, _turned([0.3, 0.0, 0.0]))
    certificate = prove_impossible(problem)
    assert certificate is not None
    assert certificate.margin == pytest.approx(0.8 - 0.2 - 0.2 - 1e-3 - 1e-2 * 0.1, abs=1e-6)
    assert check_certificate(problem, certificate) is None


def test_offsets_along_the_axes_do_not_count():
    # joints 2 and 3 stand 0.6 up and down along the common axis: a plain sum of lengths would be 1.34, not 0.6
    robot = replace(planar((0.3, 0.3, 0.2)), joint_xyz=np.array([[0, 0, 0], [0.3, 0, 0.6], [0.3, 0, -0.6]]))
    problem = IKProblem(robot, _turned([0.9, 0.0, 0.0]))
    certificate = prove_impossible(problem)
    assert certificate is not None
    assert 0.09 < certificate.margin <= 0.1 - 1e-3 - 1e-2 * 0.2
    assert check_certificate(problem, certificate) is None


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 100_000), st.booleans())
def test_nothing_is_proved_of_a_target_that_is_reached(seed, sliding):
    rng = np.random.default_rng(seed)
    robot = random_arm(rng, n=int(rng.integers(2, 8)), sliding=sliding)
    cover = beads(robot, float(rng.uniform(0.02, 0.15)))
    # stretched arms are where a bound that is too tight would fail
    q = rng.choice([robot.lower, robot.upper, 0 * robot.lower, robot.random_configuration(rng)])
    reached = robot.fk(q)
    direction, turn = rng.normal(size=(2, 3))
    away, angle = 0.99e-4 * rng.uniform(), 0.99e-3 * rng.uniform()
    axis = turn / np.linalg.norm(turn) * np.sin(angle / 2)
    moved = Pose(np.zeros(3), np.array([np.cos(angle / 2), *axis])) @ reached
    target = Pose(reached.position + away * direction / np.linalg.norm(direction), moved.quat_wxyz)
    balls = tuple(
        Piece(
            f"ball {k}",
            "sphere",
            Pose.from_xyz(reached.position + rng.normal(size=3) * 0.4),
            np.array([0.15]),
        )
        for k in range(4)
    )
    problem = IKProblem(robot, target, balls, cover)
    if verify(problem, q).accepted:
        assert prove_impossible(problem) is None
    assert prove_impossible(IKProblem(robot, target)) is None


def _last_link_blocked(depth=0.05, **parts):
    robot = seven()
    target = robot.fk(np.array([0.2, 0.5, 0.1, 0.6, 0.0, 0.4, 0.0]))
    cover = SphereCover(
        np.array([7]), np.array([[0.0, 0.0, 0.1]]), np.array([0.05]), parts.pop("kind", "given")
    )
    T_world_link = target @ robot.tool().T_link_tool.inverse()
    centre = T_world_link.apply([0.0, 0.0, 0.1])
    wall = box("wall", tuple(centre + np.array([0.15 - depth, 0, 0])), (0.1, 0.3, 0.3))
    return IKProblem(robot, target, (wall,), cover, **parts)


def test_a_blocked_last_link():
    problem = _last_link_blocked(depth=0.03)
    certificate = prove_impossible(problem)
    assert certificate is not None and certificate.kind == "last_link" and certificate.scope == "geometry"
    # sphere at 0.05 m from the tool point: 0.01 rad move it by 0.5 mm
    assert certificate.margin == pytest.approx(0.03 - 1e-3 - 1e-3 - 0.01 * 0.05, abs=1e-6)
    assert "sphere 0 (link7) is inside wall" in certificate.statement
    assert check_certificate(problem, certificate) is None


@pytest.mark.parametrize(("depth", "proved"), [(1.4e-4, False), (1.6e-4, True), (-0.01, False)])
def test_what_the_tolerances_can_undo_is_not_proved(depth, proved):
    # 0.1 mm and 0.001 rad at 0.05 m: 0.15 mm
    assert (prove_impossible(_last_link_blocked(depth)) is not None) is proved


def test_a_sphere_that_circles_the_last_axis_counts_less_its_distance_to_it():
    robot = planar((0.5, 0.4))
    target = robot.fk(np.array([0.3, 0.8]))
    elbow = target.apply([-0.4, 0.0, 0.0])
    for offset, proved in ((0.02, True), (0.08, False)):
        cover = SphereCover(np.array([1]), np.array([[0.5 - offset, 0.0, 0.0]]), np.array([0.03]))
        ball = Piece("ball", "sphere", Pose.from_xyz(elbow), np.array([0.04]))
        assert (prove_impossible(IKProblem(robot, target, (ball,), cover)) is not None) is proved


def test_scopes_follow_what_the_spheres_are():
    checker = lambda q: Clearance(1.0)  # noqa: E731
    for kind, truth, scope in (
        ("given", None, "geometry"),
        ("given", checker, "model"),
        ("outer", None, "model"),
        ("outer", checker, "model"),
        ("inner", checker, "geometry"),
    ):
        problem = _last_link_blocked(kind=kind, checker=truth)
        certificate = prove_impossible(problem)
        assert certificate is not None and certificate.scope == scope
        assert check_certificate(problem, certificate) is None


def _forged(certificate, **changes):
    data = {**certificate.data, **changes.pop("data", {})}
    return replace(certificate, data=data, **changes)


def test_forged_certificates_are_refused():
    reach_problem = IKProblem(planar(), _turned([1.5, 0.0, 0.0]))
    reach = prove_impossible(reach_problem)
    blocked_problem = _last_link_blocked(kind="outer")
    blocked = prove_impossible(blocked_problem)
    assert reach is not None and blocked is not None
    easy = IKProblem(planar(), _turned([0.9, 0.0, 0.0]))
    cases = [
        (reach_problem, _forged(reach, problem_hash="0" * 64), "another problem"),
        (easy, reach, "another problem"),
        (easy, _forged(reach, problem_hash=_hash(easy)), "within the chain's reach"),
        (reach_problem, _forged(reach, scope="geometry"), "of the scope 'kinematics'"),
        (reach_problem, _forged(reach, scope="nonsense"), "scope"),
        (reach_problem, _forged(reach, kind="trust me"), "unknown"),
        (reach_problem, _forged(reach, data={"slides": np.zeros(5)}), "shape [5]"),
        (reach_problem, _forged(reach, data={"slides": np.full(2, np.nan)}), "not finite"),
        (reach_problem, _forged(reach, data={"tolerances": np.zeros(3)}), "narrower"),
        (reach_problem, _forged(reach, data={"tolerances": np.zeros(2)}), "shape [2]"),
        (reach_problem, replace(reach, data={}), "missing"),
        (blocked_problem, _forged(blocked, scope="geometry"), "of the scope 'model'"),
        (blocked_problem, _forged(blocked, data={"tolerances": np.full(3, 1.0)}), "need not penetrate"),
        (reach_problem, _forged(reach, kind="last_link", scope="geometry"), "no spheres"),
        (reach_problem, _forged(reach, margin=2 * reach.margin), "margin"),
        (reach_problem, _forged(reach, statement="so it is"), "statement"),
        (reach_problem, _forged(reach, data={"slides": np.full(2, 1e300)}), "larger than"),
        (reach_problem, _forged(reach, data={"slides": np.full(2, 1e49)}), "along its joint's axis"),
        (blocked_problem, _forged(blocked, data={"pair": np.array([0.0, 1e30])}), "isn't there"),
        (blocked_problem, _forged(blocked, data={"pair": np.array([-1.0, 0.0])}), "isn't there"),
        (blocked_problem, _forged(blocked, data={"pair": np.array([0.5, 0.0])}), "isn't there"),
    ]
    for problem, certificate, words in cases:
        refusal = check_certificate(problem, certificate)
        assert refusal is not None and words in refusal, (words, refusal)


def _hash(problem):
    from workcell.ik.certificate import problem_hash

    return problem_hash(problem)


def test_certificates_survive_json():
    problem = _last_link_blocked()
    certificate = prove_impossible(problem)
    assert certificate is not None
    again = Certificate.from_json(certificate.to_json())
    assert check_certificate(problem, again) is None
