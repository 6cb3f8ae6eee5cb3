"""The plain relaxation contains every configuration, in all its forms, and is one where its blocks have rank 1."""

from __future__ import annotations

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.ik.ikspark.mechanisms.plain.chance import mechanism_of, unit
from workcell.errors import InputError
from workcell.ik.ikspark.mechanisms.plain.relaxation import plain_relaxation, pose_cost
from workcell.ik.mechanisms.goals import FrameGoal, InRegion
from workcell.ik.mechanisms.problem import MechanismProblem, UserConstraint
from workcell.model.mechanism.mechanism import Follower, Joint, JointSum, Mechanism
from workcell.model.mechanism.placing import place
from workcell.pose import Pose

VARIANTS = [
    *(("quaternion", slide) for slide in ("split", "whole", "paper", "three")),
    ("rotation", "paper"),
]
TIGHT = {"solver": "CLARABEL", "tol_gap_abs": 1e-8, "tol_gap_rel": 1e-8, "tol_feas": 1e-8}
KINDS = st.lists(st.sampled_from(["hinge", "slide", "ball", "free"]), min_size=1, max_size=4)


def question(mechanism, q, rng) -> MechanismProblem:
    """All kinds of rows, answered by q."""
    placed, last = place(mechanism, q), f"f{len(mechanism.joints)}"
    frame = mechanism.frames[last]
    T = Pose.from_rotation(placed.p[frame.link], placed.R[frame.link]) @ frame.T_link_frame
    near = unit(rng, 3) * 0.3 + T.rotation[:, 2]
    normals = np.stack([unit(rng, 3) for _ in range(4)])
    point = rng.uniform(-0.2, 0.2, 3)
    return MechanismProblem(
        mechanism,
        goals=(
            FrameGoal.posed(last, T),
            FrameGoal.pointing(last, T.rotation[:, 0], (1.0, 0.0, 0.0)),
            FrameGoal.pointing(last, near / np.linalg.norm(near), within=0.4),
        ),
        regions=(
            InRegion.polytope(last, normals, normals @ T.apply(point) + rng.uniform(0, 0.1, 4), point),
            InRegion.plane(last, normals[0], float(normals[0] @ T.position)),
        ),
        constraints=(UserConstraint("ball", lambda e: [cp.norm(e.point(last) - T.position) <= 0.1]),),
        q_reference=q,
        max_step=0.5,
        max_link_rotation=0.7,
    )


@settings(max_examples=25, deadline=None)
@given(KINDS, st.booleans(), st.sampled_from([None, "connect", "weld"]), st.integers(0, 10**6))
def test_every_configuration_is_in_it_and_is_read_back(kinds, tree, loop, seed) -> None:
    rng = np.random.default_rng(seed)
    mechanism, q = mechanism_of(rng, kinds, tree=tree, loop=loop)
    problem = question(mechanism, q, rng)
    form, slide = VARIANTS[seed % len(VARIANTS)]
    relaxed, model = plain_relaxation(problem, form, slide)
    model.put(q)
    for constraint in relaxed.constraints:
        assert np.max(constraint.violation(), initial=0.0) < 1e-8, constraint
    assert np.max(model.gaps, initial=0.0) < 1e-12
    assert float(pose_cost(model).value) < 1e-15
    placed, found = place(mechanism, q), place(mechanism, model.configuration())
    np.testing.assert_allclose(found.R, placed.R, atol=1e-7)
    np.testing.assert_allclose(found.p, placed.p, atol=1e-7)
    for link in range(mechanism.link_count):
        np.testing.assert_allclose(model.rotations[link].value, placed.R[link], atol=1e-9)
        np.testing.assert_allclose(model.origins[link].value, placed.p[link], atol=1e-9)


def test_what_breaks_a_row_is_not_in_it() -> None:
    rng = np.random.default_rng(1)
    mechanism, q = mechanism_of(rng, ["hinge", "slide", "ball", "hinge"], loop="weld")
    problem = question(mechanism, q, rng)
    relaxed, model = plain_relaxation(problem)
    other = np.array(q)
    other[0] += 0.01
    model.put(other)
    assert max(np.max(one.violation(), initial=0.0) for one in relaxed.constraints) > 1e-3


