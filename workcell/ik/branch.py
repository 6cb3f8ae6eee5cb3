"""Joint-space branch and bound: every query ends in a configuration or in a proof that there is none.

A node is a box of joint angles. Contractors derived from the closure of the chain (axes seen from the base and from the
target, with bounds on how far they move over the box) shrink it; obstacles exclude it when some sphere collides all
over it; a local search from its centre ends the tree with a solution; otherwise it is split. See `branch_kernels`.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workcell.errors import InputError
from workcell.geometry.types import Piece
from workcell.ik.branch_check import seal, statement
from workcell.ik.certificate import Certificate, Scope, problem_hash
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.result import Candidate
from workcell.ik.verify import Verifier
from workcell.model.robot import LIMIT_SLACK
from workcell.pose import Array, quat_to_matrix

OVERLAP = 1e-5
"""Metres: "no" is proved for a clearance of c + OVERLAP at most, "yes" shown for c. Without it gaps that are just too
narrow leave thousands of tiny boxes."""
INFLATION = (1e-4, 1e-3)
"""Metres and radians of departure from the target that every proof covers at least."""
MOST_NODES = 2_000_000
"""Size of the tree at which the search gives up: its memory."""
_CHUNK = 500
_LEVER = 0.3
_KINDS = {"box": 0, "sphere": 1, "capsule": 2, "cylinder": 3, "halfspace": 4, "hull": 5}


def solve_branch(problem: IKProblem, budget: Budget, seed: int = 0) -> Candidate:
    """Decide `problem`: a configuration, or a certificate of kind `branch` that none exists, or neither in the budget.

    The search is deterministic; `seed` is taken for the signature all solvers share.

    Raises:
        InputError: a joint is prismatic, a piece is of a kind that has no exclusion test, or a bound on the rotation of
            links is asked for.
    """
    del seed
    return _Search(problem).run(time.process_time() + budget.cpu_s)


def joint_box(problem: IKProblem) -> tuple[Array, Array]:
    """The box (n,), (n,) of all admissible configurations, with `LIMIT_SLACK`; a joint that can turn fully has one turn."""
    lower, upper = problem.robot.lower - LIMIT_SLACK, problem.robot.upper + LIMIT_SLACK
    if problem.q_reference is not None and problem.max_step is not None:
        step = np.asarray(problem.max_step) + LIMIT_SLACK
        lower = np.maximum(lower, problem.q_reference - step)
        upper = np.minimum(upper, problem.q_reference + step)
    turn = 2 * np.pi + 1e-9
    middle = 0.5 * (lower + upper)
    wide = upper - lower > turn
    return np.where(wide, middle - turn / 2, lower), np.where(wide, middle + turn / 2, upper)


@dataclass(slots=True)
class _Arrays:
    """A problem as the kernels take it."""

    chain: Any
    world: Any
    root: Array
    sphere_order: NDArray[np.int64]


class _Search:
    """One query."""

    def __init__(self, problem: IKProblem) -> None:
        _refuse(problem)
        self.problem = problem
        self.arrays = problem_arrays(problem)
        self.verifier = Verifier(problem)
        self.rejected: list[str] = []

    def run(self, deadline: float) -> Candidate:
        from workcell.ik.branch_kernels import search
        from workcell.ik.branch_kernels.obstacles import new_sweep
        from workcell.ik.branch_kernels.state import new_state

        chain, world, root = self.arrays.chain, self.arrays.world, self.arrays.root
        joints = root.shape[1]
        state, sweep = new_state(joints), new_sweep(joints)
        tree = search.Tree(
            np.zeros((1024, 2, joints)), np.zeros((4096, 4)), np.zeros(8, dtype=np.int64), np.zeros(joints)
        )
        if np.any(root[0] > root[1]):
            raise InputError("the limits and max_step leave no configuration", where="max_step")
        tree.stack[0] = root
        tree.counts[0], tree.counts[6] = 1, -1
        tolerances = self.problem.tolerances
        reached = np.array([0.9999 * tolerances.position, 0.9999 * tolerances.rotation])
        while True:
            outcome = search.run(chain, world, root, state, sweep, tree, reached, _CHUNK)
            if outcome == search.FOUND:
                q = self._accept(tree.found[1:-1])
                if q is not None:
                    return Candidate(q=q, stats=self._stats(tree), rejected=tuple(self.rejected))
            elif outcome == search.DONE:
                break
            elif outcome == search.FULL:
                if tree.counts[0] + 2 > len(tree.stack) or len(tree.nodes) >= MOST_NODES:
                    break
                tree = tree._replace(nodes=np.concatenate([tree.nodes, np.zeros_like(tree.nodes)]))
            if time.process_time() > deadline:
                break
        certificate = self._certificate(tree) if tree.counts[0] == 0 and tree.counts[4] == 0 else None
        return Candidate(certificate=certificate, stats=self._stats(tree), rejected=tuple(self.rejected))

    def _accept(self, q: Array) -> Array | None:
        robot = self.problem.robot
        q = np.clip(robot.unwrap(q), robot.lower, robot.upper)
        verdict = self.verifier(q)
        if verdict.accepted:
            return q
        if len(self.rejected) < 5:
            self.rejected.append("; ".join(verdict.reasons))
        return None

    def _stats(self, tree: Any) -> dict[str, float]:
        names = ("boxes_left", "nodes", "kinematic_leaves", "obstacle_leaves", "given_up", "local_searches")
        return {name: float(tree.counts[k]) for k, name in enumerate(names)}

    def _certificate(self, tree: Any) -> Certificate:
        nodes = tree.nodes[: tree.counts[1]]
        blocked = nodes[:, 0] == -2
        problem = self.problem
        clearance = problem.tolerances.safety_margin
        if np.any(blocked):
            clearance = max(clearance, float(nodes[blocked, 3].max()))
        data = {
            "tree": nodes[:, 0],
            "splits": nodes[nodes[:, 0] >= 0, 1],
            "blocked": np.stack([self.arrays.sphere_order[nodes[blocked, 1].astype(int)], nodes[blocked, 2]]),
            "root": self.arrays.root[:, 1:-1],
            "inflation": np.array(inflation(problem)),
            "clearance": np.array([clearance]),
        }
        data["seal"] = seal(data)
        return Certificate(
            kind="branch",
            scope=certificate_scope(problem, bool(np.any(blocked))),
            statement=statement(data),
            margin=float(data["inflation"][0]),
            problem_hash=problem_hash(problem),
            data=data,
        )


def inflation(problem: IKProblem) -> tuple[float, float]:
    """Departure from the target (m, rad) that a proof for `problem` covers."""
    allowed = problem.tolerances
    return max(allowed.position, INFLATION[0]), max(allowed.rotation, INFLATION[1])


def certificate_scope(problem: IKProblem, obstacles_used: bool) -> Scope:
    """What a proof is about: see `workcell.ik.certificate.Scope`."""
    if not obstacles_used:
        return "kinematics"
    given = problem.cover is not None and problem.cover.kind == "given" and problem.checker is None
    return "geometry" if given else "model"


def _refuse(problem: IKProblem) -> None:
    robot = problem.robot
    for k in np.flatnonzero(robot.prismatic):
        raise InputError(
            f"joint {robot.joint_names[k]!r} is prismatic",
            where=robot.name,
            remedy="branch and bound takes revolute joints; try another solver",
        )
    if problem.max_link_rotation is not None:
        raise InputError("branch and bound doesn't know this bound", where="max_link_rotation", remedy="None")
    if robot.tool().link != robot.dof:
        raise InputError("the tool must sit on the last link", where="robot", remedy="pass robot.chain(tool)")
    if problem.cover is not None:
        for piece in problem.obstacles:
            if piece.kind not in _KINDS:
                raise InputError(
                    f"a piece of kind {piece.kind!r}", where=piece.name, remedy=f"one of {', '.join(_KINDS)}"
                )


def problem_arrays(problem: IKProblem) -> _Arrays:
    """The problem in the base's frame, every joint axis turned into its frame's z, a fixed joint at either end."""
    from workcell.ik.branch_kernels.state import Chain
    from workcell.ik.branch_kernels.world import World

    robot = problem.robot
    n = robot.dof
    turned = [_frame_with_z(axis) for axis in robot.axis]
    fixed: list[Array] = []
    base = _line_beside(np.eye(4), _transform(robot.joint_rotation[0] @ turned[0], robot.joint_xyz[0]))
    before = np.linalg.inv(base)
    for k in range(n):
        fixed.append(before @ _transform(robot.joint_rotation[k] @ turned[k], robot.joint_xyz[k]))
        before = _transform(turned[k].T, np.zeros(3))
    tool = robot.tool().T_link_tool.matrix
    T_last_tool = before @ tool
    end = _line_beside(T_last_tool, np.eye(4))
    frames = np.array([base, *fixed, end])
    target = problem.T_base_tool.matrix
    goal = target @ np.linalg.inv(T_last_tool) @ end
    feet = _feet(frames)
    position, rotation = inflation(problem)
    chain = Chain(
        _rows(frames),
        feet,
        _bands(frames, feet),
        _rows(goal[None])[0],
        np.array([position, rotation, *target[:3, 3]]),
    )
    order, spheres = _spheres(problem, turned, base)
    lower, upper = joint_box(problem)
    root = np.array([[0.0, *lower, 0.0], [0.0, *upper, 0.0]])
    obstacles, vertices, planes = _obstacles(problem)
    margin = np.array([problem.tolerances.safety_margin, OVERLAP])
    return _Arrays(chain, World(spheres, obstacles, vertices, planes, margin), root, order)


def _transform(R: Array, p: Array) -> Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, p
    return T


def _rows(T: Array) -> Array:
    return np.ascontiguousarray(np.concatenate([T[:, :3, :3].reshape(-1, 9), T[:, :3, 3]], axis=1))


def _frame_with_z(axis: Array) -> Array:
    """A rotation whose third column is `axis`."""
    z = axis / np.linalg.norm(axis)
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _line_beside(T_frame: Array, T_joint: Array) -> Array:
    """A frame whose z axis is a line at right angles to a joint's axis and beside it: what fixes the joint's angle.

    It passes at the height of `T_frame`'s origin; both transforms are in the frame of the result.
    """
    R = T_joint[:3, :3]
    along = R[:, 2] @ (T_frame[:3, 3] - T_joint[:3, 3])
    line = np.stack([R[:, 2], R[:, 0], R[:, 1]], axis=1)
    return _transform(line, T_joint[:3, 3] + along * R[:, 2] + _LEVER * R[:, 0])


def _feet(frames: Array) -> Array:
    """(N, 2) where along its axis each joint is nearest to the axis before it, and after it."""
    feet = np.zeros((len(frames), 2))
    for k in range(1, len(frames)):
        p, z = frames[k][:3, 3], frames[k][:3, 2]
        across = z[0] ** 2 + z[1] ** 2
        if across > 1e-12:
            feet[k, 0] = -(p[0] * z[0] + p[1] * z[1]) / across
            feet[k - 1, 1] = p[2] + feet[k, 0] * z[2]
        else:
            feet[k - 1, 1] = p[2]
    feet[0, 0], feet[-1, 1] = feet[0, 1], feet[-1, 0]
    return feet


def _bands(frames: Array, feet: Array) -> Array:
    """(2, N, 4, 3) coefficients of the invariants about each joint, for both views (see `branch_kernels.invariants`)."""
    count = len(frames)
    bands = np.zeros((2, count, 4, 3))
    for i in range(1, count - 1):
        back = np.linalg.inv(frames[i])
        y = (back @ np.array([0.0, 0.0, feet[i - 1, 0], 1.0]))[:3]
        zy = back[:3, 2]
        zx = frames[i + 1][:3, 2]
        x = frames[i + 1][:3, 3] + feet[i + 1, 1] * zx
        distance = -2 * _turning(y, x) + np.array([x @ x + y @ y, 0.0, 0.0])
        near = _turning(zy, x) - np.array([zy @ y, 0.0, 0.0])
        far = np.array([zx @ x, 0.0, 0.0]) - _turning(y, zx)
        between = _turning(zy, zx)
        bands[0, i] = distance, near, far, between
        bands[1, count - 1 - i] = distance, -far, -near, between
    return bands


def _turning(u: Array, v: Array) -> Array:
    """(a, b, c) of u . Rz(t) v = a + b cos t + c sin t."""
    return np.array([u[2] * v[2], u[0] * v[0] + u[1] * v[1], u[1] * v[0] - u[0] * v[1]])


def _spheres(problem: IKProblem, turned: list[Array], base: Array) -> tuple[NDArray[np.int64], Array]:
    """Spheres in the kernels' frames, the largest of each link first, from the tool to the base; and their order."""
    cover = problem.cover
    if cover is None or not len(cover) or not problem.obstacles:
        return np.zeros(0, dtype=np.int64), np.zeros((0, 5))
    into = [np.linalg.inv(base), *(_transform(R.T, np.zeros(3)) for R in turned)]
    order = np.lexsort((-cover.radius, -cover.link))
    rows = [
        [link, *(into[link] @ np.array([*cover.centre[s], 1.0]))[:3], cover.radius[s]]
        for s, link in ((s, int(cover.link[s])) for s in order)
    ]
    return order.astype(np.int64), np.array(rows)


