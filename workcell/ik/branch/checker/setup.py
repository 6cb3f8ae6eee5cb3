"""A problem as the checker of branch-and-bound proofs takes it: lines, spheres and obstacles in the world."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from workcell.identity_cache import ByIdentity
from workcell.ik.branch.checker.closure import Robot
from workcell.ik.branch.checker.obstacles import BOX, CAPSULE, CYLINDER, HALFSPACE, HULL, SPHERE, Scene
from workcell.ik.branch.checker.vectors import EPS
from workcell.ik.problem import IKProblem
from workcell.model.coupling import Coupling
from workcell.model.robot import LIMIT_SLACK
from workcell.model.robot import Robot as Arm
from workcell.pose import Array, quat_to_matrix

KINDS = {
    "box": BOX,
    "sphere": SPHERE,
    "capsule": CAPSULE,
    "cylinder": CYLINDER,
    "halfspace": HALFSPACE,
    "hull": HULL,
}
"""Pieces that the checker knows, and its own numbers for them: it shares nothing with solvers, their table of shapes
included."""
_PARALLEL = 1e-4
_GRID = 2001
"""Places at which a polynomial is looked at for its range."""
"""Square of the sine below which no nearest points are looked for: any points of two lines do as well."""
_FARTHEST = 10.0
"""Metres along its axis beyond which a nearest point is not taken: rounding grows with the lengths."""
_FREE = {"pose": [], "position": [0, 1, 2], "axis": [2]}
"""Axes of the tool about which a goal leaves the target free to turn, outermost first: joints of the target."""
_lines, _centres = ByIdentity(), ByIdentity()


def admissible(problem: IKProblem) -> tuple[Array, Array, Array]:
    """Limits (n,), (n,) that a proof must cover, free joints of the target last, and which joints repeat every turn."""
    robot = problem.robot
    lower, upper = robot.lower - LIMIT_SLACK, robot.upper + LIMIT_SLACK
    if problem.q_reference is not None and problem.max_step is not None:
        step = np.asarray(problem.max_step) + LIMIT_SLACK
        lower = np.maximum(lower, problem.q_reference - step)
        upper = np.minimum(upper, problem.q_reference + step)
    turning = ~robot.prismatic
    if robot.coupling is not None:
        lower, upper, turning = _of_all_joints(robot.coupling, lower, upper, turning)
    # Turns about the tool's x, y and z reach every rotation with the second within a quarter turn of zero.
    free = np.array({"pose": [], "position": [1.0, 0.5, 1.0], "axis": [1.0]}[problem.goal]) * np.pi
    periodic = np.concatenate([turning, np.full(len(free), problem.goal == "axis")])
    return np.concatenate([lower, -free]), np.concatenate([upper, free]), periodic


def _of_all_joints(
    coupling: Coupling, lower: Array, upper: Array, turning: NDArray[np.bool_]
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Limits (m,) of all joints from those of the variables, and which repeat: none that follows or leads."""
    low, high = np.array(lower[coupling.variable]), np.array(upper[coupling.variable])
    apart = np.array(turning)
    for k, variable in enumerate(coupling.variable):
        if int(coupling.own[variable]) == k:
            continue
        apart[k] = apart[coupling.own[variable]] = False
        # the values on a fine grid, and how far a parabola may leave the chords between them
        x, row = np.linspace(lower[variable], upper[variable], _GRID), coupling.coefficients[k]
        values = np.polynomial.polynomial.polyval(x, row)
        reach = max(abs(float(lower[variable])), abs(float(upper[variable])))
        bend = float(
            np.polynomial.polynomial.polyval(reach, np.abs(np.polynomial.polynomial.polyder(row, 2)))
        )
        between = 0.125 * (float(upper[variable] - lower[variable]) / (_GRID - 1)) ** 2 * bend
        low[k], high[k] = values.min() - between - EPS, values.max() + between + EPS
    return low, high, apart


