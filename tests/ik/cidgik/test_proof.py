"""CIDGIK's relaxation: reductions hold, the plain model agrees, its proofs are never about what is possible."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest

from tests.ik.arms import beads
from tests.ik.lifted_arms import parallel_elbow, seven_axis, skew_arm
from workcell.bench.ik.cidgik_scaling import long_arm
from workcell.bench.ik.cidgik_supplement import infeasible_problems
from workcell.bench.reference.cidgik_problems import (
    bench_arm,
    environment,
    joint_points,
    link_points,
    off_centre,
    random_problems,
)
from workcell.bench.reference.closed_forms import parallel_arm
from workcell.geometry.types import Piece
from workcell.ik.certificate import Certificate, problem_hash
from workcell.ik.check import check_certificate
from workcell.ik.cidgik.check import check_cidgik
from workcell.ik.cidgik.chordal import ChordalInstance, ChordalStructure
from workcell.ik.cidgik.gram import Columns, Multipliers, Sum, margin
from workcell.ik.cidgik.instance import Instance
from workcell.ik.cidgik.model import relaxation_at
from workcell.ik.cidgik.plain import relaxation
from workcell.ik.cidgik.proof import Proof, proof_of
from workcell.ik.cidgik.proof import margin as proof_margin
from workcell.ik.cidgik.query import check_query, solve_query
from workcell.ik.cidgik.skeleton import Skeleton
from workcell.ik.cidgik.solver import prove_cidgik, solve_cidgik
from workcell.ik.cidgik.structure import Structure
from workcell.ik.problem import Budget, IKProblem, Tolerances
from workcell.ik.result import Status
from workcell.ik.shared.conic import svec
from workcell.ik.solve import solve
from workcell.ik.trees.query import Balls, Goal, Points, Query, Workspace
from workcell.model.robot import Robot
from workcell.pose import Pose, axis_angle_to_matrix

NO_POINTS = (np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
ARMS = [bench_arm("ur10"), off_centre(bench_arm("kuka")), seven_axis(), skew_arm(5, 5)]


def skeleton_of(robot: Robot) -> Skeleton:
    goal = Goal.posed("tool", robot.fk(np.zeros(robot.dof)))
    return Skeleton(robot, (goal,), NO_POINTS, robot.lower, robot.upper)


def test_orders_after_the_reduction() -> None:
    """UR10: 13 points to 6; KUKA and LWA4D: 15 points to one 4x4 block once axes are left out."""
    assert [Structure(skeleton_of(bench_arm(name))).order for name in ("ur10", "kuka", "lwa4d")] == [6, 4, 4]


@pytest.mark.parametrize("robot", [*ARMS, parallel_elbow()], ids=lambda robot: f"{robot.name}{robot.dof}")
def test_every_row_holds_at_every_configuration(robot: Robot) -> None:
    structure = Structure(skeleton_of(robot))
    reduction = structure.reduction
    rng = np.random.default_rng(3)
    for _ in range(4):
        q = rng.uniform(robot.lower, robot.upper)
        X, G = reduction.basis_at(q), reduction.columns_at(q)
        columns = np.vstack([X, np.eye(3)])
        T = robot.T_world_base.inverse().matrix @ robot.link_transforms(q)
        for link, directions in reduction.directions.items():
            assert np.allclose(
                directions.at(G) @ columns, (T[link, :3, :3] @ structure.skeleton.basis[link]).T
            )
            assert np.allclose(reduction.origins[link].at(G) @ columns, T[link, :3, 3])
        Z = svec(columns @ columns.T)
        rows, constants = structure.equalities(G)
        assert np.abs(rows @ Z - constants).max() < 1e-9
        limits, least = structure.limits.at(
            G, 0.5 * (robot.lower + robot.upper), 0.5 * (robot.upper - robot.lower)
        )
        assert np.all(limits @ Z - least > -1e-9)
        blocks, quarter = structure.frames.quaternions(G)
        for block in blocks @ Z + quarter:
            # the triangle of q q^T, of trace one and rank one
            assert np.isclose(block[[0, 2, 5, 9]].sum(), 1.0) and np.isclose(np.linalg.norm(block), 1.0)


def own_points(instance: Instance) -> np.ndarray:
    """The plain model's variable points over the kept columns."""
    structure = instance.structure
    skeleton, reduction = structure.skeleton, structure.reduction
    points = []
    for link in range(1, skeleton.robot.dof + 1):
        if link not in skeleton.known:
            points.append(instance.vector(reduction.point(link, np.zeros(3))))
            points += [instance.vector(reduction.point(link, along)) for along in skeleton.basis[link].T]
    return np.array(points)


