"""Multipliers of the relaxation become certificates that are checked from the mechanism alone."""

from dataclasses import replace

import numpy as np
import pytest

from tests.ik.mechanisms.planted import planted, unit
from workcell.ik.ikspark.mechanisms.claim import certify_cost, certify_empty
from workcell.ik.ikspark.mechanisms.program import Program
from workcell.ik.ikspark.mechanisms.relaxation import Relaxation
from workcell.ik.mechanisms.check import check_cost, check_mechanism, why_no_bound
from workcell.ik.mechanisms.goals import FrameGoal
from workcell.ik.mechanisms.problem import MechanismProblem, MechanismTolerances
from workcell.model.mechanism.mechanism import Closure, Frame, Joint, Mechanism
from workcell.pose import Pose

X, Y, Z = np.eye(3)
AT_HOME = Pose.identity()


def at(x, y=0.0, z=0.0):
    return Pose.from_xyz([x, y, z])


def multipliers(problem, form="quaternion"):
    """What the relaxation has to say: multipliers where it is empty, else None."""
    relaxation = Relaxation.of(problem, form, pointing=False)
    program = Program(relaxation.lift.size, relaxation.rows)
    if program.contradiction is not None:
        return program.contradiction
    solution = program.solve(np.zeros(relaxation.lift.size))
    return program.multipliers(solution.z) if solution.status == "infeasible" else None


def certificate_of(problem, form="quaternion"):
    found = multipliers(problem, form)
    return None if found is None else certify_empty(problem, found)


def four_bar(reach=1.0, limits=(-np.inf, np.inf)):
    """A crank of 0.3 m, a coupler of `reach`, a rocker of 0.8 m, a ground of 1 m; a pen on the coupler."""
    joints = (
        Joint("crank", "hinge", 0, AT_HOME, Z, *limits),
        Joint("coupler", "hinge", 1, at(0.3), Z),
        Joint("rocker", "hinge", 0, at(1.0), Z),
    )
    return Mechanism(
        "four-bar",
        joints,
        ("world", "crank", "coupler", "rocker"),
        (Closure("pin", "connect", (2, 3), (at(reach), at(0.8))),),
        frames={"pen": Frame("pen", 2, at(0.5 * reach, 0.2)), "tip": Frame("tip", 3, at(0.8))},
    )


def platform(lower=0.7, upper=1.3):
    """A plate on six legs: each a ball, a slide, and a connect to the plate; the plate floats."""
    joints, names = [], ["world"]
    base = [0.5 * np.array([np.cos(a), np.sin(a), 0.0]) for a in np.linspace(0.0, 2.0 * np.pi, 7)[:6]]
    top = [0.3 * np.array([np.cos(a), np.sin(a), 0.0]) for a in np.linspace(0.5, 0.5 + 2.0 * np.pi, 7)[:6]]
    closures = []
    for leg in range(6):
        joints.append(Joint(f"foot{leg}", "ball", 0, at(*base[leg]), np.zeros(3)))
        joints.append(Joint(f"leg{leg}", "slide", 2 * leg + 1, AT_HOME, Z, lower, upper))
        names += [f"foot{leg}", f"rod{leg}"]
        closures.append(Closure(f"top{leg}", "connect", (2 * leg + 2, 13), (AT_HOME, at(*top[leg]))))
    joints.append(Joint("plate", "free", 0, AT_HOME, np.zeros(3)))
    frames = {"plate": Frame("plate", 13, AT_HOME)}
    return Mechanism("platform", tuple(joints), (*names, "plate"), tuple(closures), frames=frames)


