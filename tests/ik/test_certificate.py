"""Proofs: made where there is no solution, never where there is one, refused when damaged, kept when saved."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from tests.ik.arms import beads, box
from tests.ik.lifted_arms import parallel_elbow, scara, seven_axis, skew_arm
from workcell.errors import InputError
from workcell.geometry.types import FreeSpace
from workcell.ik.branch.checker.check import scope_of
from workcell.ik.certificate import Certificate, Grounds, Scope, problem_hash, proof_scope
from workcell.ik.check import check_certificate
from workcell.ik.claims.chain import Chain
from workcell.ik.ikspark.bound import Multipliers, Sum, upper_bound
from workcell.ik.ikspark.check import check_farkas, margin
from workcell.ik.ikspark.instance import instance_of, relaxation_of
from workcell.ik.ikspark.obstacles.cuboids import whole_set
from workcell.ik.ikspark.obstacles.pairs import reachable_pairs
from workcell.ik.ikspark.rays import certify_kinematics, certify_model
from workcell.ik.ikspark.solver import solve_ikspark
from workcell.ik.problem import Budget, Clearance, IKProblem, Tolerances
from workcell.ik.registry import SOLVERS, load
from workcell.model.robot import Robot
from workcell.pose import Pose, axis_angle_to_matrix

BUDGET = Budget(10.0)


def nearly_parallel() -> Robot:
    """Three axes that a file with few digits makes 1e-5 rad apart."""
    robot = scara()
    axis = np.array(robot.axis)
    for k, tilt in enumerate((0.0, 1e-5, -1e-5)):
        axis[k] = axis_angle_to_matrix(np.eye(3)[0], tilt) @ axis[k]
    return replace(robot, name="nearly", axis=axis)


def far(robot: Robot, seed: int = 0, away: float = 2.0) -> IKProblem:
    target = robot.fk(robot.random_configuration(np.random.default_rng(seed)))
    return IKProblem(robot, Pose(target.position + away * np.eye(3)[0], target.quat_wxyz))


def proof(problem: IKProblem) -> Certificate:
    candidate = solve_ikspark(problem, BUDGET, 0)
    assert candidate.q is None and candidate.certificate is not None, candidate
    return candidate.certificate


ARMS = [seven_axis(), parallel_elbow(), scara(), *(skew_arm(n, n) for n in (1, 2, 3, 5, 8))]


@pytest.mark.parametrize("robot", ARMS, ids=lambda robot: f"{robot.name}{robot.dof}")
def test_far_targets_are_certified(robot: Robot) -> None:
    problem = far(robot, away=4.0)
    certificate = proof(problem)
    assert certificate.scope == "kinematics" and certificate.margin > 0
    assert check_farkas(problem, certificate) is None


def test_joint_limits_alone_can_be_the_reason() -> None:
    robot, wide = seven_axis(0.4), seven_axis()
    problem = IKProblem(robot, wide.fk(np.array([2.5, 1.0, 0.3, -1.5, 0.2, 1.0, 0.0])))
    certificate = proof(problem)
    assert check_farkas(problem, certificate) is None
    assert solve_ikspark(replace(problem, robot=wide), BUDGET, 0).q is not None


def test_a_step_too_long_is_certified_as_such() -> None:
    robot = seven_axis()
    q = np.array([0.3, 0.6, -0.4, 1.2, 0.2, 0.8, 0.0])
    target = robot.fk(q)
    moved = Pose(target.position + 0.1 * np.eye(3)[0], target.quat_wxyz)
    problem = IKProblem(robot, moved, q_reference=q, max_step=0.02)
    certificate = proof(problem)
    assert check_farkas(problem, certificate) is None
    assert "max_step of q_reference" in certificate.statement
    assert solve_ikspark(replace(problem, max_step=None), BUDGET, 0).q is not None


def test_a_target_off_the_plane_of_a_planar_arm() -> None:
    robot = scara()
    target = robot.fk(np.array([0.3, 0.5, -0.2]))
    problem = IKProblem(robot, Pose(target.position + 0.01 * np.eye(3)[2], target.quat_wxyz))
    assert check_farkas(problem, proof(problem)) is None


def any_multipliers(robot: Robot, rng: np.random.Generator) -> Multipliers:
    """Numbers that no solver would think of; planar links anywhere."""
    n = robot.dof
    first = int(rng.integers(0, n))
    last = int(rng.integers(0, n - first))
    chords = np.abs(rng.standard_normal(2)) * [first > 0, last > 0]
    size = 10.0 ** rng.uniform(-9, 9)
    axes, limits = size * rng.standard_normal((2, n, 3))
    return Multipliers((first, last), axes, size * rng.standard_normal(3), limits, size * chords)


@pytest.mark.parametrize("robot", [*ARMS, nearly_parallel()], ids=lambda robot: f"{robot.name}{robot.dof}")
def test_the_bound_lies_above_every_configuration_that_reaches_within_the_tolerances(robot: Robot) -> None:
    """F at configurations whose tool is anywhere in the ball: zero or more, and never above the bound."""
    rng, covered = np.random.default_rng(robot.dof), np.array([5e-3, 5e-2])
    for _ in range(40):
        q = robot.random_configuration(rng)
        T, (direction, axis) = robot.fk(q), rng.standard_normal((2, 3))
        shift = covered[0] * direction / np.linalg.norm(direction)
        turn = axis_angle_to_matrix(axis / np.linalg.norm(axis), covered[1])
        problem = IKProblem(robot, Pose.from_rotation(T.position + shift, turn @ T.rotation))
        chain, m = Chain.of(problem), any_multipliers(robot, rng)
        total = Sum(chain, m)
        R = problem.robot.link_transforms(q)[:, :3, :3]
        at_q = total.constant + float(np.sum(total.N * (R[0].T @ R)))
        at_q += float(m.chords @ np.cos(q - chain.middle)[[0, -1]])
        at_q += float(m.position @ (chain.position - problem.robot.T_world_base.inverse().apply(T.position)))
        bound = upper_bound(chain, m, total, *covered)
        assert -1e-9 * m.length() <= at_q + covered[0] * np.linalg.norm(m.position)
        assert at_q <= bound + 1e-9 * m.length()
        assert margin(problem, m, covered) <= 0.0


@pytest.mark.parametrize("seed", range(6))
def test_no_ray_certifies_a_reachable_target(seed: int) -> None:
    """Whatever is handed in as a ray: rays of far targets, random vectors, zeros."""
    robot, rng = seven_axis(), np.random.default_rng(seed)
    problem = IKProblem(robot, robot.fk(robot.random_configuration(rng)))
    rows = relaxation_of(problem).cones.rows
    for z in (rng.standard_normal(rows), np.zeros(rows)):
        assert certify_kinematics(problem, z) is None
    stolen = replace(proof(far(robot, seed)), problem_hash=problem_hash(problem))
    for size in (1.0, 1e-12, 1e12, 0.0):
        data = {name: size * values for name, values in stolen.data.items()}
        kept = {name: stolen.data[name] for name in ("tolerances", "planar")}
        refusal = check_farkas(problem, replace(stolen, data=data | kept))
        assert refusal is not None and "does not prove" in refusal


def test_borrowed_damaged_and_overclaiming_certificates_are_refused() -> None:
    problem = far(seven_axis())
    certificate = proof(problem)

    def refused(problem: IKProblem, changed: Certificate, because: str) -> None:
        reason = check_farkas(problem, changed)
        assert reason is not None and because in reason

    def with_numbers(**numbers: np.ndarray) -> Certificate:
        return replace(certificate, data={**certificate.data, **numbers})

    refused(far(seven_axis(), seed=1), certificate, "another problem")
    wider = replace(problem, tolerances=Tolerances(position=0.1))
    refused(wider, replace(certificate, problem_hash=problem_hash(wider)), "tolerances")
    axes = np.asarray(certificate.data["axes"])
    for name in certificate.data:
        left = {key: values for key, values in certificate.data.items() if key != name}
        refused(problem, replace(certificate, data=left), f"'{name}' is missing")
    refused(problem, with_numbers(axes=axes[:-1]), "shape")
    refused(problem, with_numbers(axes=np.full_like(axes, np.nan)), "not finite")
    refused(problem, with_numbers(axes=np.full_like(axes, 1e60)), "larger than")
    refused(problem, with_numbers(axes=-axes), "does not prove")
    refused(problem, with_numbers(chords=np.array([-1e-300, 0.0])), "negative")
    refused(problem, with_numbers(tolerances=np.array([1e-4, 2.0])), "exceed")
    for planar in ([0.5, 1.0], [-1.0, 1.0], [1e300, 0.0], [4.0, 4.0]):
        refused(
            problem, with_numbers(planar=np.array(planar) % 1e49), "planar links" if max(planar) < 4 else ""
        )
    refused(problem, with_numbers(planar=np.zeros(2), chords=np.ones(2)), "belongs to a planar link")
    refused(problem, with_numbers(ray=axes), "'ray' has no place")
    refused(problem, replace(certificate, scope="model"), "of the scope 'kinematics'")
    refused(problem, replace(certificate, scope="geometry"), "of the scope 'kinematics'")
    refused(problem, replace(certificate, margin=1.1 * certificate.margin), "the margin is")
    refused(problem, replace(certificate, margin=1e-9), "the margin is")
    refused(problem, replace(certificate, statement="No way."), "the statement is not")
    refused(problem, replace(certificate, kind="reach"), "kind")


def test_a_proof_is_worth_the_same_at_any_scale() -> None:
    problem = far(seven_axis())
    certificate = proof(problem)
    for size in (1e-12, 1e12):
        data = {name: size * values for name, values in certificate.data.items()}
        kept = {name: certificate.data[name] for name in ("tolerances", "planar")}
        assert check_farkas(problem, replace(certificate, data=data | kept)) is None


def test_what_was_written_before_is_refused_by_name() -> None:
    problem = far(seven_axis())
    old = replace(proof(problem), kind="farkas")
    assert "ask ikspark again" in str(check_certificate(problem, old))


def test_nearly_parallel_axes_prove_what_is_true_of_them() -> None:
    """Axes 1e-5 rad apart, taken as parallel: a target that only their departure reaches is not proved away."""
    robot = nearly_parallel()
    for seed in range(5):
        q = robot.random_configuration(np.random.default_rng(seed))
        problem = IKProblem(robot, robot.fk(q), tolerances=Tolerances(1e-7, 1e-6))
        assert solve_ikspark(problem, Budget(0.2), 0).certificate is None
    assert proof(far(robot, away=3.0)).margin > 0


def test_saved_and_read_back() -> None:
    problem = far(parallel_elbow())
    certificate = proof(problem)
    again = Certificate.from_json(json.dumps(certificate.to_json()))
    assert again.to_json() == certificate.to_json()
    assert check_farkas(problem, again) is None


@pytest.mark.parametrize(
    ("change", "because"),
    [
        (lambda d: d.pop("format"), "not a certificate"),
        (lambda d: d.update(kind=3), "kind"),
        (lambda d: d.update(scope="everything"), "scope"),
        (lambda d: d.update(margin="big"), "margin"),
        (lambda d: d.update(margin=float("nan")), "margin"),
        (lambda d: d.update(data=[]), "data"),
        (lambda d: d["data"].update(axes=[1, 2]), "data.axes"),
        (lambda d: d["data"]["axes"].update(shape=[7]), "data.axes"),
        (lambda d: d["data"]["axes"].update(shape=[-1, 2]), "data.axes"),
        (lambda d: d["data"]["axes"].update(values=["x"]), "data.axes"),
        (lambda d: d["data"]["tolerances"].update(values=[1e-4, float("inf")]), "data.tolerances"),
        (lambda d: d["data"]["tolerances"].update(values=[True, 1.0]), "data.tolerances"),
        (lambda d: d["data"]["tolerances"].update(values=["1", 1.0]), "data.tolerances"),
        (lambda d: d["data"]["tolerances"].update(values=[10**400, 1.0]), "data.tolerances"),
        (lambda d: d["data"]["tolerances"].update(shape=[2.0]), "data.tolerances"),
        (lambda d: d["data"]["tolerances"].update(shape=[1] * 9 + [2]), "data.tolerances"),
        (lambda d: d["data"].update({"\udc00": {"shape": [1]}}), "data."),
    ],
)
def test_damaged_documents(change, because: str) -> None:
    document = json.loads(json.dumps(proof(far(seven_axis())).to_json()))
    change(document)
    with pytest.raises(InputError, match=r"cert\.json") as caught:
        Certificate.from_json(document, "cert.json")
    assert because in str(caught.value)


def test_not_json_at_all() -> None:
    twice, deep = '{"a": 1, "a": 1}', "[" * 99 + "]" * 99
    wrong = ((twice, "twice"), (deep, "too deeply"), ("", "not JSON"), ("[", "not JSON"), ("[]", "an object"))
    for text, words in (*wrong, ("7", "an object")):
        with pytest.raises(InputError, match=words):
            Certificate.from_json(text)


def test_the_hash_sees_what_a_proof_depends_on() -> None:
    problem = far(seven_axis())
    robot = problem.robot
    changed = [
        replace(problem, target=Pose(problem.target.position + 1e-12, problem.target.quat_wxyz)),
        replace(problem, robot=replace(robot, upper=np.asarray(robot.upper) + 1e-9)),
        replace(problem, obstacles=(box("a", (1, 1, 1), (0.1, 0.1, 0.1)),)),
        replace(problem, cover=beads(robot)),
        replace(problem, q_reference=np.zeros(7)),
        replace(problem, q_reference=np.zeros(7), max_step=0.1),
        replace(problem, tolerances=Tolerances(position=1e-3)),
        replace(problem, free_space=FreeSpace([[0, 0, 0]], [[1, 1, 1]])),
    ]
    assert len({problem_hash(p) for p in [problem, *changed]}) == len(changed) + 1
    renamed = replace(problem, robot=replace(robot, name="other"), checker=lambda q: None)
    assert problem_hash(renamed) == problem_hash(problem)


def walled(seed: int, cuboids: FreeSpace) -> IKProblem:
    robot = seven_axis()
    target = robot.fk(np.random.default_rng(seed).uniform(-1.5, 1.5, 7))
    return IKProblem(robot, target, cover=beads(robot, 0.04), free_space=cuboids)


def test_free_space_too_small_for_the_arm_is_certified_in_the_model() -> None:
    problem = walled(0, FreeSpace([[-1, -1, 0], [-0.1, -0.1, 0.0]], [[-0.3, 1, 0.9], [0.1, 0.1, 0.4]]))
    with instance_of(problem) as instance:
        cuboids = whole_set(instance, problem, problem.free_space)
        if cuboids is not None:
            outcome = cuboids.solve(np.zeros(instance.lift.size))
            assert outcome.status == "infeasible"
            certificate = certify_model(problem, outcome.z)
            assert certificate is not None and certificate.scope == "model"
            assert check_farkas(problem, certificate) is None
            saved = Certificate.from_json(certificate.to_json())
            assert check_farkas(problem, saved) is None
            places = np.asarray(certificate.data["places"])
            broken = replace(certificate, data={**certificate.data, "places": 0.0 * places})
            assert "does not prove" in str(check_farkas(problem, broken))
        else:
            pytest.fail("the example should need the relaxation, not only distances")


@pytest.mark.parametrize("seed", range(4))
def test_pairs_that_hold_a_sphere_are_never_dropped(seed: int) -> None:
    """Cuboids around a known solution's spheres: pruning keeps those pairs, and nothing certifies their absence."""
    robot, rng = seven_axis(), np.random.default_rng(seed)
    q = rng.uniform(-1.5, 1.5, 7)
    cover = beads(robot, 0.04)
    centres = cover.centres_world(robot.link_transforms(q))
    size = 0.04 + rng.uniform(1e-3, 0.1, (len(cover), 1))
    free_space = FreeSpace(centres - size, centres + size)
    problem = IKProblem(robot, robot.fk(q), cover=cover, free_space=free_space)
    pairs = reachable_pairs(problem, free_space)
    with instance_of(problem) as instance:
        for j, sphere in enumerate(pairs.sphere):
            assert pairs.allowed[j, sphere]
        cuboids = whole_set(instance, problem, free_space)
        assert cuboids is not None
        outcome = cuboids.solve(np.zeros(instance.lift.size))
        assert outcome.usable
        assert certify_model(problem, rng.standard_normal(len(outcome.z))) is None
        assert certify_model(problem, outcome.z) is None


