"""`Stage`: the things in a recording, placed as they were at any time, ready to be drawn."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from workcell.pose import Array, Pose, from_xyzw
from workcell.record.read.cuboids import LinkUse, link_uses
from workcell.record.read.paths import above, names_of
from workcell.record.read.reader import Contents, Entity
from workcell.record.render.raster import Surface
from workcell.record.render.shade import Line
from workcell.record.render.tessellate import Triangles, tessellate
from workcell.record.shapes import Shape, ShapeKind
from workcell.record.write.live_log import TARGETS

_TRANSLATION, _QUATERNION = "Transform3D:translation", "Transform3D:quaternion"
_PARENT_FRAME, _FRAME, _TF = "Transform3D:parent_frame", "CoordinateFrame:frame", "tf#/"
_STRIPS = "LineStrips3D:strips"
_DEEPEST = 100
_DEFAULT_RGBA = np.array([0.6, 0.6, 0.6, 1.0])
_AXIS_M = 0.08
_AXES_RGB = ((0.85, 0.10, 0.10), (0.10, 0.60, 0.10), (0.10, 0.20, 0.85))
PLAN_RGB, TRACE_RGB = (0.10, 0.40, 0.95), (0.95, 0.45, 0.0)


@dataclass(frozen=True, slots=True)
class Motion:
    """Poses of an entity in its parent: times (T,), positions (T, 3), quaternions wxyz (T, 4)."""

    times: Array
    positions: Array
    quats: Array

    def at(self, time: float) -> Pose:
        """The last pose at or before a time; the first one before all."""
        k = max(int(np.searchsorted(self.times, time + 1e-9, side="right")) - 1, 0)
        return Pose(self.positions[k], self.quats[k])


@dataclass(frozen=True, slots=True)
class Thing:
    """An entity with shapes: triangles and colour of each in the entity's frame (its own pose included if static)."""

    path: str
    kind: str
    owner: str
    parts: tuple[tuple[Triangles, Array], ...]