def least(problem, form, slide, seed) -> float:
    """The optimum of a random linear function of all rotations and one point."""
    relaxed, model = plain_relaxation(problem, form, slide)
    rng = np.random.default_rng(seed)
    cost = rng.standard_normal(3) @ model.origins[-1]
    for rotation in model.rotations:
        cost = cost + cp.sum(cp.multiply(rng.standard_normal((3, 3)), rotation))
    optimum = cp.Problem(cp.Minimize(cost), relaxed.constraints)
    optimum.solve(**TIGHT)
    assert optimum.status == "optimal"
    return float(optimum.value)


def reaching(kinds, seed, loop=None) -> MechanismProblem:
    rng = np.random.default_rng(seed)
    mechanism, q = mechanism_of(rng, kinds, loop=loop)
    last = f"f{len(kinds)}"
    frame = mechanism.frames[last]
    position = place(mechanism, q).point(frame.link, frame.T_link_frame.position)
    return MechanismProblem(mechanism, (FrameGoal.at(last, position),))


@pytest.mark.parametrize(
    ("kinds", "loop"),
    [
        (["hinge", "slide", "ball"], None),
        (["ball", "slide", "ball"], "connect"),
        (["ball", "hinge", "slide"], None),
    ],
)
def test_forms_and_lifts_of_slides_contain_each_other(kinds, loop) -> None:
    problem = reaching(kinds, 3, loop)
    split, whole, paper, three, rotation = (least(problem, *variant, 0) for variant in VARIANTS)
    assert whole == pytest.approx(split, abs=1e-5), "both are the hull"
    assert split >= paper - 1e-6, "the paper's contains it"
    assert three == pytest.approx(paper, abs=1e-5), "three submatrices say what the whole matrix says"
    assert paper >= rotation - 1e-6, "the quaternion form is the hull of rotations"


def least_over_rotations(weights: np.ndarray) -> float:
    """The least of <weights, R> over all rotations, by singular values."""
    sizes = np.linalg.svd(weights, compute_uv=False)
    return -float(sizes[0] + sizes[1] + np.sign(np.linalg.det(-weights)) * sizes[2])


def test_the_quaternion_form_is_the_hull_of_rotations_and_the_rotation_form_contains_it() -> None:
    free = Joint("turns", "ball", 0, Pose.identity(), np.zeros(3))
    problem = MechanismProblem(Mechanism("one", (free,), ("world", "body")))
    rng = np.random.default_rng(4)
    for _ in range(2):
        weights, values = rng.standard_normal((3, 3)), []
        for form in ("quaternion", "rotation"):
            relaxed, model = plain_relaxation(problem, form)
            cost = cp.sum(cp.multiply(weights, model.rotations[1]))
            values.append(cp.Problem(cp.Minimize(cost), relaxed.constraints).solve(**TIGHT))
        assert values[0] == pytest.approx(least_over_rotations(weights), abs=1e-6)
        assert values[1] <= values[0] + 1e-6


def test_the_split_slide_is_the_hull_of_rotations_and_values() -> None:
    """A linear function is least at one of the slide's ends."""
    rng = np.random.default_rng(5)
    joints = (
        Joint("turns", "ball", 0, Pose.identity(), np.zeros(3)),
        Joint("slides", "slide", 1, Pose.identity(), unit(rng, 3), -0.5, 1.5),
    )
    problem = MechanismProblem(Mechanism("two", joints, ("world", "body", "sled")))
    relaxed, model = plain_relaxation(problem)
    for _ in range(3):
        weights, along, share = rng.standard_normal((3, 3)), 2 * rng.standard_normal(3), rng.standard_normal()
        cost = cp.sum(cp.multiply(weights, model.rotations[1])) + along @ model.slides[1].product
        cost = cost + share * model.slides[1].value
        value = cp.Problem(cp.Minimize(cost), relaxed.constraints).solve(**TIGHT)
        ends = [
            least_over_rotations(weights + end * np.outer(along, joints[1].axis)) + share * end
            for end in (-0.5, 1.5)
        ]
        assert value == pytest.approx(min(ends), abs=1e-6)