def two_arms():
    """Two arms of three hinges that hold one bar, which is welded to both hands."""
    joints, names = [], ["world"]
    for side, y in enumerate((-0.4, 0.4)):
        first = 3 * side
        joints += [
            Joint(f"a{side}", "hinge", 0, at(0.0, y), Z, -2.0, 2.0),
            Joint(f"b{side}", "hinge", first + 1, at(0.4), Z, -2.0, 2.0),
            Joint(f"c{side}", "hinge", first + 2, at(0.4), Y, -1.5, 1.5),
        ]
        names += [f"a{side}", f"b{side}", f"c{side}"]
    joints.append(Joint("bar", "free", 0, AT_HOME, np.zeros(3)))
    closures = (
        Closure("left", "weld", (3, 7), (at(0.1), at(0.0, -0.1))),
        Closure("right", "weld", (6, 7), (at(0.1), at(0.0, 0.1))),
    )
    frames = {"bar": Frame("bar", 7, AT_HOME)}
    return Mechanism("arms", tuple(joints), (*names, "bar"), closures, frames=frames)


@pytest.mark.parametrize("form", ["quaternion", "rotation"])
def test_a_four_bar_whose_coupler_is_too_short_cannot_close(form):
    certificate = certificate_of(MechanismProblem(four_bar(reach=0.05, limits=(2.0, 4.0))), form)
    assert certificate is not None and certificate.scope == "kinematics"
    assert certificate.statement == (
        "No configuration within the joint limits keeps the ties within 0.001 mm and 1e-06 rad, obstacles aside."
    )


@pytest.mark.parametrize("mechanism", [four_bar(), two_arms(), platform()], ids=lambda m: m.name)
def test_what_is_out_of_reach_of_a_mechanism_is_proved_to_be(mechanism):
    frame = next(iter(mechanism.frames))
    for k in range(3):
        direction = unit(np.random.default_rng(k))
        for goal in (
            FrameGoal.at(frame, 2.5 * direction),
            FrameGoal.posed(frame, Pose.from_xyz(2.5 * direction)),
        ):
            problem = MechanismProblem(mechanism, (goal,))
            certificate = certificate_of(problem)
            assert certificate is not None
            assert check_mechanism(problem, certificate) is None


def test_legs_that_are_a_little_too_short_are_found_out():
    goal = FrameGoal.posed("plate", Pose.from_xyz([0.0, 0.0, 1.0]))
    length = float(np.linalg.norm([0.3 * np.cos(0.5) - 0.5, 0.3 * np.sin(0.5), 1.0]))
    for short, proved in ((0.01, True), (-0.01, False)):
        problem = MechanismProblem(platform(0.5, length - short), (goal,))
        assert (certificate_of(problem) is not None) is proved


def test_planar_links_count_from_either_side():
    mechanism = two_arms()
    # the bar upright, which hands about y only reach where their arms' planes are its own
    goal = FrameGoal.posed("bar", Pose(np.array([0.5, 0.0, 0.3]), np.array([1.0, 0.0, 0.0, 0.0])))
    problem = MechanismProblem(mechanism, (goal,))
    found = multipliers(problem)
    assert found is not None
    certificate = certify_empty(problem, found)
    assert certificate is not None and np.any(certificate.data["hangs"] >= 0)


def test_contradictory_goals_are_proved_to_be():
    mechanism = four_bar()
    both = (FrameGoal.at("pen", [0.4, 0.4, 0.0]), FrameGoal.at("pen", [0.4, 0.5, 0.0]))
    assert certificate_of(MechanismProblem(mechanism, both)) is not None
    out_of_plane = (FrameGoal.pointing("pen", X),)
    assert certificate_of(MechanismProblem(mechanism, out_of_plane)) is not None


def test_the_known_sides_may_be_given():
    problem = MechanismProblem(four_bar(), (FrameGoal.at("pen", [2.5, 0.0, 0.0]),))
    found = multipliers(problem)
    certificate = certify_empty(problem, found, planar=[0, 0, 0, 0])
    assert certificate is not None and np.array_equal(certificate.data["hangs"][1:], [0.0, 1.0, 2.0])


