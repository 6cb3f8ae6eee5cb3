"""Finer spheres where the hand comes close: those that touch obstacles along a way are replaced by smaller ones.

Where the tool's link is at a tool pose is no choice. So a sphere of it that touches something there, though the hand
does not, leaves a planner nothing to choose from.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from workcell.geometry.covers.outer import cover_of, merge_covers, overshoots
from workcell.geometry.covers.subdivision import cover_by_cells, expected_count
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.pieces import move_piece, pieces_of_bodies, robot_pieces
from workcell.geometry.types import Piece, SphereCover
from workcell.model.robot import Robot
from workcell.model.scene import Scene
from workcell.model.scene_parts import SceneRobot, body_pose
from workcell.pose import Array, Pose

FINER = (0.01, 0.006, 0.004)
"""Metres by which finer spheres may stick out, one after the other, until none touches."""
_FEW, _MOST = 70, 1000
"""Spheres of a piece, about: up to so many they are searched for, and for more than `_MOST` it keeps those it has."""
_ROOM = 1e-3
"""Metres that a sphere should have around it: for the pose's tolerance, and a cuboid's gap."""


def fitting_cover(
    cover: SphereCover, pieces: Sequence[Piece], link: int, T_world_link: Array, obstacles: Sequence[Piece]
) -> SphereCover:
    """The cover with smaller spheres in place of those of one link that touch obstacles; itself if none does.

    It still holds all that it held: the smaller ones cover every piece that a replaced one meets, as far as that one
    reaches.

    Args:
        cover: outer spheres in link frames.
        pieces: all that is on the link, in its frame.
        link: its index.
        T_world_link: (k, 4, 4) where it will be; places where what it holds is in an obstacle don't count.
        obstacles: convex pieces in the world frame.
    """
    packed = ObstacleArrays(obstacles)
    T_world_link = T_world_link[_possible(_part(cover, cover.link == link), T_world_link, packed)]
    for overshoot in FINER:
        assert cover.overshoot is not None  # set by SphereCover
        touching = (cover.link == link) & (cover.overshoot > overshoot)
        touching[touching] = _touching(_part(cover, touching), T_world_link, packed)
        if not touching.any():
            break
        cover = _refined(cover, touching, pieces, link, overshoot)
    return cover


def hand_places(robot: Robot, way: Sequence[Pose]) -> Array:
    """(k, 4, 4) where the tool's link is at tool poses."""
    T_tool_link = robot.tool().T_link_tool.inverse()
    return np.array([(pose @ T_tool_link).matrix for pose in way]).reshape(-1, 4, 4)


def sphere_centres(centres: Array, T_world_link: Array) -> Array:
    """(k, m, 3) in the world, of centres (m, 3) in a link's frame, where the link is at (k, 4, 4)."""
    moved: Array = np.einsum("kij,mj->kmi", T_world_link[:, :3, :3], centres) + T_world_link[:, None, :3, 3]
    return moved


def hand_pieces(scene: Scene, robot: SceneRobot, attached: tuple[str, Pose] | None) -> tuple[Piece, ...]:
    """All that is on the tool's link, in its frame: hand, fingers, and an object (T_tool_object) that it holds."""
    tool = robot.robot.tool()
    pieces = robot_pieces(scene.model, robot)[tool.link]
    if attached is None:
        return pieces
    held, qpos = scene.object(attached[0]), np.array(scene.model.qpos0)
    held.place(qpos, Pose.identity())
    T_object_world = body_pose(scene.model, held.body_id, qpos).inverse()
    T_link_world = tool.T_link_tool @ attached[1] @ T_object_world
    carried = pieces_of_bodies(scene.model, sorted(held.body_ids), qpos)
    return (*pieces, *(move_piece(piece, T_link_world) for piece in carried))


def _possible(cover: SphereCover, T_world_link: Array, packed: ObstacleArrays) -> NDArray[np.bool_]:
    """(k,) in which places no sphere of a link, less its overshoot, is in an obstacle: in others no cover helps."""
    solid = cover.bare_radius > 0  # the others may be wholly beside what they cover
    centres = sphere_centres(cover.centre[solid], T_world_link)
    possible: NDArray[np.bool_] = np.all(packed.nearest(centres)[0] > cover.bare_radius[solid], axis=1)
    return possible


def _touching(cover: SphereCover, T_world_link: Array, packed: ObstacleArrays) -> NDArray[np.bool_]:
    """(m,) which spheres of one link have less than some room around them in one of its places."""
    room = packed.nearest(sphere_centres(cover.centre, T_world_link))[0] - cover.radius
    touching: NDArray[np.bool_] = np.any(room < _ROOM, axis=0)
    return touching


def _refined(
    cover: SphereCover, gone: NDArray[np.bool_], pieces: Sequence[Piece], link: int, overshoot: float
) -> SphereCover:
    """The cover without some spheres of a link, and with finer ones wherever those met a piece."""
    meets = cover.radius > ObstacleArrays(pieces).distances(cover.centre).T
    large = np.array([expected_count(piece, overshoot) > _MOST for piece in pieces])
    gone = gone & ~meets[large].any(axis=0)
    kept = _part(cover, ~gone)
    fellows = kept.link == link
    parts = [kept]
    for piece, met in zip(pieces, meets, strict=True):
        near = met[gone]
        if not near.any():
            continue
        fine = _fine(piece, overshoot, link)
        apart = np.linalg.norm(fine.centre[:, None] - cover.centre[gone][near], axis=2)
        needed = np.any(apart < fine.radius[:, None] + cover.radius[gone][near], axis=1)
        beside = np.linalg.norm(fine.centre[:, None] - kept.centre[fellows], axis=2)
        held = np.any(beside + fine.radius[:, None] <= kept.radius[fellows], axis=1)
        needed &= ~held  # those that stay hold it already
        parts.append(_part(fine, needed))
    return merge_covers(*parts)


def _fine(piece: Piece, overshoot: float, link: int) -> SphereCover:
    """Finer spheres of a whole piece; of a large one by cells, more of them, because the fewest take long to find."""
    # covered in its own frame: the same numbers, and the same cover, wherever the fingers are
    local = replace(piece, pose=Pose.identity())
    if expected_count(piece, overshoot) <= _FEW:
        cover = cover_of([local], overshoot, link=link)
    else:
        centres, radii = cover_by_cells(local, overshoot)
        of, measured = np.full(len(radii), link), overshoots([local], centres, radii)
        cover = SphereCover(of, centres, radii, "outer", measured, (piece.name,) * len(radii))
    return replace(cover, centre=piece.pose.apply(cover.centre))


def _part(cover: SphereCover, chosen: NDArray[np.bool_]) -> SphereCover:
    """Some spheres (m,) of a cover."""
    assert cover.overshoot is not None  # set by SphereCover
    return SphereCover(
        cover.link[chosen],
        cover.centre[chosen],
        cover.radius[chosen],
        cover.kind,
        cover.overshoot[chosen],
        tuple(name for name, its in zip(cover.source, chosen, strict=False) if its),
    )
