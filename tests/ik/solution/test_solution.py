"""Boxes around solutions: every planted one is certified, what they claim is true, and forged ones are refused."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tests.ik.arms import beads, hugged, planar, seven
from tests.ik.lifted_arms import parallel_elbow, seven_axis, skew_arm
from workcell.bench.reference.nearly import nearly_arm, planted
from workcell.geometry.types import Piece, SphereCover
from workcell.ik.certificate import Certificate, problem_hash
from workcell.ik.check import STATUS_OF_SCOPE, check_certificate
from workcell.ik.judge.verify import verify
from workcell.ik.problem import IKProblem, Tolerances
from workcell.ik.result import Status
from workcell.ik.solution.check import check_solution, statement
from workcell.ik.solution.issue import certify_solution
from workcell.model.robot import LIMIT_SLACK, Robot
from workcell.pose import Array, Pose

ARMS = {
    "skew6": lambda seed: skew_arm(seed, 6),
    "skew7": lambda seed: skew_arm(seed, 7),
    "skew9": lambda seed: skew_arm(seed, 9),
    "seven axes": lambda seed: seven_axis(),
    "parallel elbow": lambda seed: parallel_elbow(),
    "nearly": lambda seed: nearly_arm(np.random.default_rng(seed)),
}


def certified(problem: IKProblem, q: Array) -> Certificate:
    """The certificate of a configuration that the judge accepts."""
    assert verify(problem, q).accepted
    found = certify_solution(problem, q)
    assert found is not None
    assert check_certificate(problem, found) is None
    return found


def off_by(q: Array, size: float, rng: np.random.Generator) -> Array:
    """A configuration near another."""
    return np.asarray(q + size * rng.uniform(-1.0, 1.0, len(q)))


def rank_of(robot: Robot, q: Array) -> float:
    """Least singular value of the Jacobian."""
    return float(np.linalg.svd(robot.jacobian(q))[1][min(robot.dof, 6) - 1])


def crowded(robot: Robot, q: Array, rng: np.random.Generator, gap: float) -> tuple[Piece, ...]:
    """A box, a sphere and a cylinder, each exactly `gap` from the nearest of the robot's beads."""
    cover = beads(robot, 0.04)
    T = robot.link_transforms(q)
    centres = np.einsum("mij,mj->mi", T[cover.link, :3, :3], cover.centre) + T[cover.link, :3, 3]
    pieces = []
    for kind, size in (("sphere", [0.05]), ("box", [0.03, 0.05, 0.08]), ("cylinder", [0.05, 0.1])):
        way = rng.normal(size=3)
        way /= np.linalg.norm(way)
        quat = rng.normal(size=4)
        far = Piece(
            kind, kind, Pose(centres.mean(axis=0) + 3.0 * way, quat / np.linalg.norm(quat)), np.array(size)
        )
        low, high = 0.0, 3.0
        for _ in range(60):
            step = 0.5 * (low + high)
            moved = dataclasses.replace(far, pose=Pose(far.pose.position - step * way, far.pose.quat_wxyz))
            clearance = verify(IKProblem(robot, robot.fk(q), (moved,), cover), q).clearance.distance
            low, high = (step, high) if clearance > gap else (low, step)
        kept = dataclasses.replace(far, pose=Pose(far.pose.position - low * way, far.pose.quat_wxyz))
        pieces.append(kept)
    return tuple(pieces)


@pytest.mark.parametrize("arm", ARMS)
def test_every_planted_solution_is_certified(arm: str) -> None:
    exact = regular = 0
    for seed in range(25):
        robot, rng = ARMS[arm](seed), np.random.default_rng(seed)
        problem, q = planted(robot, rng)
        near = np.clip(off_by(q, 1e-6, rng), robot.lower, robot.upper)
        held = certified(problem, near)
        holds_one = len(held.data["joints"]) == 6
        far_from_limits = np.all(np.minimum(q - robot.lower, robot.upper - q) > 1e-3)
        if rank_of(robot, q) > 1e-2 and far_from_limits:
            regular += 1
            exact += holds_one
    assert exact == regular > 10


