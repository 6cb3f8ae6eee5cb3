"""MuJoCo's own measure of a mechanism's configuration: its constraints, frames, limits, what touches.

Nothing here asks `placing`: poses are MuJoCo's kinematics, residuals the positions of its constraint rows.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from workcell.errors import ModelError
from workcell.identity_cache import ByIdentity
from workcell.model.judge.distances import judge_model
from workcell.model.judge.nearest import Distance, NearestPair, refuse_unmeasured
from workcell.model.judge.pairs import colliding_pairs
from workcell.model.labels import geom_name, geoms_called
from workcell.model.loops.elements import joined, loop_elements
from workcell.model.mechanism.mechanism import WORLD, Closure, Mechanism
from workcell.model.mechanism.walking import joint_label
from workcell.pose import Array, Pose, quat_to_matrix, rotation_vector

if TYPE_CHECKING:
    import mujoco

_EXACT = 1e-9
"""Metres (radians) within which a frame is the site or body of its name."""


@dataclass(frozen=True, slots=True)
class Tie:
    """What one tie misses: metres (of couplings in the unit of who follows), and radians of a weld's rotation."""

    name: str
    missed: float
    turned: float = 0.0

    @property
    def worst(self) -> float:
        """The larger of both."""
        return max(self.missed, self.turned)


