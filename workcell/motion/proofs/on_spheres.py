"""Continuous proof of lines and polynomials in the model of spheres and pieces: compiled, second order.

The outer cover of a robot contains it, and the pieces are the obstacles: what is proved here holds for the true
shapes, and the true clearance is at least the margin.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workcell.errors import InputError
from workcell.geometry.types import Piece, SphereCover
from workcell.ik.problem import Clearance
from workcell.model.robot import LIMIT_SLACK, Robot
from workcell.motion.body import BodyClearance, Upright, kernels, pack_body
from workcell.motion.path import Path, Trajectory
from workcell.motion.polynomials import PolynomialMotion
from workcell.motion.proofs.on_model import Proof
from workcell.pose import Array

FINEST = 1e-9
"""Radians (of all joints together) below which intervals are not divided further."""
_PARTS = 8
"""Parts of each piece of a motion on which the travel of slides is bounded."""


class CoverProver:
    """Proves motions of one robot among fixed obstacles; what depends on these alone is packed once.

    Args:
        robot: serial.
        cover: spheres of all that moves, `outer` or `given`; those of attached objects too.
        obstacles: convex pieces in the world frame.
        self_pairs: (p, 2) spheres of the cover that must keep clear of each other; None: none.
        upright: limit on the tool's orientation, to be kept all along; None: none.

    Raises:
        InputError: inner spheres, which contain nothing; or what `pack_body` refuses.
    """

    def __init__(
        self,
        robot: Robot,
        cover: SphereCover,
        obstacles: Sequence[Piece],
        *,
        self_pairs: ArrayLike | None = None,
        upright: Upright | None = None,
    ) -> None:
        if cover.kind == "inner":
            raise InputError(
                "a proof needs spheres that contain the moving robot, not inner ones", where="cover"
            )
        self.robot = robot
        self.body = pack_body(robot, cover, obstacles, self_pairs=self_pairs, upright=upright)
        self.clearance = BodyClearance(self.body, cover, obstacles)

    def path(
        self, path: Path | ArrayLike, *, floor: float = 0.0, keep: float = 0.5, most: int = 1_000_000
    ) -> Proof:
        """Prove that a joint-linear path keeps its clearance above `floor` everywhere, or find where it does not.

        Args:
            path: a `Path`, or corners (k, n); slides within their limits.
            floor: metres.
            keep: share of the clearance above the floor, in [0, 1), that the margin is to have at the worst place;
                the nearer to 1, the more configurations are looked at.
            most: configurations to look at before giving up.

        Raises:
            InputError: no configurations, of the wrong size or not finite, or a slide beyond its limits.
        """
        points = path.configurations if isinstance(path, Path) else np.asarray(path, dtype=float)
        if points.ndim != 2 or points.shape[1] != self.robot.dof or not np.all(np.isfinite(points)):
            raise InputError(
                f"a path of shape {points.shape}, or not finite",
                where="path",
                remedy=f"(k, {self.robot.dof})",
            )
        if len(points) == 0:
            raise InputError("a path without configurations proves nothing", where="path")
        self._check_slides(np.abs(points).max(axis=0), "path")
        if len(points) < 2:
            points = np.repeat(points, 2, axis=0)
        out = np.empty(7)
        kernels().prove_lines(
            self._floored(floor, keep), np.ascontiguousarray(points), keep, FINEST, most, out
        )
        return self._proof(out, floor)

    def motion(
        self,
        motion: PolynomialMotion | Trajectory,
        *,
        floor: float = 0.0,
        keep: float = 0.5,
        most: int = 1_000_000,
    ) -> Proof:
        """The same for a timed motion, over all of time; `failed_at` counts pieces."""
        if isinstance(motion, Trajectory):
            motion = PolynomialMotion.of_trajectory(motion)
        if motion.coefficients.shape[1] != self.robot.dof:
            raise InputError(
                f"the motion moves {motion.coefficients.shape[1]} joints, {self.robot.name} has {self.robot.dof}",
                where="motion",
            )
        if np.any(self._bounded()):
            self._check_slides(motion.divided(_PARTS).largest(0).max(axis=0), "motion")
        out = np.empty(7)
        coefficients = np.ascontiguousarray(motion.coefficients)
        kernels().prove_curves(
            self._floored(floor, keep), coefficients, np.array(motion.durations), keep, FINEST, most, out
        )
        return self._proof(out, floor)

    def _check_slides(self, largest: Array, where: str) -> None:
        """What carries a slide's links far out turns faster: the bounds hold for slides within their limits alone."""
        robot = self.robot
        travel = np.maximum(np.abs(robot.lower), np.abs(robot.upper)) + LIMIT_SLACK
        beyond = np.flatnonzero(self._bounded() & (largest > travel))
        if len(beyond):
            k = int(beyond[0])
            raise InputError(
                f"{robot.joint_names[k]} slides to {largest[k]:.6g} m, "
                f"outside [{robot.lower[k]:.6g}, {robot.upper[k]:.6g}]",
                where=where,
            )

    def _bounded(self) -> NDArray[np.bool_]:
        """(n,) bool: variables that slides, or joints that follow by more than a turn, depend on."""
        coupling = self.robot.coupling
        if coupling is None:
            return self.robot.prismatic
        moved = coupling.variable[self.robot.prismatic]
        return np.isin(np.arange(self.robot.dof), moved)

    def _floored(self, floor: float, keep: float) -> object:
        if not np.isfinite(floor):
            raise InputError(f"a clearance of {floor} m can't be kept", where="floor")
        if not 0 <= keep < 1:
            raise InputError(f"a share of {keep} can't be kept", where="keep", remedy="from 0 to below 1")
        return self.body._replace(floor=float(floor))

    def _proof(self, out: Array, floor: float) -> Proof:
        entries, code = kernels(), int(out[0])
        smallest = Clearance(float(out[3]), self.clearance.pair(int(out[4]), int(out[5])))
        looks = int(out[6])
        if code == entries.PROVED:
            return Proof(True, float(out[2]), smallest, float("nan"), "", looks)
        return Proof(False, -np.inf, smallest, float(out[1]), self._words(code, out, smallest, floor), looks)

    def _words(self, code: int, out: Array, smallest: Clearance, floor: float) -> str:
        entries = kernels()
        if int(out[5]) == entries.CONE:
            what = (
                "the tool leaves its cone"
                if code == entries.BLOCKED
                else "the tool is at the edge of its cone"
            )
            return f"{what} at {out[1]:.4f}"
        first, second = smallest.pair
        between = f" between {first} and {second}" if first else ""
        gap = 1e3 * smallest.distance
        if code == entries.SPENT:
            return f"no proof within {int(out[6])} configurations: clearance {gap:.4f} mm{between}"
        if smallest.distance < 0:
            return f"collision{between}, {-gap:.4f} mm deep"
        return f"clearance {gap:.4f} mm{between}, not above {1e3 * floor:.2f} mm"