def longest(problem: IKProblem) -> float:
    """An upper bound in metres on the distances that occur."""
    robot, cover = problem.robot.uncoupled, problem.cover
    # where neighbouring axes are nearly parallel, the points where they are nearest may lie far away on them
    points = _zero(robot, problem.goal)[2][:, 3:9].reshape(-1, 3) - robot.T_world_base.position
    sliding = np.maximum(np.abs(robot.lower), np.abs(robot.upper))[robot.prismatic]
    reach = np.linalg.norm(robot.joint_xyz, axis=1).sum() + sliding.sum()
    lengths = [
        float(reach + np.linalg.norm(robot.tool().T_link_tool.position)),
        float(np.linalg.norm(problem.target.position)),
        float(np.linalg.norm(robot.T_world_base.position)),
        float(np.linalg.norm(points, axis=1).max()),
    ]
    if cover is not None and len(cover):
        lengths.append(float(np.abs(cover.centre).max() + cover.radius.max()))
        for piece in problem.obstacles:
            size = max(
                [*piece.size.tolist(), 0.0 if piece.vertices is None else np.abs(piece.vertices).max()],
                default=0.0,
            )
            lengths.append(float(max(map(abs, piece.pose.position.tolist())) + size))
    return max(lengths)


def proof_robot(problem: IKProblem, inflation: Array, length: float) -> Robot:
    """The kinematics of a problem."""
    rotation, position, lines = _zero(problem.robot, problem.goal)
    frame = problem.robot.tool()
    tool = rotation[-1] @ frame.T_link_tool.rotation
    tip = position[-1] + rotation[-1] @ frame.T_link_tool.position
    turned = problem.target.rotation @ tool.T
    goal = np.concatenate([turned.ravel(), problem.target.position - turned @ tip])
    ball = np.concatenate([inflation, problem.target.position])
    free = problem.goal == "position"
    middle = problem.robot.joint_count + 1 if free else (len(lines) - 1) // 2
    scale = np.array([EPS * max(1.0, length) ** 2])
    return Robot(lines, middle, not free, goal, ball, scale, _coupled(problem.robot))


def proof_scene(problem: IKProblem, used: bool) -> Scene:
    """Spheres and obstacles of a problem; none where the proof names none."""
    cover = problem.cover
    if cover is None or not used:
        return Scene(np.zeros((0, 5)), np.zeros((0, 18)), np.zeros((0, 9)))
    rotation, position, _ = _zero(problem.robot, problem.goal)
    spheres = _centres.get(
        (rotation, cover),
        lambda: np.column_stack(
            [
                cover.link,
                np.einsum("mij,mj->mi", rotation[cover.link], cover.centre) + position[cover.link],
                cover.radius,
            ]
        ),
    )
    pieces, count = problem.obstacles, 0
    triangles, rows = [np.zeros((0, 9))], np.zeros((len(pieces), 18))
    if pieces:
        rotations = quat_to_matrix(np.array([piece.pose.quat_wxyz for piece in pieces]))
        rows[:, 1:10] = rotations.reshape(-1, 9)
    for row, piece in zip(rows, pieces, strict=True):
        row[0], row[10:13] = KINDS[piece.kind], piece.pose.position
        row[13 : 13 + len(piece.size)] = piece.size
        if piece.vertices is not None:
            faces = _faces(piece.vertices.tobytes())
            row[16:18] = count, count + len(faces)
            triangles.append(faces)
            count += len(faces)
    return Scene(spheres, rows, np.concatenate(triangles))


def _zero(robot: Arm, goal: str) -> tuple[Array, Array, Array]:
    return _lines.get((robot, goal), lambda: zero_links(robot.uncoupled, goal))


def _coupled(robot: Arm) -> Array:
    """Rows of `closure.Robot.coupled`."""
    coupling = robot.coupling
    if coupling is None:
        return np.zeros((0, 4))
    rows = [
        [k + 1.0, coupling.own[variable] + 1.0, *coupling.coefficients[k]]
        for k, variable in enumerate(coupling.variable)
        if int(coupling.own[variable]) != k
    ]
    return np.array(rows)


