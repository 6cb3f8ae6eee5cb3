"""What plain MuJoCo says about a stranger's cell: contacts, tool poses, limits, couplings.

The files' texts are all that it has. Nothing of workcell's reading of the model is used: the files are compiled here,
and joints are found by the names that the generator gave them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workcell.bench.strangers.arms import Arm
from workcell.bench.strangers.cells import Cell
from workcell.pose import Array, Pose

SEEN = 0.02
"""Metres up to which contacts are listed."""
_DRAWS = 200


@dataclass(frozen=True, slots=True)
class Contact:
    """The nearest two geoms of which one is the arm's: signed distance in metres, and their numbers."""

    distance: float
    geoms: tuple[int, int]


class Oracle:
    """A cell compiled by itself, with contacts listed from `SEEN` metres on and MuJoCo's own default solver options.

    Args:
        cell: the cell.
        prefix: of the arm that is asked about; everything that its bodies carry counts as its own.
    """

    def __init__(self, cell: Cell, prefix: str = "") -> None:
        import mujoco

        self._mujoco, self._arm, self._prefix = mujoco, cell.arms[prefix], prefix
        spec, plain = cell.assemble(), mujoco.MjSpec()
        spec.option.ccd_iterations = 200
        spec.option.ccd_tolerance = plain.option.ccd_tolerance
        spec.option.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_NATIVECCD)
        for element in [*spec.geoms, *spec.pairs]:
            element.margin, element.gap = 0.0, SEEN
        self.model = spec.compile()
        self._data = mujoco.MjData(self.model)
        self._home = self._begin(cell)
        self.driven = [self.model.joint(prefix + name).id for name in self._arm.driven]
        root = int(self.model.jnt_bodyid[self.driven[0]])
        while self._is_mine(int(self.model.body_parentid[root])):
            root = int(self.model.body_parentid[root])
        self.bodies = self._subtree(root)
        self.own = frozenset(body for body in self.bodies if self._is_mine(body))

    def _begin(self, cell: Cell) -> Array:
        """Where everything stands: as the file says, but arms within their limits, and what was moved."""
        qpos = np.array(self.model.qpos0, dtype=float)
        for name, value in cell.moved.items():
            qpos[self.model.joint(name).qposadr[0]] = value
        for prefix, arm in cell.arms.items():
            for name in arm.driven:
                joint = self.model.joint(prefix + name)
                low, high = self._room(prefix, arm, name)
                qpos[joint.qposadr[0]] = np.clip(qpos[joint.qposadr[0]], low, high)
            self._follow(qpos, prefix, arm)
        return qpos

    def _room(self, prefix: str, arm: Arm, name: str) -> tuple[float, float]:
        """Limits of a driven joint within which its followers, straight lines of it, keep theirs."""
        joint = self.model.joint(prefix + name)
        low, high = arm.limits.get(name, tuple(joint.range))
        for follower in arm.followers:
            if follower.leader == name:
                other, (offset, gain) = self.model.joint(prefix + follower.name), follower.polycoef[:2]
                ends = np.array(arm.limits.get(follower.name, tuple(other.range)))
                leads = joint.qpos0[0] + (ends - other.qpos0[0] - offset) / gain
                low, high = max(low, leads.min()), min(high, leads.max())
        return float(low), float(high)

    def _follow(self, qpos: Array, prefix: str, arm: Arm) -> None:
        for follower in arm.followers:
            at, leads = (
                int(self.model.joint(prefix + n).qposadr[0]) for n in (follower.name, follower.leader)
            )
            moved = qpos[leads] - self.model.qpos0[leads]
            qpos[at] = self.model.qpos0[at] + np.polynomial.polynomial.polyval(moved, follower.polycoef)

    def _is_mine(self, body: int) -> bool:
        return body > 0 and str(self.model.body(body).name).startswith(self._prefix)

    def _subtree(self, root: int) -> frozenset[int]:
        inside = {root}
        for body in range(root + 1, self.model.nbody):
            if int(self.model.body_parentid[body]) in inside:
                inside.add(body)
        return frozenset(inside)

    def random_configuration(self, rng: np.random.Generator) -> Array | None:
        """Within the file's limits, and within those of the joints that follow; None: no draw was."""
        lower, upper = self.limits()
        for _ in range(_DRAWS):
            q = rng.uniform(lower, upper)
            if self.limits_broken(q) <= 0.0:
                return np.asarray(q)
        return None

    def limits(self) -> tuple[Array, Array]:
        """(n,) lower and upper limits of the driven joints; within a turn of zero."""
        low, high = self._ranges(self._arm.driven).T
        return np.maximum(low, -2 * np.pi), np.minimum(high, 2 * np.pi)

    def _ranges(self, names: tuple[str, ...]) -> Array:
        """(k, 2) limits as the file's own format means them."""
        compiled = [self.model.joint(self._prefix + name).range for name in names]
        given = [
            self._arm.limits.get(name, tuple(there)) for name, there in zip(names, compiled, strict=True)
        ]
        return np.array(given, dtype=float).reshape(-1, 2)

    def place(self, q: Array) -> None:
        """Put the arm at driven joints' values (n,), its followers where their leaders want them."""
        model, data = self.model, self._data
        data.qpos[:] = self._home
        data.qpos[model.jnt_qposadr[self.driven]] = q
        self._follow(data.qpos, self._prefix, self._arm)
        self._mujoco.mj_kinematics(model, data)
        self._mujoco.mj_comPos(model, data)

    def limits_broken(self, q: Array) -> float:
        """By how much the worst joint, driven or following, is outside the file's limits at `q` (n,)."""
        self.place(q)
        names = (*self._arm.driven, *(follower.name for follower in self._arm.followers))
        joints = [self.model.joint(self._prefix + name).id for name in names]
        values, ranges = self._data.qpos[self.model.jnt_qposadr[joints]], self._ranges(names)
        return float(np.maximum(ranges[:, 0] - values, values - ranges[:, 1]).max())

    def tool_pose(self, q: Array) -> Pose:
        """`T_world_tool` at `q` (n,)."""
        self.place(q)
        site = self._data.site(self._prefix + self._arm.tool)
        return Pose.from_rotation(np.array(site.xpos), np.array(site.xmat).reshape(3, 3))

    def nearest(self, q: Array) -> Contact:
        """The nearest contact of the arm at `q` (n,), of those within `SEEN` metres."""
        self.place(q)
        self._mujoco.mj_collision(self.model, self._data)
        best = Contact(SEEN, (-1, -1))
        for contact in self._data.contact[: self._data.ncon]:
            a, b = int(contact.geom1), int(contact.geom2)
            mine = {int(self.model.geom_bodyid[a]), int(self.model.geom_bodyid[b])} & self.bodies
            if mine and contact.dist < best.distance:
                best = Contact(float(contact.dist), (a, b))
        return best
