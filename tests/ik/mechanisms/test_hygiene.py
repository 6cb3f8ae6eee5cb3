"""Questions that make no sense are refused by name; what is odd but allowed is noted."""

from __future__ import annotations

from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from workcell.errors import InputError
from workcell.ik.mechanisms.goals import FrameGoal, InRegion
from workcell.ik.mechanisms.hygiene import check_problem, check_regions, is_bounded, least_outside
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.model.mechanism.mechanism import Frame, Joint, Mechanism
from workcell.model.mechanism.placing import place
from workcell.pose import Pose

TURN = Pose(np.array([0.1, 0.2, 0.3]), np.array([0.5, 0.5, 0.5, 0.5]))
BODY = Mechanism(
    "body",
    (
        Joint("floats", "free", 0, Pose.identity(), np.zeros(3)),
        Joint("held", "hinge", 0, TURN, np.eye(3)[2], 0.3, 0.3),
        Joint("turns", "hinge", 2, TURN, np.eye(3)[2], -1.0, 1.0),
    ),
    ("world", "floating", "post", "flag"),
    frames={
        "a": Frame("a", 1, Pose.identity()),
        "b": Frame("b", 1, Pose.from_xyz([0.4, 0.0, 0.0])),
        "bent": Frame("bent", 1, TURN),
        "floor": Frame("floor", 0, Pose.from_xyz([0.0, 0.0, 1.0])),
        "post": Frame("post", 2, TURN),
        "flag": Frame("flag", 3, TURN),
    },
)
UP = (0.0, 0.0, 1.0)


def notes(*goals, regions=()):
    return check_problem(MechanismProblem(BODY, goals, regions))


def refused(*goals, regions=(), match):
    with pytest.raises(InputError, match=match) as caught:
        notes(*goals, regions=regions)
    return caught.value


def box(frame, lower, upper, point=(0.0, 0.0, 0.0)):
    A = np.vstack([np.eye(3), -np.eye(3)])
    return InRegion.polytope(frame, A, np.concatenate([upper, -np.asarray(lower)]), point)


def test_a_sensible_question_has_no_notes() -> None:
    goals = (FrameGoal.at("a", (0, 0, 0)), FrameGoal.pointing("b", UP, within=0.1))
    assert notes(*goals, regions=(box("b", (0.1, -1, -1), (1, 1, 1)), InRegion.plane("flag", UP, 0.2))) == ()


def test_an_empty_polytope_is_refused() -> None:
    error = refused(regions=(box("a", (0, 0, 0), (1, 1, 1)), box("b", (0, 0, 1), (1, 1, 0.5))), match="empty")
    assert error.where == "region 1 of 'b'"
    assert "0.25 m outside" in error.message


def test_planes_that_never_meet_are_refused() -> None:
    planes = (InRegion.plane("a", UP, 0.5), InRegion.plane("a", (0, 0, -1.0), -0.7))
    error = refused(regions=planes, match="its planes are parallel, 0.2 m apart")
    assert error.where == "plane 0 of 'a'"
    assert "plane 1 of 'a'" in error.message


def test_contacts_with_opposite_faces_are_refused() -> None:
    contacts = [InRegion.on_face("a", Pose.identity(), (0.1, 0.1, 0.1), face) for face in ("+x", "-x")]
    refused(regions=tuple(contacts), match="contact 0 of 'a': it contradicts contact 1")


def test_regions_too_far_apart_for_one_link_are_refused() -> None:
    near, far = box("a", (0, 0, 0), (0.1, 0.1, 0.1)), box("b", (0.6, 0, 0), (0.7, 0.1, 0.1))
    refused(regions=(near, far), match="contradicts region 1 of 'b': points of link 'floating'")
    assert notes(regions=(near, box("b", (0.45, 0, 0), (0.7, 0.1, 0.1)))) == ()


def test_three_regions_of_which_any_two_go_together_are_refused() -> None:
    directions = [np.array([np.cos(t), np.sin(t), 0.0]) for t in (0, 2 * np.pi / 3, 4 * np.pi / 3)]
    regions = tuple(InRegion.polytope("a", d[None], np.array([-0.1])) for d in directions)
    refused(regions=regions, match="contradicts region 1 of 'a' and region 2 of 'a'")


def test_a_goal_outside_a_region_is_refused() -> None:
    refused(
        FrameGoal.at("a", (0, 0, 2)),
        regions=(box("a", (0, 0, 0), (1, 1, 1)),),
        match="its point is 1 m outside",
    )
    refused(
        FrameGoal.at("a", (0, 0, 2)),
        regions=(box("b", (0, 0, 0), (1, 1, 1)),),
        match="contradicts goal 0 of 'a'",
    )
    posed = FrameGoal.posed("bent", TURN)
    refused(posed, regions=(box("b", (0.5, 0, 0), (1, 1, 1)),), match="0.1 m outside.*goal 0 of 'bent'")


def test_regions_without_an_end_are_noted() -> None:
    half = InRegion.polytope("a", np.array([[0.0, 0.0, 1.0]]), np.array([1.0]))
    assert notes(regions=(half,)) == ("region 0 of 'a': it has no end in some direction",)


def test_rows_that_say_nothing_new_are_noted() -> None:
    A = np.vstack([np.eye(3), -np.eye(3), [[0.0, 0.0, 2.0]]])
    region = InRegion.polytope("a", A, np.array([1, 1, 1, 1, 1, 1, 3.0]))
    assert notes(regions=(region,)) == ("region 0 of 'a': row 6 says nothing new",)


