"""Proofs that CIDGIK's relaxation (Problem 3) is empty, made from a dual ray and checked without a solver.

Every configuration that reaches the goals gives a Z of rank d. With multipliers of the equalities (lambda, free), of
limits and workspace rows (mu >= 0) and of Z and the frames' quaternion matrices (S, T, positive semidefinite), the sum
`F(Z) = lambda . equalities + mu . inequalities + <S, Z> + <T, Q>` is then at least zero. But F is affine in the entries
of Z, which are bounded: basis vectors are directions (length 1) or points of the chain (no farther than it is long).
Where F's constant, plus its coefficients times those bounds, is negative, there is no such configuration.

A goal that is reached within a tolerance changes the vectors that hang from it by a known amount; what that can add to
F is counted too. So the proof covers the tolerances it names, and no residual of a solver enters.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from workcell.ik.cidgik.instance import Instance
from workcell.ik.cidgik.rank import Kept, Relaxed
from workcell.ik.cidgik.reduction import Vectors
from workcell.ik.cidgik.structure import Structure
from workcell.ik.cidgik.workspace.keeper import Keeper
from workcell.ik.cidgik.workspace.rules import KINDS, Key
from workcell.ik.shared.conic import smat, svec, triangle
from workcell.ik.trees.query import PLANE_SLACK
from workcell.pose import Array, read_only

ROUNDING = 1e-9
"""Part of F (for multipliers of unit length) that rounding may account for."""
LARGEST = 1e50
"""Size of a multiplier for which all sums are finite."""


@dataclass(frozen=True, slots=True)
class Proof:
    """Multipliers that show a relaxation empty.

    Attributes:
        equalities: (m,) of the structure's independent equalities, then of points in planes.
        limits: (l,) of the joint limits, >= 0.
        keys: (k, 3) workspace rows: kind (index in `KINDS`), and its two numbers.
        rows: (k,) their multipliers, >= 0.
        S: (K,) triangle of the multiplier of Z.
        frames: (f, 10) triangles of those of the frames.
    """

    equalities: Array
    limits: Array
    keys: Array
    rows: Array
    S: Array
    frames: Array

    def __post_init__(self) -> None:
        for name in self.__slots__:
            object.__setattr__(self, name, read_only(getattr(self, name)))

    def size(self) -> float:
        """Euclidean length of all that is multiplied: a margin is counted in it."""
        parts = (self.equalities, self.limits, self.rows, self.S, self.frames.ravel())
        return float(np.linalg.norm(np.concatenate(parts)))


def proof_of(instance: Instance, keeper: Keeper | None, z: Array) -> Proof | None:
    """Multipliers of unit length from a solver's ray `z`; None where it leans on rows that not every solution keeps."""
    limits, slots, S, frames = instance.split(z)
    keys: list[Key] = []
    rows = []
    for key, value in zip([] if keeper is None else keeper.loaded, slots, strict=True):
        if key is None or key[0] not in KINDS:
            return None
        if value > 0:
            keys.append(key)
            rows.append(float(value))
    coded = np.array([(KINDS.index(kind), i, j) for kind, i, j in keys], dtype=float).reshape(-1, 3)
    order = instance.structure.order
    proof = Proof(
        np.zeros(len(instance.structure.used) + len(instance.added)),
        np.maximum(limits, 0.0),
        coded,
        np.array(rows),
        _positive(S, order),
        np.array([_positive(block, 4) for block in frames]).reshape(-1, 10),
    )
    total = _Sum(instance, keeper, proof, 0.0)
    A, _ = instance.equalities()
    equalities = np.asarray(-np.linalg.lstsq(A.T, total.gradient, rcond=None)[0], dtype=float)
    size = replace(proof, equalities=equalities).size()
    if not size > 0:
        return None
    return Proof(
        equalities / size,
        proof.limits / size,
        coded,
        proof.rows / size,
        proof.S / size,
        proof.frames / size,
    )


def prove_empty(instance: Instance, keeper: Keeper | None, over: Callable[[], bool]) -> Proof | None:
    """Multipliers that show a relaxation empty, with every sphere that it breaks; None where they can't be had."""
    ray = empty_with_all(instance, keeper, over)
    proof = None if ray is None else proof_of(instance, keeper, ray)
    instance.release()
    return proof


