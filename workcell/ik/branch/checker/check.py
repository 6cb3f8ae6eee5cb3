"""Re-checks proofs by branch and bound, with kinematics, bounds and code of its own.

A certificate of kind `branch` holds a tree of boxes of joint angles, in pre-order. It is only a hint: the checker
starts from the box of all admissible configurations, contracts every box by inequalities that hold in all of it,
splits where the tree says, lower half first, and proves every leaf (subdividing where it must). A bad tree can fail,
never mislead. What is in `data`:

    tree        (nodes,)    joint to split, from 0; or -1: no configuration of the box closes the chain;
                            or -2: in all of it a sphere collides with an obstacle;
                            or -3: in all of it two spheres of the robot collide
    splits      (inner,)    where
    blocked     (2, ...)    sphere and obstacle of every -2, the two spheres of every -3
    root        (2, n)      the box of all configurations, of the robot's joints and those of the target (three turns
                            about the tool's x, y and z where only its position counts, one about z where its axis does)
    inflation   (2,)        departure from the target (m, rad) that the proof covers
    clearance   (1,)        no configuration keeps this clearance (m)
    seal        (8,)        SHA-256 of all that, in words of 32 bits: detects damage, not fraud
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from workcell.ik.certificate import Certificate, problem_hash
from workcell.ik.claims.form import WIDEST, Shape, whole_numbers, wrong_form
from workcell.ik.problem import IKProblem
from workcell.pose import Array

LEAST_INFLATION = (1e-4, 1e-3)
"""Metres and radians that a proof must cover at least."""
MOST_OVERLAP = 1e-5
"""Metres by which the clearance of a proof may exceed the one that is asked for."""
LONGEST = 50.0
"""Metres within which the rounding slack of the checker is justified."""
MOST_TURNED = 100.0
"""Radians or metres beyond which no box goes."""
MOST_NODES = 5_000_000
WIDENED = 1e-10
"""Radians (metres) by which the root box is widened before anything is proved: a double turn is less than 2 pi."""
_FIELDS = ("tree", "splits", "blocked", "root", "inflation", "clearance")
_SHAPES: dict[str, Shape] = {
    "tree": (None,),
    "splits": (None,),
    "blocked": (2, None),
    "inflation": (2,),
    "clearance": (1,),
    "seal": (8,),
}
_FREE_JOINTS = {"pose": 0, "position": 3, "axis": 1}
"""Joints of the target, by the goal."""
_OUTCOMES = {
    1: "the tree ends too early",
    2: "the tree goes on after its last leaf",
    3: "the tree has an unknown reason or joint",
    4: "a split lies outside the joint's range",
    5: "a leaf names a sphere or an obstacle that isn't there",
    6: "a leaf can't be proved",
    7: "the tree is too deep",
}


def check_branch(problem: IKProblem, certificate: Certificate) -> str | None:
    """None when the certificate proves that `problem` has no solution, else why it doesn't."""
    if certificate.kind != "branch":
        return f"a proof of kind {certificate.kind!r} is not a tree of boxes"
    if certificate.problem_hash != problem_hash(problem):
        return "the certificate belongs to another problem"
    from workcell.ik.branch.checker.setup import KINDS, longest

    data = certificate.data
    refusal = (
        _check_form(problem, certificate)
        or _check_claim(problem, certificate)
        or _check_root(problem, data["root"])
        or _check_pairs(problem, data)
    )
    if refusal is not None:
        return refusal
    for piece in problem.obstacles if data["blocked"].shape[1] else ():
        if piece.kind not in KINDS:
            return f"the checker doesn't know pieces of kind {piece.kind!r}"
    length = longest(problem)
    if length > LONGEST:
        return f"the robot or its surroundings reach {length:.3g} m; the checker's rounding is proved up to {LONGEST:g}"
    return check_tree(problem, data, length)


def obstacles_used(certificate: Certificate) -> list[int]:
    """Indices of the obstacles that exclude boxes of a proof."""
    data = certificate.data
    leaves = data["tree"][data["tree"] <= -2]
    return [int(k) for k in np.unique(data["blocked"][1, leaves == -2])]


def seal(data: Mapping[str, Any]) -> Array:
    """(8,) words of the SHA-256 of a proof's numbers."""
    digest = hashlib.sha256()
    for name in _FIELDS:
        values = np.asarray(data[name], dtype=float)
        digest.update(f"{name}{values.shape}".encode() + (values + 0.0).tobytes())
    return np.frombuffer(digest.digest(), dtype=">u4").astype(float)


def statement(data: Mapping[str, Any]) -> str:
    """The claim of a proof in words."""
    leaves = int(np.count_nonzero(np.asarray(data["tree"]) < 0))
    position, rotation = (float(value) for value in data["inflation"])
    blocked = np.asarray(data["blocked"]).shape[-1] > 0
    clearance = f"{float(data['clearance'][0]) * 1e3:.4g} mm or more"
    keeping = (
        f" with a clearance of {clearance} (up to {MOST_OVERLAP * 1e3:g} mm beyond the wanted one)"
        if blocked
        else ""
    )
    return (
        f"No configuration{keeping} brings the tool within {position * 1e3:g} mm and {rotation:g} rad of its target: "
        f"each of the {leaves} boxes that cover all joint angles is excluded."
    )


