"""The truth about collisions in a scene: signed distances of the compiled model's own geometry.

They are those of `workcell.model.judge.distances`. Deep penetration is measured poorly by MuJoCo for some pairs of
shapes: trust the sign, not the depth.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workcell.errors import InputError, ModelError
from workcell.model.judge.distances import TOLERANCE, judge_model
from workcell.model.judge.nearest import Distance, NearestPair, refuse_unmeasured
from workcell.model.judge.pairs import colliding_pairs
from workcell.model.labels import bodies_called, geom_name
from workcell.model.loops.elements import joined
from workcell.model.passive_motion import PassivePairs
from workcell.model.scene import Scene
from workcell.model.scene_parts import SceneObject, SceneRobot, place_holding
from workcell.pose import Array, Pose, read_only

_MISSED = 1e-3
"""Metres that stand for the distance where a robot's loops can't be closed."""


class CollisionModel:
    """Smallest signed distance of one robot to everything else and to itself, at any configuration.

    Geom pairs follow MuJoCo's own rules: contype and conaffinity, `<exclude>`, bodies welded together, parent with
    child (unless the model disables that filter), and `<pair>`, which overrules them; bodies that a connect or a weld
    joins are neighbours like parent and child. Other robots and free objects stand where `qpos` has them. Passive
    joints of the robot stand where its loops have them (`workcell.model.loops`); where those can't be closed, there is
    no configuration, and the distance is negative.

    Args:
        scene: the scene.
        robot: the robot's name; None: the only one.
        qpos: (nq,) raw positions of everything else; None: the initial ones.
        attached: (object name, T_tool_object): an object that the hand carries; it counts as robot.
        ignored: bodies (names) that don't count at all, e.g. an object about to be grasped.
        allowed_geoms: pairs of geom ids whose contact is intended, e.g. an object and the board it stands on.

    Raises:
        ModelError: the model holds something that can't be honoured: a loop that ties driven joints, geoms whose
            distances can't be trusted.
    """

    def __init__(
        self,
        scene: Scene,
        robot: str | None = None,
        *,
        qpos: ArrayLike | None = None,
        attached: tuple[str, Pose] | None = None,
        ignored: Iterable[str] = (),
        allowed_geoms: Iterable[tuple[int, int]] = (),
    ) -> None:
        import mujoco

        self._mujoco = mujoco
        self._judge = judge_model(scene.model)
        self._model = self._judge.model
        self._data = mujoco.MjData(self._model)
        self._qpos = np.array(scene.initial_qpos() if qpos is None else qpos, dtype=float)
        self.scene, self.robot = scene, scene.robot(robot).standing(scene.model, self._qpos)
        _refuse_loops(self.robot)
        self._attached: SceneObject | None = None
        if attached is not None:
            self._attached = scene.object(attached[0])
            if self._attached.qpos_address is None:
                raise InputError(
                    f"the object {attached[0]!r} is fixed",
                    where="attached",
                    remedy="only free objects can be carried",
                )
            self._T_tool_object = attached[1]
        moving = set(self.robot.body_ids) | (self._attached.body_ids if self._attached else set())
        self._pairs = _colliding_pairs(scene, moving, self._attached, self.robot, ignored)
        intended = {frozenset(pair) for pair in allowed_geoms}
        kept = [frozenset((int(a), int(b))) not in intended for a, b in self._pairs]
        self._pairs = self._pairs[np.array(kept, dtype=bool)]
        refuse_unmeasured(self._model, np.unique(self._pairs).tolist())
        self._search = NearestPair(self._judge)
        self._look_at(self._pairs)

    def ignoring(self, bodies: Iterable[int], geoms: Iterable[int] = ()) -> CollisionModel:
        """The same model without the pairs that some bodies or geoms (ids) belong to."""
        gone = np.isin(self._model.geom_bodyid, list(bodies))
        gone[list(geoms)] = True
        smaller = copy.copy(self)
        smaller._look_at(self._pairs[~gone[self._pairs].any(axis=1)])
        return smaller

    def between(self, first: Iterable[int], second: Iterable[int]) -> CollisionModel:
        """The same model with the pairs alone that two groups of bodies (ids) have with each other."""
        body_of = self._model.geom_bodyid
        one, two = (np.isin(body_of, list(group))[self._pairs] for group in (first, second))
        smaller = copy.copy(self)
        smaller._look_at(self._pairs[(one[:, 0] & two[:, 1]) | (one[:, 1] & two[:, 0])])
        return smaller

    def only(self, pairs: Iterable[int]) -> CollisionModel:
        """The same model with some of its pairs alone, by their rows in `pair_geoms`."""
        smaller = copy.copy(self)
        smaller._look_at(self._pairs[np.asarray(list(pairs), dtype=np.int64)])
        return smaller

    def _look_at(self, pairs: NDArray[np.int64]) -> None:
        self._pairs, links = pairs, self._links()
        self._pair_links = np.sort(links[pairs], axis=1)
        loops = self.robot.loops
        self._passive = None
        if loops is not None and loops.loops:
            self._passive = PassivePairs(self._model, self.robot, pairs, links)

    def without_own(self) -> CollisionModel:
        """The same model without the pairs of two of the robot's own geoms, what it carries among them."""
        carriers = set(self.robot.body_ids) | (self._attached.body_ids if self._attached else set())
        own = np.isin(self._model.geom_bodyid, list(carriers))
        smaller = copy.copy(self)
        smaller._look_at(self._pairs[~own[self._pairs].all(axis=1)])
        return smaller

    @property
    def tolerance(self) -> float:
        """Metres by which distances between convex shapes may be off: MuJoCo's solver stops there."""
        return TOLERANCE

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """Names of the geom pairs that are looked at."""
        return tuple((geom_name(self._model, a), geom_name(self._model, b)) for a, b in self._pairs)

    @property
    def pair_links(self) -> NDArray[np.int64]:
        """(p, 2) links that carry each pair of geoms, the lower first; 0 for what stands in the world."""
        return self._pair_links

    @property
    def pair_geoms(self) -> NDArray[np.int64]:
        """Ids of the geom pairs (p, 2) that are looked at."""
        return read_only(self._pairs, np.int64)

    @property
    def own_pairs(self) -> NDArray[np.bool_]:
        """(p,) which of them are of the robot, or of what it carries, with itself."""
        mine = self.robot.body_ids | (self._attached.body_ids if self._attached else frozenset())
        inside = np.isin(self._model.geom_bodyid, list(mine))[self._pairs]
        own: NDArray[np.bool_] = inside[:, 0] & inside[:, 1]
        return own

    @property
    def carried_geoms(self) -> frozenset[str]:
        """Names of the geoms of the object that the hand carries."""
        if self._attached is None:
            return frozenset()
        mine = np.isin(self._model.geom_bodyid, list(self._attached.body_ids))
        return frozenset(geom_name(self._model, int(geom)) for geom in np.flatnonzero(mine))

    @property
    def self_links(self) -> frozenset[tuple[int, int]]:
        """Pairs of the robot's links, the lower first, with geoms that are looked at.

        What the hand carries is on the tool's link.
        """
        carrier = np.full(self._model.nbody, -1, dtype=np.int64)
        for link, bodies in enumerate(self.robot.link_body_ids):
            carrier[list(bodies)] = link
        if self._attached is not None:
            carrier[list(self._attached.body_ids)] = self.robot.robot.tool().link
        owners = np.sort(carrier[self._model.geom_bodyid[self._pairs]], axis=1)
        own = owners[(owners[:, 0] >= 0) & (owners[:, 0] < owners[:, 1])]
        return frozenset((a, b) for a, b in own.tolist())

    def full_qpos(self, q: ArrayLike) -> Array:
        """Raw positions (nq,) of the whole scene with the robot at `q` (n,), the carried object with it."""
        return self._placed(q)[0]

    def _placed(self, q: ArrayLike) -> tuple[Array, str]:
        """Raw positions with the robot at `q`, and why that is no configuration of it, if it is none."""
        qpos, here = np.array(self._qpos), np.asarray(q, dtype=float)
        if self._attached is None:
            return qpos, self.robot.place(qpos, here)
        return qpos, place_holding(qpos, self.robot, here, self._attached, self._T_tool_object)

    def site_pose(self, site: str, q: ArrayLike) -> Pose:
        """World pose of one of the robot's sites (without its prefix) at `q` (n,), by MuJoCo's own kinematics."""
        self._data.qpos[:] = self.full_qpos(q)
        self._mujoco.mj_kinematics(self._model, self._data)
        k = self.robot.site_ids[self.robot.robot.tool(site).name]
        return Pose.from_rotation(self._data.site_xpos[k], self._data.site_xmat[k].reshape(3, 3))

    def distance(self, q: ArrayLike, *, limit: float = 10.0) -> Distance:
        """The smallest signed distance at `q` (n,), looked for up to `limit` metres."""
        qpos, reason = self._placed(q)
        return _nowhere(reason) if reason else self.distance_at(qpos, limit=limit)

    def distance_at(self, qpos: ArrayLike, *, limit: float = 10.0) -> Distance:
        """The same at raw positions (nq,)."""
        self._data.qpos[:] = qpos
        self._mujoco.mj_kinematics(self._model, self._data)
        return self._search(self._data, self._pairs, limit)

    def contact(self, q: ArrayLike) -> Distance | None:
        """What MuJoCo's own collision pipeline has in contact at `q` (n,), deeper than `tolerance`; None: nothing.

        A second opinion beside `distance`, for what is to be accepted.
        """
        self._data.qpos[:] = self.full_qpos(q)
        self._mujoco.mj_kinematics(self._model, self._data)
        return self._search.contact(self._data, self._pairs)

    def torn(self, q_a: ArrayLike, q_b: ArrayLike) -> str:
        """Why passive loops can't go along on the straight line between two configurations; empty where they can."""
        loops = self.robot.loops
        if loops is None or not (loops.loops or loops.limits):
            return ""
        (one, unclosed), (two, open_too) = self._placed(q_a), self._placed(q_b)
        return unclosed or open_too or loops.torn(one, two)

    def excess(
        self, q: ArrayLike, moved: Array, half: Array, *, limit: float = 10.0
    ) -> tuple[float, Distance]:
        """By how much every pair's distance at `q` (n,) exceeds how far its links may move; the pair with the least.

        Only pairs whose bounding spheres and boxes leave that open are measured, so that links that hardly move,
        such as those next to the base, cost nothing.

        Args:
            q: configuration (n,).
            moved: (n + 1, n + 1) metres by which points of link b may move relative to link a < b; row 0 is the world.
            half: (n,) how far each variable may be from its value in `q`: what passive joints do follows from it.
            limit: distances beyond it count as it, metres.

        Returns:
            The least of distance minus motion, and the distance of that pair; -inf where it is not known how far
            passive bodies move.
        """
        qpos, reason = self._placed(q)
        if reason:
            return -np.inf, _nowhere(reason)
        motion = moved[self._pair_links[:, 0], self._pair_links[:, 1]]
        if self._passive is not None:
            here = np.asarray(q, dtype=float)
            if not self._passive.lose(qpos, here, np.asarray(half, dtype=float), moved, motion):
                return -np.inf, self.distance_at(qpos, limit=limit)
        return self.excess_at(qpos, motion, limit=limit)

    def excess_at(self, qpos: ArrayLike, motion: Array, *, limit: float = 10.0) -> tuple[float, Distance]:
        """The same at raw positions (nq,), where each pair of geoms may come closer by `motion` (p,) metres."""
        self._data.qpos[:] = qpos
        self._mujoco.mj_kinematics(self._model, self._data)
        return self._search.excess(self._data, self._pairs, motion, limit)

    def _links(self) -> NDArray[np.int64]:
        """(g,) for each geom of the model the link that carries it; 0 for what stands in the world."""
        owner = np.zeros(self._model.nbody, dtype=np.int64)
        for link, bodies in enumerate(self.robot.link_body_ids):
            owner[list(bodies)] = link
        if self._attached is not None:
            owner[list(self._attached.body_ids)] = self.robot.robot.tool().link
        links: NDArray[np.int64] = owner[self._model.geom_bodyid]
        return links