def empty_with_all(instance: Relaxed, keeper: Kept | None, over: Callable[[], bool]) -> Array | None:
    """Add the rows on spheres that points of the relaxation break, until it is empty or keeps them all.

    Returns its ray where it is empty, None where it keeps them.
    """
    C = instance.nuclear()
    while not over():
        solution = instance.solve(C)
        if solution.status == "infeasible":
            return solution.z
        if keeper is None or not solution.usable or not keeper.add_cut_off(instance.matrix(solution.x)):
            return None
    return None


def _positive(packed: Array, order: int) -> Array:
    values, vectors = np.linalg.eigh(smat(packed, order))
    return svec((vectors * np.maximum(values, 0.0)) @ vectors.T)


def malformed(instance: Instance, keeper: Keeper | None, proof: Proof) -> str | None:
    """Why the multipliers can't belong to this relaxation, or None."""
    structure = instance.structure
    shapes = (
        (proof.equalities, (len(structure.used) + len(instance.added),)),
        (proof.limits, (len(instance.limit_rows),)),
        (proof.rows, (len(proof.keys),)),
        (proof.S, instance.Z0.shape),
        (proof.frames, (len(instance.frame_rows) // 10, 10)),
    )
    if any(values.shape != shape or not np.all(np.abs(values) <= LARGEST) for values, shape in shapes):
        return "its multipliers are damaged or of another relaxation"
    if not (np.all(proof.limits >= 0) and np.all(proof.rows >= 0)):
        return "a multiplier of an inequality is negative"
    if len(proof.keys) and (keeper is None or not keeper.knows(proof.keys)):
        return "it names a row that the workspace does not have"
    return None


def margin(
    instance: Instance,
    keeper: Keeper | None,
    proof: Proof,
    position: float,
    rotation: float,
    clearance: float,
) -> float:
    """By how much F stays below zero at every configuration that reaches the goals within `position` metres and
    `rotation` radians, and keeps the workspace but for `clearance` metres; positive: there is none."""
    structure = instance.structure
    if not structure.reduction.exact:
        # the rows hold of a chain that is only near this one
        return -np.inf
    total = _Sum(instance, keeper, proof, -clearance)
    A, b = instance.equalities()
    coefficients = total.gradient + A.T @ proof.equalities
    value = total.constant - float(proof.equalities @ b)
    strayed = _Strayed(instance, position, rotation)
    moved = strayed.equalities(proof.equalities) + strayed.limits(proof.limits)
    moved += strayed.rows(keeper, proof, clearance) + strayed.frames(proof.frames)
    moved += _indefinite(proof.S, structure.order) * _trace_bound(structure)
    moved += sum(_indefinite(block, 4) for block in proof.frames)
    size = proof.size()
    if not size > 0.0:
        return -np.inf
    return -(value + float(np.abs(coefficients) @ _entry_bounds(structure)) + moved) / size - ROUNDING


def _indefinite(packed: Array, order: int) -> float:
    """By how much a triangle's least eigenvalue may lie below zero, at most: what it then takes from a trace of one."""
    matrix = smat(packed, order)
    slack = 1e-12 * float(np.linalg.norm(matrix))
    return max(slack - float(np.linalg.eigvalsh(matrix)[0]), 0.0)


def _trace_bound(structure: Structure) -> float:
    d = structure.skeleton.dimension
    return float(np.sum(structure.reduction.bounds()[structure.keep[:-d]] ** 2)) + d


def _entry_bounds(structure: Structure) -> Array:
    """(v,) largest absolute values of the variable entries of svec(Z)."""
    d = structure.skeleton.dimension
    length = np.concatenate([structure.reduction.bounds()[structure.keep[:-d]], np.ones(d)])
    a, b, factor = triangle(structure.order)
    bounds: Array = (length[a] * length[b] * factor)[structure.free]
    return bounds


class _Sum:
    """F without its equalities, affine in the variable entries of svec(Z): gradient (v,) and constant."""

    def __init__(self, instance: Instance, keeper: Keeper | None, proof: Proof, spare: float) -> None:
        structure = instance.structure
        packed, least = structure.limits.at(instance.G, instance.middle, instance.half)
        whole = proof.limits @ packed[:, structure.sub] + proof.S
        constant = -float(proof.limits @ least)
        for (kind, i, j), mu in zip(proof.keys, proof.rows, strict=True):
            assert keeper is not None  # `malformed` refuses such keys, `proof_of` has none
            row, offset, _ = keeper.inequality((KINDS[int(kind)], int(i), int(j)), spare)
            whole = whole + mu * row
            constant += float(mu * offset)
        blocks, quarter = structure.frames.quaternions(instance.G)
        if len(blocks):
            whole = whole + np.einsum("fs,fsk->k", proof.frames, blocks[:, :, structure.sub])
            constant += float(np.sum(proof.frames @ quarter))
        self.gradient: Array = whole[structure.free]
        self.constant = constant + float(whole[~structure.free] @ structure.fixed_value)


class _Strayed:
    """What F can gain because goals are reached within tolerances only, not exactly."""

    def __init__(self, instance: Instance, position: float, rotation: float) -> None:
        self.instance, self.structure = instance, instance.structure
        self._position = position
        self._chord = 2.0 * np.sin(0.5 * min(rotation, np.pi))

    def _off(self, vectors: Vectors) -> Array:
        """(...) metres by which vectors lie off, because they are written with the goals' own columns."""
        off, start = np.zeros(vectors.goal.shape[:-1]), 0
        for goal in self.structure.skeleton.goals:
            stop = start + 1 + len(goal.axes)
            part = vectors.goal[..., start:stop]
            off = off + np.abs(part[..., 0]) * self._position
            off = off + np.linalg.norm(part[..., 1:], axis=-1) * self._chord
            start = stop
        return off

    def equalities(self, multipliers: Array) -> float:
        """Directions are unit vectors: a product of two is off by the sum of what they are off."""
        products = self.structure.rigid
        a, b = self._off(products.left), self._off(products.right)
        per_row = np.zeros(len(products.constant))
        np.add.at(per_row, products.row, np.abs(products.weight) * (a + b + a * b))
        a, b, z = (self._off(part) for part in self.structure.frames.turned)
        per_frame = b + a + z + z * a
        d = self.structure.skeleton.dimension
        whole = np.concatenate([per_row, np.repeat(per_frame, d)])
        # the judge takes a point for being in a plane when it is as near as this
        planes = [float(self._off(point)) + PLANE_SLACK for point, _, _ in self.instance.added]
        return float(np.abs(multipliers) @ np.append(whole[self.structure.used], planes))

    def limits(self, multipliers: Array) -> float:
        products = self.structure.limits.products
        a, b = self._off(products.left), self._off(products.right)
        per_row = np.zeros(len(products.constant))
        np.add.at(per_row, products.row, a + b + a * b)
        return float(multipliers @ per_row)

    def rows(self, keeper: Keeper | None, proof: Proof, clearance: float) -> float:
        """A product of two vectors is off by their lengths times what they are off."""
        total = 0.0
        for (kind, i, j), mu in zip(proof.keys, proof.rows, strict=True):
            assert keeper is not None
            key: Key = (KINDS[int(kind)], int(i), int(j))
            off = float(self._off(keeper.vectors.one(key[1])))
            if key[0] == "apart":
                off += float(self._off(keeper.vectors.one(key[2])))
            a, b = keeper.inequality(key, -clearance)[2]
            if key[0] == "plane":
                total += float(mu) * off
            else:
                total += float(mu) * off * (self._length(a) + self._length(b) + off)
        return total

    def _length(self, coefficients: Array) -> float:
        """Upper bound of the length of a vector given over the kept [X; I]."""
        d = self.structure.skeleton.dimension
        bounds = self.structure.reduction.bounds()[self.structure.keep[:-d]]
        return float(np.abs(coefficients[:-d]) @ bounds + np.linalg.norm(coefficients[-d:]))

    def frames(self, multipliers: Array) -> float:
        """The quaternion matrix changes by half as much as the rotation (Frobenius)."""
        off = [0.5 * float(np.linalg.norm(self._off(frame))) for frame in self.structure.frames.free]
        return float(sum(np.linalg.norm(T) * moved for T, moved in zip(multipliers, off, strict=True)))