def _obstacles(problem: IKProblem) -> tuple[Array, Array, Array]:
    """Obstacle rows in the base's frame with vertices and planes of the hulls."""
    from_world = problem.robot.T_world_base.inverse()
    rows, vertices, planes = [], [np.zeros((0, 3))], [np.zeros((0, 4))]
    counts = [0, 0]
    for piece in problem.obstacles if problem.cover is not None else ():
        pose = from_world @ piece.pose
        R = quat_to_matrix(pose.quat_wxyz)
        row = np.zeros(24)
        row[0], row[1:10], row[10:13] = _KINDS[piece.kind], R.ravel(), pose.position
        row[13 : 13 + len(piece.size)] = piece.size
        half = _half_extent(piece, R)
        row[16:19], row[19:22] = pose.position - half, pose.position + half
        if piece.kind == "hull":
            corners, facets = _hull(piece)
            world = corners @ R.T + pose.position
            row[16:19], row[19:22] = world.min(axis=0), world.max(axis=0)
            row[13:15] = counts[0], counts[0] + len(corners)
            row[22:24] = counts[1], counts[1] + len(facets)
            counts = [counts[0] + len(corners), counts[1] + len(facets)]
            vertices.append(corners)
            planes.append(facets)
        rows.append(row)
    return np.array(rows).reshape(-1, 24), np.concatenate(vertices), np.concatenate(planes)


def _half_extent(piece: Piece, R: Array) -> Array:
    """Half the size of an axis-aligned box around the piece's origin that holds it; inf for a half-space."""
    size = piece.size
    if piece.kind == "box":
        extent: Array = np.abs(R) @ size
        return extent
    if piece.kind == "sphere":
        return np.full(3, size[0])
    if piece.kind in ("capsule", "cylinder"):
        return np.abs(R[:, 2]) * size[1] + size[0]
    return np.full(3, 1e9)


def _hull(piece: Piece) -> tuple[Array, Array]:
    from scipy.spatial import ConvexHull

    assert piece.vertices is not None
    hull = ConvexHull(piece.vertices)
    return piece.vertices[hull.vertices], np.asarray(hull.equations)