def sleds(*, sums=(), followers=(), turning=False) -> Mechanism:
    """Three slides, on the world or on a body that turns."""
    joints = tuple(
        Joint(f"s{k}", "slide", int(turning), Pose.identity(), np.eye(3)[k], 0.0, 1.0) for k in range(3)
    )
    if turning:
        joints = (Joint("turns", "ball", 0, Pose.identity(), np.zeros(3)), *joints)
    names = ("world", *(joint.name for joint in joints))
    return Mechanism("sleds", joints, names, sums=sums, followers=followers)


@pytest.mark.parametrize("turning", [False, True])
def test_slides_among_slides_by_rows(turning) -> None:
    first = int(turning)
    a, b, c = first, first + 1, first + 2
    mechanism = sleds(
        sums=(JointSum("tendon", (a, b), np.array([1.0, 2.0]), 0.5, 1.0),),
        followers=(Follower("c follows a", c, a, np.array([0.3, 0.5])),),
        turning=turning,
    )
    relaxed, model = plain_relaxation(MechanismProblem(mechanism))
    most = cp.Problem(cp.Maximize(model.slides[c].value), relaxed.constraints).solve(**TIGHT)
    assert most == pytest.approx(0.3 + 0.5 * 1.0, abs=1e-6)
    least_b = cp.Problem(
        cp.Minimize(model.slides[b].value), [*relaxed.constraints, model.slides[a].value <= 0.1]
    ).solve(**TIGHT)
    assert least_b == pytest.approx(0.2, abs=1e-6)


def test_a_slide_held_by_what_it_follows() -> None:
    mechanism = sleds(followers=(Follower("held", 1, -1, np.array([0.4])),))
    relaxed, model = plain_relaxation(MechanismProblem(mechanism))
    relaxed.solve(**TIGHT)
    assert model.slides[1].value.value == pytest.approx(0.4, abs=1e-6)


def test_floating_bodies_stay_in_the_workspace() -> None:
    joint = Joint("floats", "free", 0, Pose.identity(), np.zeros(3))
    problem = MechanismProblem(Mechanism("one", (joint,), ("world", "body")))
    relaxed, model = plain_relaxation(problem, workspace=(np.zeros(3), np.array([1.0, 2.0, 3.0])))
    most = cp.Problem(cp.Maximize(cp.sum(model.origins[1])), relaxed.constraints).solve(**TIGHT)
    assert most == pytest.approx(6.0, abs=1e-6)


def test_a_reference_outside_the_limits_leaves_nothing() -> None:
    problem = MechanismProblem(sleds(), q_reference=np.array([3.0, 0.5, 0.5]), max_step=0.1)
    relaxed, _ = plain_relaxation(problem)
    relaxed.solve(solver="CLARABEL")
    assert relaxed.status == "infeasible"


def test_bad_input_is_refused() -> None:
    problem = reaching(["ball", "slide"], 0)
    with pytest.raises(InputError, match="no form"):
        plain_relaxation(problem, "euler")
    with pytest.raises(InputError, match="no lift"):
        plain_relaxation(problem, slide="none")
    with pytest.raises(InputError, match="quaternion form alone"):
        plain_relaxation(problem, "rotation", "whole")
    joints = (
        Joint("turns", "ball", 0, Pose.identity(), np.zeros(3)),
        Joint("slides", "slide", 1, Pose.identity(), np.eye(3)[0]),
    )
    with pytest.raises(InputError, match="finite limits"):
        plain_relaxation(MechanismProblem(Mechanism("endless", joints, ("world", "a", "b"))))


@pytest.mark.parametrize(("form", "slide"), VARIANTS)
def test_two_metres_further_is_infeasible(form, slide) -> None:
    problem = reaching(["hinge", "slide", "hinge"], 5)
    goal = problem.goals[0]
    far = MechanismProblem(
        problem.mechanism, (FrameGoal.at(goal.frame, goal.position + np.array([4.0, 0.0, 0.0])),)
    )
    relaxed, _ = plain_relaxation(far, form, slide)
    relaxed.solve(solver="CLARABEL")
    assert relaxed.status == "infeasible"
