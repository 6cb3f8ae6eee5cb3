"""Which sphere of a robot can ever be inside which cuboid: a table for a cell, computed once, stored, read back.

A pair is dropped only by proof: the joint box of the first joints is cut into cells, and in each of them the sphere's
centre stays in a ball (chain lengths bound how far each joint can move it, and how far the remaining joints can carry
it). If none of the balls meets the cuboid shrunk by the sphere's radius, the sphere is never inside.
"""

from __future__ import annotations

import hashlib
import io
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from workcell.errors import InputError, OutputError
from workcell.geometry.types import FreeSpace, SphereCover
from workcell.identity_cache import ByIdentity
from workcell.model.robot import LIMIT_SLACK, Robot
from workcell.pose import Array

_CELLS = 4096
"""Cells that the first joints' ranges are cut into, at most."""
_JOINTS = 3
_ROUNDING = 1e-9
_known = ByIdentity()
"""Whether tables are of the robot and cover that they were asked about."""


def admissible_pairs(robot: Robot, cover: SphereCover, free_space: FreeSpace) -> NDArray[np.bool_]:
    """(m, k) False where sphere j is never wholly inside cuboid i, whatever the joints within their limits; proved.

    Args:
        robot: kinematic tree.
        cover: m spheres in its link frames; those of link 0 don't move.
        free_space: k cuboids in the world frame.
    """
    robot = robot.uncoupled
    table = np.zeros((len(cover), len(free_space)), dtype=bool)
    lower, upper = free_space.lower, free_space.upper
    for link in np.unique(cover.link):
        chain = _joints_to(robot, int(link))
        turned, rest = chain[:_JOINTS], chain[_JOINTS:]
        q, half = _cells(robot, turned)
        T = robot.link_transforms(q)
        carrier = turned[-1] + 1 if turned else 0
        for j in np.flatnonzero(cover.link == link):
            centre, stray = _ball(robot, T, carrier, turned, rest, half, cover.centre[j])
            low, high = lower + cover.radius[j], upper - cover.radius[j]
            fits = np.all(low <= high, axis=1)
            outside = np.maximum(np.maximum(low - centre[:, None], centre[:, None] - high), 0.0)
            table[j] = fits & (np.linalg.norm(outside, axis=2) <= stray + _ROUNDING).any(axis=0)
    return table


def _joints_to(robot: Robot, link: int) -> list[int]:
    """The joints from the base to a link, in order."""
    joints: list[int] = []
    while link > 0:
        joints.append(link - 1)
        link = int(robot.parents[link - 1])
    return joints[::-1]


def _cells(robot: Robot, joints: list[int]) -> tuple[Array, Array]:
    """Middles (c, n) of a grid over the ranges of some joints, and the cells' half widths (n,), slack included."""
    middle = 0.5 * (robot.lower + robot.upper)
    half = np.zeros(robot.dof)
    if not joints:
        return middle[None], half
    each = max(int(_CELLS ** (1 / len(joints))), 1)
    axes = []
    for joint in joints:
        cell = 0.5 * (robot.upper[joint] - robot.lower[joint]) / each
        axes.append(robot.lower[joint] + cell * (2 * np.arange(each) + 1))
        half[joint] = cell + LIMIT_SLACK
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(joints))
    q = np.tile(middle, (len(grid), 1))
    q[:, joints] = grid
    return q, half


def _ball(
    robot: Robot, T: Array, carrier: int, turned: list[int], rest: list[int], half: Array, centre: Array
) -> tuple[Array, float]:
    """Centres (c, 3) and the radius of balls that hold the sphere's centre while the joints stay in their cells."""
    travel = robot.prismatic * (np.maximum(np.abs(robot.lower), np.abs(robot.upper)) + LIMIT_SLACK)
    if rest:
        point = robot.joint_xyz[rest[0]]
        beyond = float(np.linalg.norm(centre)) + float(travel[rest].sum())
        beyond += float(np.linalg.norm(robot.joint_xyz[rest[1:]], axis=1).sum())
    else:
        point, beyond = centre, 0.0
    arm, stray = float(np.linalg.norm(point)), beyond
    for joint in reversed(turned):
        moved = half[joint] if robot.prismatic[joint] else 2 * np.sin(min(half[joint], np.pi) / 2) * arm
        stray += float(moved)
        arm += float(np.linalg.norm(robot.joint_xyz[joint])) + float(travel[joint])
    return T[:, carrier, :3, :3] @ point + T[:, carrier, :3, 3], stray