@pytest.mark.filterwarnings("ignore:Solution may be inaccurate")
@pytest.mark.parametrize(
    "robot", [ARMS[0], off_centre(bench_arm("ur10")), skew_arm(5, 4)], ids=lambda r: r.name
)
def test_the_plain_model_has_the_same_optimum(robot: Robot) -> None:
    q = np.random.default_rng(0).uniform(robot.lower, robot.upper)
    plain, model = relaxation(Query(robot, (Goal.posed("tool", robot.fk(q)),)))
    oracle = cp.Problem(cp.Minimize(cp.trace(model.Z) - 3.0), plain.constraints)
    oracle.solve(solver="CLARABEL")
    # without an interior some of them end a little early
    assert oracle.status in ("optimal", "optimal_inaccurate")
    problem = IKProblem(robot, robot.fk(q))
    instance, _ = relaxation_at(problem)
    assert not instance.structure.dropped
    points = own_points(instance)
    solution = instance.solve(points.T @ points)
    value = float(np.sum((points.T @ points) * instance.matrix(solution.x)))
    assert value == pytest.approx(oracle.value, rel=1e-4)


def test_blocks_and_one_block_have_the_same_optimum() -> None:
    robot = long_arm(8, 2.0)
    skeleton = skeleton_of(robot)
    goals = (Goal.posed("tool", robot.fk(np.full(8, 0.4))),)
    middle, half = np.zeros(8), np.full(8, 2.0)
    whole, blocks = (
        Instance(Structure(skeleton), goals, middle, half),
        ChordalInstance(ChordalStructure(skeleton), goals, middle, half),
    )
    rng = np.random.default_rng(0)
    for _ in range(3):
        weights = {link: rng.standard_normal((2, skeleton.basis[link].shape[1])) for link in range(2, 7)}
        C_whole = sum(_squares(whole, link, w) for link, w in weights.items())
        C_blocks = [np.zeros((part.structure.order,) * 2) for part in blocks.parts]
        for link, w in weights.items():
            C_blocks[blocks.structure.home[link]] += _squares(
                blocks.parts[blocks.structure.home[link]], link, w
            )
        one, many = whole.solve(C_whole), blocks.solve(C_blocks)
        value = float(np.sum(C_whole * whole.matrix(one.x)))
        parts = sum(float(np.sum(C * Z)) for C, Z in zip(C_blocks, blocks.matrix(many.x), strict=True))
        assert parts == pytest.approx(value, abs=1e-4)


def _squares(instance: Instance, link: int, weights: np.ndarray) -> np.ndarray:
    """C of the squared lengths of two combinations of a link's directions and its origin."""
    reduction = instance.structure.reduction
    vectors = np.vstack(
        [instance.vector(reduction.directions[link].mix(weights)), instance.vector(reduction.origins[link])]
    )
    C: np.ndarray = vectors.T @ vectors
    return C


