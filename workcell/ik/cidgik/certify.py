"""CIDGIK's proofs as `cidgik/2` certificates: what was proved of a few chosen vectors, said of the chain's own.

The multipliers of limits, spheres and positive semidefinite matrices are carried over; what is zero at every
configuration (closure, axes, hands of frames) is multiplied anew, by whatever makes the sum vanish between links. The
checker takes multipliers from any source, so nothing here needs to be exact.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from workcell.ik.certificate import Certificate, problem_hash
from workcell.ik.cidgik.check import KIND, scope_of, statement
from workcell.ik.cidgik.gram import Columns, Multipliers, Sum, margin, quaternion_of, turned_terms
from workcell.ik.cidgik.instance import Instance
from workcell.ik.cidgik.model import relaxation_at
from workcell.ik.cidgik.proof import Proof
from workcell.ik.cidgik.proof import margin as proof_margin
from workcell.ik.cidgik.workspace.rules import KINDS
from workcell.ik.claims.chain import unsuited
from workcell.ik.elementary.bounds import WIDE
from workcell.ik.problem import IKProblem
from workcell.ik.shared.conic import smat
from workcell.pose import Array


def certify(problem: IKProblem, proof: Proof) -> Certificate | None:
    """A certificate of what the multipliers prove of a problem, or None if that is too weak.

    It covers a millimetre, a hundredth of a radian and a millimetre of penetration where the margin allows, else the
    problem's own tolerances.
    """
    if unsuited(problem) is not None:
        return None
    instance, keeper = relaxation_at(problem)
    asked = np.array([problem.tolerances.position, problem.tolerances.rotation, 0.0])
    # what is too weak for the solver's own vectors, which costs little to find out, is so for the chain's
    if not proof_margin(instance, keeper, proof, *map(float, asked)) > 0.0:
        return None
    m = translated(problem, instance, proof)
    for covered in (np.maximum(asked, WIDE), asked):
        found = margin(problem, m, covered)
        if found > 0.0:
            words = statement(m, covered)
            return Certificate(
                KIND, scope_of(problem, m), words, found, problem_hash(problem), _numbers(m, covered)
            )
    return None


def _numbers(m: Multipliers, covered: Array) -> dict[str, Array]:
    data = {
        "tolerances": covered,
        "facts": m.facts,
        "hands": m.hands,
        "turned": m.turned,
        "limits": m.limits,
        "keys": m.keys.astype(float),
        "rows": m.rows,
        "S": m.S,
        "frames": m.frames,
    }
    return data | ({"pairs": m.pairs.astype(float), "own": m.own} if len(m.pairs) else {})


def translated(problem: IKProblem, instance: Instance, proof: Proof) -> Multipliers:
    """A proof's multipliers over the chain's own vectors."""
    columns = Columns(problem)
    n = columns.chain.joints
    limits = np.zeros(n)
    for plan, mu in zip(instance.structure.limits.limited, proof.limits, strict=True):
        limits[plan.joint] = mu
    kind = proof.keys[:, 0].astype(int)
    balls, apart = kind == KINDS.index("ball"), kind == KINDS.index("apart")
    numbered = np.flatnonzero([piece.kind == "sphere" for piece in problem.obstacles])
    keys = proof.keys[balls, 1:].astype(np.int64)
    if len(keys):
        keys[:, 1] = numbered[keys[:, 1]]
    m = Multipliers(
        np.zeros((n + 2 if problem.goal == "axis" else n + 1, columns.width)),
        np.zeros((n, 2)),
        np.zeros((2, 3)),
        limits,
        keys,
        proof.rows[balls],
        proof.keys[apart, 1:].astype(np.int64),
        proof.rows[apart],
        _factor(instance, columns, proof.S),
        _frames(instance, columns, proof.frames),
    )
    return _vanishing(problem, columns, m)


def _factor(instance: Instance, columns: Columns, packed: Array) -> Array:
    """(u, ...) factor of the multiplier of Z, which is of the kept basis vectors and the base's axes."""
    structure = instance.structure
    reduction, d = structure.reduction, structure.skeleton.dimension
    vectors = [b @ columns.of_link[k] for k in reduction.links for b in structure.skeleton.basis[k].T] + [
        columns.origin(k) for k in reduction.links
    ]
    basis = np.vstack([np.array(vectors)[reduction.chosen], columns.of_link[0]])[structure.keep]
    assert d == 3
    values, directions = np.linalg.eigh(smat(packed, structure.order))
    factor: Array = basis.T @ (directions * np.sqrt(np.maximum(values, 0.0)))
    return factor


def _frames(instance: Instance, columns: Columns, packed: Array) -> Array:
    """(m, 4, 4) factors of the multipliers of quaternion matrices, which are of frames turned against their links'."""
    frames = np.zeros((columns.links, 4, 4))
    skeleton = instance.structure.skeleton
    for link, block in zip(instance.structure.frames.free_links, packed, strict=True):
        values, directions = np.linalg.eigh(smat(block, 4))
        w, x, y, z = quaternion_of(skeleton.basis[link])
        # the quaternion of R B is this times that of R
        turned = np.array([[w, -x, -y, -z], [x, w, z, -y], [y, -z, w, x], [z, y, -x, w]])
        frames[link - 1] = turned.T @ (directions * np.sqrt(np.maximum(values, 0.0)))
    return frames


def _vanishing(problem: IKProblem, columns: Columns, m: Multipliers) -> Multipliers:
    """The same with the multipliers of what is zero chosen so that least is left between links."""
    from scipy.linalg import lstsq

    i, j = np.nonzero(np.triu(columns.between()))
    rest = Sum(problem, m, np.zeros(3)).H[i, j]
    n, u = columns.chain.joints, columns.width
    e, f, c, d = columns.sides()
    rows = [_by_facts(columns.facts(problem), u, i, j)]
    rows += [_between(e, c, i, j) - _between(f, d, i, j), _between(f, c, i, j) + _between(e, d, i, j)]
    for k in range(6):
        left, right = turned_terms(columns, np.eye(6)[k].reshape(2, 3))
        rows.append(_between(left, right, i, j).sum(axis=0, keepdims=True))
    solution = -np.asarray(
        lstsq(np.concatenate(rows).T, rest, cond=1e-10, lapack_driver="gelsy", check_finite=False)[0],
        dtype=float,
    )
    facts, others = solution[: m.facts.size].reshape(-1, u), solution[m.facts.size :]
    hands, turned = others[: 2 * n].reshape(2, n).T, others[2 * n :].reshape(2, 3)
    return replace(m, facts=facts, hands=hands, turned=turned)


def _by_facts(facts: Array, u: int, i: NDArray[np.int64], j: NDArray[np.int64]) -> Array:
    """(facts u, entries) what the product of each fact with each column adds to the entries (i, j) of H."""
    unit = np.eye(u)
    each: Array = 0.5 * (facts[:, None, i] * unit[None, :, j] + facts[:, None, j] * unit[None, :, i])
    return each.reshape(-1, len(i))


def _between(left: Array, right: Array, i: NDArray[np.int64], j: NDArray[np.int64]) -> Array:
    """(t, entries) what products of vectors (t, u) add to the entries (i, j) of H."""
    added: Array = 0.5 * (left[:, i] * right[:, j] + left[:, j] * right[:, i])
    return added
