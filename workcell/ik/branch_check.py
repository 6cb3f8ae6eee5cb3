"""Re-checks proofs by branch and bound, with kinematics, bounds and code of its own.

A certificate of kind `branch` holds a tree of boxes of joint angles, in pre-order. It is only a hint: the checker starts
from the box of all admissible configurations, contracts every box by inequalities that hold in all of it, splits where
the tree says, lower half first, and proves every leaf (subdividing where it must). A bad tree can fail, never mislead.
What is in `data`:

    tree        (nodes,)    joint to split, from 0; or -1: no configuration of the box closes the chain;
                            or -2: in all of it a sphere collides with an obstacle
    splits      (inner,)    where
    blocked     (2, ...)    sphere and obstacle of every -2
    root        (2, n)      the box of all configurations
    inflation   (2,)        departure from the target (m, rad) that the proof covers
    clearance   (1,)        no configuration keeps this clearance (m)
    seal        (8,)        SHA-256 of all that, in words of 32 bits: detects damage, not fraud
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from workcell.geometry.types import Piece
from workcell.ik.certificate import Certificate, problem_hash
from workcell.ik.problem import IKProblem
from workcell.model.robot import LIMIT_SLACK
from workcell.pose import Array, quat_to_matrix

LEAST_INFLATION = (1e-4, 1e-3)
"""Metres and radians that a proof must cover at least."""
MOST_OVERLAP = 1e-5
"""Metres by which the clearance of a proof may exceed the one that is asked for."""
LONGEST = 50.0
"""Metres within which the rounding slack of the checker is justified."""
MOST_NODES = 5_000_000
_FIELDS = {"tree": 1, "splits": 1, "blocked": 2, "root": 2, "inflation": 1, "clearance": 1}
_KINDS = {"box": 0, "sphere": 1, "capsule": 2, "cylinder": 3, "halfspace": 4, "hull": 5}
_OUTCOMES = {
    1: "the tree ends too early",
    2: "the tree goes on after its last leaf",
    3: "the tree has an unknown reason or joint",
    4: "a split lies outside the joint's range",
    5: "a leaf names a sphere or an obstacle that isn't there",
    6: "a leaf can't be proved",
    7: "the tree is too deep",
}


def check_branch(problem: IKProblem, certificate: Certificate) -> str | None:
    """None when the certificate proves that `problem` has no solution, else why it doesn't."""
    if certificate.kind != "branch":
        return f"a proof of kind {certificate.kind!r} is not a tree of boxes"
    if certificate.problem_hash != problem_hash(problem):
        return "the certificate belongs to another problem"
    data = certificate.data
    refusal = _check_form(data) or _check_claim(problem, certificate) or _check_root(problem, data["root"])
    if refusal is not None:
        return refusal
    longest = _longest(problem)
    if longest > LONGEST:
        return f"the robot or its surroundings reach {longest:.3g} m; the checker's rounding is proved up to {LONGEST:g}"
    return _walk(problem, data, longest)


def seal(data: Mapping[str, Any]) -> Array:
    """(8,) words of the SHA-256 of a proof's numbers."""
    digest = hashlib.sha256()
    for name in _FIELDS:
        values = np.asarray(data[name], dtype=float)
        digest.update(f"{name}{values.shape}".encode() + (values + 0.0).tobytes())
    return np.frombuffer(digest.digest(), dtype=">u4").astype(float)


def statement(data: Mapping[str, Any]) -> str:
    """The claim of a proof in words."""
    leaves = int(np.count_nonzero(np.asarray(data["tree"]) < 0))
    position, rotation = (float(value) for value in data["inflation"])
    blocked = np.asarray(data["blocked"]).shape[-1] > 0
    keeping = f" with a clearance of {float(data['clearance'][0]) * 1e3:.4g} mm or more" if blocked else ""
    return (
        f"No configuration{keeping} brings the tool within {position * 1e3:g} mm and {rotation:g} rad of its target: "
        f"each of the {leaves} boxes that cover all joint angles is excluded."
    )


def _check_form(data: Mapping[str, Array]) -> str | None:
    for name, dimensions in _FIELDS.items():
        if name not in data:
            return f"the proof lacks {name!r}"
        if data[name].ndim != dimensions:
            return f"{name!r} has the wrong shape"
        if not np.all(np.isfinite(data[name])):
            return f"{name!r} holds a number that is not finite"
    tree, blocked = data["tree"], data["blocked"]
    if len(tree) > MOST_NODES:
        return f"the tree has {len(tree)} nodes; at most {MOST_NODES} are read"
    inner = int(np.count_nonzero(tree >= 0))
    if len(data["splits"]) != inner or len(tree) != 2 * inner + 1:
        return "the numbers of nodes, splits and leaves don't fit together"
    if blocked.shape[0] != 2 or blocked.shape[1] != np.count_nonzero(tree == -2) or np.any(blocked % 1):
        return "the pairs of spheres and obstacles don't fit the leaves"
    if "seal" not in data or not np.array_equal(data["seal"], seal(data)):
        return "the proof's numbers have been changed since it was made"
    return None