@pytest.mark.parametrize(
    "robot", [*ARMS, off_centre(bench_arm("ur10"))], ids=lambda robot: f"{robot.name}{robot.dof}"
)
def test_far_targets_are_certified_and_the_certificate_says_so_again(robot: Robot) -> None:
    target = robot.fk(np.full(robot.dof, 0.5))
    far = Pose(target.position * (1.5 * robot.reach() / np.linalg.norm(target.position)), target.quat_wxyz)
    problem = IKProblem(robot, far)
    certificate = prove_cidgik(problem)
    assert certificate is not None and certificate.scope == "kinematics"
    assert check_certificate(problem, Certificate.from_json(certificate.to_json())) is None
    near = replace(problem, target=target)
    assert check_certificate(near, certificate) == "it belongs to another problem"
    claimed = replace(certificate, problem_hash=problem_hash(near))
    assert "do not prove the claim" in str(check_certificate(near, claimed))


@functools.cache
def far_proof() -> tuple[IKProblem, Certificate]:
    """Of a chain whose limits and frames have multipliers."""
    robot = ARMS[3]
    problem = IKProblem(robot, Pose.from_xyz([1.5 * robot.reach(), 0.0, 0.0]))
    certificate = prove_cidgik(problem)
    assert certificate is not None and len(certificate.data["limits"]) and len(certificate.data["frames"])
    return problem, certificate


@functools.cache
def blocked_proof() -> tuple[IKProblem, Certificate]:
    """Of a pose that obstacles block: a row of the workspace has a multiplier."""
    for problem in infeasible_problems(6, 0):
        certificate = prove_cidgik(problem)
        if certificate is not None and len(certificate.data["rows"]):
            return problem, certificate
    pytest.fail("none of the poses is proved blocked")


@pytest.mark.parametrize(
    ("made", "part", "change", "because"),
    [
        (far_proof, "limits", lambda limits: limits - 1e-300 - limits.max(), "multiplier of an inequality is negative"),
        (blocked_proof, "rows", np.negative, "multiplier of an inequality is negative"),
        (far_proof, "S", lambda S: S[:-1], "'S' is of shape"),
        (far_proof, "S", lambda S: np.hstack([S, S, S]), "more columns than rows"),
        (far_proof, "facts", lambda values: values[:-1], "'facts' is of shape"),
        (far_proof, "limits", lambda values: np.append(values, 0.0), "'limits' is of shape"),
        (far_proof, "frames", lambda frames: frames[1:], "'frames' is of shape"),
        (far_proof, "keys", lambda keys: keys[:, :1], "'keys' is of shape"),
        (far_proof, "keys", lambda keys: np.zeros((1, 2)), "'rows' is of shape"),
        (far_proof, "S", lambda S: np.nan * S, "not finite"),
        (far_proof, "S", lambda S: 1e60 * S, "larger than"),
        (blocked_proof, "keys", lambda keys: keys + np.array([0, 100]), "isn't there"),
        (blocked_proof, "keys", lambda keys: keys + np.array([100, 0]), "isn't there"),
        (blocked_proof, "keys", lambda keys: keys - np.array([100, 0]), "isn't there"),
        (blocked_proof, "keys", lambda keys: keys + 0.5, "isn't there"),
        (blocked_proof, "keys", lambda keys: 1e30 + keys, "isn't there"),
        (blocked_proof, "keys", lambda keys: np.tile(keys, (9, 1)), "'rows' is of shape"),
        (far_proof, "facts", np.zeros_like, "do not prove the claim"),
        (far_proof, "S", np.zeros_like, "do not prove the claim"),
        (blocked_proof, "rows", np.zeros_like, "do not prove the claim"),
        (far_proof, "tolerances", lambda _: np.array([1e-9, 1.0, 0.0]), "narrower than those of the problem"),
        (far_proof, "tolerances", lambda _: np.array([1.0, 1e-9, 0.0]), "narrower than those of the problem"),
        (far_proof, "tolerances", lambda _: np.array([1.0, 1.0, -1.0]), "narrower than those of the problem"),
        (far_proof, "tolerances", lambda _: np.array([10.0, 1.0, 0.0]), "exceed"),
        (far_proof, "tolerances", lambda _: np.array([1.0, 1.0, 0.0]), "do not prove the claim"),
        (far_proof, "tolerances", lambda values: values[:2], "'tolerances' is of shape"),
        (far_proof, "tolerances", lambda values: np.nan * values, "not finite"),
    ],
)  # fmt: skip
def test_damaged_certificates_are_refused_for_what_is_wrong_with_them(
    made: Callable[[], tuple[IKProblem, Certificate]],
    part: str,
    change: Callable[[np.ndarray], np.ndarray],
    because: str,
) -> None:
    problem, certificate = made()
    assert check_cidgik(problem, certificate) is None
    numbers = dict(certificate.data) | {part: change(np.array(certificate.data[part]))}
    assert because in str(check_cidgik(problem, replace(certificate, data=numbers)))


