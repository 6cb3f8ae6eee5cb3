"""Signed distances between geoms as a judge needs them, whatever options the user's model has.

They are `mj_geomDistance`'s on a copy of the compiled model: the user's file may have few iterations, a coarse
tolerance or an older method, which are right for his simulation and wrong for a proof. To a height field MuJoCo's
distance is that to some part of it: there the distance is our own. And a capsule whose axis goes through a box is in
it, which MuJoCo does not see where the box is thin.
"""

from __future__ import annotations

import copy
import functools
import importlib
from typing import TYPE_CHECKING, Any

import numpy as np

from workcell.identity_cache import ByIdentity
from workcell.model.judge.solids import BOX, CAPSULE, FIELD, Core, core_of, field_of
from workcell.pose import Array

if TYPE_CHECKING:
    import mujoco

TOLERANCE = 1e-6
"""Metres by which distances between convex shapes may be off: MuJoCo's solver stops there."""
_ITERATIONS = 1000
"""Of MuJoCo's solver; it converges in some dozens, and stops too early at its default of 35 for flat ellipsoids."""
_CLEARED = ("NATIVECCD", "CONTACT", "CONSTRAINT", "MIDPHASE")
_made = ByIdentity()


class JudgeModel:
    """A copy of a compiled model that measures distances reliably; make one with `judge_model`.

    Attributes:
        model: the copy. Its geoms, bodies, sites and positions are those of the original.
        name: of the model, for messages.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        import mujoco

        self._mujoco = mujoco
        self.model = copy.copy(model)
        self.name = str(model.names[: model.names.find(b"\0")].decode(errors="replace"))
        option = self.model.opt
        for name in _CLEARED:
            option.disableflags &= ~int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}"))
        option.enableflags = 0  # no other margins, nothing asleep
        option.ccd_tolerance, option.ccd_iterations = TOLERANCE, _ITERATIONS
        for name in ("geom_margin", "geom_gap", "pair_margin", "pair_gap"):
            getattr(self.model, name)[:] = 0.0
        self._kinds = model.geom_type.tolist()
        self._spare = np.zeros(6)
        self._cores: dict[int, Core] = {}
        self._fields = {int(g): field_of(model, int(g)) for g in np.flatnonzero(model.geom_type == FIELD)}

    def distance(
        self, data: mujoco.MjData, a: int, b: int, limit: float, points: Array | None = None
    ) -> float:
        """The signed distance between two geoms (ids) where `data` has them, or `limit` metres where it is larger.

        Of overlapping solids only the sign can be trusted, not the depth.

        Args:
            data: of this or the original model, its geoms placed.
            a, b: geoms.
            limit: metres, zero or more.
            points: (6,) for the nearest points of both, in the world.
        """
        kinds = self._kinds[a], self._kinds[b]
        if FIELD not in kinds:
            found = float(self._mujoco.mj_geomDistance(self.model, data, a, b, limit, points))
            if found > 0.0 and kinds == (CAPSULE, BOX):
                return self._through(data, b, a, found, points)
            return (
                self._through(data, a, b, found, points) if found > 0.0 and kinds == (BOX, CAPSULE) else found
            )
        if a in self._fields:
            return self._to_field(data, b, a, limit, points, True)
        return self._to_field(data, a, b, limit, points, False)

    @functools.cached_property
    def _pierced(self) -> Any:
        """Compiled, imported on first use: numba takes half a second."""
        return importlib.import_module("workcell.model.judge.convex").pierced

    def _through(
        self, data: mujoco.MjData, box: int, capsule: int, found: float, points: Array | None
    ) -> float:
        """The distance found between a box and a capsule, unless the capsule's axis goes through the box.

        MuJoCo takes thin plates that are pierced for free of the capsule, by as much as its half length.
        """
        radius, reach = self.model.geom_size[capsule, :2]
        through = self._pierced(
            self.model.geom_size[box], data.geom_xmat[box], data.geom_xpos[box],
            reach, data.geom_xmat[capsule], data.geom_xpos[capsule],
            self._spare if points is None else points,
        )  # fmt: skip
        return -float(radius) if through else found

    def _to_field(
        self, data: mujoco.MjData, geom: int, field: int, limit: float, points: Array | None, swapped: bool
    ) -> float:
        from workcell.model.judge.terrain import field_distance

        core = self._cores.get(geom)
        if core is None:
            core = self._cores[geom] = core_of(self.model, geom)
        ground = self._fields[field]
        frame = data.geom_xmat[field].reshape(3, 3)
        turned = np.ascontiguousarray(frame.T @ data.geom_xmat[geom].reshape(3, 3)).ravel()
        place = frame.T @ (data.geom_xpos[geom] - data.geom_xpos[field])
        near = np.zeros((2, 3))
        found = field_distance(
            core.kind, core.size, core.vertices, turned, place, core.radius,
            ground.heights, ground.grid, ground.levels, ground.peaks, float(limit), near,
        )  # fmt: skip
        if points is not None:
            points.reshape(2, 3)[:] = (near[::-1] if swapped else near) @ frame.T + data.geom_xpos[field]
        return float(found)


def judge_model(model: mujoco.MjModel) -> JudgeModel:
    """The judge's copy of a compiled model, made once; the model's geoms and options must not change after that."""
    made: JudgeModel = _made.get((model,), lambda: JudgeModel(model))
    return made