def test_the_solver_reports_a_proof_in_the_model() -> None:
    """A box around the shoulder lets no attempt succeed, and says nothing of the last link."""
    problem = walled(0, FreeSpace([[-1, -1, 0], [-0.1, -0.1, 0.0]], [[-0.3, 1, 0.9], [0.1, 0.1, 0.27]]))
    problem = replace(problem, obstacles=(box("wall", (0.0, 0.0, 0.3), (0.02, 0.02, 0.02)),))
    load(SOLVERS["ikspark"].prepare)(problem)  # so that compiling is not part of the budget
    candidate = solve_ikspark(problem, Budget(1.0), 0)
    assert candidate.q is None and candidate.certificate is not None
    assert (candidate.certificate.kind, candidate.certificate.scope) == ("farkas/2", "model")
    assert check_farkas(problem, candidate.certificate) is None


@pytest.mark.parametrize(
    "kind, judged, grounds, scope",
    [
        ("inner", False, "spheres", "geometry"),
        ("inner", True, "spheres", "geometry"),
        ("given", False, "spheres", "geometry"),
        ("given", True, "spheres", "model"),
        ("outer", False, "spheres", "model"),
        ("outer", True, "spheres", "model"),
        ("inner", False, "cuboids", "model"),
        ("outer", True, "chain", "kinematics"),
    ],
)
def test_a_proof_claims_no_more_than_it_rests_on(
    kind: str, judged: bool, grounds: Grounds, scope: Scope
) -> None:
    robot = seven_axis()
    cover = replace(beads(robot), kind=kind)
    checker = (lambda q: Clearance(1.0)) if judged else None
    problem = IKProblem(robot, robot.fk(robot.home), cover=cover, checker=checker)
    assert proof_scope(problem, grounds) == scope
    if grounds != "cuboids":
        # the checker of trees says it for itself
        assert scope_of(problem, grounds == "spheres") == scope
