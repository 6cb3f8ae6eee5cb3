"""The solver's reduced program has the optima and verdicts of the plain relaxation, which reduces nothing."""

from __future__ import annotations

from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest

from tests.ik.ikspark.mechanisms.plain.chance import mechanism_of
from workcell.ik.ikspark.mechanisms.plain.relaxation import plain_relaxation
from workcell.ik.ikspark.mechanisms.program import Program
from workcell.ik.ikspark.mechanisms.relaxation import Relaxation
from workcell.ik.ikspark.mechanisms.users.constraints import conic_rows
from workcell.ik.mechanisms.goals import FrameGoal, InRegion
from workcell.ik.mechanisms.problem import MechanismProblem, UserConstraint
from workcell.model.mechanism.placing import place
from workcell.pose import Pose

TIGHT = {"solver": "CLARABEL", "tol_gap_abs": 1e-9, "tol_gap_rel": 1e-9, "tol_feas": 1e-9}


def near(e):
    return [cp.norm(e.point("f1")) <= 1.2, e.rotation("f1")[0, 0] >= -0.5]


def asked(kinds, seed, loop, what) -> tuple[MechanismProblem, np.ndarray]:
    rng = np.random.default_rng(seed)
    mechanism, q = mechanism_of(rng, kinds, loop=loop)
    joints = tuple(
        replace(joint, lower=-np.inf, upper=np.inf)
        if joint.kind == "hinge" and "limits" not in what
        else joint
        for joint in mechanism.joints
    )
    mechanism = replace(mechanism, joints=joints)
    last = mechanism.frames[f"f{len(kinds)}"]
    placed = place(mechanism, q)
    T = Pose.from_rotation(placed.p[last.link], placed.R[last.link]) @ last.T_link_frame
    goals = {
        "at": (FrameGoal.at(last.name, T.position),),
        "posed": (FrameGoal.posed(last.name, T),),
        "cone": (FrameGoal.pointing(last.name, T.rotation[:, 2], position=T.position, within=0.2),),
    }
    problem = MechanismProblem(mechanism, next((goals[name] for name in what.split() if name in goals), ()))
    if "region" in what:
        normals = rng.standard_normal((5, 3))
        region = InRegion.polytope(last.name, normals, normals @ T.position + rng.uniform(0, 0.2, 5))
        problem = replace(problem, regions=(region,))
    if "steps" in what:
        problem = replace(problem, q_reference=q, max_step=0.4, max_link_rotation=0.8)
    if "user" in what:
        problem = replace(problem, constraints=(UserConstraint("near", near),))
    return problem, q


CASES = [
    (("hinge", "hinge", "hinge", "hinge"), None, "at"),
    (("hinge", "slide", "hinge", "ball"), None, "posed"),
    (("ball", "slide", "ball"), "connect", "at"),
    (("free", "hinge", "slide"), "weld", "cone region"),
    (("slide", "slide", "ball", "hinge"), None, "at region"),
    (("free", "ball", "slide"), None, "posed steps"),
    (("ball", "slide", "hinge"), None, "at user"),
]


def optima(problem: MechanismProblem, form: str, slide: str, seed: int) -> tuple[float, float]:
    """The least of a linear function of rotations, one point and slides: the program's, the plain relaxation's."""
    relaxation = Relaxation.of(problem, form)
    lift, rng = relaxation.lift, np.random.default_rng(seed)
    extra = conic_rows(problem.constraints, lift) if problem.constraints else None
    program = Program(lift.size, relaxation.rows, extra, tolerance=1e-9)
    assert program.contradiction is None
    plain, model = plain_relaxation(problem, form, slide)
    cost, row = 0.0, np.zeros(lift.size + 1)
    for link in range(1, problem.mechanism.link_count):
        weights = rng.standard_normal((3, 3))
        cost = cost + cp.sum(cp.multiply(weights, model.rotations[link]))
        row = row + np.einsum("ij,ijx->x", weights, lift.rotations[link])
    along = rng.standard_normal(3)
    cost, row = cost + along @ model.origins[-1], row + along @ lift.origins[-1]
    for joint in model.slides:
        share = rng.standard_normal()
        cost, row = cost + share * model.slides[joint].value, row + share * lift.slide_row(joint)
    oracle = cp.Problem(cp.Minimize(cost), plain.constraints)
    oracle.solve(**TIGHT)
    assert oracle.status in ("optimal", "optimal_inaccurate")
    solution = program.solve(row[:-1])
    assert solution.usable
    return float(row[:-1] @ solution.x + row[-1]), float(oracle.value)


@pytest.mark.parametrize(
    ("kinds", "loop", "what"), CASES, ids=lambda case: "-".join(case) if case else "open"
)
def test_optima_agree(kinds, loop, what) -> None:
    problem, _ = asked(kinds, 7, loop, what)
    ours, plain = optima(problem, "quaternion", "split", 0)
    assert ours == pytest.approx(plain, abs=1e-5)


def test_optima_agree_in_the_rotation_form() -> None:
    problem, _ = asked(("hinge", "ball", "hinge", "hinge"), 3, None, "at")
    ours, plain = optima(problem, "rotation", "paper", 0)
    assert ours == pytest.approx(plain, abs=1e-5)


@pytest.mark.parametrize("kinds", [("hinge", "hinge", "hinge"), ("hinge", "slide", "ball", "hinge")])
def test_limits_next_to_known_links_only_cut_more_off(kinds) -> None:
    problem, _ = asked(kinds, 5, None, "at limits")
    ours, plain = optima(problem, "quaternion", "split", 1)
    assert ours >= plain - 1e-5


@pytest.mark.parametrize(
    "kinds", [("hinge", "hinge", "hinge"), ("hinge", "slide", "ball"), ("slide", "ball")]
)
def test_both_find_far_goals_infeasible(kinds) -> None:
    problem, _ = asked(kinds, 2, None, "posed")
    goal = problem.goals[0]
    far = Pose.from_rotation(goal.position + np.array([4.0, 0.0, 0.0]), goal.rotation)
    problem = replace(problem, goals=(FrameGoal.posed(goal.frame, far),))
    plain, _ = plain_relaxation(problem)
    plain.solve(solver="CLARABEL")
    assert plain.status == "infeasible"
    relaxation = Relaxation.of(problem)
    program = Program(relaxation.lift.size, relaxation.rows)
    assert (
        program.contradiction is not None
        or program.solve(np.zeros(relaxation.lift.size)).status == "infeasible"
    )
