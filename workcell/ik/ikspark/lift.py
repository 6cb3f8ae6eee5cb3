"""The lifted model of a serial revolute chain (IKSPARK, sections III-V and IX-B), reduced to its faces.

Unknown link rotations become 4x4 quaternion blocks Q >= 0 of trace 1 (Eq. 77-78), of which the rotation is linear.
Links whose rotation is `F1 Rz(phi) F2` with both F known, those next to the base or to the goal and, where joint
axes are parallel, their neighbours, become planar: a unit disc (c, s). The last link's rotation is the goal's. What
stays has interior points, which interior-point methods need.

Every quantity of interest is affine in the lifted variables x and affine in the goal. It is kept as a tensor
(..., N + 1, 13): contracted with `goal_vector(T_base_tool)` it gives coefficients over (x, 1). So one `Lift` serves
all targets of a robot, and how much a proof may change when the target moves is read off the same numbers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workcell.errors import InputError
from workcell.ik.registry import takers
from workcell.ik.shared.conic import smat, svec, triangle
from workcell.model.robot import Robot
from workcell.pose import Array, Pose

GOAL = 13
"""Length of a goal vector: 1, the position (3), the rotation matrix row by row (9)."""

_PARALLEL = 1e-13
"""Sine below which two axes are one direction but for rounding."""
_NEGLIGIBLE = 1e-13
_TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])


def goal_vector(T_base_tool: Pose) -> Array:
    """(13,) the numbers of a tool pose in which the model is affine."""
    return np.concatenate([[1.0], T_base_tool.position, T_base_tool.rotation.ravel()])


def rotation_map() -> Array:
    """(3, 3, 10): rotation matrix as a linear function of the triangle of Q = q q^T, q wxyz, trace 1 (Eq. 78)."""
    rows, columns, factor = triangle(4)
    entry = {(int(i), int(j)): (k, f) for k, (i, j, f) in enumerate(zip(rows, columns, factor, strict=True))}
    out = np.zeros((3, 3, 10))

    def add(i: int, j: int, a: int, b: int, value: float) -> None:
        k, f = entry[(min(a, b), max(a, b))]
        out[i, j, k] += value / f

    for i in range(3):
        add(i, i, 0, 0, 1.0)
        for k in range(3):
            add(i, i, k + 1, k + 1, 1.0 if k == i else -1.0)
    for i, j, k, sign in ((0, 1, 2, -1.0), (0, 2, 1, 1.0), (1, 2, 0, -1.0)):
        for a, b, s in ((i, j, sign), (j, i, -sign)):
            add(a, b, i + 1, j + 1, 2.0)
            add(a, b, 0, k + 1, 2.0 * s)
    return out


def frame_with_z(axis: Array) -> Array:
    """A rotation (3, 3) whose third column is `axis`."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    x = np.cross(helper, axis)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=1)


@dataclass(frozen=True, slots=True)
class Disc:
    """A planar link: its rotation is `outer F Rz(sign phi) F^T C`, outer = I (base side) or the goal-fixed R_n.

    Attributes:
        link: index of the link.
        start: index of c in x; s follows.
        F, C: the known rotations (3, 3).
        from_goal: which end it hangs from; then sign = -1.
        joint: the joint whose angle phi is, or -1 where phi is a sum of angles.
    """

    link: int
    start: int
    F: Array
    C: Array
    from_goal: bool
    joint: int


