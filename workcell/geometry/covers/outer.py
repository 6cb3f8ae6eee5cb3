"""Outer sphere covers: few spheres that hold all of the geometry, each sticking out of it by no more than asked.

A ball of radius r around a point whose signed distance to a convex piece is s sticks out of it by exactly `r + s`. So a
centre may have the radius `overshoot - s`, and the best cover is the smallest set of such balls that holds the pieces:
a greedy set cover over sample points, thinned and tightened, and then proved by subdivision
(`workcell.geometry.covers.proof`), which names the cells that samples have missed until none is left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from workcell.errors import InputError
from workcell.geometry.covers.by_count import by_count, sphere_budget
from workcell.geometry.covers.cache import cached_cover, content_key
from workcell.geometry.covers.greedy import cover_union
from workcell.geometry.covers.inner import inner_link_cover, inner_obstacle_cover
from workcell.geometry.covers.reach_ball import ReachBall, part_in_reach
from workcell.geometry.covers.subdivision import cover_by_cells, expected_count
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.pieces import model_pieces, move_piece, pieces_of_bodies, robot_pieces
from workcell.geometry.types import Piece, SphereCover
from workcell.model.scene_parts import body_pose
from workcell.pose import Array, Pose, read_only

if TYPE_CHECKING:
    import mujoco

    from workcell.model.robot import Robot
    from workcell.model.scene import Scene
    from workcell.model.scene_parts import SceneRobot

CoverKind = Literal["outer", "inner"]


def cover_pieces(pieces: Sequence[Piece], overshoot: float) -> tuple[Array, Array, Array]:
    """Spheres that hold the union of pieces that move together; a sphere may serve several of them.

    Args:
        pieces: bounded convex pieces, all in one frame.
        overshoot: metres that a sphere may stick out.

    Returns:
        centres (m, 3), radii (m,) and each sphere's measured overshoot (m,), in the pieces' frame.

    Raises:
        InputError: a half-space, or an overshoot that is not positive.
    """
    check_overshoot(overshoot)
    for piece in pieces:
        if piece.kind == "halfspace":
            raise InputError("no finite number of spheres covers a half-space", where=piece.name)
    if not pieces:
        return np.zeros((0, 3)), np.zeros(0), np.zeros(0)
    key = content_key(pieces, overshoot)
    if key not in _covers:
        _covers[key] = cached_cover(pieces, overshoot, lambda: _cover(pieces, overshoot))
    return _covers[key]


LEAST_OVERSHOOT = 5e-4
"""Metres: below, a robot takes more spheres than anything here can do with, and the proof's cells are as large."""


def check_overshoot(overshoot: float) -> None:
    """Raise InputError when an overshoot is not a number of metres, or too small for a cover to come to an end."""
    if not (np.isfinite(overshoot) and overshoot >= LEAST_OVERSHOOT):
        raise InputError(
            f"an overshoot of {overshoot} m makes no sense",
            where="overshoot",
            remedy=f"{LEAST_OVERSHOOT} or more, e.g. 0.02",
        )


_covers: dict[str, tuple[Array, Array, Array]] = {}
"""Covers already made or read, by content: a task asks for those of the same robot more than once."""

_LARGE, _LARGE_UNION = 300, 1000
"""Balls beyond which a piece is cut into cells, and a union covered piece by piece: the search pays on small things."""


def _cover(pieces: Sequence[Piece], overshoot: float) -> tuple[Array, Array, Array]:
    counts = [expected_count(piece, overshoot) for piece in pieces]
    pairs = list(zip(pieces, counts, strict=True))
    parts = [cover_by_cells(piece, overshoot) for piece, count in pairs if count > _LARGE]
    small = [piece for piece, count in pairs if count <= _LARGE]
    if sum(count for count in counts if count <= _LARGE) <= _LARGE_UNION:
        parts += [cover_union(small, overshoot)] if small else []
    else:
        parts += [cover_union([piece], overshoot) for piece in small]
    centres, radii = (np.concatenate(column) for column in zip(*parts, strict=True))
    return read_only(centres), read_only(radii), read_only(overshoots(pieces, centres, radii))


def overshoots(pieces: Sequence[Piece], centres: ArrayLike, radii: ArrayLike) -> Array:
    """How far each sphere, centres (m, 3) and radii (m,), sticks out of the piece that it suits best: (m,) metres."""
    depth = ObstacleArrays(pieces).nearest(centres)[0]
    measured: Array = np.maximum(np.asarray(radii, dtype=float) + depth, 0.0)
    return measured


def robot_cover(
    model: mujoco.MjModel,
    robot: SceneRobot,
    *,
    kind: CoverKind = "outer",
    overshoot: float = 0.02,
    count: int | str | None = None,
    share: float | None = None,
    qpos: ArrayLike | None = None,
    base: bool = False,
) -> SphereCover:
    """Cover of a scene's robot, gripper included, in link frames.

    Guaranteed of an outer cover: every point of a link lies in one of its spheres. Of an inner one: every sphere lies
    inside a piece of its link.

    Args:
        model: the scene's compiled model.
        robot: the robot.
        kind: `outer` or `inner`.
        overshoot: metres that an outer sphere may stick out of its link.
        count: spheres at most, or `low`, `mid`, `high` (5, 10, 22, or one a moving link where that is more). An outer
            cover then has the least overshoot that as many allow; what `base` adds is not counted.
        share: of the links' volume that an inner cover is to fill, as `inscribed_balls`.
        qpos: (nq,) where the joints that are not planned for stand; None: the gripper at its home.
        base: cover what no joint moves, too (a pedestal: it stands where it stands), as `obstacle_cover` does.

    Raises:
        InputError: an unknown kind, or a count, share or overshoot that makes no sense.
    """
    return _cover_links(robot_pieces(model, robot, qpos), kind, overshoot, count, share, base)