def zero_links(robot: Arm, goal: str = "pose") -> tuple[Array, Array, Array]:
    """Rotations (n + 1, 3, 3), positions (n + 1, 3) and lines (N, 10) in the world, all joints at zero.

    See `closure.Robot`: one fixed line at either end, the goal's free joints before the last.
    """
    rotation, position = [robot.T_world_base.rotation], [np.array(robot.T_world_base.position)]
    for k in range(robot.dof):
        position.append(position[-1] + rotation[-1] @ robot.joint_xyz[k])
        rotation.append(rotation[-1] @ robot.joint_rotation[k])
    frame = robot.tool()
    tip = position[-1] + rotation[-1] @ frame.T_link_tool.position
    tool = rotation[-1] @ frame.T_link_tool.rotation
    z = [rotation[k + 1] @ robot.axis[k] for k in range(robot.dof)] + [tool[:, a] for a in _FREE[goal]]
    z = [direction / np.linalg.norm(direction) for direction in z]
    o = position[1:] + [tip] * len(_FREE[goal])
    first, last = _beside(z[0], o[0], position[0]), _beside(z[-1], o[-1], tip)
    directions, points = np.vstack([first[0], *z, last[0]]), np.vstack([first[1], *o, last[1]])
    near, far = points.copy(), points.copy()
    for k in range(len(points) - 1):
        far[k], near[k + 1] = _closest(directions[k], points[k], directions[k + 1], points[k + 1])
    slides = np.zeros((len(points), 1))
    slides[1 : robot.dof + 1, 0] = robot.prismatic
    return np.array(rotation), np.array(position), np.hstack([directions, near, far, slides])


def _beside(z: Array, o: Array, height: Array) -> tuple[Array, Array]:
    """(direction, point) of a line across the axis (z, o) and a lever away from it, at the height of a point."""
    across = np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))])
    across /= np.linalg.norm(across)
    return np.cross(z, across), o + z * (z @ (height - o)) + 0.25 * across


def _closest(z: Array, o: Array, y: Array, p: Array) -> tuple[Array, Array]:
    """The points of two lines (direction, point) that are nearest each other; any pair if they are nearly parallel."""
    normal = np.cross(z, y)
    square = normal @ normal
    if square < _PARALLEL:
        return o + z * (z @ (p - o)), p
    s = np.cross(p - o, y) @ normal / square
    t = np.cross(p - o, z) @ normal / square
    if max(abs(s), abs(t)) > _FARTHEST:
        return o + z * (z @ (p - o)), p
    return o + s * z, p + t * y


@functools.lru_cache(maxsize=512)
def _faces(vertex_bytes: bytes) -> Array:
    """Triangles (f, 9) of a hull's surface in its frame, wound so that their normals point outwards.

    Raises ValueError where they don't close or leave a vertex outside: nothing is taken on trust from the library.
    """
    from scipy.spatial import ConvexHull

    vertices = np.frombuffer(vertex_bytes).reshape(-1, 3)
    simplices = ConvexHull(vertices).simplices
    corners = vertices[simplices]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inwards = np.einsum("fi,fi->f", normal, corners[:, 0] - vertices.mean(axis=0)) < 0
    simplices[inwards] = simplices[inwards][:, ::-1]
    corners[inwards], normal[inwards] = corners[inwards][:, ::-1], -normal[inwards]
    edges = np.concatenate([simplices[:, [0, 1]], simplices[:, [1, 2]], simplices[:, [2, 0]]])
    forward, backward = (
        {tuple(edge) for edge in edges.tolist()},
        {tuple(edge) for edge in edges[:, ::-1].tolist()},
    )
    heights = np.einsum("vi,fi->vf", vertices, normal) - np.einsum("fi,fi->f", corners[:, 0], normal)
    if (
        len(forward) != len(edges)
        or forward != backward
        or np.any(heights > 1e-9 * (1.0 + np.abs(vertices).max()))
    ):
        raise ValueError("the surface of a hull can't be established")
    return np.asarray(corners).reshape(-1, 9)