def test_what_a_box_claims_is_true_of_samples_and_a_solution_is_in_it() -> None:
    for seed in range(10):
        rng, robot = np.random.default_rng(seed), seven()
        problem = hugged(robot, beads(robot, 0.04), np.random.default_rng(seed))
        q = np.random.default_rng(seed).uniform(robot.lower, robot.upper)
        held = certified(problem, off_by(q, 2e-7, rng))
        middle, half = held.data["middle"], held.data["half"]
        for _ in range(20):
            assert verify(problem, middle + half * rng.uniform(-1.0, 1.0, 7)).accepted
        joints = held.data["joints"].astype(int)
        found = np.array(middle)
        for _ in range(20):
            pose = robot.fk(found)
            turn = problem.target.rotation @ pose.rotation.T
            error = np.concatenate(
                [
                    problem.target.position - pose.position,
                    0.5
                    * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]),
                ]
            )
            found[joints] += np.linalg.solve(robot.jacobian(found)[:, joints], error)
        assert np.all(np.abs(found - middle) <= half + 1e-13)


@pytest.mark.parametrize("gap", [1e-9, 1e-6, 1e-3])
def test_a_thin_clearance_is_certified(gap: float) -> None:
    for seed in range(4):
        rng, robot = np.random.default_rng(seed), skew_arm(seed, 6)
        q = 0.5 * (robot.lower + robot.upper) + 0.3 * rng.uniform(-1.0, 1.0, 6)
        pieces = crowded(robot, q, rng, gap)
        problem = IKProblem(robot, robot.fk(q), pieces, beads(robot, 0.04))
        certified(problem, q)
        tight = dataclasses.replace(problem, tolerances=Tolerances(safety_margin=gap + 1e-8))
        assert certify_solution(tight, q) is None


def test_limits_are_those_of_the_judge() -> None:
    robot = skew_arm(3, 6)
    for share, holds in ((0.0, True), (0.9, True), (1.1, False)):
        q = np.array(robot.upper)
        q[2] += share * LIMIT_SLACK
        assert (certify_solution(IKProblem(robot, robot.fk(q)), q) is not None) is holds


def test_fewer_joints_and_singular_arms_have_a_box_without_a_solution_in_it() -> None:
    arm = planar((0.5, 0.4, 0.2), 2.0)
    for robot, q in ((arm, np.array([0.3, 0.4, 0.5])), (seven_axis(), np.zeros(7))):
        held = certified(IKProblem(robot, robot.fk(q)), q)
        assert held.data["joints"].shape == (0,) and "exactly" not in held.statement


def test_near_singularities_solutions_are_still_shown_to_exist() -> None:
    robot, held = seven_axis(), []
    for tilt in (1e-2, 1e-3, 1e-4):
        q = np.array([0.3, 0.5, 0.2, 0.9, -0.2, tilt, 0.4])
        held.append(len(certified(IKProblem(robot, robot.fk(q)), q).data["joints"]))
    assert held == [6, 6, 6]


def changed(held: Certificate, **data: Array) -> Certificate:
    """A certificate with other numbers, and the statement and margin that belong to them."""
    numbers = dict(held.data) | {name: np.asarray(value, dtype=float) for name, value in data.items()}
    try:
        words, margin = statement(numbers), float(numbers["tolerances"][0])
    except (ValueError, TypeError, IndexError, KeyError):
        words, margin = held.statement, held.margin
    return dataclasses.replace(held, data=numbers, statement=words, margin=margin)


def solved() -> tuple[IKProblem, Array]:
    """A problem among obstacles and a configuration that solves it to about a micrometre."""
    robot, rng = skew_arm(1, 7), np.random.default_rng(5)
    q = 0.5 * (robot.lower + robot.upper) + 0.3 * rng.uniform(-1.0, 1.0, 7)
    return IKProblem(robot, robot.fk(q), crowded(robot, q, rng, 1e-4), beads(robot, 0.04)), off_by(
        q, 1e-7, rng
    )