def model_cover(
    model: mujoco.MjModel,
    robot: Robot,
    *,
    kind: CoverKind = "outer",
    overshoot: float = 0.02,
    count: int | str | None = None,
    share: float | None = None,
    base: bool = False,
) -> SphereCover:
    """The same for a robot file that was compiled by itself (`workcell.model.loading.load.load_compiled`)."""
    return _cover_links(model_pieces(model, robot), kind, overshoot, count, share, base)


def attached_cover(
    scene: Scene,
    robot: SceneRobot,
    object_name: str,
    T_tool_object: Pose,
    *,
    overshoot: float = 0.02,
) -> SphereCover:
    """Outer cover of a carried object, in the frame of the link that carries the robot's default tool.

    Raises:
        UnknownNameError: no object of that name.
    """
    held, tool = scene.object(object_name), robot.robot.tool()
    # covered where its own frame is the world's: the same numbers, and the same cover, wherever it stands
    qpos = np.array(scene.model.qpos0)
    held.place(qpos, Pose.identity())
    T_object_world = body_pose(scene.model, held.body_id, qpos).inverse()
    pieces = pieces_of_bodies(scene.model, sorted(held.body_ids), qpos)
    cover = cover_of([move_piece(piece, T_object_world) for piece in pieces], overshoot, link=tool.link)
    return replace(cover, centre=(tool.T_link_tool @ T_tool_object).apply(cover.centre))


def obstacle_cover(
    pieces: Sequence[Piece],
    *,
    kind: CoverKind = "outer",
    overshoot: float = 0.02,
    count: int | None = None,
    share: float | None = None,
    reach: ReachBall | None = None,
) -> SphereCover:
    """Cover of what stands still, piece by piece; outer ones by cells: quickly made, with more balls than need be.

    Args:
        pieces: convex pieces in one frame.
        kind: `outer` or `inner`, which is `inner_obstacle_cover`.
        overshoot: metres that an outer sphere may stick out of its piece.
        count, share: of an inner cover, for each piece.
        reach: cover only what `part_in_reach` says of each piece; None: all of it, half-spaces left out (no finite
            cover holds them).
    """
    if kind == "inner":
        return inner_obstacle_cover(pieces, count=count, share=share, reach=reach)
    check_overshoot(overshoot)
    covers = []
    for piece in pieces:
        part = part_in_reach(piece, reach) if reach else piece if piece.kind != "halfspace" else None
        if part is None:
            continue
        centres, radii = cover_by_cells(part, overshoot, of=piece)
        link, names = np.zeros(len(radii), dtype=np.int64), (piece.name,) * len(radii)
        covers.append(SphereCover(link, centres, radii, "outer", overshoots([piece], centres, radii), names))
    return merge_covers(*covers)


def cover_of(pieces: Sequence[Piece], overshoot: float, *, link: int = 0) -> SphereCover:
    """Outer cover of pieces that move together, carried by one link."""
    centres, radii, measured = cover_pieces(pieces, overshoot)
    return SphereCover(np.full(len(radii), link), centres, radii, "outer", measured, sources(pieces, centres))


def sources(pieces: Sequence[Piece], centres: Array) -> tuple[str, ...]:
    """Name of the piece nearest to each centre (m, 3)."""
    if len(centres) == 0:
        return ()
    nearest = ObstacleArrays(pieces).nearest(centres)[2]
    return tuple(pieces[int(k)].name for k in nearest)


def merge_covers(*covers: SphereCover) -> SphereCover:
    """One cover out of several of the same robot and of the same kind.

    Raises:
        InputError: outer, inner or given spheres mixed, of which no proof could say what it is about.
    """
    parts = [cover for cover in covers if len(cover)]
    if not parts:
        return SphereCover(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros(0), "outer")
    kinds = {cover.kind for cover in parts}
    if len(kinds) > 1:
        raise InputError(
            f"{' and '.join(sorted(kinds))} spheres can't be merged",
            where="covers",
            remedy="covers of one kind",
        )
    return SphereCover(
        np.concatenate([cover.link for cover in parts]),
        np.concatenate([cover.centre for cover in parts]),
        np.concatenate([cover.radius for cover in parts]),
        kinds.pop(),
        np.concatenate([cover.overshoot for cover in parts if cover.overshoot is not None]),
        tuple(name for cover in parts for name in (cover.source or ("",) * len(cover))),
    )


def _cover_links(
    links: Sequence[Sequence[Piece]],
    kind: CoverKind,
    overshoot: float,
    count: int | str | None,
    share: float | None,
    base: bool,
) -> SphereCover:
    if kind not in get_args(CoverKind):
        raise InputError(f"unknown kind of cover {kind!r}", where="kind", remedy="outer or inner")
    if kind == "inner":
        budget = None if count is None else sphere_budget(count)
        filled = [p if index or base else () for index, p in enumerate(links)]
        return inner_link_cover(filled, count=budget, share=share)
    if share is not None:
        raise InputError("an outer cover has no share", where="share", remedy="give an overshoot or a count")
    standing = [obstacle_cover(links[0], overshoot=overshoot)] if base else []
    if count is None:
        return merge_covers(*standing, _cover_moving(links, overshoot))
    budget = sphere_budget(count, links[1:])
    return merge_covers(*standing, by_count(budget, lambda size: _cover_moving(links, size)))


def _cover_moving(links: Sequence[Sequence[Piece]], overshoot: float) -> SphereCover:
    return merge_covers(
        *(cover_of(pieces, overshoot, link=link) for link, pieces in enumerate(links) if link)
    )