def with_table(robot: Robot, cover: SphereCover, free_space: FreeSpace) -> FreeSpace:
    """The same free space with its table, which the convex planners then start from."""
    return _with(admissible_pairs(robot, cover, free_space), robot, cover, free_space)


def _with(table: NDArray[np.bool_], robot: Robot, cover: SphereCover, free_space: FreeSpace) -> FreeSpace:
    return replace(free_space, admissible=table, table_key=_key(robot, cover, free_space))


def check_table(robot: Robot, cover: SphereCover, free_space: FreeSpace, where: str = "free_space") -> None:
    """Refuses a table of another robot, cover or free space: it would rule out what is possible.

    Raises:
        InputError: the free space has a table, which is not of these.
    """
    if free_space.admissible is None:
        return
    if not _known.get(
        (robot, cover, free_space), lambda: free_space.table_key == _key(robot, cover, free_space)
    ):
        raise InputError(
            f"the free space's table of pairs is of another robot, cover or free space than this one of {len(cover)} "
            f"spheres and {len(free_space)} cuboids",
            where=f"{where}.admissible",
            remedy="make it for these (workcell.geometry.free_space.admissible.with_table)",
        )


def save_table(path: str | Path, robot: Robot, cover: SphereCover, free_space: FreeSpace) -> Path:
    """Write the table of a free space as `.npz`, with a hash of what it is true of.

    Raises:
        InputError: the free space has no table, or one of another robot or cover.
        OutputError: the file can't be written.
    """
    if free_space.admissible is None:
        raise InputError("this free space has no table", remedy="use with_table first")
    path, buffer = Path(path), io.BytesIO()
    check_table(robot, cover, free_space)
    key = np.frombuffer(free_space.table_key, dtype=np.uint8)
    np.savez_compressed(buffer, key=key, admissible=np.packbits(free_space.admissible))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(buffer.getvalue())
    except OSError as error:
        raise OutputError(f"the table can't be written: {error.strerror}", where=path) from None
    return path


def load_table(path: str | Path, robot: Robot, cover: SphereCover, free_space: FreeSpace) -> FreeSpace:
    """The free space with the table of a file.

    Raises:
        InputError: the file can't be read, is damaged, or is the table of another robot, cover or free space.
    """
    remedy = "make it again with `workcell decompose --table`"
    try:
        with np.load(Path(path), allow_pickle=False) as stored:
            key, bits = bytes(stored["key"]), np.asarray(stored["admissible"], dtype=np.uint8)
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"this is not a readable table: {error}", where=path, remedy=remedy) from None
    count = len(cover) * len(free_space)
    if key != _key(robot, cover, free_space) or bits.shape != ((count + 7) // 8,):
        raise InputError("this table is of another robot, cover or free space", where=path, remedy=remedy)
    table = np.unpackbits(bits, count=count).astype(bool).reshape(len(cover), len(free_space))
    return _with(table, robot, cover, free_space)


def _key(robot: Robot, cover: SphereCover, free_space: FreeSpace) -> bytes:
    sha, robot = hashlib.sha256(b"workcell pairs 2"), robot.uncoupled
    base = robot.T_world_base
    for array in (
        *(robot.parents, robot.joint_xyz, robot.joint_rotation, robot.axis, robot.prismatic),
        *(robot.lower, robot.upper, base.position, base.quat_wxyz),
        *(cover.link, cover.centre, cover.radius, free_space.lower, free_space.upper),
    ):
        data = np.ascontiguousarray(array)
        sha.update(repr((data.shape, str(data.dtype))).encode())
        sha.update(data.tobytes())
    return sha.digest()
