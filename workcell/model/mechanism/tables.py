"""A mechanism's joints as arrays, so that placing them takes few calls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workcell.identity_cache import ByIdentity
from workcell.model.mechanism.mechanism import Mechanism
from workcell.pose import Array, axis_angle_to_matrix, quat_to_matrix

Index = NDArray[np.int64]
_FOUR, _BEFORE = np.arange(4), np.arange(3, 0, -1)


@dataclass(frozen=True, slots=True)
class Tables:
    """The joints by kind.

    Attributes:
        parents: (n,) links.
        still, sine, cosine: (n, 3, 3); a hinge turns by `still + sin(value) sine + (1 - cos(value)) cosine`; zeros of
            sine and cosine else.
        offset, along: (n, 3) metres, and metres per metre of a slide, in the parent.
        axis: (n, 3) in the child.
        hinges, slides, balls, frees: indices of the joints.
        hinge_values, slide_values: where their numbers are in a configuration; of the others where a quaternion begins.
        single_values, single_rates: where hinges and slides have their numbers in configurations and tangents.
        first_rates: (n,) where each joint's numbers in tangents begin.
        quats, turns: (b, 4) and (b, 3) where quaternions of balls and floating bodies are, and their turns in tangents.
        places, shifts: (f, 3) where floating bodies are, and how they shift in tangents.
        rate_joint: (dof,) the joint of each number of a tangent.
        moves: (links, dof) whether it moves a link.
    """

    parents: tuple[int, ...]
    still: Array
    sine: Array
    cosine: Array
    offset: Array
    along: Array
    axis: Array
    hinges: Index
    slides: Index
    balls: Index
    frees: Index
    hinge_values: Index
    slide_values: Index
    ball_values: Index
    free_values: Index
    single_values: Index
    single_rates: Index
    first_rates: Index
    quats: Index
    turns: Index
    places: Index
    shifts: Index
    rate_joint: Index
    moves: NDArray[np.bool_]

    def local(self, q: Array) -> tuple[Array, Array]:
        """Rotations (..., n, 3, 3) and places (..., n, 3) of all children in their parents, q (..., size)."""
        batch = q.shape[:-1]
        R = np.broadcast_to(self.still, (*batch, *self.still.shape)).copy()
        p = np.broadcast_to(self.offset, (*batch, *self.offset.shape)).copy()
        if len(self.hinges):
            angle = q[..., self.hinge_values, None, None]
            k = self.hinges
            R[..., k, :, :] += np.sin(angle) * self.sine[k] + (1.0 - np.cos(angle)) * self.cosine[k]
        if len(self.slides):
            p[..., self.slides, :] += q[..., self.slide_values, None] * self.along[self.slides]
        if len(self.balls):
            turned = quat_to_matrix(q[..., self.ball_values[:, None] + _FOUR])
            R[..., self.balls, :, :] = self.still[self.balls] @ turned
        if len(self.frees):
            R[..., self.frees, :, :] = rotations(q[..., self.free_values[:, None] + _FOUR])
            p[..., self.frees, :] = q[..., self.free_values[:, None] - _BEFORE]
        return R, p


def _forms() -> Array:
    """(16, 9) the entries of a rotation matrix as quadratic forms of its unit quaternion wxyz."""
    unit = np.eye(4)
    alone = quat_to_matrix(unit).reshape(4, 9)
    form = np.zeros((4, 4, 9))
    for i in range(4):
        form[i, i] = alone[i]
        for j in range(i):
            both = 2.0 * quat_to_matrix(unit[i] + unit[j]).ravel() - alone[i] - alone[j]
            form[i, j] = form[j, i] = 0.5 * both
    return form.reshape(16, 9)


_FORMS = _forms()


def rotations(quats: Array) -> Array:
    """Rotation matrices (..., 3, 3) of unit quaternions wxyz (..., 4)."""
    R: Array = (quats[..., :, None] * quats[..., None, :]).reshape(-1, 16) @ _FORMS
    return R.reshape(*quats.shape[:-1], 3, 3)


def crossed(one: Array, two: Array) -> Array:
    """Cross products (m, 3) of vectors (m, 3)."""
    found = np.empty_like(one)
    found[:, 0] = one[:, 1] * two[:, 2] - one[:, 2] * two[:, 1]
    found[:, 1] = one[:, 2] * two[:, 0] - one[:, 0] * two[:, 2]
    found[:, 2] = one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]
    return found


_made = ByIdentity()


def tables_of(mechanism: Mechanism) -> Tables:
    """The mechanism's tables, remembered."""
    made: Tables = _made.get((mechanism,), lambda: _tables(mechanism))
    return made


def _tables(mechanism: Mechanism) -> Tables:
    joints, n = mechanism.joints, len(mechanism.joints)
    kinds = np.array([joint.kind for joint in joints])
    hinges, slides, balls, frees = (
        np.flatnonzero(kinds == kind) for kind in ("hinge", "slide", "ball", "free")
    )
    first = np.array([at.start for at in mechanism.value_slices])
    rates = np.array([at.start for at in mechanism.rate_slices])
    still = np.array([joint.T_parent_joint.rotation for joint in joints]).reshape(n, 3, 3)
    axis = np.array([joint.axis for joint in joints]).reshape(n, 3)
    quarter, half = (axis_angle_to_matrix(axis, np.full(n, angle)) for angle in (np.pi / 2, np.pi))
    cosine = 0.5 * (half - np.eye(3))
    sine = quarter - np.eye(3) - cosine
    turning = (kinds == "hinge")[:, None, None]
    single = np.flatnonzero((kinds == "hinge") | (kinds == "slide"))
    quats = np.concatenate([first[balls], first[frees] + 3])
    rate_joint = np.repeat(np.arange(n), [at.stop - at.start for at in mechanism.rate_slices])
    return Tables(
        parents=tuple(joint.parent for joint in joints),
        still=still,
        sine=np.where(turning, still @ sine, 0.0),
        cosine=np.where(turning, still @ cosine, 0.0),
        offset=np.array([joint.T_parent_joint.position for joint in joints]).reshape(n, 3),
        along=(still @ axis[..., None])[..., 0],
        axis=axis,
        hinges=hinges,
        slides=slides,
        balls=balls,
        frees=frees,
        hinge_values=first[hinges],
        slide_values=first[slides],
        ball_values=first[balls],
        free_values=first[frees] + 3,
        single_values=first[single],
        single_rates=rates[single],
        first_rates=rates,
        quats=quats[:, None] + _FOUR,
        turns=np.concatenate([rates[balls], rates[frees] + 3])[:, None] + _FOUR[:3],
        places=first[frees][:, None] + _FOUR[:3],
        shifts=rates[frees][:, None] + _FOUR[:3],
        rate_joint=rate_joint,
        moves=mechanism.ancestors[:, rate_joint],
    )
