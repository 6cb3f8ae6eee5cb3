"""The checker of branch-and-bound proofs accepts the proofs and nothing that was made of them."""

import dataclasses
import functools
import json

import numpy as np
import pytest

from tests.ik.branch.test_solver import BUDGET, elbow_problem, ur_like, wall
from workcell.bench.reference.planting import planted_problem, random_chain, surround
from workcell.errors import InputError
from workcell.geometry.types import Piece, SphereCover
from workcell.ik.branch.checker.check import check_branch, seal, statement
from workcell.ik.branch.solver import solve_branch
from workcell.ik.certificate import Certificate
from workcell.ik.judge.exact import ExactKinematics
from workcell.ik.judge.verify import verify
from workcell.ik.problem import IKProblem, Tolerances
from workcell.pose import Pose


@functools.cache
def proof() -> tuple[IKProblem, Certificate]:
    problem = elbow_problem((wall("left", -0.3, 0.3), wall("right", 0.3, 0.3)))
    certificate = solve_branch(problem, BUDGET).certificate
    assert certificate is not None
    assert np.count_nonzero(certificate.data["tree"] >= 0) >= 2
    return problem, certificate


def changed(certificate: Certificate, *, honest_seal: bool = True, **data: object) -> Certificate:
    """The same certificate with other numbers, sealed and stated anew as a forger would."""
    numbers = {**certificate.data, **data}
    if honest_seal:
        numbers["seal"] = seal(numbers)
        certificate = dataclasses.replace(certificate, statement=statement(numbers))
    return dataclasses.replace(certificate, data=numbers)


def test_proof_survives_saving() -> None:
    problem, certificate = proof()
    assert check_branch(problem, Certificate.from_json(certificate.to_json())) is None


def test_other_problems_are_refused() -> None:
    problem, certificate = proof()
    moved = dataclasses.replace(problem, target=problem.target @ Pose.from_xyz([1e-6, 0.0, 0.0]))
    assert "another problem" in str(check_branch(moved, certificate))
    assert check_branch(problem, dataclasses.replace(certificate, kind="reach")) is not None


