"""The workspace as rows on Z, added lazily: only what the points found so far break.

|y - c|^2 >= l^2 for a point y and a sphere's centre c is linear in Z (Eq. 6), so it holds for every solution: such rows
are kept once they were needed. Obstacles that are not spheres are covered by spheres, and kept out of like these;
`cidgik+planes` parts them from the point by a plane that touches them where they are nearest, which is one choice of
side among several, and is forgotten at the next restart.
"""

from __future__ import annotations

import numpy as np

from workcell.ik.cidgik.instance import Instance
from workcell.ik.cidgik.reduction import Vectors
from workcell.ik.cidgik.rows import products
from workcell.ik.cidgik.workspace.rules import KINDS, Key, Kind, Rules
from workcell.ik.cidgik.workspace.solids import SolidSpheres
from workcell.ik.shared.convex import KEEP_OFF
from workcell.ik.trees.query import Plane
from workcell.pose import Array, Pose

MOST_ROWS = 192
"""Rows that one cone program may carry; the latest are kept."""
_MOVES = 1e-9


class Keeper:
    """The rules of one query over the relaxation's variables, and the rows that were needed so far.

    Attributes:
        vectors: the points (m, ...).
        points: (m, N) coefficients of the points over the kept [X; I].
        loaded: keys of the rows in the instance's slots, None for planes chosen in this restart.
    """

    def __init__(self, instance: Instance, points: Vectors, rules: Rules, base: Pose) -> None:
        self._instance, self._rules, self._base = instance, rules, base
        self.vectors, self.points = points, instance.vector(points)
        d = instance.structure.skeleton.dimension
        self._movable = np.any(np.abs(self.points[:, :-d]) > _MOVES, axis=1)
        self._centres = self._seen(rules.obstacles.centre)
        self._inside = self._seen(rules.inside.centre)
        self._planes = [
            plane_in_base(plane, base, instance.structure.skeleton.plane) for plane in rules.planes
        ]
        self._needed: Array = rules.obstacles.radius + rules.radius[:, None] + rules.margin
        self._off = np.where(self._movable, rules.radius + rules.margin, -np.inf)
        self.covered: SolidSpheres | None = None
        if rules.solids is not None and not rules.tangent:
            spare = np.zeros(len(self.points)) if rules.spare is None else rules.spare
            self.covered = SolidSpheres(rules.solids, self._off, rules.start, spare)
        self._lasting: dict[Key, Array] = {}
        self._passing: list[Array] = []
        self.loaded: list[Key | None] = []

    def _seen(self, world: Array) -> Array:
        """World points in the base frame (in the arm's plane)."""
        base = self._base
        local: Array = (world - base.position) @ base.rotation @ self._instance.structure.skeleton.plane.T
        return local

    @property
    def passing(self) -> bool:
        """Whether rows are loaded that not every solution keeps."""
        return bool(self._passing)

    @property
    def conservative(self) -> bool:
        """Whether rows are loaded for spheres that cover solids: the solids themselves may allow more."""
        return any(kind == "cover" for kind, _, _ in self._lasting)

    @property
    def left_out(self) -> int:
        """How many pairs of point and solid are not kept apart, and left to the judge."""
        return 0 if self.covered is None else len(self.covered.left_out)

    def give_way(self) -> int:
        """Drop the rows between spheres that may stick out of the robot and solids that these overlap by as much.

        How many; the judge, who knows the robot itself, is then to say whether they touch.
        """
        if self.covered is None:
            return 0
        gone = [key for key in self._lasting if key[0] == "cover" and self.covered.may_be_clear(*key[1:])]
        for key in gone:
            self.covered.leave_out(*key[1:])
            del self._lasting[key]
        if gone:
            self._load()
        return len(gone)

    def knows(self, keys: Array) -> bool:
        """Whether (k, 3) coded keys (kind, i, j) name rows of these rules."""
        rules = self._rules
        most = {
            "ball": len(rules.obstacles),
            "inside": len(rules.inside),
            "apart": len(self.points),
            "plane": len(rules.planes),
        }
        for kind, i, j in keys:
            if kind not in range(len(KINDS)) or i not in range(len(self.points)):
                return False
            name = KINDS[int(kind)]
            if j not in range(most[name]) or (name == "apart" and (int(i), int(j)) not in rules.apart):
                return False
            if name == "plane" and (
                rules.planes[int(j)].equal
                or int(i) not in (rules.planes[int(j)].points or range(len(self.points)))
            ):
                return False
        return True

    def fixed_inside(self) -> tuple[int, int, float] | None:
        """A point that can't move and the obstacle sphere that its centre is in: (point, sphere, metres), or None."""
        y = self.points[:, -self._centres.shape[1] :]
        gap = np.linalg.norm(y[:, None] - self._centres, axis=-1) - self._rules.obstacles.radius
        gap[self._movable] = np.inf
        if not gap.size or gap.min() >= 0:
            return None
        i, j = np.unravel_index(int(gap.argmin()), gap.shape)
        return int(i), int(j), float(-gap[i, j])

    def forget_passing(self) -> None:
        """At a restart: planes chosen before are forgotten."""
        if self._passing:
            self._passing = []
            self._load()

    def add_broken(self, Z: Array) -> int:
        """Rows for the rules that the points in Z (its X) break; how many are broken."""
        y = self.points @ Z[:, -self._centres.shape[1] :]
        broken = self._broken(y)
        for key in broken:
            # a row that is broken again moves to the end, where it is not the first to be left out
            row = self._lasting.pop(key) if key in self._lasting else self.row(key)
            self._lasting[key] = row
        planes = self._touching(y)
        self._passing += planes
        if broken or planes:
            self._load()
        return len(broken) + len(planes)

    def add_cut_off(self, Z: Array) -> int:
        """Rows for the rules on spheres that Z itself breaks (not only its points); how many are new."""
        values = self._squared(Z) - self._needed**2
        values[~self._movable] = np.inf
        new = [key for key in _worst("ball", values) if key not in self._lasting]
        for key in new:
            self._lasting[key] = self.row(key)
        if new:
            self._load()
        return len(new)

    def _squared(self, Z: Array) -> Array:
        """(m, k) squared distances of points to obstacle centres as Z has them."""
        d = self._centres.shape[1]
        own = np.einsum("ij,jk,ik->i", self.points, Z, self.points)
        y = self.points @ Z[:, -d:]
        squared: Array = own[:, None] - 2.0 * y @ self._centres.T + np.sum(self._centres**2, axis=1)
        return squared

    def _load(self) -> None:
        width = self._instance.D.shape[1] + 1
        keys: list[Key | None] = [*self._lasting, *([None] * len(self._passing))]
        rows = [*self._lasting.values(), *self._passing]
        self.loaded = keys[-MOST_ROWS:]
        self._instance.set_slots(np.array(rows[-MOST_ROWS:]).reshape(-1, width))

    def row(self, key: Key) -> Array:
        """(f + 1,) over (y, 1), nonnegative where the rule is kept with `KEEP_OFF` to spare."""
        packed, constant, _ = self.inequality(key, KEEP_OFF)
        row: Array = self._instance.reduced(packed[None], np.array([constant]))[0]
        return row

    def inequality(self, key: Key, spare: float) -> tuple[Array, float, tuple[Array, Array]]:
        """Triangle (K,) and constant whose sum on Z is >= 0 where the rule is kept with `spare` metres to spare, and
        the two vectors (N,) whose product the triangle is."""
        kind, i, j = key
        d, radius = self._centres.shape[1], self._rules.radius
        difference = self.points[i].copy()
        if kind == "cover":
            assert self.covered is not None  # it has numbered the ball
            difference[-d:] -= self._seen(self.covered.centre[j])
            least = self.covered.radius[j] + self._off[i] + spare
            return products(difference, difference), -float(least**2), (difference, difference)
        if kind == "apart":
            difference -= self.points[j]
            least = radius[i] + radius[j] + self._rules.margin + spare
            return products(difference, difference), -float(least * abs(least)), (difference, difference)
        if kind == "plane":
            normal, offset = self._planes[j]
            constant = np.zeros_like(difference)
            constant[-d:] = normal
            return products(difference, constant), -float(offset + radius[i] + spare), (difference, constant)
        if kind == "ball":
            difference[-d:] -= self._centres[j]
            least = self._needed[i, j] + spare
            return products(difference, difference), -float(least * abs(least)), (difference, difference)
        difference[-d:] -= self._inside[j]
        most = max(self._rules.inside.radius[j] - radius[i] - spare, 0.0)
        return -products(difference, difference), float(most**2), (-difference, difference)

    def _broken(self, y: Array) -> list[Key]:
        rules, keys = self._rules, []
        keys += _worst("ball", self._squares(y, self._centres) - self._needed**2)
        if self.covered is not None:
            keys += [("cover", i, j) for i, j in self.covered.met(self._placed(y))]
        if len(self._inside):
            room = np.maximum(rules.inside.radius - rules.radius[:, None], 0.0)
            keys += _worst("inside", room**2 - self._squares(y, self._inside, -np.inf))
        for i, j in rules.apart:
            if np.linalg.norm(y[i] - y[j]) < rules.radius[i] + rules.radius[j] + rules.margin:
                keys.append(("apart", i, j))
        for j, plane in enumerate(rules.planes):
            if plane.equal:
                continue
            normal, offset = self._planes[j]
            for i in range(len(y)) if plane.points is None else plane.points:
                if self._movable[i] and normal @ y[i] < offset + rules.radius[i]:
                    keys.append(("plane", i, j))
        return keys

    def _squares(self, y: Array, centres: Array, fixed: float = np.inf) -> Array:
        """(m, k) squared distances of points to centres; `fixed` for points that can't move."""
        squares: Array = (y * y).sum(axis=1)[:, None] + (centres * centres).sum(axis=1) - 2.0 * y @ centres.T
        squares[~self._movable] = fixed
        return squares

    def _placed(self, y: Array) -> Array:
        """Points (m, 3) of the base frame in the world."""
        placed: Array = y @ self._base.rotation.T + self._base.position
        return placed

    def _touching(self, y: Array) -> list[Array]:
        """Rows of half-spaces that part the deepest point inside each solid from it, where these are asked for."""
        rules, rows = self._rules, []
        if rules.solids is None or not rules.tangent:
            return []
        pairs, distances, gradients = rules.solids.near(self._placed(y), self._off)
        gaps = distances - self._off[pairs[:, 0]]
        for k in np.unique(pairs[:, 1]):
            mine = np.flatnonzero(pairs[:, 1] == k)
            deepest = mine[int(gaps[mine].argmin())]
            i, normal = int(pairs[deepest, 0]), gradients[deepest] @ self._base.rotation
            constant = np.zeros(self.points.shape[1])
            constant[-3:] = normal
            row = self._instance.rows_of(self.points[i][None], constant[None])[0]
            row[-1] -= float(normal @ y[i] - gaps[deepest]) + KEEP_OFF
            rows.append(row)
        return rows


def plane_in_base(plane: Plane, base: Pose, flat: Array) -> tuple[Array, float]:
    """Normal (d,) and offset of a plane seen from the base; `flat` (d, 3) spans the arm's own plane."""
    normal: Array = flat @ (base.rotation.T @ plane.normal)
    return normal, float(plane.offset - plane.normal @ base.position)


def _worst(kind: Kind, gap: Array) -> list[Key]:
    """For each obstacle that some point breaks (m, k): the point that breaks it most."""
    if not gap.size:
        return []
    worst = gap.argmin(axis=0)
    broken = np.flatnonzero(gap[worst, np.arange(gap.shape[1])] < 0)
    return [(kind, int(worst[j]), int(j)) for j in broken]