def test_rows_without_end_are_not_read() -> None:
    problem, certificate = blocked_proof()
    many = {name: np.repeat(certificate.data[name], 5000, axis=0) for name in ("keys", "rows")}
    refusal = check_cidgik(problem, replace(certificate, data={**certificate.data, **many}))
    assert refusal == "it has more than 4096 rows of spheres"


def test_incomplete_borrowed_and_overclaiming_certificates_are_refused() -> None:
    problem, certificate = far_proof()
    for part in certificate.data:
        left = {name: values for name, values in certificate.data.items() if name != part}
        assert f"'{part}' is missing" in str(check_cidgik(problem, replace(certificate, data=left)))
    more = {**certificate.data, "equalities": np.zeros(1)}
    assert "'equalities' has no place" in str(check_cidgik(problem, replace(certificate, data=more)))
    assert "it is of kind 'reach'" in str(check_cidgik(problem, replace(certificate, kind="reach")))
    wider = replace(problem, tolerances=Tolerances(position=1.0))
    assert check_cidgik(wider, certificate) == "it belongs to another problem"
    claimed = replace(certificate, problem_hash=problem_hash(wider))
    assert "narrower than those of the problem" in str(check_cidgik(wider, claimed))
    for scope in ("geometry", "model"):
        refusal = str(check_cidgik(problem, replace(certificate, scope=scope)))
        assert "of the scope 'kinematics'" in refusal
    blocked, proof = blocked_proof()
    assert "of the scope 'geometry'" in str(check_cidgik(blocked, replace(proof, scope="kinematics")))
    assert "the margin is" in str(check_cidgik(problem, replace(certificate, margin=1.0)))
    assert "the statement is not" in str(check_cidgik(problem, replace(certificate, statement="No way.")))
    old = replace(certificate, kind="cidgik")
    assert "ask cidgik again" in str(check_certificate(problem, old))


def test_a_proof_is_worth_the_same_at_any_scale() -> None:
    for problem, certificate in (far_proof(), blocked_proof()):
        for size in (1e-12, 1e12):
            data = {
                name: values
                * (1.0 if name in ("tolerances", "keys") else size ** (0.5 if name in ("S", "frames") else 1))
                for name, values in certificate.data.items()
            }
            assert check_cidgik(problem, replace(certificate, data=data)) is None


def any_multipliers(problem: IKProblem, rng: np.random.Generator) -> Multipliers:
    """Numbers that no solver would think of."""
    columns, n = Columns(problem), problem.robot.dof
    u, count = columns.width, 2 * (problem.cover is not None)
    size = 10.0 ** rng.uniform(-6, 6)
    spheres = 1 if problem.cover is None else len(problem.cover)
    keys = np.stack(
        [rng.integers(0, spheres, count), rng.integers(0, max(len(problem.obstacles), 1), count)], axis=1
    )
    none, frames = np.zeros((0, 2), dtype=np.int64), rng.standard_normal((columns.links, 4, 4))
    return Multipliers(
        size * rng.standard_normal((n + 1 + (problem.goal == "axis"), u)),
        size * rng.standard_normal((n, 2)),
        size * rng.standard_normal((2, 3)),
        size * np.abs(rng.standard_normal(n)),
        keys,
        size * np.abs(rng.standard_normal(count)),
        none,
        np.zeros(0),
        rng.standard_normal((u, int(rng.integers(0, u)))),
        frames,
    )