def _colliding_pairs(
    scene: Scene,
    moving: set[int],
    attached: SceneObject | None,
    robot: SceneRobot,
    ignored: Iterable[str],
) -> NDArray[np.int64]:
    model = scene.model
    pairs = colliding_pairs(model, moving, bodies_called(model, ignored, "ignored"))
    pairs = pairs[~joined(model, pairs)]
    if attached is None:
        return pairs
    carriers = robot.hand_ids
    owners = np.asarray(model.geom_bodyid)[pairs]
    grip = [_is_grip(int(a), int(b), attached, carriers) for a, b in owners]
    kept: NDArray[np.int64] = pairs[~np.array(grip, dtype=bool)]
    return kept


def _nowhere(reason: str) -> Distance:
    return Distance(-_MISSED, ("", ""), np.zeros((2, 3)), (-1, -1), reason)


def _refuse_loops(robot: SceneRobot) -> None:
    """Raise ModelError for what a robot's passive joints and loops ask for that can't be honoured."""
    if robot.loops is not None and robot.loops.refusals:
        raise ModelError(
            "; ".join(robot.loops.refusals),
            where=f"robot {robot.name!r}",
            remedy="workcell closes loops of passive joints, which leave the driven ones free; leave the others out",
        )


def _is_grip(a: int, b: int, attached: SceneObject, carriers: frozenset[int]) -> bool:
    inside = attached.body_ids
    return (a in inside and b in carriers) or (b in inside and a in carriers) or (a in inside and b in inside)