@pytest.mark.parametrize("name", ["tree", "splits", "blocked", "root", "inflation", "clearance", "seal"])
def test_any_changed_number_is_refused(name: str) -> None:
    problem, certificate = proof()
    for index in range(0, certificate.data[name].size, max(certificate.data[name].size // 7, 1)):
        values = np.array(certificate.data[name])
        values.flat[index] += 1e-3
        assert check_branch(problem, changed(certificate, honest_seal=False, **{name: values})) is not None
    missing = {key: value for key, value in certificate.data.items() if key != name}
    assert check_branch(problem, dataclasses.replace(certificate, data=missing)) is not None


def test_forged_trees_are_refused() -> None:
    problem, certificate = proof()
    tree, splits, blocked = (certificate.data[name] for name in ("tree", "splits", "blocked"))
    forgeries = {
        "a missing leaf": {"tree": tree[:-1]},
        "a leaf too many": {"tree": np.append(tree, -1.0)},
        "an unknown reason": {
            "tree": np.where(np.arange(len(tree)) == np.argmax(tree == -2), -3.0, tree), "blocked": blocked[:, 1:]
        },
        "an unknown joint": {"tree": np.where(tree >= 0, 7.0, tree)},
        "half a joint": {"tree": np.where(tree >= 0, 0.5, tree)},
        "a split outside": {"splits": splits + 10.0},
        "not a number": {"splits": splits * np.nan},
        "too few splits": {"splits": splits[1:]},
        "too few pairs": {"blocked": blocked[:, 1:]},
        "another sphere": {"blocked": blocked + np.array([[1.0], [0.0]])},
        "a gap": {"root": certificate.data["root"] * 0.9},
        "a smaller tolerance": {"inflation": certificate.data["inflation"] * 0.5},
        "a larger clearance": {"clearance": certificate.data["clearance"] + 1.0},
    }  # fmt: skip
    for what, data in forgeries.items():
        assert check_branch(problem, changed(certificate, **data)) is not None, what
    alone = changed(certificate, tree=np.array([-1.0]), splits=np.zeros(0), blocked=np.zeros((2, 0)))
    assert check_branch(problem, dataclasses.replace(alone, scope="kinematics")) is not None


def test_claims_beyond_the_proof_are_refused() -> None:
    problem, certificate = proof()
    assert check_branch(problem, dataclasses.replace(certificate, scope="kinematics")) is not None
    assert check_branch(problem, dataclasses.replace(certificate, scope="model")) is not None
    assert check_branch(problem, dataclasses.replace(certificate, statement="No way.")) is not None
    assert check_branch(problem, dataclasses.replace(certificate, margin=1.0)) is not None


def test_wrong_obstacle_is_refused() -> None:
    """A proof that lays every collision at one wall's door fails: the other wall blocks the other half."""
    problem, certificate = proof()
    one = np.array(certificate.data["blocked"])
    one[1] = 0.0
    assert "can't be proved" in str(check_branch(problem, changed(certificate, blocked=one)))


def test_no_tree_proves_a_solvable_problem() -> None:
    """The proof of a blocked problem, handed in for the one with a gap in the wall, and for planted solutions."""
    _, certificate = proof()
    gap = elbow_problem((wall("left", -0.4, 0.3), wall("right", 0.4, 0.3)))
    from workcell.ik.certificate import problem_hash

    forged = dataclasses.replace(certificate, problem_hash=problem_hash(gap))
    assert check_branch(gap, forged) is not None


def test_checker_never_excludes_a_planted_solution() -> None:
    """A tree of one kinematic leaf: the checker subdivides it at will and must not prove it away."""
    rng = np.random.default_rng(11)
    for _ in range(40):
        problem, q = planted_problem(random_chain(rng, int(rng.integers(5, 8))), rng)
        problem = surround(problem, q, rng, count=3)
        data = {
            "tree": np.array([-1.0]),
            "splits": np.zeros(0),
            "blocked": np.zeros((2, 0)),
            "root": np.array([q - 0.02, q + 0.02]),
            "inflation": np.array([1e-4, 1e-3]),
            "clearance": np.array([0.0]),
        }
        from workcell.ik.branch.checker.check import _walk

        assert _walk(problem, data, 3.0) is not None


def test_kinematics_of_checker_agree_with_the_judge() -> None:
    from workcell.ik.branch.checker.setup import zero_links

    robot = ur_like()
    rotation, position = ExactKinematics(robot).links(np.zeros(6))
    mine = zero_links(robot)
    assert np.allclose(mine[0], rotation, atol=1e-14)
    assert np.allclose(mine[1], position, atol=1e-14)


def test_wider_tolerances_need_a_wider_proof() -> None:
    problem, certificate = proof()
    wide = dataclasses.replace(problem, tolerances=Tolerances(position=1e-3, rotation=1e-2))
    from workcell.ik.certificate import problem_hash

    claim = dataclasses.replace(certificate, problem_hash=problem_hash(wide))
    assert "are needed" in str(check_branch(wide, claim))
    certificate = solve_branch(wide, BUDGET).certificate
    assert certificate is not None
    assert check_branch(wide, certificate) is None


def full_tree(depth: int) -> dict[str, np.ndarray]:
    """A tree that halves joint 0 and its successors over and over, all leaves said to be kinematic."""
    tree = np.full(2 ** (depth + 1) - 1, -1.0)

    def fill(start: int, level: int) -> None:
        if level == depth:
            return
        tree[start] = level % 7
        size = 2 ** (depth - level) - 1
        fill(start + 1, level + 1)
        fill(start + 1 + size, level + 1)

    fill(0, 0)
    return {"tree": tree, "splits": np.zeros(np.count_nonzero(tree >= 0)), "blocked": np.zeros((2, 0))}


def test_large_trees_are_read_in_bounded_memory_and_larger_ones_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    far = IKProblem(elbow_problem(()).robot, Pose.from_xyz([1.4, 0.3, 0.4]))
    certificate = solve_branch(far, BUDGET).certificate
    assert certificate is not None
    large = changed(certificate, **full_tree(16))
    assert len(large.data["tree"]) == 2**17 - 1
    assert check_branch(far, large) is None
    assert check_branch(far, changed(large, tree=np.append(large.data["tree"][:-1], 0.0))) is not None
    monkeypatch.setattr("workcell.ik.branch.checker.check.MOST_NODES", 1000)
    assert "at most 1000 are read" in str(check_branch(far, large))


def test_damaged_files_are_refused_with_the_reason() -> None:
    _, certificate = proof()
    text = json.dumps(certificate.to_json())
    for cut in (10, len(text) // 2, len(text) - 2):
        with pytest.raises(InputError, match="not JSON"):
            Certificate.from_json(text[:cut])
    for old, new, reason in (
        ('"workcell-certificate/1"', '"workcell-certificate/9"', "not a certificate"),
        ('"geometry"', '"hearsay"', "unknown scope"),
        ('"margin": ', '"margin": NaN, "was": ', "finite"),
    ):
        assert old in text
        with pytest.raises(InputError, match=reason):
            Certificate.from_json(text.replace(old, new))
    document = certificate.to_json()
    document["data"]["splits"]["values"][0] = float("nan")
    with pytest.raises(InputError, match="not finite"):
        Certificate.from_json(document)


def test_an_obstacle_around_the_base_and_limits_wider_than_a_turn_are_handled() -> None:
    robot = dataclasses.replace(ur_like(), lower=np.full(6, -20.0), upper=np.full(6, 20.0))
    cover = SphereCover(np.array([0, 3]), np.zeros((2, 3)), np.array([0.1, 0.1]))
    around = Piece("pit", "box", Pose.identity(), np.array([0.3, 0.3, 0.3]))
    problem = IKProblem(robot, robot.fk(np.array([0.3, -1.0, 1.2, 0.4, 0.9, 0.1])), (around,), cover)
    certificate = solve_branch(problem, BUDGET).certificate
    assert certificate is not None
    assert certificate.scope == "geometry"
    assert check_branch(problem, certificate) is None
    free = dataclasses.replace(problem, obstacles=())
    q = solve_branch(free, BUDGET).q
    assert q is not None
    assert verify(free, q).accepted


def test_a_huge_scene_is_beyond_the_checker() -> None:
    far = IKProblem(elbow_problem(()).robot, Pose.from_xyz([100.0, 0.0, 0.0]))
    certificate = solve_branch(far, BUDGET).certificate
    assert certificate is not None
    assert "rounding is proved up to" in str(check_branch(far, certificate))