class MechanismMeasure:
    """MuJoCo's view of a mechanism, on private copies of its compiled model and data.

    Pairs of geoms that may collide follow MuJoCo's rules (`workcell.model.judge.pairs`), with one geom that the
    mechanism moves; left out are neighbours by a connect, a weld or the mechanism's own closures, and `touching` pairs.

    Args:
        mechanism: with its compiled model.
        touching: pairs of geoms (names) that may touch.

    Attributes:
        pairs: (p, 2) geoms (ids) that must not touch.
        touching: (t, 2) those that may, and can.

    Raises:
        ModelError: it has no compiled model, or geoms whose distances can't be trusted; UnknownNameError: no such geom.
    """

    def __init__(self, mechanism: Mechanism, touching: Iterable[tuple[str, str]] = ()) -> None:
        import mujoco

        compiled = mechanism.compiled
        if compiled is None:
            raise ModelError(f"{mechanism.name} comes from no compiled model", where="mechanism")
        self._mujoco, self.mechanism, self._compiled = mujoco, mechanism, compiled
        self._judge = judge_model(compiled.model)
        self._model = self._judge.model
        self._data = mujoco.MjData(self._model)
        self._tied = _constrained(compiled.model)
        self._tied_data = mujoco.MjData(self._tied)
        self._rows = mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_tendon, mujoco.mj_makeConstraint
        self._equalities = _equalities(mechanism)
        self._own = tuple(closure for closure in mechanism.closures if closure.id < 0)
        self._bodies: dict[int, int] = {
            int(link): body for body, link in reversed(list(enumerate(compiled.link_of_body)))
        }
        for closure in self._own:
            for link in closure.links:
                self._body_of(link)
        self._places = {name: self._place_of(name) for name in mechanism.frames}
        self.pairs, self.touching = self._pairs(touching)
        refuse_unmeasured(self._model, np.unique(np.concatenate([self.pairs, self.touching])).tolist())
        self._search = NearestPair(self._judge)

    @property
    def pair_names(self) -> tuple[tuple[str, str], ...]:
        """Names of the pairs of geoms that are looked at."""
        return tuple((geom_name(self._model, int(a)), geom_name(self._model, int(b))) for a, b in self.pairs)

    def ties(self, q: Array) -> tuple[Tie, ...]:
        """What every active equality constraint misses that a moving joint has part in, and every closure beside them.

        Args:
            q: configuration (size,).
        """
        data = self._tied_data
        data.qpos[:] = self._compiled.qpos(q)
        for step in self._rows:
            step(self._tied, data)
        rows = data.efc_type == int(self._mujoco.mjtConstraint.mjCNSTR_EQUALITY)
        found = []
        for equality, name in self._equalities.items():
            missed = np.array(data.efc_pos[rows & (data.efc_id == equality)])
            found.append(self._tie(equality, name, missed))
        if self._own:
            self._look(q)
            found += [self._own_tie(closure) for closure in self._own]
        return tuple(found)

    def frame(self, name: str, q: Array) -> tuple[Array, Array]:
        """World rotation (3, 3) and place (3,) of a frame at a configuration (size,)."""
        return self.frames((name,), q)[name]

    def frames(self, names: Iterable[str], q: Array) -> dict[str, tuple[Array, Array]]:
        """The same of several frames."""
        self._look(q)
        return {name: self._frame(name) for name in names}

    def distance(self, q: Array, *, limit: float = 10.0) -> Distance:
        """The smallest signed distance of the pairs at a configuration (size,), looked for up to `limit` metres."""
        self._look(q)
        return self._search(self._data, self.pairs, limit)

    def overlap(self, q: Array) -> Distance:
        """The smallest signed distance of the pairs that may touch, zero or less where they do."""
        self._look(q)
        return self._search(self._data, self.touching, 0.0)

    def contact(self, q: Array) -> Distance | None:
        """What MuJoCo's own collision pipeline has in contact among the pairs, deeper than distances may be off."""
        self._look(q)
        return self._search.contact(self._data, self.pairs)

    def beyond(self, q: Array) -> tuple[tuple[str, float, float, float], ...]:
        """Joints outside the compiled model's own limits: name, value, lower, upper (a ball's angle, 0, its limit)."""
        model, qpos, found = self._model, self._compiled.qpos(q), []
        for joint in self.mechanism.joints:
            if joint.kind == "free" or not model.jnt_limited[joint.id]:
                continue
            low, high = map(float, model.jnt_range[joint.id])
            at = int(model.jnt_qposadr[joint.id])
            value = float(qpos[at]) if joint.kind != "ball" else turn_of(qpos[at : at + 4])
            if not low <= value <= high:
                found.append((joint.name, value, low, high))
        return tuple(found)

    def _look(self, q: Array) -> None:
        self._data.qpos[:] = self._compiled.qpos(q)
        self._mujoco.mj_kinematics(self._model, self._data)

    def _body_of(self, link: int) -> int:
        if link not in self._bodies:
            raise ModelError(
                f"no body stands on link {self.mechanism.link_names[link]!r} (number {link})",
                where=self.mechanism.name,
                remedy="tie, or ask for, frames of links that carry a body",
            )
        return self._bodies[link]

    def _place_of(self, name: str) -> tuple[str, int, Pose]:
        """A frame as a site or a body of the model, or as a place on a body."""
        model, frame = self._model, self.mechanism.frames[name]
        for kind, thing in (
            ("site", self._mujoco.mjtObj.mjOBJ_SITE),
            ("body", self._mujoco.mjtObj.mjOBJ_BODY),
        ):
            index = self._mujoco.mj_name2id(model, thing, name)
            if index < 0:
                continue
            body = index if kind == "body" else int(model.site_bodyid[index])
            T = self._compiled.T_link_body[body]
            if kind == "site":
                T = T @ Pose(model.site_pos[index], model.site_quat[index])
            if (
                int(self._compiled.link_of_body[body]) == frame.link
                and max(T.error_to(frame.T_link_frame)) < _EXACT
            ):
                return kind, index, Pose.identity()
        body = self._body_of(frame.link)
        return "body", body, self._compiled.T_link_body[body].inverse() @ frame.T_link_frame

    def _frame(self, name: str) -> tuple[Array, Array]:
        kind, index, T = self._places[name]
        R, p = (
            (self._data.site_xmat, self._data.site_xpos)
            if kind == "site"
            else (self._data.xmat, self._data.xpos)
        )
        rotation = R[index].reshape(3, 3)
        return rotation @ T.rotation, rotation @ T.position + p[index]

    def _tie(self, equality: int, name: str, rows: Array) -> Tie:
        """One constraint, by its rows of MuJoCo's; a weld's rotation, which they scale, by the bodies' rotations."""
        kinds, model = self._mujoco.mjtEq, self._tied
        kind = int(model.eq_type[equality])
        if kind not in (int(kinds.mjEQ_CONNECT), int(kinds.mjEQ_WELD)):
            return Tie(name, float(np.abs(rows).max(initial=0.0)) if len(rows) else float("inf"))
        away = float(np.linalg.norm(rows[:3])) if len(rows) else float("inf")
        if kind == int(kinds.mjEQ_CONNECT):
            return Tie(name, away)
        one, two = int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])
        data, scale = self._tied_data, float(model.eq_data[equality, 10])
        if int(model.eq_objtype[equality]) == int(self._mujoco.mjtObj.mjOBJ_SITE):
            A, B = (data.site_xmat[site].reshape(3, 3) for site in (one, two))
        else:
            A, B = (data.xmat[body].reshape(3, 3) for body in (one, two))
            A = A @ quat_to_matrix(model.eq_data[equality, 6:10])
            if scale == 0.0:  # then it is a connect
                return Tie(name, away)
        return Tie(name, away, float(np.linalg.norm(rotation_vector(A @ B.T))))

    def _own_tie(self, closure: Closure) -> Tie:
        ends = []
        for link, frame in zip(closure.links, closure.frames, strict=True):
            body = self._body_of(link)
            T = self._compiled.T_link_body[body].inverse() @ frame
            R = self._data.xmat[body].reshape(3, 3)
            ends.append((R @ T.rotation, R @ T.position + self._data.xpos[body]))
        (A, a), (B, b) = ends
        turned = float(np.linalg.norm(rotation_vector(A @ B.T))) if closure.kind == "weld" else 0.0
        return Tie(closure.name, float(np.linalg.norm(a - b)), turned)

    def _pairs(self, touching: Iterable[tuple[str, str]]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Those that must not touch, and those that may."""
        model, links = self._model, self._compiled.link_of_body
        pairs = colliding_pairs(model, np.flatnonzero(links != WORLD).tolist())
        pairs = pairs[~joined(model, pairs)]
        carried = np.sort(links[np.asarray(model.geom_bodyid)[pairs]], axis=1)
        tied = {tuple(sorted(closure.links)) for closure in self._own}
        loose = [a != b and (a, b) not in tied for a, b in carried.tolist()]
        pairs = pairs[np.array(loose, dtype=bool)]
        intended = {tuple(sorted(geoms_called(model, pair, "touching"))) for pair in touching}
        may = np.array([tuple(pair) in intended for pair in pairs.tolist()], dtype=bool)
        return pairs[~may], pairs[may]


def turn_of(quat: Array) -> float:
    """Angle in [0, pi] of a quaternion wxyz (4,)."""
    return 2.0 * float(np.arctan2(np.linalg.norm(quat[1:]), abs(quat[0])))


def _constrained(model: mujoco.MjModel) -> mujoco.MjModel:
    """A copy whose only constraints are its active equalities."""
    import mujoco

    tied, bits = copy.copy(model), mujoco.mjtDisableBit
    tied.opt.disableflags = int(bits.mjDSBL_CONTACT) | int(bits.mjDSBL_LIMIT) | int(bits.mjDSBL_FRICTIONLOSS)
    tied.opt.enableflags = 0
    return tied


def _equalities(mechanism: Mechanism) -> dict[int, str]:
    """The active equality constraints in which a moving joint has part, by id, with their names."""
    import mujoco

    compiled = mechanism.compiled
    assert compiled is not None
    model, found = compiled.model, {}
    moving = {joint.id for joint in mechanism.joints}
    for element in loop_elements(model):
        if moving.intersection(element.joints):
            found[element.id] = element.name
    for equality in np.flatnonzero(model.eq_active0).tolist():
        if int(model.eq_type[equality]) == int(mujoco.mjtEq.mjEQ_JOINT):
            pair = int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])
            if moving.intersection(pair):
                names = [f"joint {joint_label(model, joint)!r}" for joint in pair if joint >= 0]
                what = "coupling" if len(names) > 1 else "lock"
                found[equality] = f"the {what} of {' with '.join(names)}"
    return found


_made = ByIdentity()


def measure_of(mechanism: Mechanism, touching: tuple[tuple[str, str], ...] = ()) -> MechanismMeasure:
    """The mechanism's measure, remembered for it and its touching pairs; raises as `MechanismMeasure`."""
    known: dict[tuple[tuple[str, str], ...], MechanismMeasure] = _made.get((mechanism,), dict)
    if touching not in known:
        known[touching] = MechanismMeasure(mechanism, touching)
    return known[touching]