def _check_form(problem: IKProblem, certificate: Certificate) -> str | None:
    """Whether the numbers are a proof's: the arrays, and every index within its range before anything uses it."""
    n, data = problem.robot.joint_count + _FREE_JOINTS[problem.goal], certificate.data
    refusal = wrong_form(certificate, {**_SHAPES, "root": (2, n)})
    if refusal is not None:
        return refusal
    tree, blocked = data["tree"], data["blocked"]
    if len(tree) > MOST_NODES:
        return f"the tree has {len(tree)} nodes; at most {MOST_NODES} are read"
    if not np.array_equal(data["seal"], seal(data)):
        return "the proof's numbers have been changed since it was made"
    inner, named = tree >= 0, (tree == -2) | (tree == -3)
    if not whole_numbers(tree[inner], n) or not bool(np.all(inner | named | (tree == -1))):
        return "the tree has an unknown reason or joint"
    count = int(np.count_nonzero(inner))
    if len(data["splits"]) != count or len(tree) != 2 * count + 1:
        return "the numbers of nodes, splits and leaves don't fit together"
    if blocked.shape[1] != np.count_nonzero(named):
        return "the pairs of spheres and obstacles don't fit the leaves"
    own = tree[named] == -3
    spheres = 0 if problem.cover is None else len(problem.cover)
    others = blocked[1]
    if (
        not whole_numbers(blocked[0], spheres)
        or not whole_numbers(others[own], spheres)
        or not whole_numbers(others[~own], len(problem.obstacles))
    ):
        return _OUTCOMES[5]
    return None


def _check_claim(problem: IKProblem, certificate: Certificate) -> str | None:
    data, allowed = certificate.data, problem.tolerances
    inflation = data["inflation"]
    least = (max(allowed.position, LEAST_INFLATION[0]), max(allowed.rotation, LEAST_INFLATION[1]))
    if not (least[0] <= inflation[0] <= WIDEST and least[1] <= inflation[1] <= WIDEST):
        return f"the proof covers {inflation.tolist()} (m, rad) around the target; {list(least)} are needed"
    if certificate.margin != inflation[0]:
        return "the margin is not the tolerance that the proof covers"
    margin = allowed.safety_margin
    if not margin <= data["clearance"][0] <= margin + MOST_OVERLAP:
        return f"the proof is about a clearance of {data['clearance'][0]:g} m, the problem about {margin:g} m"
    if certificate.scope != scope_of(problem, data["blocked"].shape[1] > 0):
        return f"the proof's scope is not {certificate.scope!r}"
    if certificate.statement != statement(data):
        return "the statement is not what the proof shows"
    return None


def scope_of(problem: IKProblem, obstacles_used: bool) -> str:
    """What a proof by branch and bound is about.

    The rule of `workcell.ik.certificate.proof_scope`, said again: the checker takes nothing on trust from those who
    issue proofs.
    """
    if not obstacles_used:
        return "kinematics"
    kind = None if problem.cover is None else problem.cover.kind
    return "geometry" if kind == "inner" or (kind == "given" and problem.checker is None) else "model"


def _check_root(problem: IKProblem, root: Array) -> str | None:
    from workcell.ik.branch.checker.setup import admissible

    lower, upper, periodic = admissible(problem)
    covered = ((root[0] <= lower) & (root[1] >= upper)) | (periodic & (root[1] - root[0] >= 2 * np.pi))
    if not np.all(covered) or not np.all(np.abs(root) <= MOST_TURNED):
        k = int(np.argmin(covered))
        names = problem.robot.all_joint_names
        part = f"joint {names[k]!r}" if k < len(names) else "the rotations of the target"
        return f"the boxes leave out a part of {part}"
    return None


def _check_pairs(problem: IKProblem, data: Mapping[str, Array]) -> str | None:
    """Whether the pairs of spheres that the proof uses are among those that must keep clear."""
    own = data["blocked"][:, data["tree"][data["tree"] <= -2] == -3].astype(int)
    pairs = np.zeros((0, 2)) if problem.self_collision is None else problem.self_collision
    known = {frozenset(pair) for pair in pairs.tolist()}
    for one, two in set(zip(*own.tolist(), strict=True)):
        if frozenset((one, two)) not in known:
            return f"the spheres {one} and {two} may touch"
    return None


def check_tree(problem: IKProblem, data: Mapping[str, Array], length: float) -> str | None:
    """None when a proof's tree excludes every configuration of its root box, else why it doesn't.

    Nothing else of the proof is looked at: neither whether the root box holds all configurations, nor the claim.

    Args:
        problem: what the proof is about.
        data: `tree`, `splits`, `blocked`, `root`, `inflation` and `clearance` of a proof, well formed.
        length: metres, no less than the robot and its surroundings reach: sets the slack for rounding.
    """
    from workcell.ik.branch.checker.closure import new_box
    from workcell.ik.branch.checker.setup import proof_robot, proof_scene
    from workcell.ik.branch.checker.walk import walk

    used = data["blocked"].shape[1] > 0
    robot = proof_robot(problem, data["inflation"], length)
    try:
        scene = proof_scene(problem, used)
    except ValueError as error:
        return str(error)
    root = np.zeros((2, data["root"].shape[1] + 2))
    root[0, 1:-1], root[1, 1:-1] = data["root"][0] - WIDENED, data["root"][1] + WIDENED
    tree = np.array(data["tree"])
    spare = 10 * len(tree) + 1000
    arrays = (np.array(data["splits"]), np.array(data["blocked"]))
    box = new_box(root.shape[1])
    outcome, node = walk(robot, scene, root, tree, *arrays, float(data["clearance"][0]), spare, box)
    return None if outcome == 0 else f"{_OUTCOMES[outcome]} (node {node} of {len(tree)})"