@dataclass(slots=True)
class Stage:
    """Everything drawable in a recording.

    Attributes:
        things: solids; `kind` is robots, objects, obstacles, spheres, obstacle_spheres, free_space or why.
        motions: by entity path, of all that has a transform.
        plans, traces: by robot, or by mechanism and frame: planned points (k, 3); executed (times (T,), points (T, 3)).
        goals: pose by name.
        uses: which cuboids the links are in.
        targets: by robot, the goals that its tool followed live.
        carriers: by entity path, the entity it is fixed to where that is not the one above it in the path.
    """

    things: list[Thing]
    motions: dict[str, Motion]
    plans: dict[str, Array]
    traces: dict[str, tuple[Array, Array]]
    goals: dict[str, Pose]
    carriers: dict[str, str]
    uses: tuple[LinkUse, ...] = ()
    targets: dict[str, Motion] = field(default_factory=dict)

    @staticmethod
    def of(contents: Contents) -> Stage:
        """The stage of a recording; what the recording lacks is absent."""
        world = contents.below("world")
        motions = {path: motion for path, entity in world.items() if (motion := _motion(entity)) is not None}
        things, plans, traces, goals = [], {}, {}, {}
        for path, entity in world.items():
            names = names_of(path)
            if (names[-1] == "plan" or names[3:4] == ["plans"]) and _STRIPS in entity.static:
                plans[_whose(names)] = np.asarray(entity.static[_STRIPS][0], dtype=float)
            elif (names[-1] == "trace" or names[3:4] == ["traces"]) and entity.has(_STRIPS):
                times, strips = entity.over_time(_STRIPS)
                traces[_whose(names)] = (times, np.array([strip[0][-1] for strip in strips], dtype=float))
            elif names[1:2] == ["goals"] and path in motions:
                goals[names[2]] = motions[path].at(0.0)
            elif (kind := _kind(names)) and (shapes := _shapes(entity)):
                parts = tuple((tessellate(shape), shape.rgba) for shape in shapes)
                things.append(Thing(path, kind, names[2], parts))
        carriers = {
            path: carrier for path, entity in world.items() if (carrier := _carrier(entity)) is not None
        }
        targets = {
            names[2]: motion
            for path, motion in motions.items()
            if (names := names_of(path))[1:2] == [TARGETS]
        }
        return Stage(things, motions, plans, traces, goals, carriers, link_uses(contents), targets)

    @property
    def times(self) -> Array:
        """All times at which something has a pose, in order."""
        times = [motion.times for motion in self.motions.values() if len(motion.times) > 1]
        return np.unique(np.concatenate(times)) if times else np.zeros(1)

    def _chain(self, path: str) -> list[str]:
        """The entities whose transforms place an entity, outermost first."""
        chain: list[str] = []
        while path and len(chain) < _DEEPEST:
            chain.append(path)
            path = self.carriers.get(path, above(path))
        return chain[::-1]

    def moves(self, path: str) -> bool:
        """Whether an entity, or one that carries it, moves."""
        return any(len(self.motions[p].times) > 1 for p in self._chain(path) if p in self.motions)

    def pose(self, path: str, time: float) -> Pose:
        """World pose of an entity at a time."""
        pose = Pose.identity()
        for carrier in self._chain(path):
            if carrier in self.motions:
                pose = pose @ self.motions[carrier].at(time)
        return pose

    def surfaces(self, time: float, kinds: tuple[str, ...], moving: bool | None = None) -> list[Surface]:
        """Triangles in the world; `moving` keeps only what moves, or only what does not."""
        found = []
        owners = {owner: k for k, owner in enumerate(sorted({(t.kind, t.owner) for t in self.things}))}
        for index, thing in enumerate(self.things):
            if thing.kind not in kinds or (moving is not None and self.moves(thing.path) != moving):
                continue
            pose = self.pose(thing.path, time)
            # every robot link and board has its own outline; the parts of an object share one
            ident = owners[(thing.kind, thing.owner)] if thing.kind != "robots" else len(owners) + index
            found += [
                Surface(mesh.moved(pose.rotation, pose.position), rgba, ident) for mesh, rgba in thing.parts
            ]
        return found

    def lines(self, time: float) -> list[Line]:
        """The plan, what of it has been executed, and goals that are followed: their way, and their axes now."""
        lines = [Line(points, PLAN_RGB, 1.6) for points in self.plans.values() if len(points) > 1]
        for times, points in self.traces.values():
            done = points[times <= time + 1e-9]
            if len(done) > 1:
                lines.append(Line(done, TRACE_RGB, 2.6))
        for target in self.targets.values():
            lines += _target_lines(target, time)
        return lines

    def object_paths(self) -> dict[str, str]:
        """For each object, the entity that carries it."""
        paths: dict[str, str] = {}
        for path in self.motions:
            names = names_of(path)
            if names[1:2] == ["objects"] and len(names) == 5 and names[3] == "visual":
                paths.setdefault(names[2], path)
        return paths


def _target_lines(target: Motion, time: float) -> list[Line]:
    """Where a goal that moves was told to be until now, and its axes."""
    known = target.times <= time + 1e-9
    if not known.any():
        return []
    pose, lines = target.at(time), []
    if known.sum() > 1:
        lines.append(Line(target.positions[known], PLAN_RGB, 1.6))
    for k in range(3):
        ends = np.stack([pose.position, pose.position + _AXIS_M * pose.rotation[:, k]])
        lines.append(Line(ends, _AXES_RGB[k], 2.6))
    return lines


def _whose(names: list[str]) -> str:
    """A robot's name, or a mechanism's with that of its frame."""
    return "/".join([names[2], *names[4:5]])


def _carrier(entity: Entity) -> str | None:
    frame = entity.static.get(_PARENT_FRAME, entity.static.get(_FRAME))
    return str(frame[0]).removeprefix(_TF) if frame and str(frame[0]).startswith(_TF) else None