def _check_claim(problem: IKProblem, certificate: Certificate) -> str | None:
    data, allowed = certificate.data, problem.tolerances
    inflation = data["inflation"]
    if inflation.shape != (2,) or data["clearance"].shape != (1,):
        return "the claim is damaged"
    least = (max(allowed.position, LEAST_INFLATION[0]), max(allowed.rotation, LEAST_INFLATION[1]))
    if inflation[0] < least[0] or inflation[1] < least[1] or np.any(inflation > 1.0):
        return f"the proof covers {inflation.tolist()} (m, rad) around the target; {list(least)} are needed"
    if certificate.margin != inflation[0]:
        return "the margin is not the tolerance that the proof covers"
    margin = allowed.safety_margin
    if not margin <= data["clearance"][0] <= margin + MOST_OVERLAP:
        return f"the proof is about a clearance of {data['clearance'][0]:g} m, the problem about {margin:g} m"
    if certificate.scope != _scope(problem, data["blocked"].shape[1] > 0):
        return f"the proof's scope is not {certificate.scope!r}"
    if certificate.statement != statement(data):
        return "the statement is not what the proof shows"
    return None


def _scope(problem: IKProblem, obstacles_used: bool) -> str:
    if not obstacles_used:
        return "kinematics"
    truth = problem.cover is not None and problem.cover.kind == "given" and problem.checker is None
    return "geometry" if truth else "model"


def _check_root(problem: IKProblem, root: Array) -> str | None:
    robot = problem.robot
    if root.shape != (2, robot.dof):
        return "the box of all configurations has the wrong shape"
    if np.any(robot.prismatic):
        return "the robot has a prismatic joint"
    lower, upper = robot.lower - LIMIT_SLACK, robot.upper + LIMIT_SLACK
    if problem.q_reference is not None and problem.max_step is not None:
        step = np.asarray(problem.max_step) + LIMIT_SLACK
        lower = np.maximum(lower, problem.q_reference - step)
        upper = np.minimum(upper, problem.q_reference + step)
    covered = ((root[0] <= lower) & (root[1] >= upper)) | (root[1] - root[0] >= 2 * np.pi)
    if not np.all(covered) or np.any(np.abs(root) > 100.0):
        k = int(np.argmin(covered))
        return f"the boxes leave out a part of joint {robot.joint_names[k]!r}"
    return None


def _walk(problem: IKProblem, data: Mapping[str, Array], longest: float) -> str | None:
    from workcell.ik.branch_proof.closure import Robot, new_box
    from workcell.ik.branch_proof.obstacles import Scene
    from workcell.ik.branch_proof.vectors import EPS
    from workcell.ik.branch_proof.walk import walk

    for piece in problem.obstacles:
        if piece.kind not in _KINDS:
            return f"the checker doesn't know pieces of kind {piece.kind!r}"
    rotation, position = _zero_links(problem)
    lines, goal = _lines_and_goal(problem, rotation, position)
    ball = np.array([*data["inflation"], *problem.target.position])
    robot = Robot(lines, goal, ball, np.array([EPS * max(1.0, longest)]))
    used = data["blocked"].shape[1] > 0
    scene = Scene(*_scene(problem, rotation, position, used))
    root = np.pad(data["root"], ((0, 0), (1, 1)))
    tree = np.array(data["tree"])
    spare = 10 * len(tree) + 1000
    arrays = (np.array(data["splits"]), np.array(data["blocked"]))
    box = new_box(root.shape[1])
    outcome, node = walk(robot, scene, root, tree, *arrays, float(data["clearance"][0]), spare, box)
    return None if outcome == 0 else f"{_OUTCOMES[outcome]} (node {node} of {len(tree)})"


def _zero_links(problem: IKProblem) -> tuple[Array, Array]:
    """Rotations (n + 1, 3, 3) and positions (n + 1, 3) of the links in the world, all joints at zero."""
    robot = problem.robot
    rotation, position = (
        [problem.robot.T_world_base.rotation],
        [np.array(problem.robot.T_world_base.position)],
    )
    for k in range(robot.dof):
        position.append(position[-1] + rotation[-1] @ robot.joint_xyz[k])
        rotation.append(rotation[-1] @ robot.joint_rotation[k])
    return np.array(rotation), np.array(position)


