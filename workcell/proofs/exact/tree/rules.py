"""`branch` (section 6): what its arrays have to be, and what they claim."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from workcell.proofs.exact.certificates import Array, Certificate, Claim, index, tolerances
from workcell.proofs.exact.problems import SLACK, Problem
from workcell.proofs.exact.reading import RefusedError
from workcell.proofs.exact.spans import ONE as SPAN_ONE
from workcell.proofs.exact.spans import PI, span
from workcell.proofs.exact.tree.closures import closures
from workcell.proofs.exact.tree.collisions import named_pairs
from workcell.proofs.exact.tree.fixed import ONE, Ints
from workcell.proofs.exact.tree.relations import Blur
from workcell.proofs.exact.tree.views import fixed_arm
from workcell.proofs.exact.tree.walk import Tree, Walker

MOST_NODES = 5_000_000
MOST_CLEARANCE = 1e-5
FARTHEST = 100.0
WIDENED = Fraction(1e-10)


def branch(problem: Problem, certificate: Certificate) -> Claim:
    """A tree of boxes that cover all joint angles, each of them excluded.

    Raises:
        RefusedError: an array breaks a rule, or a leaf is not excluded.
    """
    n = len(problem.arm.joints)
    tree, splits, blocked, root, inflation, clearance, _ = certificate.arrays(
        tree=("nodes",),
        splits=("inner",),
        blocked=(2, "named"),
        root=(2, n),
        inflation=(2,),
        clearance=(1,),
        seal=(8,),
    )
    position, rotation = tolerances(inflation.values)
    (c,) = clearance.values
    if not 0.0 <= c <= MOST_CLEARANCE:
        raise RefusedError(f"its clearance is {c:g}, not from 0 to {MOST_CLEARANCE:g}")
    low, high = _root(problem, root)
    nodes, named = _tree(tree, splits, blocked, (low, high), problem)
    used = sorted(set(named))
    places = [problem.obstacles[o].centre for _, o in used]
    arm = fixed_arm(problem, places)
    numbers = {both: k for k, both in enumerate(used)}
    nodes.label[nodes.label >= 0] = [numbers[both] for both in named]
    pairs = named_pairs(problem, used, c, arm.units)
    blur = Blur(_ceiling(Fraction(position) / Fraction(2) ** arm.units), _ceiling(Fraction(rotation)))
    ends = [
        np.array([_floor(Fraction(v) - WIDENED) for v in low], dtype=np.int64),
        np.array([_ceiling(Fraction(v) + WIDENED) for v in high], dtype=np.int64),
    ]
    Walker(arm, blur, pairs, closures(arm)).prove(nodes, ends[0], ends[1])
    leaves = int(np.count_nonzero(nodes.joint < 0))
    wanted = (
        f" with a clearance of {1e3 * c:.4g} mm or more (up to 0.01 mm beyond the wanted one)"
        if named
        else ""
    )
    statement = (
        f"No configuration{wanted} brings the tool within {1e3 * position:g} mm and {rotation:g} rad "
        f"of its target: each of the {leaves} boxes that cover all joint angles is excluded."
    )
    if certificate.margin != position:
        raise RefusedError(f"it says a margin of {certificate.margin:g}, and a tree's is {position:g}")
    return Claim("geometry" if named else "kinematics", statement, span(position))


def _floor(x: Fraction) -> int:
    return (x * ONE).__floor__()


def _ceiling(x: Fraction) -> int:
    return (x * ONE).__ceil__()


def _root(problem: Problem, root: Array) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Rule 6.2: every joint's range with its slack, or a whole turn; both when widened."""
    low, high = root.rows()
    if not all(abs(value) <= FARTHEST for value in root.values):
        raise RefusedError(f"the root reaches beyond {FARTHEST:g} rad")
    turn = Fraction(2 * PI.high, SPAN_ONE)
    for k, joint in enumerate(problem.arm.joints):
        first, last = Fraction(low[k]) - WIDENED, Fraction(high[k]) + WIDENED
        lower, upper = Fraction(joint.lower) - Fraction(SLACK), Fraction(joint.upper) + Fraction(SLACK)
        if not (first <= lower and last >= upper) and not last - first >= turn:
            raise RefusedError(f"the root leaves out a part of joint {k}'s range")
    return low, high


def _tree(
    tree: Array, splits: Array, blocked: Array, root: tuple[tuple[float, ...], ...], problem: Problem
) -> tuple[Tree, list[tuple[int, int]]]:
    """Rules 6.1 and 6.3: nodes as whole numbers, and the pairs of the leaves that name one, in order."""
    joints = len(problem.arm.joints)
    count = len(tree.values)
    if not 1 <= count <= MOST_NODES or count != 2 * len(splits.values) + 1:
        raise RefusedError(f"a tree of {count} nodes with {len(splits.values)} splits")
    kinds = np.array(tree.values)
    if not np.all(np.isin(kinds, np.arange(-2, joints))):
        raise RefusedError("a node is neither a joint's split nor a leaf of -1 or -2")
    joint = kinds.astype(np.int64)
    inner = np.flatnonzero(joint >= 0)
    cuts = np.array(splits.values)
    limits = np.array(root)[:, joint[inner]] if len(inner) else np.zeros((2, 0))
    if not np.all((limits[0] <= cuts) & (cuts <= limits[1])):
        raise RefusedError("a box is split outside the root")
    split = np.zeros(count, dtype=np.int64)
    split[inner] = np.floor(cuts * ONE).astype(np.int64)  # a product with a power of two is exact
    names = np.flatnonzero(joint == -2)
    rows = blocked.rows()
    if len(rows[0]) != len(names):
        raise RefusedError(f"{len(names)} leaves name a sphere and an obstacle, {len(rows[0])} are named")
    pairs = [
        (index(s, len(problem.arm.spheres), "a sphere"), index(o, len(problem.obstacles), "an obstacle"))
        for s, o in zip(*rows, strict=True)
    ]
    label = np.full(count, -1, dtype=np.int64)
    label[names] = np.arange(len(names))
    return Tree(joint, _second_halves(joint), split, label), pairs


def _second_halves(joint: Ints) -> Ints:
    """Where the second half of every inner node is: behind all of the first one's nodes.

    Raises:
        RefusedError: the nodes are no tree.
    """
    second = np.zeros(len(joint), dtype=np.int64)
    waiting: list[int] = []
    for k, kind in enumerate(joint.tolist()):
        if kind >= 0:
            waiting.append(k)
        elif k + 1 < len(joint):
            if not waiting:
                raise RefusedError("the tree ends before its nodes do")
            second[waiting.pop()] = k + 1
    if waiting:
        raise RefusedError("the tree's nodes end before it does")
    return second