@pytest.mark.parametrize("seed", range(40))
def test_what_the_relaxation_finds_empty_is_proved(seed):
    problem, _ = planted(seed, MechanismTolerances(), worst=0.0)
    rng = np.random.default_rng(seed)
    goals = tuple(
        goal if goal.position is None else replace(goal, position=goal.position + 0.5 * rng.normal(size=3))
        for goal in problem.goals
    )
    moved = replace(problem, goals=goals)
    found = multipliers(moved)
    if found is None:
        return
    certificate = certify_empty(moved, found)
    assert certificate is not None
    assert check_mechanism(moved, certificate) is None
    # nothing of it is true of what has an answer
    assert certify_empty(problem, found) is None


def test_nothing_comes_of_nothing():
    problem = MechanismProblem(four_bar(), (FrameGoal.at("pen", [0.4, 0.3, 0.0]),))
    assert certify_empty(problem, {}) is None
    assert certify_empty(problem, {("user", 0): np.ones(3), ("sum", 0): np.ones(1)}) is None


def cost_multipliers(problem):
    """The least squared error of the relaxation: errors there, and multipliers of the other rows."""
    import cvxpy as cp

    relaxation = Relaxation.of(problem, poses=False)
    lift, x = relaxation.lift, cp.Variable(relaxation.lift.size)
    constraints, kept, errors = [], [], []
    for rows in relaxation.rows:
        value = rows.rows[:, :-1] @ x + rows.rows[:, -1]
        if rows.cone == "zero":
            constraints.append(value == 0)
        elif rows.cone == "nonneg":
            constraints.append(value >= 0)
        elif rows.cone == "soc":
            constraints.append(cp.SOC(value[0], value[1:]))
        else:
            Q, at_, order = cp.Variable((4, 4), PSD=True), 0, 4
            for j in range(order):
                for i in range(j + 1):
                    factor = 1.0 if i == j else np.sqrt(2.0)
                    constraints.append(value[at_] == factor * Q[i, j])
                    kept.append(None)
                    at_ += 1
            continue
        kept.append(rows)
    for goal in problem.goals:
        frame = problem.mechanism.frame(goal.frame)
        T = frame.T_link_frame
        R = np.einsum("ijx,jk->ikx", lift.rotations[frame.link], T.rotation).reshape(9, -1)
        p = lift.point(frame.link, T.position)
        target = np.concatenate([goal.rotation.ravel(), goal.position])
        both = np.vstack([R, p])
        errors.append(both[:, :-1] @ x + both[:, -1] - target)
    question = cp.Problem(cp.Minimize(sum(cp.sum_squares(error) for error in errors)), constraints)
    value = question.solve(solver=cp.CLARABEL)
    found = {}
    for rows, constraint in zip(kept, constraints, strict=True):
        if rows is None:
            continue
        z = constraint.dual_value
        if rows.cone == "soc":
            z = np.concatenate([np.atleast_1d(z[0]), np.ravel(z[1])])
        # cvxpy adds multipliers of equalities, where ours are taken away
        found[(rows.family, rows.index)] = -np.atleast_1d(z) if rows.cone == "zero" else np.atleast_1d(z)
    return value, np.array([error.value for error in errors]), found


@pytest.mark.parametrize("mechanism", [four_bar(), two_arms(), platform()], ids=lambda m: m.name)
def test_the_closest_configuration_has_a_certified_bound(mechanism):
    frame = next(iter(mechanism.frames))
    goal = FrameGoal.posed(frame, Pose.from_xyz([1.5, 0.3, 1.6]))
    problem = MechanismProblem(mechanism, (goal,))
    value, errors, found = cost_multipliers(problem)
    assert value > 0.1
    bound, certificate = certify_cost(problem, errors, found)
    assert value - 1e-4 <= bound <= value + 1e-6
    assert check_cost(problem, certificate) == bound
    assert check_mechanism(problem, certificate) is not None
    assert "squared pose errors (metres, and entries of rotations) below" in certificate.statement
    assert why_no_bound(problem, replace(certificate, margin=1.001 * bound)) is not None
    assert check_cost(replace(problem, goals=()), certificate) is None