def _lines_and_goal(problem: IKProblem, rotation: Array, position: Array) -> tuple[Array, Array]:
    """The joints' lines in the zero configuration, one fixed line at either end, and the tool's motion to the target."""
    robot, frame = problem.robot, problem.robot.tool()
    tool = rotation[-1] @ frame.T_link_tool.rotation
    tip = position[-1] + rotation[-1] @ frame.T_link_tool.position
    turned = problem.target.rotation @ tool.T
    goal = np.concatenate([turned.ravel(), problem.target.position - turned @ tip])
    z = np.einsum("kij,kj->ki", rotation[1:], robot.axis)
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    o = position[1:]
    first, last = _beside(z[0], o[0], position[0]), _beside(z[-1], o[-1], tip)
    z, o = np.vstack([first[0], z, last[0]]), np.vstack([first[1], o, last[1]])
    near, far = o.copy(), o.copy()
    for k in range(len(z) - 1):
        far[k], near[k + 1] = _closest(z[k], o[k], z[k + 1], o[k + 1])
    return np.hstack([z, near, far]), goal


def _beside(z: Array, o: Array, height: Array) -> tuple[Array, Array]:
    """(direction, point) of a line across the axis (z, o) and a lever away from it, at the height of a point."""
    across = np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))])
    across /= np.linalg.norm(across)
    return np.cross(z, across), o + z * (z @ (height - o)) + 0.25 * across


def _closest(z: Array, o: Array, y: Array, p: Array) -> tuple[Array, Array]:
    """The points of two lines (direction, point) that are nearest each other; any pair of such if they are parallel."""
    normal = np.cross(z, y)
    square = normal @ normal
    if square < 1e-12:
        return o + z * (z @ (p - o)), p
    s = np.cross(p - o, y) @ normal / square
    t = np.cross(p - o, z) @ normal / square
    return o + s * z, p + t * y


def _scene(problem: IKProblem, rotation: Array, position: Array, used: bool) -> tuple[Array, Array, Array]:
    spheres, rows, triangles = np.zeros((0, 5)), [], [np.zeros((0, 9))]
    if used and problem.cover is not None:
        cover = problem.cover
        centres = np.einsum("mij,mj->mi", rotation[cover.link], cover.centre) + position[cover.link]
        spheres = np.column_stack([cover.link, centres, cover.radius])
        count = 0
        rotations = quat_to_matrix(np.array([piece.pose.quat_wxyz for piece in problem.obstacles]))
        for piece, R in zip(problem.obstacles, rotations, strict=True):
            faces = _faces(piece)
            size = [*piece.size.tolist(), 0.0, 0.0, 0.0][:3]
            where = [*R.ravel().tolist(), *piece.pose.position.tolist(), *size, count, count + len(faces)]
            rows.append([_KINDS[piece.kind], *where])
            triangles.append(faces)
            count += len(faces)
    return spheres, np.array(rows, dtype=float).reshape(-1, 18), np.concatenate(triangles)


def _faces(piece: Piece) -> Array:
    """Triangles (f, 9) of a hull in its frame, wound so that their normals point outwards."""
    if piece.vertices is None:
        return np.zeros((0, 9))
    from scipy.spatial import ConvexHull

    corners = piece.vertices[ConvexHull(piece.vertices).simplices]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inwards = np.einsum("fi,fi->f", normal, corners[:, 0] - piece.vertices.mean(axis=0)) < 0
    corners[inwards] = corners[inwards][:, ::-1]
    return np.asarray(corners).reshape(-1, 9)


def _longest(problem: IKProblem) -> float:
    """An upper bound in metres on the distances that occur."""
    robot = problem.robot
    base = robot.T_world_base.position
    reach = float(
        np.linalg.norm(robot.joint_xyz, axis=1).sum() + np.linalg.norm(robot.tool().T_link_tool.position)
    )
    lengths = [reach, float(np.linalg.norm(problem.target.position)), float(np.linalg.norm(base))]
    for piece in problem.obstacles if problem.cover is not None else ():
        size = piece.size.max(initial=0.0) + (0.0 if piece.vertices is None else np.abs(piece.vertices).max())
        lengths.append(float(np.linalg.norm(piece.pose.position) + size))
    if problem.cover is not None and len(problem.cover):
        lengths.append(float(np.abs(problem.cover.centre).max() + problem.cover.radius.max()))
    return max(lengths)