@pytest.mark.parametrize("goal", ["pose", "position", "axis"])
@pytest.mark.parametrize("robot", ARMS, ids=lambda robot: f"{robot.name}{robot.dof}")
def test_the_bound_lies_above_every_configuration_that_reaches_within_the_tolerances(
    robot: Robot, goal: str
) -> None:
    """F at configurations whose tool is anywhere in the ball: not below its charge, and never above the bound."""
    rng, covered = np.random.default_rng(robot.dof), np.array([5e-3, 5e-2, 1e-3])
    cover = beads(robot, 0.04)
    for _ in range(20):
        q = robot.random_configuration(rng)
        T, (direction, axis) = robot.fk(q), rng.standard_normal((2, 3))
        shift = covered[0] * direction / np.linalg.norm(direction)
        turn = axis_angle_to_matrix(axis / np.linalg.norm(axis), covered[1])
        centres = cover.centres_world(robot.link_transforms(q))
        away = rng.standard_normal((2, 3)) * 3
        gaps = np.linalg.norm(centres[:, None] - away, axis=2).min(axis=0) - 0.04 + 1e-3
        balls = tuple(
            Piece(f"ball {k}", "sphere", Pose.from_xyz(away[k]), np.array([gaps[k]]))
            for k in range(2)
            if gaps[k] > 0
        )
        target = Pose.from_rotation(T.position + shift, turn @ T.rotation)
        problem = IKProblem(robot, target, balls, cover if len(balls) == 2 else None, goal=goal)
        m = any_multipliers(problem, rng)
        total = Sum(problem, m, covered)
        R = robot.link_transforms(q)[:, :3, :3]
        R = R[0].T @ R
        X = np.hstack([*R[1 : total.columns.links + 1], np.eye(3)])
        at_q = total.constant + float(np.sum(total.H * (X.T @ X)))
        assert at_q >= -total.charge - 1e-9 * m.size()
        assert at_q <= total.value() + 1e-9 * m.size()
        assert margin(problem, m, covered) <= 0.0


def test_what_is_possible_is_never_proved_impossible() -> None:
    for robot in (bench_arm("ur10"), off_centre(bench_arm("ur10")), bench_arm("kuka")):
        for problem in random_problems(robot, link_points(robot), *environment("cube"), 5, 1):
            assert prove_cidgik(problem) is None


@pytest.mark.parametrize(
    "robot", [ARMS[0], off_centre(bench_arm("ur10")), ARMS[3]], ids=lambda robot: robot.name
)
def test_no_multipliers_prove_a_reachable_pose_impossible(robot: Robot) -> None:
    """F is not negative at a configuration, whatever the multipliers: neither random ones nor those of a near miss."""
    rng = np.random.default_rng(2)
    q = np.full(robot.dof, 0.4)
    pose = robot.fk(q)
    instance, _ = relaxation_at(IKProblem(robot, pose))
    frames, order = len(instance.frame_rows) // 10, instance.structure.order
    proofs = []
    for _ in range(20):
        R = rng.standard_normal((order, order))
        Ts = [svec(t @ t.T) for t in rng.standard_normal((frames, 4, 4))]
        proofs.append(
            Proof(
                rng.standard_normal(len(instance.structure.used)),
                rng.uniform(0, 1, len(instance.limit_rows)),
                np.zeros((0, 3)),
                np.zeros(0),
                svec(R @ R.T),
                np.array(Ts).reshape(-1, 10),
            )
        )
    for distance in (0.02, 0.2):
        away = Pose(
            pose.position * (1 + (robot.reach() + distance) / np.linalg.norm(pose.position)), pose.quat_wxyz
        )
        other, _ = relaxation_at(IKProblem(robot, away))
        solution = other.solve(other.nuclear())
        proof = proof_of(other, None, solution.z) if solution.status == "infeasible" else None
        assert proof is not None
        proofs.append(proof)
    for proof in proofs:
        for tolerance in (0.0, 1e-3):
            assert proof_margin(instance, None, proof, tolerance, tolerance, 0.0) <= 0.0


