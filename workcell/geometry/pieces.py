"""MuJoCo geoms as convex pieces: what collides, where it is, and with which exact shape."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from workcell.errors import ModelError
from workcell.geometry.types import Piece, PieceKind
from workcell.model.judge.solids import hull_vertices
from workcell.model.labels import body_name, geom_name, obstacle_label
from workcell.model.loading.compiled import link_bodies
from workcell.model.loading.couplings import locked_values
from workcell.model.loading.labels import shape_name
from workcell.model.mechanism.placing import place
from workcell.model.scene_parts import data_at
from workcell.pose import Array, Pose

if TYPE_CHECKING:
    import mujoco

    from workcell.model.mechanism.mechanism import Mechanism
    from workcell.model.robot import Robot
    from workcell.model.scene import Scene
    from workcell.model.scene_parts import SceneRobot

MAX_PRISMS = 20_000
"""Triangular prisms that one height field may turn into."""

_FLATNESS = 1e-7
"""Metres: a hull thinner than this in some direction has no inside."""


def pieces_of_bodies(
    model: mujoco.MjModel, body_ids: Iterable[int], qpos: ArrayLike | None = None
) -> tuple[Piece, ...]:
    """Every geom of these bodies that can collide, as convex pieces in the world frame.

    A mesh is its convex hull, as MuJoCo collides it; a plane is the half-space behind it, without edges; a height
    field becomes triangular prisms down to its base. Geoms with neither contype nor conaffinity, nor a `<pair>`, are
    left out: they are for the eye.

    Args:
        model: compiled model.
        body_ids: bodies to look at.
        qpos: (nq,) raw positions; None: the model's `qpos0`.

    Raises:
        ModelError: a geom of a kind that has no convex form here, or a mesh without volume; `where` names the geom.
    """
    data = data_at(model, model.qpos0 if qpos is None else qpos)
    wanted, paired = set(body_ids), {*map(int, model.pair_geom1), *map(int, model.pair_geom2)}
    pieces: list[Piece] = []
    for geom in range(model.ngeom):
        if int(model.geom_bodyid[geom]) not in wanted:
            continue
        if model.geom_contype[geom] or model.geom_conaffinity[geom] or geom in paired:
            pose = Pose.from_rotation(data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3))
            pieces += _geom_pieces(model, geom, pose)
    return tuple(pieces)


def scene_obstacles(
    scene: Scene,
    robot: str | None = None,
    *,
    exclude_objects: Collection[str] = (),
    qpos: ArrayLike | None = None,
) -> tuple[Piece, ...]:
    """Everything that the robot may hit, in the world frame: all that collides and is not the robot.

    Other robots and objects stand where `qpos` has them. Geoms that no geom of the robot can touch, by MuJoCo's bit
    masks, are left out.

    Args:
        scene: the scene.
        robot: the robot's name; None: the only one.
        exclude_objects: objects (by name) that don't count, such as the one to be grasped.
        qpos: (nq,) raw positions; None: the scene's initial ones.

    Raises:
        ModelError: as `pieces_of_bodies`; UnknownNameError: an unknown robot or object.
    """
    model, actor = scene.model, scene.robot(robot)
    if model.nflex:
        raise ModelError("deformable bodies (flex) are not supported as obstacles", where=model.flex(0).name)
    skipped = set(actor.body_ids)
    for name in exclude_objects:
        skipped |= scene.object(name).body_ids
    touchable = _touchable_bodies(model, actor.body_ids)
    bodies = [body for body in range(model.nbody) if body not in skipped and body in touchable]
    return pieces_of_bodies(model, bodies, scene.initial_qpos() if qpos is None else qpos)


def robot_pieces(
    model: mujoco.MjModel, robot: SceneRobot, qpos: ArrayLike | None = None
) -> tuple[tuple[Piece, ...], ...]:
    """The robot's colliding geometry, for each link (base first) in that link's frame.

    Joints that are not planned for (a gripper's fingers, those of a robot on its flange) stand where `qpos` has them;
    None: at their home, or where the scene begins.
    """
    positions = np.array(model.qpos0 if qpos is None else qpos, dtype=float)
    if qpos is None:
        for address, value in (*robot.riders, *robot.fingers):
            positions[address] = value
        robot.place(positions, robot.start)
    q = positions[robot.qpos_addresses]
    robot.place(positions, q)
    here = robot.standing(model, positions).robot
    return _link_pieces(model, here, robot.link_body_ids, positions, q)


def model_pieces(model: mujoco.MjModel, robot: Robot) -> tuple[tuple[Piece, ...], ...]:
    """The same for a robot file that was compiled by itself (`workcell.model.loading.load.load_compiled`)."""
    positions = np.array(model.qpos0)
    for joint, value in locked_values(model).items():
        positions[model.jnt_qposadr[joint]] = value
    q = positions[[int(model.joint(name).qposadr[0]) for name in robot.joint_names]]
    positions[[int(model.joint(name).qposadr[0]) for name in robot.all_joint_names]] = robot.joint_values(q)
    return _link_pieces(model, robot, link_bodies(model, robot), positions, q)


def mechanism_pieces(
    mechanism: Mechanism, geoms: Collection[int] | None = None
) -> tuple[tuple[Piece, ...], ...]:
    """A mechanism's colliding geometry, for each link in that link's frame; of the world what stands there.

    Args:
        mechanism: with its compiled model.
        geoms: ids of those that count; None: all that can collide.

    Raises:
        ModelError: it has no compiled model, or as `pieces_of_bodies`.
    """
    compiled = mechanism.compiled
    if compiled is None:
        raise ModelError("there is no compiled model that has its geometry", where=mechanism.name)
    placed, qpos, links = place(mechanism, mechanism.home), compiled.qpos(mechanism.home), []
    for link in range(mechanism.link_count):
        bodies = np.flatnonzero(compiled.link_of_body == link).tolist()
        world = pieces_of_bodies(compiled.model, bodies, qpos)
        T_link_world = Pose.from_rotation(placed.p[link], placed.R[link]).inverse()
        kept = [piece for piece in world if geoms is None or piece.geom in geoms]
        links.append(tuple(_rounded(move_piece(piece, T_link_world)) for piece in kept))
    return tuple(links)


def move_piece(piece: Piece, pose: Pose) -> Piece:
    """The piece seen from another frame: `pose` is that of the piece's present frame in the new one."""
    return replace(piece, pose=pose @ piece.pose)


def _link_pieces(
    model: mujoco.MjModel,
    robot: Robot,
    bodies_of_links: Iterable[Iterable[int]],
    qpos: Array,
    q: Array,
) -> tuple[tuple[Piece, ...], ...]:
    links = []
    for T_world_link, bodies in zip(robot.link_transforms(q), bodies_of_links, strict=True):
        T_link_world = Pose.from_matrix(T_world_link).inverse()
        world = pieces_of_bodies(model, bodies, qpos)
        links.append(tuple(_rounded(move_piece(piece, T_link_world)) for piece in world))
    return tuple(links)


def _rounded(piece: Piece) -> Piece:
    """The piece without the rounding errors of its way through the world: links of one kind are alike bit by bit."""
    pose = Pose(np.round(piece.pose.position, 12) + 0.0, np.round(piece.pose.quat_wxyz, 12) + 0.0)
    return replace(piece, pose=pose)


def _touchable_bodies(model: mujoco.MjModel, robot_bodies: Collection[int]) -> set[int]:
    """Bodies with a geom that some geom of the robot may collide with."""
    body_of = model.geom_bodyid
    own = np.isin(body_of, list(robot_bodies))
    contype = np.bitwise_or.reduce(model.geom_contype[own], initial=0)
    conaffinity = np.bitwise_or.reduce(model.geom_conaffinity[own], initial=0)
    meets = (model.geom_contype & conaffinity) | (model.geom_conaffinity & contype)
    paired = {int(body_of[g]) for g in (*model.pair_geom1, *model.pair_geom2)}
    return {int(body) for body in body_of[meets != 0]} | paired


def _geom_pieces(model: mujoco.MjModel, geom: int, pose: Pose) -> list[Piece]:
    """One geom as pieces, which know what they are part of; raises ModelError for what is not supported."""
    whole = obstacle_label(model, geom)
    return [replace(piece, geom=geom, part_of=whole) for piece in _solids(model, geom, pose)]


def _solids(model: mujoco.MjModel, geom: int, pose: Pose) -> list[Piece]:
    import mujoco

    name = geom_name(model, geom)
    body = body_name(model, int(model.geom_bodyid[geom]))
    kind = mujoco.mjtGeom(int(model.geom_type[geom]))
    size = np.array(model.geom_size[geom])
    primitives: dict[mujoco.mjtGeom, tuple[PieceKind, int]] = {
        mujoco.mjtGeom.mjGEOM_BOX: ("box", 3),
        mujoco.mjtGeom.mjGEOM_SPHERE: ("sphere", 1),
        mujoco.mjtGeom.mjGEOM_CAPSULE: ("capsule", 2),
        mujoco.mjtGeom.mjGEOM_CYLINDER: ("cylinder", 2),
        mujoco.mjtGeom.mjGEOM_ELLIPSOID: ("ellipsoid", 3),
        mujoco.mjtGeom.mjGEOM_PLANE: ("halfspace", 0),
    }
    if kind in primitives:
        shape, count = primitives[kind]
        return [Piece(name, shape, pose, size[:count], body=body)]
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        return [hull_piece(name, hull_vertices(model, int(model.geom_dataid[geom])), pose, body=body)]
    if kind == mujoco.mjtGeom.mjGEOM_HFIELD:
        return _height_field(model, geom, pose, name, body)
    raise ModelError(
        f"a geom of type {shape_name(kind)} has no convex form here",
        where=name,
        remedy="use box, sphere, capsule, cylinder, ellipsoid, plane, mesh or hfield",
    )


def hull_piece(name: str, vertices: ArrayLike, pose: Pose | None = None, *, body: str = "") -> Piece:
    """The convex hull of points (k, 3) as a piece that keeps the hull's own vertices only.

    Raises:
        ModelError: vertices that are not finite, or that have no volume.
    """
    from scipy.spatial import ConvexHull, QhullError

    points = np.asarray(vertices, dtype=float).reshape(-1, 3)
    if len(points) == 0:
        raise ModelError("the mesh is empty", where=name, remedy="give it at least four vertices")
    if not np.all(np.isfinite(points)):
        raise ModelError("the mesh has vertices that are not finite", where=name, remedy="mend the mesh file")
    spread = points - points.mean(axis=0)
    thickness = np.ptp(spread @ np.linalg.svd(spread, full_matrices=False)[2].T, axis=0).min()
    try:
        if len(points) < 4 or thickness < _FLATNESS:
            raise QhullError
        hull = ConvexHull(points)
    except QhullError:
        raise ModelError(
            f"the hull of the mesh is flat: {len(points)} vertices, {1e3 * thickness:.3g} mm thick",
            where=name,
            remedy="give the mesh a thickness, or use a thin box",
        ) from None
    pose = Pose.identity() if pose is None else pose
    return Piece(name, "hull", pose, np.zeros(0), points[np.sort(hull.vertices)], body)


def _height_field(model: mujoco.MjModel, geom: int, pose: Pose, name: str, body: str) -> list[Piece]:
    """Two triangular prisms a cell, from the surface down to the base, as MuJoCo collides it."""
    field = int(model.geom_dataid[geom])
    rows, columns = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
    if 2 * (rows - 1) * (columns - 1) > MAX_PRISMS:
        raise ModelError(
            f"the height field has {rows} x {columns} points, more than {MAX_PRISMS} prisms",
            where=name,
            remedy="use a coarser height field",
        )
    half_x, half_y, top, base = (float(v) for v in model.hfield_size[field])
    first = int(model.hfield_adr[field])
    height = np.array(model.hfield_data[first : first + rows * columns], dtype=float).reshape(rows, columns)
    x = np.linspace(-half_x, half_x, columns)
    y = np.linspace(-half_y, half_y, rows)
    surface = np.stack([*np.meshgrid(x, y), top * height], axis=-1)
    prisms = []
    for row in range(rows - 1):
        for column in range(columns - 1):
            corner = surface[row : row + 2, column : column + 2]
            for half, triangle in enumerate(
                (corner[[0, 0, 1], [0, 1, 1]], corner[[0, 1, 1], [0, 0, 1]]),
            ):
                floor = np.column_stack([triangle[:, :2], np.full(3, -base)])
                label = f"{name}[{row},{column},{half}]"
                prisms.append(hull_piece(label, np.vstack([triangle, floor]), pose, body=body))
    return prisms