def test_contradictory_goals_of_one_frame_are_refused() -> None:
    refused(
        FrameGoal.at("a", (0, 0, 0)),
        FrameGoal.at("a", (0, 0, 0.1)),
        match="goal 1 of 'a': its position is 0.1 m",
    )
    turned = FrameGoal.turned("a", (0.5, 0.5, 0.5, 0.5)), FrameGoal.turned("a", (1, 0, 0, 0))
    refused(*turned, match="its rotation is 2.09 rad from.*goal 0 of 'a'")
    refused(turned[1], FrameGoal.pointing("a", (1, 0, 0), UP, within=1.0), match="its direction is 0.571 rad")
    up, down = FrameGoal.pointing("a", UP, within=0.5), FrameGoal.pointing("a", (0, 0, -1), within=0.5)
    refused(up, down, match="its direction is 2.14 rad")


def test_contradictory_goals_of_one_link_are_refused() -> None:
    refused(FrameGoal.at("a", (0, 0, 0)), FrameGoal.at("b", (0, 0, 0.5)), match="0.5 m from where goal 0")
    assert notes(FrameGoal.at("a", (0, 0, 0)), FrameGoal.at("b", (0, 0, 0.4))) == ()
    posed = FrameGoal.posed("bent", TURN)
    refused(posed, FrameGoal.at("b", (0, 0, 0.4)), match="goal 1 of 'b': its position")


def test_goals_that_say_nothing_new_are_noted() -> None:
    posed = FrameGoal.posed("bent", TURN)
    (note,) = notes(posed, FrameGoal.at("b", (0.4, 0, 0)))
    assert note == "goal 1 of 'b': its position says nothing new of link 'floating': goal 0 of 'bent'"
    (note,) = notes(FrameGoal.pointing("a", UP, within=0.1), FrameGoal.pointing("a", UP, within=0.3))
    assert note.startswith("goal 1 of 'a': its direction")
    assert notes(FrameGoal.pointing("a", UP, within=0.3), FrameGoal.pointing("a", UP, within=0.1)) == ()


def test_goals_on_what_nothing_moves() -> None:
    where = place(BODY, np.array([0, 0, 0, 1, 0, 0, 0, 0.3, 0.0]))
    T = Pose.from_rotation(where.p[2], where.R[2]) @ TURN
    assert all("nothing moves it" in note for note in notes(FrameGoal.posed("post", T)))
    assert len(notes(FrameGoal.posed("post", T), FrameGoal.at("floor", (0, 0, 1)))) == 3
    refused(FrameGoal.at("floor", (0, 0, 1.1)), match="link 'world': nothing moves it")
    refused(FrameGoal.at("post", T.position + 0.01), match="link 'post': nothing moves it")
    refused(regions=(box("floor", (0, 0, 0), (1, 1, 0.5)),), match="0.5 m outside.*nothing moves it")
    assert notes(FrameGoal.at("flag", (0, 0, 0))) == ()


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6))
def test_least_distance_outside_is_that_of_cvxpy(seed) -> None:
    rng = np.random.default_rng(seed)
    regions, rows = [], []
    points, worst = [cp.Variable(3) for _ in range(2)], cp.Variable(nonneg=True)
    apart = float(rng.uniform(0, 0.5))
    for point in points:
        region = InRegion(
            "a", rng.standard_normal((5, 3)), rng.uniform(-1, 1, 5), np.zeros(3), rng.random(5) < 0.2
        )
        regions.append(region)
        over = region.A @ point - region.b
        rows.append(over <= worst)
        rows.append(cp.multiply(region.equal.astype(float), -over) <= worst)
    rows.append(cp.abs(points[0] - points[1]) <= apart)
    expected = cp.Problem(cp.Minimize(worst), rows).solve(solver="CLARABEL")
    found = least_outside(regions, np.array([[0.0, apart], [apart, 0.0]]))
    assert found == pytest.approx(expected, abs=1e-6)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6), st.integers(3, 7))
def test_an_end_in_every_direction_is_as_cvxpy_finds_it(seed, count) -> None:
    rng = np.random.default_rng(seed)
    region = InRegion(
        "a", rng.standard_normal((count, 3)), np.ones(count), np.zeros(3), np.zeros(count, dtype=bool)
    )
    point = cp.Variable(3)
    ends = [
        cp.Problem(cp.Maximize(sign * point[k]), [region.A @ point <= region.b]).solve(solver="SCIPY")
        for k in range(3)
        for sign in (1, -1)
    ]
    assert is_bounded(region) == bool(np.all(np.isfinite(ends)))


def test_whatever_a_configuration_answers_is_not_refused() -> None:
    rng = np.random.default_rng(0)
    for _ in range(10):
        quat = rng.standard_normal(4)
        q = np.concatenate([rng.uniform(-1, 1, 3), quat / np.linalg.norm(quat), [0.3, rng.uniform(-1, 1)]])
        placed, goals, regions = place(BODY, q), [], []
        for name, frame in BODY.frames.items():
            T = Pose.from_rotation(placed.p[frame.link], placed.R[frame.link]) @ frame.T_link_frame
            point, normals = rng.uniform(-0.3, 0.3, 3), rng.standard_normal((4, 3))
            goals.append(
                [
                    FrameGoal.posed(name, T),
                    FrameGoal.at(name, T.position),
                    FrameGoal.pointing(name, T.rotation[:, 2]),
                ][rng.integers(3)]
            )
            regions.append(InRegion.polytope(name, normals, normals @ T.apply(point), point))
        problem = MechanismProblem(BODY, tuple(goals), tuple(regions))
        check_problem(problem)
        check_regions(replace(problem, goals=()))
