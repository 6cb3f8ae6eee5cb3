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
from workcell.ik.branch.checker.check import check_branch, check_tree, seal, statement
from workcell.ik.branch.solver import _rounded_up, solve_branch
from workcell.ik.certificate import Certificate, problem_hash
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
    other = dataclasses.replace(certificate, kind="reach")
    assert check_branch(problem, other) == "a proof of kind 'reach' is not a tree of boxes"


@pytest.mark.parametrize("name", ["tree", "splits", "blocked", "root", "inflation", "clearance", "seal"])
def test_any_changed_number_is_refused(name: str) -> None:
    """By the seal: each of these changes leaves the proof well formed."""
    problem, certificate = proof()
    whole = certificate.data[name]
    places = np.flatnonzero(whole >= 0) if name == "tree" else np.arange(whole.size)
    for index in places[:: max(len(places) // 7, 1)]:
        values = np.array(whole)
        values.flat[index] += 1.0 if name in ("tree", "blocked") else 1e-3
        refusal = check_branch(problem, changed(certificate, honest_seal=False, **{name: values}))
        assert refusal == "the proof's numbers have been changed since it was made"
    missing = {key: value for key, value in certificate.data.items() if key != name}
    refusal = str(check_branch(problem, dataclasses.replace(certificate, data=missing)))
    assert f"'{name}' is missing" in refusal


def with_node(tree: np.ndarray, node: int, code: float) -> np.ndarray:
    return np.where(np.arange(len(tree)) == node, code, tree)


def test_forged_trees_are_refused() -> None:
    problem, certificate = proof()
    tree, splits, blocked = (certificate.data[name] for name in ("tree", "splits", "blocked"))
    free, blocks = np.flatnonzero(tree == -1), np.flatnonzero(tree == -2)
    fit, there = "don't fit together", "a sphere or an obstacle that isn't there"
    forgeries = {
        "a missing leaf": ({"tree": tree[:-1]}, fit),
        "a leaf too many": ({"tree": np.append(tree, -1.0)}, fit),
        "too few splits": ({"splits": splits[1:]}, fit),
        "too few pairs": ({"blocked": blocked[:, 1:]}, "don't fit the leaves"),
        "a pair of halves": ({"blocked": blocked + 0.5}, there),
        "an unknown reason": ({"tree": with_node(tree, blocks[0], -4.0)}, "unknown reason or joint"),
        "an unknown joint": ({"tree": np.where(tree >= 0, 7.0, tree)}, "unknown reason or joint"),
        "a joint beyond all integers": ({"tree": np.where(tree >= 0, 1e30, tree)}, "unknown reason or joint"),
        "a joint below zero": ({"tree": np.where(tree >= 0, -0.5, tree)}, "unknown reason or joint"),
        "half a joint": ({"tree": np.where(tree >= 0, 0.5, tree)}, "unknown reason or joint"),
        "a leaf too early": ({"tree": np.append(-1.0, np.delete(tree, free[-1]))}, "a leaf can't be proved"),
        "a split outside": ({"splits": splits + 10.0}, "a split lies outside the joint's range"),
        "not a number": ({"splits": splits * np.nan}, "'splits' holds a number that is not finite"),
        "a list of lists": ({"splits": splits[:, None]}, "'splits' is of shape"),
        "another sphere": ({"blocked": blocked + np.array([[1.0], [0.0]])}, there),
        "a sphere beyond all integers": ({"blocked": np.where(blocked > 0, 1e30, blocked)}, there),
        "a sphere below zero": ({"blocked": blocked - 5.0}, there),
        "another obstacle": ({"blocked": blocked + np.array([[0.0], [2.0]])}, there),
        "spheres for a wall": ({"tree": with_node(tree, blocks[0], -3.0)}, there),
        "a gap": ({"root": certificate.data["root"] * 0.9}, "leave out a part of joint 'j0'"),
        "one joint less": ({"root": certificate.data["root"][:, 1:]}, "'root' is of shape"),
        "a smaller tolerance": ({"inflation": certificate.data["inflation"] * 0.5}, "are needed"),
        "a larger clearance": (
            {"clearance": certificate.data["clearance"] + 1.0},
            "about a clearance of 1 m",
        ),
        "more than a proof": ({"more": np.zeros(1)}, "'more' has no place"),
        "numbers too large": ({"splits": splits * 1e60}, "larger than"),
        "two clearances": ({"clearance": np.zeros(2)}, "'clearance' is of shape"),
    }
    for what, (data, because) in forgeries.items():
        assert because in str(check_branch(problem, changed(certificate, **data))), what
    alone = changed(certificate, tree=np.array([-1.0]), splits=np.zeros(0), blocked=np.zeros((2, 0)))
    alone = dataclasses.replace(alone, scope="kinematics")
    assert check_branch(problem, alone) == "a leaf can't be proved (node 1 of 1)"


def test_claims_beyond_the_proof_are_refused() -> None:
    problem, certificate = proof()
    for claim, because in (
        ({"scope": "kinematics"}, "the proof's scope is not 'kinematics'"),
        ({"scope": "model"}, "the proof's scope is not 'model'"),
        ({"statement": "No way."}, "the statement is not what the proof shows"),
        ({"margin": 1.0}, "the margin is not the tolerance that the proof covers"),
    ):
        assert check_branch(problem, dataclasses.replace(certificate, **claim)) == because


def test_wrong_obstacle_is_refused() -> None:
    """A proof that lays every collision at one wall's door fails: the other wall blocks the other half."""
    problem, certificate = proof()
    one = np.array(certificate.data["blocked"])
    one[1] = 0.0
    assert "can't be proved" in str(check_branch(problem, changed(certificate, blocked=one)))


def test_no_tree_proves_a_solvable_problem() -> None:
    """The proof of a blocked problem, handed in for the one with a gap in the wall."""
    _, certificate = proof()
    gap = elbow_problem((wall("left", -0.4, 0.3), wall("right", 0.4, 0.3)))
    forged = dataclasses.replace(certificate, problem_hash=problem_hash(gap))
    assert "a leaf can't be proved" in str(check_branch(gap, forged))


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
        assert "a leaf can't be proved" in str(check_tree(problem, data, 3.0))


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
    unfinished = changed(large, tree=np.append(large.data["tree"][:-1], 0.0))
    assert "don't fit together" in str(check_branch(far, unfinished))
    early = changed(large, tree=np.array([-1.0, 0.0, -1.0]), splits=np.zeros(1))
    assert check_branch(far, early) == "the tree goes on after its last leaf (node 1 of 3)"
    deep = changed(large, tree=np.array([0.0] * 500 + [-1.0] * 501), splits=np.zeros(500))
    assert "the tree is too deep" in str(check_branch(far, deep))
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


def test_a_clearance_is_named_no_smaller_than_it_was_proved_for():
    for proved in (9.99951e-6, 1.2344e-6, 3.0e-7, 1e-5, 0.0):
        named = _rounded_up(proved, 1e-5)
        assert proved <= named <= 1e-5
        assert float(f"{1e3 * named:.4g}") >= 1e3 * proved * (1 - 1e-12)