def test_a_proof_covers_the_tolerance_it_names() -> None:
    """Targets just out of reach: no proof at one is a proof where a configuration comes within the tolerance."""
    robot = bench_arm("ur10")
    edge = robot.fk(np.array([0.3, 0.0, 0.0, 0.2, 1.0, 0.5]))
    outward = edge.position / np.linalg.norm(edge.position)
    for distance in (2e-3, 2e-2, 2e-1):
        beyond = Pose(edge.position + distance * outward, edge.quat_wxyz)
        instance, _ = relaxation_at(IKProblem(robot, beyond))
        solution = instance.solve(instance.nuclear())
        if solution.status != "infeasible":
            continue
        proof = proof_of(instance, None, solution.z)
        assert proof is not None
        assert proof_margin(instance, None, proof, distance, 0.0, 0.0) <= 0.0


def test_poses_whose_solutions_all_collide() -> None:
    robot = bench_arm("ur10")
    problems = infeasible_problems(6, 0)
    proved = [certificate for problem in problems if (certificate := prove_cidgik(problem)) is not None]
    assert proved and all(certificate.scope == "geometry" for certificate in proved)
    for problem in problems:
        assert len(parallel_arm(robot, problem.target)) > 0
        assert solve_cidgik(problem, Budget(0.05)).q is None
    blocked = next(p for p in problems if prove_cidgik(p) is not None)
    result = solve(blocked, "cidgik", Budget(2.0))
    assert result.status is Status.BLOCKED
    assert result.certificate is not None and check_certificate(blocked, result.certificate) is None
    without = replace(blocked, obstacles=())
    smaller = replace(blocked, obstacles=tuple(replace(o, size=0.8 * o.size) for o in blocked.obstacles))
    for other, because in ((without, "isn't there"), (smaller, "do not prove")):
        assert check_certificate(other, result.certificate) == "it belongs to another problem"
        claimed = replace(result.certificate, problem_hash=problem_hash(other))
        assert because in str(check_certificate(other, claimed))


def test_proofs_of_queries() -> None:
    robot = bench_arm("ur10")
    query = Query(robot, (Goal.at("tool", [2.0, 0.0, 0.0]),))
    answer = solve_query(query, Budget(2.0))
    assert answer.status is Status.UNREACHABLE and answer.proof is not None
    assert check_query(query, answer.proof) is None
    within = replace(query, goals=(Goal.at("tool", [0.7, 0.2, 0.3]),))
    assert "do not prove the claim" in str(check_query(within, answer.proof))
    forged = replace(answer.proof, S=-answer.proof.S)
    assert "do not prove the claim" in str(check_query(query, forged))


def test_joint_points_leave_out_what_the_base_fixes() -> None:
    assert joint_points(bench_arm("kuka")).link.tolist() == [4, 5, 6, 7]


def test_the_plain_model_knows_spheres() -> None:
    """The elbow's disc of the toy in three dimensions: a ball around the circle that a position goal leaves it."""
    robot = bench_arm("ur10")
    pose = robot.fk(np.random.default_rng(0).uniform(-np.pi, np.pi, 6))
    for radius, status in ((0.05, "optimal"), (2.0, "infeasible")):
        space = Workspace(
            Points(np.array([3]), np.zeros((1, 3)), np.zeros(1)), Balls([[0.0, 0.0, 0.2]], [radius])
        )
        query = Query(robot, (Goal.posed("tool", pose),), space)
        plain, model = relaxation(query)
        oracle = cp.Problem(cp.Minimize(cp.trace(model.Z)), plain.constraints)
        oracle.solve(solver="CLARABEL")
        assert oracle.status == status
        answer = solve_query(query, Budget(1.0))
        assert (answer.status is Status.BLOCKED) == (status == "infeasible")
