"""Problems as the branch and bound's kernels take them: plain arrays in the base's frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workcell.geometry.types import Piece, SphereCover
from workcell.identity_cache import ByIdentity
from workcell.ik.branch.chain import Kinematics, joint_box, kinematics
from workcell.ik.problem import IKProblem
from workcell.kernels.shape_kinds import BOX, CAPSULE, CYLINDER, HALFSPACE, HULL, KINDS
from workcell.pose import Array, quat_to_matrix

OVERLAP = 1e-5
"""Metres: "no" is proved for a clearance of c + OVERLAP at most, "yes" shown for c. Without it gaps that are just too
narrow leave thousands of tiny boxes."""
INFLATION = (1e-4, 1e-3)
"""Metres and radians of departure from the target that every proof covers at least."""
_placed = ByIdentity()
KNOWN = ("box", "sphere", "capsule", "cylinder", "halfspace", "hull")
"""Pieces that have a test of exclusion."""


@dataclass(frozen=True, slots=True)
class Arrays:
    """A problem as the kernels take it."""

    chain: Any
    world: Any
    root: Array
    sphere_order: NDArray[np.int64]


def inflation(problem: IKProblem) -> tuple[float, float]:
    """Departure from the target (m, rad) that a proof for `problem` covers."""
    allowed = problem.tolerances
    return max(allowed.position, INFLATION[0]), max(allowed.rotation, INFLATION[1])


def problem_arrays(problem: IKProblem) -> Arrays:
    """The problem in the base's frame, every joint axis turned into its frame's z, a fixed joint at either end."""
    from workcell.ik.branch.kernels.state import Chain
    from workcell.ik.branch.kernels.world import World

    robot = kinematics(problem.robot, problem.goal)
    target = robot.T_base_world @ problem.target.matrix
    goal = target @ robot.T_tool_end
    chain = Chain(
        fixed=robot.fixed,
        feet=robot.feet,
        slides=robot.slides,
        around=robot.around,
        weights=robot.weights,
        middle=robot.middle,
        turns=problem.goal != "position",
        goal=np.concatenate([goal[:3, :3].ravel(), goal[:3, 3]]),
        ball=np.array([*inflation(problem), *target[:3, 3]]),
        follows=robot.follows,
        polynomials=robot.polynomials,
    )
    order, spheres = _spheres(problem, robot)
    lower, upper = joint_box(problem)
    root = np.zeros((2, len(lower) + 2))
    root[0, 1:-1], root[1, 1:-1] = lower, upper
    obstacles, vertices, planes = _obstacles(problem, robot.T_base_world)
    margin = np.array([problem.tolerances.safety_margin, OVERLAP])
    pairs = _pairs(problem, order, spheres)
    return Arrays(chain, World(spheres, obstacles, vertices, planes, pairs, margin), root, order)


def _pairs(problem: IKProblem, order: NDArray[np.int64], spheres: Array) -> NDArray[np.int64]:
    """Pairs of rows of `spheres` that must keep clear of each other, the one nearer to the base first."""
    if problem.self_collision is None or not len(problem.self_collision):
        return np.zeros((0, 2), dtype=np.int64)
    pairs = np.argsort(order)[problem.self_collision]
    backwards = spheres[pairs[:, 0], 0] > spheres[pairs[:, 1], 0]
    return np.where(backwards[:, None], pairs[:, ::-1], pairs)


def _spheres(problem: IKProblem, robot: Kinematics) -> tuple[NDArray[np.int64], Array]:
    """Spheres in the kernels' frames, the largest of each link first, from the tool to the base; and their order."""
    cover = problem.cover
    if cover is None or not len(cover) or not (problem.obstacles or problem.self_collision is not None):
        return np.zeros(0, dtype=np.int64), np.zeros((0, 5))
    return _placed.get((robot, cover), lambda: _place(robot, cover))


def _place(robot: Kinematics, cover: SphereCover) -> tuple[NDArray[np.int64], Array]:
    back = np.linalg.inv(robot.base)
    into = np.concatenate([back[None, :3, :3], np.swapaxes(robot.turned, 1, 2)])[cover.link]
    centres = np.einsum("mij,mj->mi", into, cover.centre)
    centres[cover.link == 0] += back[:3, 3]
    order = np.lexsort((-cover.radius, -cover.link))
    rows = np.column_stack([cover.link, centres, cover.radius])[order]
    return order.astype(np.int64), rows


def _obstacles(problem: IKProblem, T_base_world: Array) -> tuple[Array, Array, Array]:
    """Obstacle rows in the base's frame with vertices and planes of the hulls."""
    pieces = problem.obstacles if problem.cover is not None else ()
    vertices, planes = [np.zeros((0, 3))], [np.zeros((0, 4))]
    rows = np.zeros((len(pieces), 24))
    if not pieces:
        return rows, vertices[0], planes[0]
    into = T_base_world[:3, :3]
    R = into @ quat_to_matrix(np.array([piece.pose.quat_wxyz for piece in pieces]))
    origin = np.array([piece.pose.position for piece in pieces]) @ into.T + T_base_world[:3, 3]
    sizes = np.array([(piece.size.tolist() + [0.0] * 3)[:3] for piece in pieces])
    rows[:, 0] = [KINDS[piece.kind] for piece in pieces]
    rows[:, 1:10], rows[:, 10:13], rows[:, 13:16] = R.reshape(-1, 9), origin, sizes
    half = _half_extents(rows[:, 0], R, sizes)
    rows[:, 16:19], rows[:, 19:22] = origin - half, origin + half
    corner, facet = 0, 0
    for k in np.flatnonzero(rows[:, 0] == HULL):
        corners, facets = _hull(pieces[k])
        world = corners @ R[k].T + origin[k]
        rows[k, 16:19], rows[k, 19:22] = world.min(axis=0), world.max(axis=0)
        rows[k, 13:15], rows[k, 22:24] = (corner, corner + len(corners)), (facet, facet + len(facets))
        corner, facet = corner + len(corners), facet + len(facets)
        vertices.append(corners)
        planes.append(facets)
    return rows, np.concatenate(vertices), np.concatenate(planes)


def _half_extents(kinds: Array, R: Array, sizes: Array) -> Array:
    """(k, 3) half the sizes of axis-aligned boxes around the pieces' origins that hold them; huge for half-spaces."""
    core, radius = np.zeros_like(sizes), np.where(kinds == BOX, 0.0, sizes[:, 0])
    long = (kinds == CAPSULE) | (kinds == CYLINDER)
    core[long, 2] = sizes[long, 1]
    core[kinds == BOX] = sizes[kinds == BOX]
    radius[kinds == HALFSPACE] = 1e9
    half: Array = np.einsum("kij,kj->ki", np.abs(R), core) + radius[:, None]
    return half


def _hull(piece: Piece) -> tuple[Array, Array]:
    from scipy.spatial import ConvexHull

    assert piece.vertices is not None
    hull = ConvexHull(piece.vertices)
    return piece.vertices[hull.vertices], np.asarray(hull.equations)