def test_forged_boxes_are_refused() -> None:
    problem, q = solved()
    held = certified(problem, q)
    d = dict(held.data)
    assert len(d["joints"]) == 6
    spare = next(k for k in range(7) if k not in d["joints"])
    wide = np.array(d["half"])
    wide[spare] = 1e-3
    forgeries = {
        "too wide for the obstacles": {"half": wide},
        "too narrow for the solution": {"half": 0.5 * d["half"]},
        "no width": {"half": np.zeros(7)},
        "beside it": {"middle": d["middle"] + 4.0 * d["half"]},
        "far away": {"middle": d["middle"] + 0.1},
        "no inverse": {"inverse": np.zeros((6, 6))},
        "another inverse": {"inverse": -d["inverse"]},
        "huge inverse": {"inverse": 1e30 * d["inverse"]},
        "one joint twice": {"joints": d["joints"][[0, 1, 2, 3, 4, 4]]},
        "no such joint": {"joints": [0, 1, 2, 3, 4, 1e300]},
        "a negative joint": {"joints": [0, 1, 2, 3, 4, -1]},
        "half a joint": {"joints": d["joints"] + 0.5},
        "five joints": {"joints": d["joints"][:5]},
        "not a number": {"half": np.full(7, np.nan)},
        "negative widths": {"half": -d["half"]},
        "wider tolerances": {"tolerances": [1e-3, 1e-3, 0.0]},
        "more penetration": {"tolerances": [1e-4, 1e-3, -1e-3]},
        "more clearance than there is": {"tolerances": [1e-4, 1e-3, 2e-4]},
        "nothing asked": {"tolerances": [np.nan, np.nan, np.nan]},
        "one turn on": {"middle": d["middle"] + 2 * np.pi},
        "of another robot": {"middle": d["middle"][:6]},
    }
    for name, numbers in forgeries.items():
        assert check_solution(problem, changed(held, **numbers)) is not None, name
    for other in (
        dataclasses.replace(held, statement=held.statement.replace("exactly", "nearly")),
        dataclasses.replace(held, margin=2.0 * held.margin),
        dataclasses.replace(held, scope="geometry"),
        dataclasses.replace(held, kind="reach"),
        dataclasses.replace(held, problem_hash="0" * 64),
    ):
        assert check_solution(problem, other) is not None


def test_moved_targets_and_obstacles_are_noticed() -> None:
    problem, q = solved()
    held = certified(problem, q)
    target, piece = problem.target, problem.obstacles[0]
    moved = Pose(target.position + np.array([0.0, 0.0, 2e-4]), target.quat_wxyz)
    nearer = Pose(piece.pose.position + 0.01 * np.eye(3)[0], piece.pose.quat_wxyz)
    cover = problem.cover
    assert cover is not None
    fatter = SphereCover(cover.link, cover.centre, cover.radius + 2e-4, kind=cover.kind)
    other = dataclasses.replace(piece, pose=nearer, size=piece.size + 0.02)
    for name, changes in (
        ("target", {"target": moved}),
        ("cover", {"cover": fatter}),
        ("obstacle", {"obstacles": (other, *problem.obstacles[1:])}),
    ):
        new = dataclasses.replace(problem, **changes)
        forged = dataclasses.replace(held, problem_hash=problem_hash(new))
        assert check_solution(new, forged) is not None, name


@pytest.mark.parametrize("seed", range(3))
def test_mutated_numbers_prove_nothing_false(seed: int) -> None:
    problem, q = solved()
    held = certified(problem, q)
    rng = np.random.default_rng(seed)
    for _ in range(300):
        name = str(rng.choice(["middle", "half", "joints", "inverse", "tolerances"]))
        values = np.array(held.data[name], dtype=float)
        place = rng.integers(values.size)
        with np.errstate(all="ignore"):
            values.flat[place] *= rng.choice([0.0, -1.0, 0.5, 2.0, 1.0 + 1e-3, 1e6, np.inf, 1e300])
        forged = changed(held, **{name: values})
        if check_solution(problem, forged) is None:
            middle, half = forged.data["middle"], forged.data["half"]
            assert verify(problem, middle).accepted
            assert verify(problem, middle + half).accepted and verify(problem, middle - half).accepted


def test_a_wrong_configuration_is_not_certified() -> None:
    problem, q = solved()
    rng = np.random.default_rng(0)
    for size in (1e-3, 1e-2, 1.0):
        for _ in range(20):
            wrong = off_by(q, size, rng)
            assert verify(problem, wrong).accepted or certify_solution(problem, wrong) is None


def test_a_solution_awards_solved_and_never_a_no() -> None:
    problem, q = solved()
    held = certified(problem, q)
    assert STATUS_OF_SCOPE[held.scope] is Status.SOLVED
    assert Certificate.from_json(held.to_json()).scope == "solution"
    assert check_certificate(problem, Certificate.from_json(held.to_json())) is None