class Lift:
    """Variables and affine maps of a robot's chain; independent of the target and of the joint limits.

    Attributes:
        robot: the serial chain; all maps are in its base frame.
        size: N, number of lifted variables.
        balls: (k,) links that are quaternion blocks; block i has x[ball_start[i] : ball_start[i] + 10].
        discs: the planar links.
        rotations: (n + 1, 3, 3, N + 1, 13) link rotations.
        origins: (n + 1, 3, N + 1, 13) link origins, summed up from the nearer end.
        equalities: (m, N + 1, 13) rows that are zero at every configuration that reaches the goal.
        kept: (all,) which rows of blocks' traces, joints' axes (three each) and closure (three) those are; the others
            are zero throughout.
    """

    def __init__(self, robot: Robot) -> None:
        if robot.coupling is not None:
            raise InputError(
                f"joint {robot.all_joint_names[robot.coupling.followers[0]]!r} follows another",
                where=robot.name,
                remedy=f"ikspark takes joints that move by themselves; {takers(couples=True)} take others too",
            )
        sliding = [
            name for name, prismatic in zip(robot.joint_names, robot.prismatic, strict=True) if prismatic
        ]
        if sliding or not robot.is_serial:
            raise InputError(
                f"joint {sliding[0]!r} is prismatic" if sliding else f"{robot.name} is a tree",
                where=robot.name,
                remedy=f"ikspark takes serial chains of revolute joints; {takers(slides=True)} take others too",
            )
        self.robot = robot
        self.tool = robot.tool()
        if self.tool.link != robot.dof:
            raise InputError(
                f"joints beyond the tool {self.tool.name!r}",
                where=robot.name,
                remedy="pass robot.chain(tool)",
            )
        self._frames = np.stack([frame_with_z(axis) for axis in robot.axis])
        self._parent_frames = robot.joint_rotation @ self._frames
        planar = _planar_links(robot)
        links = range(1, max(robot.dof, 2))
        self.balls = tuple(k for k in links if k not in planar)
        self.ball_start = np.arange(len(self.balls)) * 10
        first = 10 * len(self.balls)
        self.discs = tuple(Disc(k, first + 2 * i, *planar[k]) for i, k in enumerate(sorted(planar)))
        self.size = first + 2 * len(self.discs)
        self.disc_start = np.array([d.start for d in self.discs], dtype=np.int64)
        self.rotations = self._rotations()
        self.origins = self._origins()
        self.equalities, self.kept = self._equalities()
        self.direct = {d.joint: d for d in self.discs if d.joint >= 0}

    def at(self, tensor: Array, goal: Array) -> Array:
        """Coefficients over (x, 1), shape (..., N + 1), of a tensor (..., N + 1, 13) at a goal vector (13,)."""
        contracted: Array = tensor @ goal
        return contracted

    def point(self, link: int, position: Array) -> Array:
        """(3, N + 1, 13) a point of a link (3,), given in its frame."""
        moved: Array = self.origins[link] + np.einsum("abxg,b->axg", self.rotations[link], position)
        return moved

    def _fixed(self) -> tuple[Array, Array]:
        """Rotation of the base and of the last link, the latter a function of the goal: R_goal R_tool^T."""
        base, last = (np.zeros((3, 3, self.size + 1, GOAL)) for _ in range(2))
        base[..., -1, 0] = np.eye(3)
        R_tool_link = self.tool.T_link_tool.rotation.T
        for i in range(3):
            last[i, :, -1, 4 + 3 * i : 7 + 3 * i] = R_tool_link.T
        return base, last

    def _rotations(self) -> Array:
        base, last = self._fixed()
        n = self.robot.dof
        out = np.zeros((n + 1, 3, 3, self.size + 1, GOAL))
        out[0], out[n] = base, last
        for link, start in zip(self.balls, self.ball_start, strict=True):
            out[link, :, :, start : start + 10, 0] = rotation_map()
        for d in self.discs:
            sign = -1.0 if d.from_goal else 1.0
            parts = {
                d.start: np.diag([1.0, 1.0, 0.0]),
                d.start + 1: sign * _TURN,
                -1: np.diag([0.0, 0.0, 1.0]),
            }
            out[d.link] = 0.0
            for column, part in parts.items():
                inner = d.F @ part @ d.F.T @ d.C
                if d.from_goal:
                    out[d.link, :, :, column] = np.einsum("abg,bc->acg", last[:, :, -1], inner)
                else:
                    out[d.link, :, :, column, 0] = inner
        return out

    def _step(self, k: int, rotations: Array) -> Array:
        """Offset from the origin of link k to that of link k + 1."""
        offset: Array = np.einsum("abxg,b->axg", rotations[k], self.robot.joint_xyz[k])
        return offset

    def _ends(self) -> tuple[list[Array], list[Array]]:
        """Origins of the links summed up from the base, and down from the goal."""
        n = self.robot.dof
        forward = [np.zeros((3, self.size + 1, GOAL))]
        for k in range(n):
            forward.append(forward[-1] + self._step(k, self.rotations))
        _, last = self._fixed()
        tip = np.zeros((3, self.size + 1, GOAL))
        tip[:, -1, 1:4] = np.eye(3)
        backward = [tip - np.einsum("abxg,b->axg", last, self.tool.T_link_tool.position)]
        for k in reversed(range(n)):
            backward.append(backward[-1] - self._step(k, self.rotations))
        return forward, backward[::-1]

    def _origins(self) -> Array:
        forward, backward = self._ends()
        fewer = [
            np.count_nonzero(np.any(f, axis=(0, 2))) <= np.count_nonzero(np.any(b, axis=(0, 2)))
            for f, b in zip(forward, backward, strict=True)
        ]
        return np.stack([f if use else b for f, b, use in zip(forward, backward, fewer, strict=True)])

    def _equalities(self) -> tuple[Array, NDArray[np.bool_]]:
        """Rows that are not zero throughout; and which of all those are: traces, three a joint, closure."""
        n, robot = self.robot.dof, self.robot
        rows = []
        for start in self.ball_start:
            trace = np.zeros((1, self.size + 1, GOAL))
            trace[0, start : start + 10, 0] = svec(np.eye(4))
            trace[0, -1, 0] = -1.0
            rows.append(trace)
        for k in range(n):
            from_parent = np.einsum("abxg,b->axg", self.rotations[k], robot.joint_rotation[k] @ robot.axis[k])
            rows.append(from_parent - np.einsum("abxg,b->axg", self.rotations[k + 1], robot.axis[k]))
        if n == 1:
            _, last = self._fixed()
            rows.append((self.rotations[1] - last).reshape(9, self.size + 1, GOAL))
        forward, backward = self._ends()
        rows.append(forward[n] - backward[n])
        stacked = np.concatenate(rows)
        stacked[np.abs(stacked) < _NEGLIGIBLE] = 0.0
        kept = np.any(stacked, axis=(1, 2))
        left: Array = stacked[kept]
        return left, kept

    def lift(self, q: Array) -> Array:
        """x (N,) of a configuration (n,): the rank-1 point that stands for it."""
        R = self.robot.link_transforms(q)[:, :3, :3]
        R = R[0].T @ R
        x = np.zeros(self.size)
        if self.balls:
            quats = _quaternions(R[list(self.balls)])
            x[: 10 * len(self.balls)] = svec(quats[:, :, None] * quats[:, None, :]).ravel()
        for d in self.discs:
            outer = R[-1] if d.from_goal else np.eye(3)
            planar = d.F.T @ outer.T @ R[d.link] @ d.C.T @ d.F
            sign = -1.0 if d.from_goal else 1.0
            cosine_sine = np.array([planar[0, 0] + planar[1, 1], sign * (planar[1, 0] - planar[0, 1])])
            x[d.start : d.start + 2] = cosine_sine / np.linalg.norm(cosine_sine)
        return x

    def angles(self, x: Array, goal: Array) -> Array:
        """Joint angles (n,) in (-pi, pi] read from a point x near rank 1."""
        coefficients = self.at(self.rotations, goal)
        R = coefficients[..., :-1] @ x + coefficients[..., -1]
        M = np.swapaxes(R[:-1] @ self._parent_frames, -1, -2) @ R[1:] @ self._frames
        angles: Array = np.arctan2(M[:, 1, 0] - M[:, 0, 1], M[:, 0, 0] + M[:, 1, 1])
        return angles