def _kind(names: list[str]) -> str:
    if names[1:2] in (["obstacle_spheres"], ["why"]):
        return names[1]
    if len(names) < 3 or "collision" in names[3:4]:
        return ""
    if names[1] == "robots":
        return {"visual": "robots", "spheres": "spheres"}.get(names[3] if len(names) > 3 else "", "")
    return names[1] if names[1] in ("objects", "obstacles", "free_space") else ""


def _motion(entity: Entity) -> Motion | None:
    if entity.has(_TRANSLATION) and entity.has(_QUATERNION):
        times, positions = entity.numbers(_TRANSLATION)
        turned = entity.numbers(_QUATERNION)[1]
        count = min(len(positions), len(turned))
        return Motion(times[:count], positions[:count].astype(float), from_xyzw(turned[:count]))
    if _TRANSLATION in entity.static:
        position = np.asarray(entity.static[_TRANSLATION], dtype=float).reshape(1, 3)
        turned = entity.static.get(_QUATERNION, [[0.0, 0.0, 0.0, 1.0]])
        return Motion(np.zeros(1), position, from_xyzw(np.asarray(turned, dtype=float).reshape(1, 4)))
    return None


def _shapes(entity: Entity) -> list[Shape]:
    static = entity.static
    if "Mesh3D:vertex_positions" in static and "Mesh3D:triangle_indices" in static:
        normals = static.get("Mesh3D:vertex_normals")
        mesh = Shape(
            "",
            "mesh",
            np.ones(3),
            Pose.identity(),
            _colours(static, "Mesh3D:albedo_factor", 1)[0],
            np.asarray(static["Mesh3D:vertex_positions"], dtype=float),
            None if normals is None else np.asarray(normals, dtype=float),
            np.asarray(static["Mesh3D:triangle_indices"], dtype=np.int64),
        )
        return [mesh]
    solids: list[tuple[ShapeKind, str, str]] = [
        ("box", "Boxes3D", "half_sizes"),
        ("ellipsoid", "Ellipsoids3D", "half_sizes"),
        ("capsule", "Capsules3D", "lengths"),
        ("cylinder", "Cylinders3D", "lengths"),
    ]
    for kind, archetype, size in solids:
        if f"{archetype}:{size}" in static:
            return _solids(static, kind, archetype, size)
    return []


def _solids(static: dict[str, Array], kind: ShapeKind, archetype: str, size: str) -> list[Shape]:
    sizes = np.asarray(static[f"{archetype}:{size}"], dtype=float)
    if size == "lengths":
        radii = np.asarray(static[f"{archetype}:radii"], dtype=float)
        sizes = np.stack([radii, sizes / 2, np.zeros(len(sizes))], axis=1)
    places = static.get(f"{archetype}:centers", static.get(f"{archetype}:translations"))
    centres = np.zeros((len(sizes), 3)) if places is None else np.asarray(places, dtype=float).reshape(-1, 3)
    if kind == "capsule":
        centres = centres + np.stack([np.zeros(len(sizes)), np.zeros(len(sizes)), sizes[:, 1]], axis=1)
    colours = _colours(static, f"{archetype}:colors", len(sizes))
    shapes = []
    for extent, centre, colour in zip(sizes, centres, colours, strict=True):
        flat: ShapeKind = "plane" if kind == "box" and extent[2] == 0.0 else kind
        shapes.append(Shape("", flat, extent, Pose.from_xyz(centre), colour))
    return shapes


def _colours(static: dict[str, Array], component: str, count: int) -> Array:
    """Colours (count, 4) in [0, 1] from packed 0xRRGGBBAA integers."""
    if component not in static:
        return np.tile(_DEFAULT_RGBA, (count, 1))
    packed = np.asarray(static[component], dtype=np.uint32)
    colours = np.stack([(packed >> shift) & 0xFF for shift in (24, 16, 8, 0)], axis=1) / 255.0
    return np.resize(colours, (count, 4))