def _quaternions(R: Array) -> Array:
    """Unit quaternions (k, 4) of rotations (k, 3, 3): the adjoint of `rotation_map` has them as top eigenvectors."""
    K = smat(np.einsum("kij,ijs->ks", R, rotation_map()), 4)
    quats: Array = np.linalg.eigh(K)[1][..., -1]
    return quats


def _is_along(axis: Array, other: Array) -> bool:
    return bool(np.linalg.norm(np.cross(axis, other)) < _PARALLEL)


def _planar_links(robot: Robot) -> dict[int, tuple[Array, Array, bool, int]]:
    """Links whose axis of rotation is known, from the base upwards and from the goal downwards: F, C, side, joint."""
    n, planar = robot.dof, {}
    F, C = robot.joint_rotation[0] @ frame_with_z(robot.axis[0]), np.eye(3)
    for k in range(max(n - 1, 1)):
        if not _is_along(F[:, 2], C @ robot.joint_rotation[k] @ robot.axis[k]):
            break
        C = C @ robot.joint_rotation[k]
        planar[k + 1] = (F, C, False, k if k == 0 else -1)
    F, C = frame_with_z(robot.axis[-1]), np.eye(3)
    for k in reversed(range(1, n)):
        if k in planar or not _is_along(F[:, 2], C @ robot.axis[k]):
            break
        C = C @ robot.joint_rotation[k].T
        planar[k] = (F, C, True, k if k == n - 1 else -1)
    return planar
